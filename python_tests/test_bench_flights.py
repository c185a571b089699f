"""The bench's flights: which returns are the drone's, which are flagged, tracks times frames."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from unlidar.errors import InputError
from unlidar.frames_io import find_sensors, list_frames, read_returns, write_pcd
from unlidar.truth import TRUTH_NAME
from unlidar_bench import moving, recordings, swarm
from unlidar_bench.processes import Usage
from unlidar_bench.setting import Setting

small = st.lists(st.tuples(*[st.sampled_from((-1.5, 0.1, 1 / 3, 7.0))] * 3), max_size=20)


@given(small, small)
def test_a_return_is_flagged_if_it_is_among_those_chosen(rows: list, chosen: list) -> None:
    of = np.array(rows, dtype=float).reshape(-1, 3)
    among = np.array(chosen, dtype=np.float32).reshape(-1, 3)  # as a file has them
    found = moving.flagged(of, among)
    assert found.tolist() == [row in chosen for row in rows]


def test_returns_that_are_flagged_are_counted_by_what_they_are_of() -> None:
    kinds = np.array(["drone", "drone", "walker", "car", "ground", "stray", "crown"])
    moves = np.array([True, False, True, True, True, True, False])
    assert moving.counts(moves, kinds) == {
        "of_drone": 2, "found": 0.5, "others_found": 1.0, "false": 2,
    }  # fmt: skip
    assert moving.counts(moves[4:], kinds[4:])["found"] is None


def test_times_are_by_the_returns_of_each_run_and_flags_add_up_over_seeds() -> None:
    kinds = [np.array(["drone"] * 2), np.array(["drone", "ground", "ground", "ground"])]
    ours = [
        moving.Found(2e-6, 10, np.ones(2, bool), {"within1m": 1.0, "tracks": 1}),
        moving.Found(8e-6, 10, np.ones(4, bool), {"within1m": 0.5, "tracks": 2}),
    ]
    theirs = [moving.Found(3 * one.cpu_s, 20, None, None) for one in ours]
    assert moving.row(ours, ours, kinds) == pytest.approx(
        {"us_per_return": 1.5, "times": 1.0, "memory_mb": 10, "of_drone": 3, "found": 1.0,
         "others_found": None, "false": 3, "within1m": 0.75, "tracks": "1 2"}
    )  # fmt: skip
    assert moving.row(theirs, ours, kinds) == pytest.approx(
        {"us_per_return": 4.5, "times": 3.0, "memory_mb": 20}
    )


@pytest.fixture(scope="module")
def setting(tmp_path_factory: pytest.TempPathFactory) -> Setting:
    work = tmp_path_factory.mktemp("flights")
    return Setting(build=work, work=work, flight_s=0.5, swarm_s=0.5)


def test_each_return_is_known_by_the_thing_it_is_of(setting: Setting) -> None:
    where = "before walls and trees"
    recording, simulation = recordings.flight(setting, "mid360", where, 1)
    kinds = moving.kinds_of_returns(simulation, recording)
    (folder,) = find_sensors(recording).values()
    xyz_m = np.concatenate([read_returns(frame.path) for frame in list_frames(folder)])
    assert len(kinds) == len(xyz_m)
    (drone,) = simulation.drones
    from_drone_m = np.linalg.norm(xyz_m - drone.centres(np.full(1, 0.25)), axis=1)
    assert (kinds == "drone").any()
    assert from_drone_m[kinds == "drone"].max() < 3  # it flies at 5 m/s for a quarter of a second
    first = list_frames(folder)[0].path
    write_pcd(first, read_returns(first) + 1)
    with pytest.raises(InputError, match="another simulator, remove"):
        moving.kinds_of_returns(simulation, recording)


def test_a_swarm_has_as_many_drones_each_on_a_way_of_its_own(setting: Setting) -> None:
    truth = recordings.swarm(setting, "mid360", 3, 1) / TRUTH_NAME
    rows = truth.read_text().splitlines()[1:]
    targets = [row.split(",")[1] for row in rows]
    assert {target: targets.count(target) for target in targets} == dict.fromkeys("012", 25)
    assert len({tuple(row.split(",")[2:5]) for row in rows}) == len(rows)


def test_tracks_times_frames_are_the_rows_of_a_trajectory(tmp_path: Path) -> None:
    path = tmp_path / "traj.csv"
    path.write_text("timestamp,track_id,x,y,z\n")
    assert swarm.track_frames(path) == 0
    path.write_text("timestamp,track_id,x,y,z\n0.0,1,0,0,0\n0.0,2,5,0,0\n0.1,1,0,0,0\n")
    assert swarm.track_frames(path) == 3


def test_a_swarm_is_measured_by_medians_of_time_and_means_of_the_rest() -> None:
    runs = [
        (Usage(9, cpu_s, 10 * cpu_s),
         {"tracks": 2, "track_frames": 30, "within1m": within, "false": 0.0})
        for cpu_s, within in ((1.0, 1.0), (2.0, 0.5), (3.0, None))
    ]  # fmt: skip
    assert swarm.row(runs, duration_s=10) == pytest.approx(
        {"cpu_s": 2.0, "share": 0.2, "memory_mb": 30.0, "tracks": "2 2 2", "within1m": 0.75,
         "matched": None, "false": 0.0, "track_frames": 30, "track_frames_per_s": 15.0}
    )  # fmt: skip


def test_dufomap_flags_what_stood_where_rays_passed_later(tmp_path: Path) -> None:
    pytest.importorskip("dufomap")
    side = np.linspace(-2, 2, 81)
    wall_m = np.array([(10.0, y, z) for y in side for z in side])
    thing_m = wall_m[np.hypot(*wall_m[:, 1:].T) < 0.8] / 2  # hides a part of the wall
    hidden = np.hypot(*wall_m[:, 1:].T) < 0.8
    frames = tmp_path / "frames"
    frames.mkdir()
    clouds = [np.concatenate([thing_m, wall_m[~hidden]])] * 3 + [wall_m] * 5
    for i, cloud in enumerate(clouds):
        write_pcd(frames / f"{1_700_000_000 + i}.0.pcd", cloud)
    out = tmp_path / "labels.npz"
    program = [sys.executable, "-m", "unlidar_bench.dufomap_labels"]
    subprocess.run([*program, out, "0.1", frames], check=True, capture_output=True)
    with np.load(out) as found:
        moves, cpu_s = found["moves"], float(found["cpu_s"])
    assert cpu_s > 0 and len(moves) == sum(map(len, clouds))
    is_thing = np.concatenate([cloud[:, 0] < 9 for cloud in clouds])
    assert moves[is_thing].mean() > 0.5
    assert moves[~is_thing].mean() < 0.01
