"""Drawn scenes come of their seed alone, and show what they say: by geometry, sensor by sensor."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scripts import load_script
from unlidar.frames_io import list_frames, read_returns
from unlidar.simulate import Simulation
from unlidar.simulate.recording import SimulatedFrame
from unlidar.simulate.sensors import MODELS, in_field_of_view, scan
from unlidar.truth import read_truth
from unlidar_bench.clutter import KINDS
from unlidar_bench.draws import FLIGHTS, draw, suited
from unlidar_bench.flights import flight_of
from unlidar_bench.unseen_sensors import UNSEEN

TOOL = Path(__file__).parents[1] / "tools/draw_scenes.py"
NOISE_M = 6 * 0.05  # no range is off by more


@pytest.fixture(autouse=True, scope="module")
def known_sensors() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for name, model in UNSEEN.items():
            patch.setitem(MODELS, name, model)
        yield


@pytest.fixture(scope="module")
def tool():
    return load_script(TOOL)


def run(tool, monkeypatch, *words: object) -> int:
    monkeypatch.setattr(sys, "argv", ["draw_scenes.py", *map(str, words)])
    return tool.main()


def contents(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def drawn(kind: str, sensor: str, seed: int = 3, duration_s: float = 2.0) -> list[Simulation]:
    """With a flight and with nobody."""
    return [scene for _, scene in draw(kind, sensor, seed, duration_s)]


def plain(scene: Simulation, sensor: str) -> list[SimulatedFrame]:
    """The frames as they were before they were altered."""
    return list(Simulation.frames(scene, sensor))


def test_a_scene_has_the_same_bytes_for_its_seed_and_others_for_another(
    tool, tmp_path, monkeypatch
) -> None:
    words = ["--sensors", "rings16", "--duration", 0.3]
    kinds = ["dust", "wet"]  # things and frames of random numbers
    assert run(tool, monkeypatch, tmp_path / "a", *kinds, *words, "--seed", 5) == 0
    assert run(tool, monkeypatch, tmp_path / "b", "calm", *kinds[::-1], *words, "--seed", 5) == 0
    assert run(tool, monkeypatch, tmp_path / "c", *kinds, *words, "--seed", 6) == 0
    one, more, other = (contents(tmp_path / name) for name in "abc")
    assert {name.split("_")[0] for name in more} == {"calm", *kinds}
    assert one == {name: data for name, data in more.items() if not name.startswith("calm")}
    clouds = [{data for name, data in all_.items() if ".pcd" in name} for all_ in (one, other)]
    assert len(clouds[0]) == len(clouds[1]) == 12
    assert clouds[0].isdisjoint(clouds[1])


def test_scenes_are_read_as_they_are_measured_and_nobody_has_an_empty_truth(
    tool, tmp_path, monkeypatch, capsys
) -> None:
    words = [tmp_path, "street", "--sensors", "rosette_ahead", "--duration", 1]
    assert run(tool, monkeypatch, *words) == 0
    scenes = sorted(tmp_path.iterdir())
    assert [scene.name for scene in scenes] == [
        "street_rosette_ahead_near", "street_rosette_ahead_none",
    ]  # fmt: skip
    flights = [flight_of(scene) for scene in scenes]
    assert [len(flight.truth) for flight in flights] == [50, 0]
    assert read_truth(scenes[1] / "ground_truth.csv").xyz_m.shape == (0, 3)
    for flight in flights:
        assert len(list_frames(flight.sensors["rosette_ahead"])) == 10
    assert str(scenes[0]) in capsys.readouterr().out
    # What is there is kept unless told otherwise.
    assert run(tool, monkeypatch, *words) == 5
    assert "street_rosette_ahead_near: exists already" in capsys.readouterr().err
    assert run(tool, monkeypatch, *words, "--force") == 0


@pytest.mark.parametrize("kind", KINDS)
def test_the_clutter_is_the_same_where_nobody_flies(kind: str) -> None:
    (flown, empty), times_s = drawn(kind, "rings32_up"), np.linspace(0, 2, 5)
    assert len(flown.drones) == 1
    assert empty.drones == []
    others = [thing for thing in flown.things if thing.kind != "drone"]
    assert [thing.kind for thing in others] == [thing.kind for thing in empty.things]
    for one, same in zip(others, empty.things, strict=True):
        np.testing.assert_array_equal(one.centres(times_s), same.centres(times_s))


@pytest.mark.parametrize("sensor", UNSEEN)
def test_returns_lie_in_the_field_of_view_and_those_of_a_drone_about_its_truth(sensor: str) -> None:
    model = UNSEEN[sensor]
    rays, _ = scan(model, 2, (0.1, 0.7))
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0, atol=1e-12)
    assert in_field_of_view(model, rays * (1 - 1e-9)).mean() > 0.93  # the rest is its very edge
    _, scene = next(draw("calm", sensor, 3))
    (drone,) = scene.drones
    index, truth = scene.things.index(drone), list(scene.truth())
    true_s = np.array([row.time_ns * 1e-9 for row in truth])
    true_m = np.stack([row.xyz_m for row in truth])
    assert np.mean([row.in_view for row in truth]) >= 0.4
    edge = np.radians(0.1)  # a ray on the edge may be rounded to the other side
    hits = frames = 0
    for frame in scene.frames(sensor):
        ranges_m = np.linalg.norm(frame.xyz_m, axis=1)
        towards = frame.xyz_m / ranges_m[:, None]
        nudges = [edge * axis for axis in (*np.eye(3), *-np.eye(3))]
        is_inside = [in_field_of_view(model, towards + nudge) for nudge in nudges]
        assert np.any(is_inside, axis=0).all()
        assert np.all(ranges_m < 4 * model.range_at_10_percent_m)
        own = frame.thing == index
        time_s = (frame.stamp_ns + frame.time_ns[own]) * 1e-9
        at_m = np.stack([np.interp(time_s, true_s, true_m[:, i]) for i in range(3)], axis=1)
        half_m = drone.size_m.max() / 2 + NOISE_M
        assert np.all(np.linalg.norm(frame.xyz_m[own] - at_m, axis=1) < half_m)
        hits, frames = hits + own.sum(), frames + 1
        if hits and frames >= 10:
            return
    raise AssertionError("no return of the drone")


@pytest.mark.parametrize("sensor", UNSEEN)
def test_every_sensor_has_a_flight_within_its_range_over_any_ground(sensor: str) -> None:
    for kind in KINDS.values():
        assert set() < set(suited(sensor, kind.scene.ground_z_m)) < set(FLIGHTS)


@pytest.mark.parametrize("kind", ["crane", "bridge", "overhead"])
@pytest.mark.parametrize("sensor", ["rings32_up", "rosette_up"])
def test_no_drone_flies_through_a_pole_and_each_is_in_view_for_long(kind, sensor) -> None:
    times_s, seen = np.linspace(0, 20, 1000), []
    for seed in range(5):
        _, scene = next(draw(kind, sensor, seed))
        way = scene.drones[0].centres(times_s)
        for pole in (thing for thing in scene.things if thing.kind == "pole"):
            away_m = np.abs(way - pole.centre_m)
            is_inside = np.hypot(away_m[:, 0], away_m[:, 1]) < pole.size_m[0] / 2
            assert not np.any(is_inside & (away_m[:, 2] < pole.size_m[2] / 2))
        seen.append(np.mean([row.in_view for row in scene.truth()]))
    assert min(seen) >= 0.4


def test_leaves_come_down_from_crowns_and_stay_on_the_ground() -> None:
    _, scene = drawn("leaves", "rings32_up", duration_s=20.0)
    times_s = np.linspace(-10, 60, 500)
    leaves = [thing for thing in scene.things if thing.kind == "leaf"]
    assert len(leaves) > 50
    for leaf in leaves:
        way = leaf.centres(times_s)
        assert way[-1, 2] == pytest.approx(scene.scenario.scene.ground_z_m)
        assert np.all(np.diff(way[:, 2]) <= 0)
        np.testing.assert_array_equal(way[-1], way[-2])
        crowns = [thing for thing in scene.things if thing.kind == "crown"]
        assert min(
            np.abs((way[0] - crown.centre_m) / crown.size_m).max() for crown in crowns
        ) <= 0.4  # fmt: skip


def test_a_jib_slews_at_one_height_about_its_mast() -> None:
    _, scene = drawn("crane", "rosette_up")
    pieces = [thing for thing in scene.things if thing.turn is not None]
    mast = max((thing for thing in scene.things if thing.kind == "pole"), key=lambda t: t.size_m[0])
    assert in_field_of_view(
        MODELS["rosette_up"], mast.centre_m[None] * [1, 1, 0] + [0, 0, 12]
    ).all()
    assert len(pieces) == 9
    times_s = np.linspace(0, 20, 50)
    for piece in pieces:
        arm = piece.centres(times_s) - mast.centre_m
        np.testing.assert_allclose(arm[:, 2], mast.size_m[2] / 2)
        np.testing.assert_allclose(np.linalg.norm(arm[:, :2], axis=1), np.linalg.norm(arm[0, :2]))
        along = np.stack([np.cos(piece.yaw_at(times_s)), np.sin(piece.yaw_at(times_s))], axis=1)
        across = along[:, 0] * arm[:, 1] - along[:, 1] * arm[:, 0]
        np.testing.assert_allclose(across, 0, atol=1e-9)


def test_what_passes_over_a_bridge_stays_on_its_deck() -> None:
    _, scene = drawn("bridge", "rings16", duration_s=20.0)
    deck = next(thing for thing in scene.things if thing.size_m[0] == 120.0)
    top_m = deck.centre_m[2] + deck.size_m[2] / 2
    passing = [thing for thing in scene.things if thing.kind in ("car", "walker")]
    assert len(passing) == 8
    along = np.array([np.cos(deck.yaw_rad), np.sin(deck.yaw_rad), 0.0])
    aside = np.array([-along[1], along[0], 0.0])
    for thing in passing:
        away = thing.centres(np.linspace(0, 20, 99)) - deck.centre_m
        assert np.ptp(away @ along) > 10.0
        assert np.abs(away @ along).max() < (deck.size_m[0] - thing.size_m[0]) / 2
        assert np.abs(away @ aside).max() < deck.size_m[1] / 2
        low_m = away[:, 2] + deck.centre_m[2] - thing.size_m[2] / 2
        np.testing.assert_allclose(low_m, top_m)


def test_dust_drifts_and_grows_while_it_is_there() -> None:
    _, scene = drawn("dust", "rings16", duration_s=20.0)
    clouds = [thing for thing in scene.things if thing.kind == "puff"]
    times_s = np.linspace(0, 30, 3001)
    for cloud in clouds:
        share, way = cloud.growth(times_s), cloud.centres(times_s)
        there = share > 0.1
        assert 3.9 < there.sum() * 0.01 < 9.1
        assert np.all(np.diff(share[there]) > 0)
        assert np.all(np.diff(way[there, 2]) > 0)
        np.testing.assert_array_equal(share[~there], 1e-3)


def test_a_wet_road_shows_below_the_ground_what_stands_above_it() -> None:
    _, scene = drawn("wet", "rings16", duration_s=0.5)
    ground_m, count = scene.scenario.scene.ground_z_m, 0
    for before, after in zip(plain(scene, "rings16"), scene.frames("rings16"), strict=True):
        assert np.all(np.diff(after.time_ns) >= 0)
        known = set(map(tuple, before.xyz_m.round(6)))
        images = np.array([row for row in after.xyz_m if tuple(row.round(6)) not in known])
        assert len(after.xyz_m) == len(before.xyz_m) + len(images)
        assert np.all(images[:, 2] < ground_m)
        assert in_field_of_view(MODELS["rings16"], images).all()
        mirrored = images * [1, 1, -1] + [0, 0, 2 * ground_m]
        assert {tuple(row) for row in mirrored.round(6)} <= known
        count += len(images)
    assert count > 100


def test_second_returns_lie_behind_the_first_in_crowns_and_on_them_elsewhere() -> None:
    _, scene = drawn("dual", "rings16", duration_s=0.2)
    crowns = [i for i, thing in enumerate(scene.things) if thing.kind == "crown"]
    for before, after in zip(plain(scene, "rings16"), scene.frames("rings16"), strict=True):
        assert len(after.xyz_m) == 2 * len(before.xyz_m)
        known = set(map(tuple, before.xyz_m))
        is_new = np.array([tuple(row) not in known for row in after.xyz_m])
        assert np.isin(after.thing[is_new], crowns).all()
        assert is_new.sum() == np.isin(before.thing, crowns).sum() > 0


def test_coarse_ranges_are_whole_multiples_on_the_same_rays() -> None:
    _, scene = drawn("coarse", "rings16", duration_s=0.2)
    for before, after in zip(plain(scene, "rings16"), scene.frames("rings16"), strict=True):
        ranges_m = [np.linalg.norm(frame.xyz_m, axis=1) for frame in (before, after)]
        np.testing.assert_allclose(ranges_m[1] / 0.04, np.rint(ranges_m[1] / 0.04), atol=1e-6)
        assert np.abs(ranges_m[1] - ranges_m[0]).max() <= 0.02 + 1e-9
        np.testing.assert_allclose(
            after.xyz_m / ranges_m[1][:, None], before.xyz_m / ranges_m[0][:, None], atol=1e-12
        )


def test_lost_frames_are_no_files_and_leave_a_pause(tool, tmp_path, monkeypatch) -> None:
    words = ["lossy", "--sensors", "rosette_up", "--duration", 8]
    assert run(tool, monkeypatch, tmp_path, *words) == 0
    for scene in tmp_path.iterdir():
        frames = list_frames(scene / "rosette_up")
        assert 30 < len(frames) < 65
        assert np.diff([frame.stamp_ns for frame in frames]).max() >= 1_000_000_000
        assert f'"rosette_up": {len(frames)}' in (scene / "scenario.json").read_text()
        assert len(read_returns(frames[0].path))


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["rain"], "no kind 'rain', expected some of: calm street"),
        (["calm", "--sensors", "vlp"], "no sensor 'vlp', expected some of: mid360"),
    ],
)
def test_what_cannot_be_drawn_is_refused(tool, tmp_path, words, why, monkeypatch, capsys) -> None:
    assert run(tool, monkeypatch, tmp_path / "out", *words) == 2
    assert why in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
