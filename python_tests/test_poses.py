"""LiDARs that move: the simulator obeys their poses, and what their files hold."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from unlidar.errors import UsageError
from unlidar.pose_files import ALL, find_poses, poses_options
from unlidar.poses import Poses, write_poses
from unlidar.simulate import Scenario, Simulation, load_scenario, simulate
from unlidar.simulate.recording import TRUE_POSES_NAME
from unlidar.simulate.scenario import Building, Carrier, Drone, Flight, Scene, Sensor
from unlidar.simulate.sensors import MODELS, in_field_of_view

EMPTY = Scene(random_buildings=0, poles=0, trees=0)
NOISE_M = 6 * 0.02  # no range is off by more than this in any test
YARD = dataclasses.replace(
    EMPTY,
    buildings=(
        Building((18.0, 0.0), (4.0, 40.0, 9.0)),
        Building((-14.0, 3.0), (4.0, 30.0, 9.0), 20.0),
        Building((0.0, 16.0), (40.0, 4.0, 9.0)),
    ),
)
# Every motion by itself, and all at once.
CARRIERS = {
    "gimbal": Carrier(pan_dps=30.0),
    "vehicle": Carrier(start_m=(-8.0, 1.0, 0.0), velocity_mps=(10.0, 0.0, 0.0)),
    "drone": Carrier(start_m=(0.0, 0.0, 6.0), drift_m=1.0, sway_deg=5.0),
    "mast": Carrier(sway_deg=1.0, mast_m=6.0),
    "all": Carrier((1.0, -2.0, 1.0), (2.0, -1.0, 0.5), -40.0, 0.5, 4.0, 0.5, 3.0),
}
PLACE = (0.3, -0.2, 0.4)  # of the sensor on its carrier


def moving(carrier: Carrier | None, **changes) -> Scenario:
    base = Scenario(
        sensors={"top": Sensor("mid360", position_m=PLACE, stray_returns=0)},
        scene=YARD,
        duration_s=1.5,
        point_times=True,
        carrier=carrier,
    )
    return dataclasses.replace(base, **changes)


def read_tum(path: Path) -> Poses:
    """Read independently of the program."""
    lines = [line.split() for line in path.read_text().splitlines() if not line.startswith("#")]
    stamps = [
        int(seconds) * 10**9 + int(rest) for seconds, rest in (w[0].split(".") for w in lines)
    ]
    values = np.array([[float(v) for v in words[1:]] for words in lines])
    return Poses(np.array(stamps), values[:, :3], Rotation.from_quat(values[:, 3:]))


def outside_m(building: Building, scene: Scene, places_m: np.ndarray) -> np.ndarray:
    """Signed distance from the surface of a building, (N,)."""
    size = np.array(building.size_m)
    centre = np.array([*building.centre_m, scene.ground_z_m + size[2] / 2])
    turned = Rotation.from_euler("z", building.yaw_deg, degrees=True).inv()
    away = np.abs(turned.apply(places_m - centre)) - size / 2
    beyond = np.linalg.norm(np.maximum(away, 0), axis=1)
    return beyond + np.minimum(away.max(axis=1), 0)


@pytest.mark.parametrize("name", CARRIERS)
def test_exact_poses_put_the_returns_back_on_what_stands_still(name):
    """Each return by the pose at its own time lies on the ground or a wall, whatever moves."""
    simulation = Simulation(moving(CARRIERS[name]), 3)
    poses, _ = simulation.poses()
    number = 0
    for frame in simulation.frames("top"):
        position, rotation = poses.at(frame.stamp_ns + frame.time_ns)
        world_m = position + rotation.apply(frame.xyz_m + PLACE)
        to_m = [np.abs(world_m[:, 2] - YARD.ground_z_m)]
        to_m += [np.abs(outside_m(building, YARD, world_m)) for building in YARD.buildings]
        assert np.min(to_m, axis=0).max() < NOISE_M + 1e-3
        number += len(world_m)
        # As the frame lies there without its poses, the walls are elsewhere.
        raw = [
            np.abs(outside_m(building, YARD, frame.xyz_m + PLACE)) for building in YARD.buildings
        ]
        if name != "mast" and frame.begin_ns > 10**9:
            assert np.median(np.min(raw, axis=0)) > NOISE_M
    assert number > 10_000


def test_what_is_behind_a_wall_from_where_the_carrier_is_now_is_out_of_view():
    """A car passes a gap between two walls; the drone behind them is in view through it only."""
    walls = (Building((-20.0, 5.0), (38.0, 1.0, 30.0)), Building((20.0, 5.0), (38.0, 1.0, 30.0)))
    drone = Drone(Flight(waypoints=((0, 0, 12, 4), (9, 0, 12, 4))), (0.8, 0.8, 0.8), 1.0)
    car = Carrier(start_m=(-20.0, 0.0, 0.0), velocity_mps=(10.0, 0.0, 0.0))
    scene = dataclasses.replace(EMPTY, buildings=walls)
    simulation = Simulation(moving(car, scene=scene, drones=(drone,), duration_s=4.0), 1)
    truth = list(simulation.truth())
    at_m = np.array(
        [-20 + 10 * (row.time_ns * 1e-9 - simulation.scenario.start_time_s) for row in truth]
    )
    seen = np.array([row.in_view for row in truth])
    # By hand: the line from the sensor to the drone must cross y = 4.5 and 5.5 between x -1 and 1.
    sensor = at_m + PLACE[0]
    across = [(sensor * (12 - y) / (12 - PLACE[1])) for y in (4.5, 5.5)]
    free = np.all(np.abs(across) < 1, axis=0)
    edge = np.any(np.abs(np.abs(across) - 1) < 0.05, axis=0)
    assert np.array_equal(seen[~edge], free[~edge])
    assert 0.05 < free.mean() < 0.3
    index = simulation.things.index(simulation.drones[0])
    hits = [
        (frame.begin_ns + frame.time_ns[frame.thing == index]) * 1e-9
        for frame in simulation.frames("top")
    ]
    hit_at_m = -20 + 10 * np.concatenate(hits) + PLACE[0]
    assert len(hit_at_m) > 5
    assert np.abs(hit_at_m).max() < 2.5


def test_a_view_turns_with_its_carrier():
    """An Avia looks up; on a carrier that tilts it loses a drone at the edge now and then."""
    drone = Drone(Flight(waypoints=((0, 13, 0, 20), (9, 13, 0, 20))))
    sensors = {"avia": Sensor("avia", stray_returns=0)}
    carrier = Carrier(sway_deg=10.0, sway_hz=0.5)
    scenario = moving(carrier, sensors=sensors, scene=EMPTY, drones=(drone,), duration_s=6.0)
    simulation = Simulation(scenario, 1)
    poses, _ = simulation.poses()
    truth = list(simulation.truth())
    position, rotation = poses.at(np.array([row.time_ns for row in truth]))
    local = rotation.inv().apply(np.array([row.xyz_m for row in truth]) - position)
    expected = in_field_of_view(MODELS["avia"], local)
    seen = [row.in_view for row in truth]
    assert np.mean(np.array(seen) == expected) > 0.995
    assert 0.2 < np.mean(seen) < 0.8


def test_poses_are_written_beside_the_frames_true_ones_and_noisy_ones(tmp_path):
    carrier = Carrier(pan_dps=30.0, drift_m=1.0, sway_deg=2.0)
    scenario = moving(carrier, scene=EMPTY, duration_s=3.0)
    simulate(scenario, tmp_path / "a", 5)
    true, measured = read_tum(tmp_path / "a" / TRUE_POSES_NAME), read_tum(tmp_path / "a/poses.tum")
    assert np.array_equal(true.stamp_ns, measured.stamp_ns)
    assert np.all(np.diff(true.stamp_ns) == 10**7)
    begin_ns = scenario.start_time_s * 10**9
    assert true.stamp_ns[0] < begin_ns
    assert true.stamp_ns[-1] > begin_ns + 3 * 10**9
    error_m = measured.position_m - true.position_m
    error_rad = (true.rotation.inv() * measured.rotation).as_rotvec()
    for error, sigma in ((error_m, carrier.pose_noise_m), (error_rad, np.radians(0.05))):
        assert error.std(axis=0) == pytest.approx(np.full(3, sigma), rel=0.15)
        assert np.abs(error.mean(axis=0)).max() < 5 * sigma / np.sqrt(len(error))
    # By hand: the heading goes on by 30 degrees a second, the tilt and the drift have their limits.
    turned = true.rotation.apply([0, 0, 1.0])
    assert np.degrees(np.arccos(turned[:, 2])).max() < 2.0
    assert np.abs(true.position_m).max() < 1.0
    heading = np.unwrap(np.arctan2(*true.rotation.apply([1.0, 0, 0]).T[1::-1]))
    span_s = (true.stamp_ns[-1] - true.stamp_ns[0]) * 1e-9
    assert np.degrees(heading[-1] - heading[0]) / span_s == pytest.approx(30, abs=1)
    simulate(scenario, tmp_path / "b", 5)
    assert (tmp_path / "b/poses.tum").read_bytes() == (tmp_path / "a/poses.tum").read_bytes()
    found = find_poses(tmp_path / "a", ["top"])
    assert found == {ALL: tmp_path / "a/poses.tum"}
    assert poses_options(found) == ["--poses", str(tmp_path / "a/poses.tum")]


def test_poses_of_a_lidar_that_is_not_there_are_noted(tmp_path, monkeypatch):
    notes = []
    monkeypatch.setattr("unlidar.pose_files.note", notes.append)
    (tmp_path / "right").mkdir()
    for name in ("poses.tum", "poses_left.tum", "poses_right.tum", "poses_rihgt.tum"):
        (tmp_path / name).write_text("")
    found = find_poses(tmp_path, ["left"])  # right was not chosen
    assert found == {ALL: tmp_path / "poses.tum", "left": tmp_path / "poses_left.tum"}
    assert notes == [f"{tmp_path / 'poses_rihgt.tum'}: not taken, no LiDAR is called rihgt"]


def test_a_sensor_beside_the_carrier_rests_and_has_no_poses(tmp_path):
    sensors = {
        "top": Sensor("mid360", position_m=PLACE, stray_returns=0),
        "ground": Sensor("mid360", on_carrier=False),
    }
    scenario = moving(CARRIERS["all"], sensors=sensors, duration_s=0.3)
    simulate(scenario, tmp_path / "both", 1)
    found = find_poses(tmp_path / "both", sensors)
    assert found == {"top": tmp_path / "both/poses_top.tum"}
    assert poses_options(found) == ["--poses", f"top={tmp_path}/both/poses_top.tum"]
    alone = dataclasses.replace(scenario, carrier=None)
    simulate(alone, tmp_path / "alone", 1)
    assert not list((tmp_path / "alone").glob("*.tum"))
    frames = sorted((tmp_path / "alone/ground").iterdir())
    assert len(frames) == 3
    for frame in frames:  # at rest it sees what it saw, to the byte
        assert frame.read_bytes() == (tmp_path / "both/ground" / frame.name).read_bytes()
    assert all(
        frame.read_bytes() != (tmp_path / "both/top" / frame.name).read_bytes()
        for frame in (tmp_path / "alone/top").iterdir()
    )


def test_the_way_of_a_car_is_free_and_has_things_beside_it_from_end_to_end():
    for seed in range(3):
        simulation = Simulation(load_scenario("drive"), seed)
        scene = simulation.scenario.scene
        poses, _ = simulation.poses()
        way = poses.position_m
        assert np.ptp(way[:, 0]) > 150
        feet = np.array(
            [
                thing.centre_m[:2]
                for thing in simulation.things
                if thing.kind in ("pole", "building") and thing.path is None
            ]
        )
        assert np.abs(feet[:, 1]).min() > scene.clear_m
        for x in np.arange(way[0, 0], way[-1, 0], 20):
            assert (np.abs(feet[:, 0] - x) < 25).sum() >= 3


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ((5, np.zeros((2, 3)), Rotation.identity(2)), r"stamp_ns: 5, expected an array of shape"),
        (([[1, 2], [3]], np.zeros((2, 3)), Rotation.identity(2)), "stamp_ns: .*an array"),
        (
            (np.arange(2), np.zeros((3, 3)), Rotation.identity(2)),
            r"position_m: \(3, 3\), expected an array of shape \(2, 3\)",
        ),
        ((np.arange(2), np.zeros((2, 3)), Rotation.identity(3)), "rotation: .* Rotation of 2"),
        ((np.arange(2), np.zeros((2, 3)), np.eye(3)), "rotation: .* Rotation of 2"),
        ((np.arange(2), np.zeros((2, 3)), None), "rotation: None, expected a Rotation of 2"),
    ],
)
def test_poses_of_other_shapes_are_refused(arrays, said):
    with pytest.raises(UsageError, match=said):
        Poses(*arrays)


def test_poses_between_two_are_on_their_line_and_half_their_turn():
    poses = Poses(
        np.array([0, 10**9]),
        np.array([[0.0, 0, 0], [2, 4, -6]]),
        Rotation.from_rotvec(np.radians([[0, 0, 0], [0, 0, 80]])),
    )
    position, rotation = poses.at(np.array([0, 25 * 10**7, 10**9]))
    np.testing.assert_allclose(position, [[0, 0, 0], [0.5, 1, -1.5], [2, 4, -6]])
    np.testing.assert_allclose(np.degrees(rotation.magnitude()), [0, 20, 80])
    assert not poses.is_still
    rest = Poses(poses.stamp_ns, np.ones((2, 3)), Rotation.from_rotvec(np.ones((2, 3))))
    assert rest.is_still


def test_poses_keep_every_nanosecond_and_nanometre(tmp_path):
    rng = np.random.default_rng(2)
    stamp_ns = np.cumsum(rng.integers(1, 10**8, 50)) + 1_700_000_000_123_456_789
    poses = Poses(
        stamp_ns, rng.normal(0, 100, (50, 3)), Rotation.from_quat(rng.normal(size=(50, 4)))
    )
    write_poses(tmp_path / "way.tum", poses, "two\nlines")
    again = read_tum(tmp_path / "way.tum")
    assert np.array_equal(again.stamp_ns, stamp_ns)
    np.testing.assert_allclose(again.position_m, poses.position_m, atol=1e-9)
    assert (poses.rotation.inv() * again.rotation).magnitude().max() < 1e-8
