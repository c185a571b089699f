"""The simulator obeys the geometry it claims: density, surfaces, occlusion, exact truth."""

import csv
import dataclasses
import json
import math
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from ruamel.yaml import YAML
from unlidar.cli import main
from unlidar.configs import SCENARIO_DIR, scenario_names
from unlidar.frames_io import read_pcd
from unlidar.simulate import Scenario, Simulation, load_scenario, simulate
from unlidar.simulate.flight import make_path
from unlidar.simulate.recording import STRAY
from unlidar.simulate.scenario import Building, Drone, Flight, Scene, Sensor
from unlidar.simulate.sensors import MODELS, detection_probability, scan

BOX = ((-15.0, -12.0, 4.0), (15.0, 12.0, 14.0))
FLIGHT = Flight(box_m=BOX, max_speed_mps=6.0)
EMPTY = Scene(random_buildings=0, poles=0, trees=0)
NOISE_M = 6 * 0.02  # no range is off by more than this in any test


def scenario(**changes) -> Scenario:
    sensors = {"mid360": Sensor("mid360", stray_returns=0), "avia": Sensor("avia", stray_returns=0)}
    base = Scenario(sensors=sensors, drones=(Drone(FLIGHT),), duration_s=3.0)
    return dataclasses.replace(base, **changes)


def hovering(x: float, y: float, z: float, **changes) -> Drone:
    return Drone(Flight(waypoints=((0, x, y, z), (10, x, y, z))), **changes)


def contents(directory: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(directory)): path.read_bytes()
        for path in sorted(directory.rglob("*"))
        if path.is_file()
    }


def drone_returns(simulation: Simulation, sensor: str) -> tuple[np.ndarray, np.ndarray]:
    """Returns of the first drone in the station's frame and their times since the begin."""
    index = simulation.things.index(simulation.drones[0])
    origin = np.array(simulation.scenario.sensors[sensor].position_m)
    points, times = [np.zeros((0, 3))], [np.zeros(0)]
    for frame in simulation.frames(sensor):
        hit = frame.thing == index
        points.append(frame.xyz_m[hit] + origin)
        times.append((frame.begin_ns + frame.time_ns[hit]) * 1e-9)
    return np.concatenate(points), np.concatenate(times)


def rays_per_sr(name: str, place: tuple[float, float, float]) -> float:
    """Rays of a frame per steradian in the direction of a place, counted in 100 frames."""
    model = MODELS[name]
    towards = np.array(place) / np.linalg.norm(place)
    radius = math.radians(2)
    frames = [scan(model, index, (0.1, 0.7))[0] for index in range(100)]
    inside = sum((direction @ towards > math.cos(radius)).sum() for direction in frames)
    return inside / 100 / (2 * math.pi * (1 - math.cos(radius)))


@pytest.mark.parametrize("seed", range(8))
def test_a_random_flight_stays_in_its_box_below_its_speed_with_continuous_acceleration(seed):
    path = make_path(FLIGHT, 30.0, np.random.default_rng(seed))
    step_s = 1e-3
    positions = path(np.arange(0, 30, step_s))
    low, high = np.array(BOX)
    assert np.all(positions >= low)
    assert np.all(positions <= high)
    velocity = np.diff(positions, axis=0) / step_s
    assert np.linalg.norm(velocity, axis=1).max() <= 6.0 + 1e-6
    jerk = np.diff(velocity, n=2, axis=0) / step_s**2
    assert np.linalg.norm(jerk, axis=1).max() < 50.0  # a leap of 1 m/s^2 would show as 1000


@pytest.mark.parametrize("seed", range(8))
def test_a_random_flight_stays_in_a_box_smaller_than_its_steps(seed):
    flight = Flight(box_m=((-1.0, 2.0, 4.0), (1.0, 3.0, 4.0)), max_speed_mps=20.0)
    positions = make_path(flight, 30.0, np.random.default_rng(seed))(np.linspace(0, 30, 5000))
    low, high = np.array(flight.box_m)
    assert np.all(positions >= low - 1e-9)
    assert np.all(positions <= high + 1e-9)
    assert np.ptp(positions[:, 0]) > 0.1


@pytest.mark.parametrize("seed", range(8))
def test_a_flight_hovers_when_it_is_told_to_and_nowhere_leaps(seed):
    flight = dataclasses.replace(FLIGHT, turn_s=1.0, hover_s=((7.3, 11.9),))
    path = make_path(flight, 30.0, np.random.default_rng(seed))
    hover = path(np.linspace(7.3, 11.9, 100))
    assert np.ptp(hover, axis=0).max() < 1e-9
    velocity = np.diff(path(np.arange(0, 30, 1e-3)), axis=0) / 1e-3
    assert np.linalg.norm(velocity, axis=1).max() <= 6.0 + 1e-6


def test_waypoints_are_met_at_their_times():
    waypoints = ((0.0, 0.0, 0.0, 5.0), (2.0, 4.0, 1.0, 6.0), (5.0, -3.0, 2.0, 9.0))
    path = make_path(Flight(waypoints=waypoints), 8.0, np.random.default_rng(0))
    np.testing.assert_allclose(
        path(np.array([0.0, 2.0, 5.0])), np.array(waypoints)[:, 1:], atol=1e-12
    )


def test_returns_of_the_drone_lie_on_its_near_side_at_their_own_time():
    fast = Flight(box_m=((-8, -8, 4), (8, 8, 9)), max_speed_mps=15.0, turn_s=1.0)
    drone = Drone(fast, size_m=(1.6, 1.2, 0.6), reflectivity=0.9)
    simulation = Simulation(scenario(drones=(drone,), scene=EMPTY), 4)
    points, times = drone_returns(simulation, "mid360")
    assert len(points) > 200
    ray = points / np.linalg.norm(points, axis=1)[:, None]

    def outside(p: np.ndarray, at_s: np.ndarray) -> np.ndarray:
        centres = simulation.drones[0].centres(at_s)
        return (((p - centres) / (np.array(drone.size_m) / 2)) ** 2).sum(axis=1) - 1

    # On the surface but for range noise: a little nearer is outside, a little farther inside.
    assert np.all(outside(points - NOISE_M * ray, times) > 0)
    assert (outside(points + NOISE_M * ray, times) < 0).mean() > 0.9
    # With the time of its frame instead of its own a return would be off the body.
    off_surface = np.abs(outside(points, times)).mean()
    assert np.abs(outside(points, np.floor(times * 10) / 10)).mean() > 3 * off_surface


def test_returns_lie_on_the_first_surface_of_their_ray():
    buildings = (
        Building((12.0, 0.0), (4.0, 8.0, 6.0)),
        Building((20.0, 1.0), (6.0, 20.0, 12.0)),
        Building((-9.0, -9.0), (3.0, 3.0, 5.0), yaw_deg=30.0),
    )
    scene = dataclasses.replace(EMPTY, buildings=buildings)
    simulation = Simulation(scenario(scene=scene, drones=(), duration_s=0.5), 2)
    frame = next(simulation.frames("mid360"))
    assert set(np.unique(frame.thing)) == {0, 1, 2, 3}
    range_m = np.linalg.norm(frame.xyz_m, axis=1)
    ray = frame.xyz_m / range_m[:, None]
    # March along every ray in small steps: the first point below ground or in a box is the surface.
    step_m = 0.01
    for i in np.random.default_rng(0).choice(len(ray), 300, replace=False):
        way = ray[i] * np.arange(0, range_m[i] + 1, step_m)[:, None]
        solid = way[:, 2] < scene.ground_z_m
        for b in buildings:
            yaw = math.radians(b.yaw_deg)
            x, y = way[:, 0] - b.centre_m[0], way[:, 1] - b.centre_m[1]
            along, across = (
                x * math.cos(yaw) + y * math.sin(yaw),
                y * math.cos(yaw) - x * math.sin(yaw),
            )
            solid |= (
                (np.abs(along) < b.size_m[0] / 2)
                & (np.abs(across) < b.size_m[1] / 2)
                & (way[:, 2] < scene.ground_z_m + b.size_m[2])
            )
        first_m = np.argmax(solid) * step_m if solid.any() else np.inf
        assert range_m[i] == pytest.approx(first_m, abs=NOISE_M)


def test_a_drone_behind_a_wall_gives_no_return_and_is_not_in_view():
    wall = Building((10.0, 0.0), (1.0, 20.0, 12.0))
    drone = hovering(20.0, 0.0, 4.0, size_m=(2.0, 2.0, 1.0), reflectivity=1.0)
    free = Simulation(scenario(scene=EMPTY, drones=(drone,)), 1)
    hidden = Simulation(
        scenario(scene=dataclasses.replace(EMPTY, buildings=(wall,)), drones=(drone,)), 1
    )
    assert len(drone_returns(free, "mid360")[0]) > 100
    assert len(drone_returns(hidden, "mid360")[0]) == 0
    assert all(row.in_view for row in free.truth())
    assert not any(row.in_view for row in hidden.truth())


def test_a_crown_before_the_drone_lets_only_a_part_of_the_rays_through():
    simulation = Simulation(scenario(scene=dataclasses.replace(EMPTY, trees=40), drones=()), 3)
    crowns = [i for i, thing in enumerate(simulation.things) if thing.kind == "crown"]
    depths = []
    for frame in simulation.frames("mid360"):
        for i in crowns:
            crown = simulation.things[i]
            points = frame.xyz_m[frame.thing == i]
            unit = (points - crown.centre_m) / (crown.size_m / 2)
            depths.append((unit**2).sum(axis=1))
    depths = np.concatenate(depths)
    assert depths.max() < 1.2  # within the crown, but for noise
    assert (depths < 0.6).mean() > 0.2  # and also deep in it


def test_the_drone_gives_as_many_returns_as_its_solid_angle_holds_rays():
    for sensor, place in (("mid360", (6.0, 5.0, 4.0)), ("avia", (1.0, 0.5, 12.0))):
        drone = hovering(*place, size_m=(0.6, 0.6, 0.6), fill=0.5, reflectivity=1.0)
        simulation = Simulation(scenario(scene=EMPTY, drones=(drone,), duration_s=10.0), 7)
        r = math.hypot(*place)
        expected = 100 * rays_per_sr(sensor, place) * math.pi * 0.3**2 / r**2 * 0.5
        assert len(drone_returns(simulation, sensor)[0]) == pytest.approx(expected, rel=0.15)


def test_detection_falls_with_range_and_with_what_the_beam_meets():
    model = MODELS["mid360"]
    ranges = np.linspace(1, 120, 50)
    wide, narrow = (
        detection_probability(model, ranges, np.full(50, 0.2), np.full(50, w)) for w in (1.0, 0.1)
    )
    assert np.all(np.diff(wide) < 0)
    assert np.all(narrow <= wide)
    assert narrow[-1] < wide[-1]
    dark = detection_probability(model, ranges, np.full(50, 0.05), np.ones(50))
    assert np.all(dark < wide)
    at_reach = detection_probability(model, np.array([40.0]), np.array([0.1]), np.array([1.0]))
    assert at_reach[0] == pytest.approx(0.5)


def test_range_noise_is_two_centimetres_along_the_ray():
    wall = Building((8.0, 0.0), (1.0, 40.0, 30.0))
    scene = dataclasses.replace(EMPTY, buildings=(wall,))
    simulation = Simulation(scenario(scene=scene, drones=()), 1)
    frame = next(simulation.frames("mid360"))
    points = frame.xyz_m[(frame.thing == 1) & (frame.xyz_m[:, 0] > 6)]
    cosine = points[:, 0] / np.linalg.norm(points, axis=1)
    assert ((points[:, 0] - 7.5) / cosine).std() == pytest.approx(0.02, rel=0.1)


def test_frames_of_a_moved_sensor_are_in_its_own_place_and_clock():
    moved = Sensor("mid360", position_m=(3.0, -2.0, 1.0), time_offset_s=0.25, stray_returns=0)
    drone = hovering(5.0, 4.0, 6.0, reflectivity=1.0, size_m=(1.0, 1.0, 1.0))
    simulation = Simulation(scenario(sensors={"m": moved}, drones=(drone,), scene=EMPTY), 1)
    frames = list(simulation.frames("m"))
    assert frames[0].stamp_ns == 1_700_000_000_000_000_000 - 250_000_000
    points = np.concatenate([f.xyz_m[f.thing == 1] for f in frames])
    assert np.abs(points - np.array([2.0, 6.0, 5.0])).max() < 0.5 + NOISE_M


def test_stray_returns_have_the_rate_they_are_given():
    sensors = {"mid360": Sensor("mid360", stray_returns=40)}
    simulation = Simulation(scenario(sensors=sensors, duration_s=5.0), 1)
    mean = np.mean([(frame.thing == STRAY).sum() for frame in simulation.frames("mid360")])
    assert mean == pytest.approx(40, rel=0.1)


def test_truth_is_exact_in_its_box_and_fifty_times_a_second(tmp_path):
    simulate(scenario(drones=(Drone(FLIGHT), Drone(FLIGHT))), tmp_path / "out", 5)
    rows = list(csv.DictReader((tmp_path / "out/ground_truth.csv").open()))
    drones = Simulation(scenario(drones=(Drone(FLIGHT), Drone(FLIGHT))), 5).drones
    assert len(rows) == 2 * 150
    for row in rows:
        since = float(row["timestamp"]) - 1_700_000_000
        xyz = np.array([float(row[a]) for a in "xyz"])
        exact = drones[int(row["target"])].centres(np.array([since]))[0]
        np.testing.assert_allclose(xyz, exact, atol=1e-4)
        assert np.all(xyz >= np.array(BOX[0]) - 1e-6)
        assert np.all(xyz <= np.array(BOX[1]) + 1e-6)
    assert [row["timestamp"][-6:] for row in rows[:3]] == ["000000", "020000", "040000"]


def test_in_view_is_where_a_field_of_view_holds_the_drone():
    places = {(10.0, 0.0, 5.0): True, (0.5, 0.0, 20.0): True, (10.0, 0.0, -1.6): False}
    for place, expected in places.items():
        simulation = Simulation(scenario(drones=(hovering(*place),), scene=EMPTY), 1)
        assert {row.in_view for row in simulation.truth()} == {expected}, place
    only = {"mid360": Sensor("mid360")}
    overhead = scenario(sensors=only, drones=(hovering(0.5, 0.0, 20.0),), scene=EMPTY)
    assert not any(row.in_view for row in Simulation(overhead, 1).truth())


def test_the_same_seed_gives_the_same_bytes_and_another_seed_other_ones(tmp_path):
    short = scenario(duration_s=0.5, scene=Scene(walkers=2))
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        simulate(short, tmp_path / name, seed)
    a, b, c = (contents(tmp_path / name) for name in "abc")
    assert a == b
    assert a.keys() == c.keys()
    assert all(a[name] != c[name] for name in a if "mid360" in name)
    assert a["ground_truth.csv"] != c["ground_truth.csv"]


def test_one_sensors_frames_do_not_depend_on_what_else_is_simulated_after_it(tmp_path):
    simulate(scenario(duration_s=0.3), tmp_path / "short", 1)
    simulate(scenario(duration_s=0.6), tmp_path / "long", 1)
    short, long = contents(tmp_path / "short"), contents(tmp_path / "long")
    frames = [name for name in short if name.endswith(".pcd")]
    assert len(frames) == 6
    assert set(frames) < set(long)


def test_point_times_are_written_when_asked_for(tmp_path):
    simulate(scenario(duration_s=0.2, point_times=True), tmp_path / "with", 1)
    simulate(scenario(duration_s=0.2), tmp_path / "without", 1)
    for path in (tmp_path / "with/mid360").iterdir():
        fields = read_pcd(path)
        assert fields["t"].dtype == np.uint32
        assert np.all(np.diff(fields["t"].astype(np.int64)) >= 0)
        assert fields["t"].max() < 100_000_000
        assert "t" not in read_pcd(tmp_path / "without/mid360" / path.name)
        assert not (np.stack([fields[a] for a in "xyz"]) == 0).all(axis=0).any()


@pytest.mark.parametrize("name", ["demo", "empty_sky"])
def test_the_scenarios_that_come_along_are_as_they_say(name, tmp_path):
    loaded = load_scenario(name)
    simulation = Simulation(loaded, 1)
    truth = list(simulation.truth())
    if name == "empty_sky":
        assert truth == []
        assert "drone" not in {thing.kind for thing in simulation.things}
        return
    assert np.mean([row.in_view for row in truth]) > 0.5
    assert len(drone_returns(simulation, "mid360")[0]) > 50


def test_an_empty_sky_has_a_truth_without_rows(tmp_path):
    simulate(scenario(drones=(), duration_s=0.2), tmp_path / "out", 1)
    text = (tmp_path / "out/ground_truth.csv").read_text()
    assert text == "timestamp,target,x,y,z,in_view\n"


def test_the_command_writes_a_folder_that_says_how_it_was_made(tmp_path, fails):
    path = tmp_path / "mine.yaml"
    path.write_text("duration_s: 0.2\nsensors:\n  front: {model: mid360}\n")
    assert main(["simulate", str(path), str(tmp_path / "out"), "--seed", "9"]) == 0
    made = json.loads((tmp_path / "out/scenario.json").read_text())
    assert made["seed"] == 9
    assert made["frames"] == {"front": 2}
    assert made["scenario"]["sensors"]["front"]["model"] == "mid360"
    fails(5, "simulate", path, tmp_path / "out")
    assert main(["simulate", str(path), str(tmp_path / "out"), "--force"]) == 0


WRONG = {
    "sensors: {a: {model: hdl64}}": "sensors.a: model 'hdl64'",
    "sensors: {a: {model: mid360, colour: 1}}": "unknown key 'colour'",
    "sensors: {a: {}}": "'model' is missing",
    "sensors: {}": "at least one sensor",
    "duration: 3\nsensors: {a: {model: avia}}": "unknown key 'duration'",
    "duration_s: long\nsensors: {a: {model: avia}}": "duration_s: 'long', expected a number",
    "duration_s: .nan\nsensors: {a: {model: avia}}": "duration_s",
    "sensors: {a: {model: avia}}\ndrones: [{flight: {}}]": "drones[0].flight: needs either",
    "sensors: {a: {model: avia}}\ndrones: [{flight: {box_m: [[0, 0, 9], [1, 1, 8]]}}]": "box_m",
    "sensors: {a: {model: avia}}\nscene: {trees: 1.5}": "scene.trees: '1.5', expected a whole",
    "sensors: {a: {model: avia}}\nscene: {trees: -1}": "scene.trees: '-1', expected a number",
    "sensors: {../../evil: {model: avia}}": "sensors: '../../evil', expected a name",
    "sensors: {/tmp/evil: {model: avia}}": "sensors: '/tmp/evil', expected a name",
    "sensors: {'': {model: avia}}": "sensors: '', expected a name",
    "sensors: {ground_truth: {model: avia}}": "sensors: 'ground_truth', expected another name",
    'sensors: {"a\\e[31m": {model: avia}}': "sensors: 'a\\x1b[31m', expected a name",
    "sensors: {a: {model: avia}}\nstart_time_s: 2020-13-01": "cannot be read as YAML",
    "[" * 1000: "cannot be read as YAML",
    "- 1": "expected keys with values",
    "sensors: [": "cannot be read as YAML",
}


@pytest.mark.parametrize("text", WRONG)
def test_a_wrong_scenario_is_refused_by_key_and_value(text, tmp_path, fails):
    path = tmp_path / "wrong.yaml"
    path.write_text(text)
    line = fails(3, "simulate", path, tmp_path / "out")
    assert str(path) in line
    assert WRONG[text] in line
    assert not (tmp_path / "out").exists()


def test_the_schema_for_editors_says_what_is_checked_and_takes_every_scenario_that_comes_along():
    from unlidar.simulate import schema

    assert schema.SCHEMA.read_text() == schema.text(), "run python -m unlidar.simulate.schema"
    known = json.loads(schema.text())
    for name in scenario_names():
        path = SCENARIO_DIR / f"{name}.yaml"
        assert path.read_text().startswith("# yaml-language-server: $schema=schema.json\n")
        jsonschema.validate(YAML(typ="safe", pure=True).load(path.read_text()), known)
    for wrong in ({}, {"sensors": {"a": {"model": "hdl64"}}}, {"sensors": {}, "duration": 3}):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(wrong, known)


def test_an_unknown_scenario_name_is_a_usage_error_that_lists_the_known(tmp_path, fails):
    line = fails(2, "simulate", "nowhere", tmp_path / "out")
    assert "demo" in line
    assert "empty_sky" in line
    fails(3, "simulate", tmp_path / "absent.yaml", tmp_path / "out")
    fails(2, "simulate", "demo", tmp_path / "out", "--seed", "-1")


def test_a_sensor_named_like_a_way_out_writes_nothing_anywhere(tmp_path, fails):
    demo = (SCENARIO_DIR / "demo.yaml").read_text()
    path = tmp_path / "evil.yaml"
    path.write_text(demo.replace("  mid360:", "  ../../evil:", 1))
    assert "../../evil" in fails(3, "simulate", path, tmp_path / "a/b/out")
    assert sorted(tmp_path.iterdir()) == [path]
