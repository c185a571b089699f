"""Motion of objects in simulated scenes, and the content of the scenarios."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from unlidar.configs import scenario_names
from unlidar.simulate import Scenario, Simulation, load_scenario, shapes
from unlidar.simulate.flight import make_path
from unlidar.simulate.recording import STRAY
from unlidar.simulate.scenario import Drone, Flight, Fog, Scene, Sensor
from unlidar.simulate.world import SceneObject, is_hidden

EMPTY = Scene(random_buildings=0, poles=0, trees=0)
NAMES = scenario_names()
NOISE_M = 6 * 0.02


def simulation(scene: Scene, seed: int = 1, **changes) -> Simulation:
    sensors = {"mid360": Sensor("mid360", stray_returns=0)}
    base = Scenario(sensors=sensors, scene=scene, duration_s=4.0)
    return Simulation(dataclasses.replace(base, **changes), seed)


def things(simulated: Simulation, kind: str) -> list[SceneObject]:
    return [thing for thing in simulated.things if thing.kind == kind]


def speed_mps(thing: SceneObject, duration_s: float = 4.0) -> np.ndarray:
    at = np.arange(0, duration_s, 1e-3)
    return np.linalg.norm(np.diff(thing.centres(at), axis=0), axis=1) / 1e-3


@pytest.mark.parametrize("seed", range(5))
def test_cars_pass_straight_on_the_ground_and_never_over_the_station(seed):
    scene = dataclasses.replace(EMPTY, cars=3)
    at = np.linspace(0, 4, 200)
    for car in things(simulation(scene, seed), "car"):
        way = car.centres(at)
        assert np.ptp(way[:, 2]) == 0
        assert way[0, 2] - car.size_m[2] / 2 == pytest.approx(scene.ground_z_m)
        assert np.linalg.norm(way[:, :2], axis=1).min() > scene.clear_m
        heading = np.array([math.cos(car.yaw_rad), math.sin(car.yaw_rad)])
        moved = way[-1, :2] - way[0, :2]
        np.testing.assert_allclose(moved / np.linalg.norm(moved), heading, atol=1e-9)
        assert 3.9 < speed_mps(car).max() < 12.1


def test_returns_of_a_car_lie_on_its_box_where_it_is_at_their_own_time():
    simulated = simulation(dataclasses.replace(EMPTY, cars=1), 2)
    car = things(simulated, "car")[0]
    index = simulated.things.index(car)
    along = np.array([math.cos(car.yaw_rad), math.sin(car.yaw_rad), 0.0])
    aside = np.array([-along[1], along[0], 0.0])
    seen = 0
    for frame in simulated.frames("mid360"):
        hit = frame.thing == index
        seen += hit.sum()
        at = (frame.begin_ns + frame.time_ns[hit]) * 1e-9
        away = frame.xyz_m[hit] - car.centres(at)
        local = np.abs(np.stack([away @ along, away @ aside, away[:, 2]], axis=1))
        assert np.all(local < car.size_m / 2 + NOISE_M)
        assert np.all((np.abs(local - car.size_m / 2) < NOISE_M).any(axis=1))
    assert seen > 100


@pytest.mark.parametrize("seed", range(3))
def test_birds_are_smaller_than_40_cm_fly_like_birds_and_are_no_part_of_the_truth(seed):
    simulated = simulation(dataclasses.replace(EMPTY, birds=5), seed)
    birds = things(simulated, "bird")
    assert len(birds) == 5
    assert list(simulated.truth()) == []
    for bird in birds:
        assert bird.size_m.max() < 0.4
        assert 2 < speed_mps(bird).mean() < 12
        assert bird.centres(np.linspace(0, 4, 100))[:, 2].min() > EMPTY.ground_z_m + 2
        fill = bird.fill_at(np.linspace(0, 4, 1000))
        beats = (np.diff(np.sign(fill - fill.mean())) != 0).sum() / 2 / 4
        assert beats == pytest.approx(bird.flap_hz, abs=0.5)


def test_insects_stay_about_the_station():
    for insect in things(simulation(dataclasses.replace(EMPTY, insects=20)), "insect"):
        away = np.linalg.norm(insect.centres(np.linspace(0, 4, 100)), axis=1)
        assert away.max() < 8
        assert insect.size_m.max() < 0.05


def test_crowns_sway_about_their_place_by_what_they_are_told():
    still = simulation(Scene(trees=10))
    swaying = simulation(Scene(trees=10, sway_m=0.5))
    at = np.linspace(0, 60, 3000)
    assert all(crown.path is None for crown in things(still, "crown"))
    for crown in things(swaying, "crown"):
        away = crown.centres(at) - crown.centre_m
        assert np.all(away[:, 2] == 0)
        assert 0.5 < np.linalg.norm(away, axis=1).max() <= 0.5 * math.sqrt(2) + 1e-9
        assert np.abs(away.mean(axis=0)).max() < 0.1


def returns_of(simulated: Simulation, *wanted: SceneObject) -> list[tuple[np.ndarray, np.ndarray]]:
    """Places (N, 3) and times (N,) of the returns of each."""
    frames = list(simulated.frames("mid360"))
    found = []
    for thing in wanted:
        index = next(i for i, one in enumerate(simulated.things) if one is thing)
        places = [frame.xyz_m[frame.thing == index] for frame in frames]
        times_ns = [f.begin_ns + f.time_ns[f.thing == index] for f in frames]
        found.append((np.concatenate(places), np.concatenate(times_ns) * 1e-9))
    return found


def top_of(thing: SceneObject) -> np.ndarray:
    return thing.centre_m + thing.size_m / 2 * np.array([0, 0, 1])


def test_what_stands_about_is_not_drawn_anew_because_of_what_is_not_there():
    """Scenes without fixtures are those of before, seed by seed."""
    many = dataclasses.replace(Scene(), gantries=1, cables=1, flags=1, steam=1)
    kinds = {"ground", "building", "pole", "crown"}
    old = [t for t in simulation(Scene(), 3).things if t.kind in kinds]
    new = simulation(many, 3).things[: len(old)]
    assert [t.centre_m.tolist() for t in old] == [t.centre_m.tolist() for t in new]


@pytest.mark.parametrize("seed", range(3))
def test_signs_hang_on_a_beam_between_two_poles_and_the_beam_on_nothing_that_is_cut(seed):
    scene = dataclasses.replace(EMPTY, gantries=1)
    simulated = simulation(scene, seed)
    beam, *signs = things(simulated, "sign")
    left, right = (pole.centre_m for pole in things(simulated, "pole"))
    np.testing.assert_allclose((left + right)[:2] / 2, beam.centre_m[:2])
    assert np.linalg.norm(left - right) == pytest.approx(beam.size_m[0])
    assert signs
    for sign in signs:
        assert abs(sign.centre_m[2] - beam.centre_m[2]) < sign.size_m[2] / 2
        assert np.linalg.norm(sign.centre_m - beam.centre_m) < beam.size_m[0] / 2


def test_a_low_field_of_view_sees_the_lower_part_of_some_signs_only():
    scene = dataclasses.replace(EMPTY, gantries=12)
    low = {"mid360": Sensor("spinning32", stray_returns=0)}
    simulated = simulation(scene, 1, sensors=low, duration_s=0.3)
    signs, cut = things(simulated, "sign"), 0
    for sign, (places, _) in zip(signs, returns_of(simulated, *signs), strict=True):
        lowest_m, highest_m = sign.centre_m[2] + np.array([-0.5, 0.5]) * sign.size_m[2]
        seen = len(places) > 50 and places[:, 2].min() < lowest_m + 0.3
        cut += seen and places[:, 2].max() < highest_m - 0.5
    assert cut >= 2


def test_a_cable_hangs_from_pole_to_pole_and_what_it_carries_hangs_on_it():
    simulated = simulation(dataclasses.replace(EMPTY, cables=1, sway_m=0.1), 2)
    rods = things(simulated, "cable")
    for one, next_one in itertools.pairwise(rods):
        np.testing.assert_allclose(
            one.centre_m + one.size_m / 2, next_one.centre_m - next_one.size_m / 2, atol=1e-9
        )
    ends = [rods[0].centre_m - rods[0].size_m / 2, rods[-1].centre_m + rods[-1].size_m / 2]
    for end, pole in zip(ends, things(simulated, "pole"), strict=True):
        np.testing.assert_allclose(end, top_of(pole), atol=1e-9)
    at = np.linspace(0, 4, 100)
    for hanging in things(simulated, "hanging"):
        assert min(np.linalg.norm(top_of(hanging) - rod.centre_m) for rod in rods) < 3.0
        assert np.linalg.norm(hanging.centres(at) - hanging.centre_m, axis=1).max() < 0.15


def test_rays_meet_a_rod_as_they_meet_a_pole_of_its_width():
    rng = np.random.default_rng(0)
    direction = rng.normal(size=(20_000, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    start, radius_m, height_m = np.array([-3.0, 0.4, 0.2]), 0.05, 2.0
    thin, cosine = shapes.meet_rod(start, direction, np.array([0, 0, height_m]), radius_m)
    round_, cosine_round = shapes.meet_pole(start, direction, radius_m, height_m)
    both = np.isfinite(thin) & np.isfinite(round_)
    assert both.sum() > 30
    # Its middle instead of its skin, and other ends by as much.
    assert (np.isfinite(thin) != np.isfinite(round_)).sum() <= 0.1 * both.sum()
    assert np.all(np.abs(thin[both] - round_[both]) < 2 * radius_m)
    np.testing.assert_allclose(cosine[both], cosine_round[both], atol=0.05)


def test_a_flag_keeps_to_its_pole_while_it_turns():
    simulated = simulation(dataclasses.replace(EMPTY, flags=1, clear_m=5.0, radius_m=8.0), 1)
    (flag,), (pole,) = things(simulated, "flag"), things(simulated, "pole")
    at = np.linspace(0, 60, 3000)
    yaw = flag.yaw_at(at)
    assert 0.5 < np.ptp(yaw) <= 1.8
    arm = np.stack([np.cos(yaw), np.sin(yaw), 0 * yaw], axis=1)
    hinge = flag.centres(at) - flag.size_m[0] / 2 * arm
    np.testing.assert_allclose(hinge[:, :2], np.tile(pole.centre_m[:2], (3000, 1)), atol=1e-9)
    ((places, times),) = returns_of(simulated, flag)
    assert len(places) > 20
    yaw = flag.yaw_at(times)
    away = places - flag.centres(times)
    aside = away[:, 1] * np.cos(yaw) - away[:, 0] * np.sin(yaw)
    along = away[:, 0] * np.cos(yaw) + away[:, 1] * np.sin(yaw)
    assert np.abs(aside).max() < flag.size_m[1] / 2 + NOISE_M
    assert np.abs(along).max() < flag.size_m[0] / 2 + NOISE_M


def test_puffs_leave_the_chimney_small_rise_grow_and_thin_out():
    simulated = simulation(
        dataclasses.replace(EMPTY, steam=1, clear_m=5.0, radius_m=8.0), 1, duration_s=10.0
    )
    (chimney,) = things(simulated, "pole")
    top_m = chimney.centre_m[2] + chimney.size_m[2] / 2
    at = np.arange(0, 10, 0.01)
    puffs = things(simulated, "puff")
    for puff, (places, times) in zip(puffs, returns_of(simulated, *puffs), strict=True):
        height, size = puff.centres(at)[:, 2] - top_m, puff.growth(at)
        leaves = np.flatnonzero(np.diff(size) < 0) + 1
        assert len(leaves) >= 1
        assert np.all(np.abs(height[leaves]) < 0.05)
        assert np.all(size[leaves] < 0.2)
        grows = np.diff(size) > 0
        assert np.all(np.diff(height)[grows] > 0)
        ways = [puff.centres(at[i : i + 300])[-1] for i in leaves if i + 300 < len(at)]
        assert all(np.linalg.norm(a - b) > 0.01 for a, b in itertools.pairwise(ways))
        unit = (places - puff.centres(times)) / (puff.size_m / 2 * puff.growth(times)[:, None])
        inside = np.linalg.norm(unit, axis=1) < 1 + NOISE_M / puff.growth(times)
        assert inside.mean() > 0.95
        share = puff.growth(times)
        assert (share < 0.5).sum() > (share > 0.9).sum()


def test_rain_has_its_rate_is_mostly_near_and_never_behind_what_a_ray_meets():
    scene = dataclasses.replace(EMPTY, rain_returns=200)
    frames = list(simulation(scene).frames("mid360"))
    drops = [frame.xyz_m[frame.thing == STRAY] for frame in frames]
    away = np.linalg.norm(np.concatenate(drops), axis=1)
    # Two drops of one ray are one return, and the ground hides those below it.
    assert np.mean([len(d) for d in drops]) == pytest.approx(195, rel=0.06)
    assert away.min() > 0.99
    assert away.max() < 25.1
    assert np.median(away) == pytest.approx(5.0, rel=0.2)
    assert np.concatenate(drops)[:, 2].min() > scene.ground_z_m


def strays_m(scene: Scene, **of_sensor) -> tuple[float, np.ndarray]:
    """Mean number a frame of returns from nothing, and their ranges."""
    sensors = {"mid360": Sensor("mid360", **({"stray_returns": 0} | of_sensor))}
    frames = list(simulation(scene, sensors=sensors).frames("mid360"))
    strays = np.concatenate([frame.xyz_m[frame.thing == STRAY] for frame in frames])
    return len(strays) / len(frames), np.linalg.norm(strays, axis=1)


def test_fog_is_the_denser_the_nearer_and_takes_what_is_far():
    clear, foggy = (Scene(fog=fog) for fog in (None, Fog(returns=300, visibility_m=60)))
    number, away = strays_m(foggy)
    assert number == pytest.approx(295, rel=0.06)
    assert away.mean() == pytest.approx(0.3 + 6.0, rel=0.1)
    per_m3 = np.histogram(away, [0.3, 1, 2, 4, 8, 16, 32])[0] / np.diff(
        np.power([0.3, 1, 2, 4, 8, 16, 32], 3)
    )
    assert np.all(np.diff(per_m3) < 0)
    counts = []
    for scene in (clear, foggy):
        hits = [f.xyz_m[f.thing != STRAY] for f in simulation(scene).frames("mid360")]
        away = np.linalg.norm(np.concatenate(hits), axis=1)
        counts.append([(away < 20).sum(), (away > 40).sum()])
    assert counts[1][0] > 0.5 * counts[0][0]
    assert counts[1][1] < 0.2 * counts[0][1]


def test_flakes_are_within_30_m_and_a_low_sun_shows_at_any_range():
    number, away = strays_m(dataclasses.replace(EMPTY, snow_returns=300))
    assert 250 < number < 300  # the ground hides some
    assert away.max() < 30
    assert np.median(away) == pytest.approx(7.1, rel=0.15)
    number, away = strays_m(EMPTY, stray_returns=300)
    assert number == pytest.approx(298, rel=0.06)
    sky = away[away > 20]  # beyond the ground
    assert np.histogram(sky, [20, 40, 60, 80])[0] == pytest.approx(len(sky) / 3, rel=0.1)


def test_a_dirty_window_hides_its_share_of_the_field_for_good_and_returns_from_within_a_metre():
    number, away = strays_m(Scene(), window_dirt=0.5, window_returns=400)
    assert number == pytest.approx(200, rel=0.4)
    assert np.median(away) < 0.7
    sensors = {"mid360": Sensor("mid360", stray_returns=0, window_dirt=0.5)}
    lost = []
    for frame, clean in zip(
        simulation(Scene(), sensors=sensors).frames("mid360"),
        simulation(Scene()).frames("mid360"),
        strict=True,
    ):
        far = np.linalg.norm(clean.xyz_m, axis=1) > 25
        still = np.linalg.norm(frame.xyz_m, axis=1) > 25
        lost.append(1 - still.sum() / far.sum())
    assert np.mean(lost) == pytest.approx(0.5, abs=0.25)
    assert np.std(lost) < 0.1


def test_a_path_that_rests_at_its_waypoints_never_leaves_the_line_between_them():
    points = (
        (0.0, 1.0, 2.0, -1.6),
        (2.0, 1.0, 2.0, -1.6),
        (6.0, 1.0, 2.0, 8.0),
        (9.0, 5.0, 2.0, 8.0),
    )
    path = make_path(Flight(waypoints=points, rest_at_waypoints=True), 9, np.random.default_rng(0))
    at = np.arange(0, 9, 1e-3)
    way = path(at)
    np.testing.assert_allclose(path(np.array([p[0] for p in points])), np.array(points)[:, 1:])
    assert np.all(way[at <= 2] == way[0])
    assert way[:, 2].min() >= -1.6
    assert way[:, 2].max() <= 8.0
    velocity = np.diff(way, axis=0) / 1e-3
    assert np.abs(np.diff(velocity, axis=0) / 1e-3).max() < 5.0  # no leap of the velocity
    np.testing.assert_allclose(velocity[np.searchsorted(at, 6.0)], 0, atol=1e-3)


def test_waypoints_are_moved_by_the_spread_at_most_and_differently_with_another_seed():
    flight = Flight(waypoints=((0, 1, 2, 3), (5, 4, 5, 6)), spread_m=0.5)
    ends = [
        make_path(flight, 5, np.random.default_rng(seed))(np.array([0.0, 5.0])) for seed in (1, 2)
    ]
    for end in ends:
        assert np.abs(end - np.array([[1, 2, 3], [4, 5, 6]])).max() <= 0.5
    assert not np.allclose(*ends)


def test_a_clock_error_shifts_the_stamps_and_nothing_else():
    right = simulation(EMPTY)
    wrong = simulation(
        EMPTY, sensors={"mid360": Sensor("mid360", stray_returns=0, clock_error_s=0.06)}
    )
    for a, b in zip(right.frames("mid360"), wrong.frames("mid360"), strict=True):
        assert a.stamp_ns - b.stamp_ns == 60_000_000
        np.testing.assert_array_equal(a.xyz_m, b.xyz_m)


def test_two_drones_have_a_truth_each():
    drones = tuple(Drone(Flight(waypoints=((0, x, 5, 6), (4, -x, 5, 6)))) for x in (5.0, -5.0))
    rows = list(simulation(EMPTY, drones=drones).truth())
    assert {row.target for row in rows} == {0, 1}
    assert len(rows) == 2 * 200


@pytest.mark.parametrize("name", NAMES)
def test_every_scenario_shows_its_drone_or_an_empty_sky(name):
    simulated = Simulation(load_scenario(name), 3)
    if not simulated.drones:
        assert list(simulated.truth()) == []
        return
    first = len(simulated.things) - len(simulated.drones)
    frames = itertools.chain.from_iterable(map(simulated.frames, simulated.scenario.sensors))
    returns = itertools.accumulate((frame.thing >= first).sum() for frame in frames)
    assert any(count > 3 for count in returns)
    assert np.mean([row.in_view for row in simulated.truth()]) > 0.25


def crown(centre_m: tuple[float, float, float], size_m: float) -> SceneObject:
    return SceneObject("crown", np.array(centre_m), np.full(3, size_m), 0.3)


@pytest.mark.parametrize(("name", "seed"), [("near", 1), ("fog", 1), ("spinning32", 2), ("two", 2)])
def test_no_drone_flies_through_a_tree(name, seed):
    simulated = Simulation(load_scenario(name), seed)
    time_s = np.arange(0.0, simulated.scenario.duration_s, 0.02)
    for drone, tree in itertools.product(simulated.drones, things(simulated, "crown")):
        offset = (drone.centres(time_s) - tree.centres(time_s)) / (tree.size_m / 2)
        assert np.linalg.norm(offset, axis=1).min() > 1.0


def test_a_drone_is_out_of_view_behind_as_many_leaves_as_stop_nine_of_ten_rays():
    origin, behind = np.zeros(3), np.array([[0.0, 10.0, 0.0]])
    at = np.zeros(1)
    for size_m, hides in ((2.2, False), (2.4, True)):  # exp(-2.2) is .111, exp(-2.4) .091
        assert is_hidden([crown((0, 5, 0), size_m)], origin, behind, at)[0] == hides
    two = [crown((0, 3, 0), 1.2), crown((0, 6, 0), 1.2)]
    assert is_hidden(two, origin, behind, at)[0]
    assert not is_hidden(two[:1], origin, behind, at)[0]
    assert not is_hidden([crown((0, 15, 0), 5.0)], origin, behind, at)[0]  # farther away
