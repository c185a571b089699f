"""A LiDAR that moves, with poses, gives what it gives at rest: the program's --poses."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import unlidar
from live_program import ENDLESS, feed, messages
from scipy.spatial.transform import Rotation
from synthetic import (
    BEGIN_NS,
    NO_DRONE_TRAJ,
    Flight,
    Traj,
    decimal_name,
    make_flight,
    read_traj,
    rmse_m,
    run_program,
    track,
    truth_m,
    write_pcd,
)
from unlidar.cli import main
from unlidar.poses import Poses, write_poses
from unlidar.report import load_run
from unlidar.simulate.carrier import Motion, exact_poses
from unlidar.simulate.scenario import Carrier

FRAMES = 100
CARRIERS = {
    "gimbal": Carrier(pan_dps=30.0),
    "drone": Carrier(drift_m=1.0, sway_deg=4.0),
    "mast": Carrier(sway_deg=1.0, mast_m=6.0),
    "car": Carrier(start_m=(-50.0, 2.0, 0.0), velocity_mps=(10.0, 0.0, 0.0)),
}
MOUNT_M, MOUNT = np.array([0.4, -0.1, 0.3]), Rotation.from_rotvec([0.0, 0.4, 1.2])
MOUNTED = (
    "--set", f"sensors.lidar.translation_m={MOUNT_M.tolist()}",
    "--set", f"sensors.lidar.rotation={MOUNT.as_quat().tolist()}",
)  # fmt: skip


def poses_of(name: str) -> Poses:
    motion = Motion(CARRIERS[name], np.random.default_rng(4))
    return exact_poses(motion, 100.0, BEGIN_NS, FRAMES / 10)


def seen_from(poses: Poses, flight: Flight, mounted: bool = False) -> Flight:
    """The same returns in the axes of a LiDAR that moves, each at its own time."""
    clouds = []
    for stamp_ns, cloud, times_s in zip(
        flight.stamps_ns, flight.clouds, flight.times_s, strict=True
    ):
        position, rotation = poses.at(stamp_ns + np.rint(times_s * 1e9).astype("i8"))
        own = rotation.inv().apply(cloud - position)
        own = MOUNT.inv().apply(own - MOUNT_M) if mounted else own
        clouds.append(own.astype(np.float32))
    return Flight(flight.stamps_ns, clouds, flight.times_s)


def written(directory: Path, flight: Flight) -> Path:
    """With the time of every return."""
    directory.mkdir(parents=True)
    for stamp_ns, cloud, times_s in zip(
        flight.stamps_ns, flight.clouds, flight.times_s, strict=True
    ):
        nanoseconds = np.rint(times_s * 1e9).astype("u4")
        write_pcd(directory / decimal_name(stamp_ns), cloud, t=nanoseconds)
    return directory


def rows_of(frames: Path, out: Path, live: bool, *arguments: str | Path) -> Traj:
    if live:
        code, _, said = feed(b"".join(messages(lidar=frames)), out, *ENDLESS, *arguments)
        assert code == 0, said
    else:
        track([f"lidar={frames}"], out, *arguments)
    return read_traj(out)


@pytest.fixture(scope="module")
def flight() -> Flight:
    return make_flight(frames=FRAMES)


@pytest.mark.parametrize("live", [False, True], ids=["recording", "stream"])
@pytest.mark.parametrize("name", CARRIERS)
def test_a_lidar_that_moves_gives_the_rows_of_one_at_rest(name, live, flight, tmp_path, program):
    rest = rows_of(written(tmp_path / "rest", flight), tmp_path / "rest.csv", live)
    assert len(rest) > 30
    poses = poses_of(name)
    write_poses(tmp_path / "way.tum", poses, name)
    frames = written(tmp_path / "lidar", seen_from(poses, flight))
    moved = rows_of(frames, tmp_path / "moved.csv", live, "--poses", tmp_path / "way.tum")
    assert set(moved.track_id) == set(rest.track_id) == {0}
    both = sorted(set(moved.stamps) & set(rest.stamps))
    assert len(both) > 0.95 * len(rest)
    assert len(moved) < 1.05 * len(rest)
    at = [[traj.stamps.index(stamp) for stamp in both] for traj in (moved, rest)]
    assert rmse_m(moved.position_m[at[0]], rest.position_m[at[1]]) < 0.1
    assert rmse_m(moved.position_m, truth_m(moved.time_s)) < 0.15


@pytest.mark.parametrize("live", [False, True], ids=["recording", "stream"])
@pytest.mark.parametrize("name", CARRIERS)
def test_where_nobody_flies_nothing_is_found_however_the_lidar_moves(name, live, tmp_path, program):
    poses = poses_of(name)
    write_poses(tmp_path / "way.tum", poses, name)
    empty = seen_from(poses, make_flight(seed=5, frames=FRAMES, drone=False))
    frames = written(tmp_path / "lidar", empty)
    rows_of(frames, tmp_path / "out.csv", live, "--poses", f"lidar={tmp_path / 'way.tum'}")
    assert (tmp_path / "out.csv").read_text() == NO_DRONE_TRAJ


def test_poses_are_of_the_carrier_on_which_the_lidar_is_mounted(flight, tmp_path, program):
    poses = poses_of("drone")
    write_poses(tmp_path / "way.tum", poses, "drone")
    option = "--poses", tmp_path / "way.tum"
    plain = written(tmp_path / "plain", seen_from(poses, flight))
    turned = written(tmp_path / "turned", seen_from(poses, flight, mounted=True))
    expected = rows_of(plain, tmp_path / "plain.csv", False, *option)
    found = rows_of(turned, tmp_path / "turned.csv", False, *option, *MOUNTED)
    assert found.stamps == expected.stamps
    assert rmse_m(found.position_m, expected.position_m) < 0.02


def test_frames_without_poses_are_left_out_and_counted(flight, tmp_path, program):
    """Before the first, after the last, and in a gap of more than a second."""
    poses = poses_of("gimbal")
    time_s = (poses.stamp_ns - BEGIN_NS) * 1e-9
    known = (time_s > 1.04) & (time_s < 9.04) & ~((time_s > 5.04) & (time_s < 6.54))
    some = Poses(poses.stamp_ns[known], poses.position_m[known], poses.rotation[known])
    write_poses(tmp_path / "some.tum", some, "with a gap")
    frames = written(tmp_path / "lidar", seen_from(poses, flight))
    summary = tmp_path / "summary.json"
    said = track(
        [f"lidar={frames}"], tmp_path / "out.csv",
        "--poses", tmp_path / "some.tum", "--summary", summary,
    )  # fmt: skip
    assert "warning" in said
    known = json.loads(summary.read_text())
    # Frames of a tenth of a second: 0 to 1.1 s, 5.0 to 6.6 s, 9.0 to 10 s.
    assert known["counts"]["unplaced_frames"] == 11 + 16 + 10
    assert known["counts"]["frames"] == FRAMES - 37
    assert "frames_without_pose" in {warning["code"] for warning in known["warnings"]}
    rows = read_traj(tmp_path / "out.csv")
    assert rmse_m(rows.position_m, truth_m(rows.time_s)) < 0.3


STAMP = f"{BEGIN_NS // 10**9}"
GOOD = f"{STAMP}.1 1 2 3 0 0 0 1\n"
BAD = {
    "absent": (None, "way.tum"),
    "empty": ("# nothing\n\n", "0 poses"),
    "one": (GOOD, "1 pose"),
    "short": (GOOD + f"{STAMP}.2 1 2 3 0 0 0\n", "way.tum:2: "),
    "long": (GOOD + f"{STAMP}.2 1 2 3 0 0 0 1 7\n", "way.tum:2: '7'"),
    "word": (GOOD + f"{STAMP}.2 1 two 3 0 0 0 1\n", "way.tum:2: 'two'"),
    "nan": (GOOD + f"{STAMP}.2 1 nan 3 0 0 0 1\n", "way.tum:2: 'nan'"),
    "stamp": (GOOD + "soon 1 2 3 0 0 0 1\n", "way.tum:2: 'soon'"),
    "descending": (GOOD + f"# one\n{STAMP}.05 1 2 3 0 0 0 1\n", "way.tum:3: "),
    "repeated": (GOOD + GOOD, "way.tum:2: "),
    "no rotation": (GOOD + f"{STAMP}.2 1 2 3 0 0 0 0\n", "way.tum:2: "),
    "no unit": (GOOD + f"{STAMP}.2 1 2 3 0 0 1 1\n", "way.tum:2: "),
}


@pytest.mark.parametrize("live", [False, True], ids=["recording", "stream"])
@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_of_poses_is_refused_by_file_line_and_value(name, live, tmp_path, program):
    text, said = BAD[name]
    way = tmp_path / "way.tum"
    if text is not None:
        way.write_text(text)
    frames = written(tmp_path / "lidar", make_flight(frames=2))
    source = ["--stdin"] if live else ["--frames", frames]
    done = run_program(*source, "--out", tmp_path / "out.csv", "--poses", way)
    assert done.returncode == 4, done.stderr
    (line,) = done.stderr.splitlines()
    assert str(way) in line
    assert said in line
    assert "expected" in line or text is None
    assert not (tmp_path / "out.csv").exists()


def test_poses_of_a_lidar_that_is_not_there_and_twice_for_one_are_wrong_usage(tmp_path, program):
    way = tmp_path / "way.tum"
    way.write_text(GOOD + GOOD.replace(".1 ", ".2 "))
    frames = written(tmp_path / "lidar", make_flight(frames=2))
    for options, said in (
        (["--poses", f"other={way}"], "other"),
        (["--poses", f"lidar={way}", "--poses", f"lidar={way}"], "twice"),
        (["--poses", way, "--poses", way], "twice"),
        (["--poses", ""], "--poses"),
    ):
        done = run_program("--frames", frames, "--out", tmp_path / "out.csv", *options)
        assert done.returncode == 2
        assert said in done.stderr


@pytest.mark.parametrize("by", ["beside", "option"])
def test_unlidar_run_and_explain_move_the_lidar(
    by, flight, tmp_path, program, monkeypatch, explained
):
    monkeypatch.setenv("UNLIDAR_TRACK", str(program))
    poses = poses_of("drone")
    recording = tmp_path / "recording"
    written(recording / "lidar", seen_from(poses, flight))
    times_s = (np.array(flight.stamps_ns) - BEGIN_NS) * 1e-9
    stamps_s = np.array(flight.stamps_ns) * 1e-9
    truth = np.column_stack([stamps_s, truth_m(times_s, 0.0)])
    np.savetxt(
        recording / "ground_truth.csv", truth, "%.6f", ",", header="timestamp,x,y,z", comments=""
    )
    way = recording / "poses.tum" if by == "beside" else tmp_path / "way.tum"
    write_poses(way, poses, "drone")
    options = [] if by == "beside" else ["--poses", str(way)]
    run = tmp_path / "run"
    assert main(["run", str(recording), "--out", str(run), "--live", *options]) == 0
    measures = json.loads((run / "evaluation.json").read_text())
    assert measures["within1m"] > 0.95
    assert measures["tracks"] == 1
    live = read_traj(run / "live.csv")
    assert rmse_m(live.position_m, truth_m(live.time_s)) < 0.3
    # The page knows the program's returns of the target by their place in the world.
    sample = load_run(run).sample
    assert sample.targets > 300
    assert np.isfinite(sample.target_s).mean() > 0.99
    # And every second of the flight has returns near the truth.
    (told,) = explained(run)
    print(told)
    assert all(part["evidence"]["returns"] > 0 for part in told["runs"])


@pytest.mark.parametrize("given", ["file", "named file", "poses", "named poses", "recording"])
def test_track_and_engine_take_the_poses(given, flight, tmp_path, program):
    poses = poses_of("car")
    way = tmp_path / "way.tum"
    write_poses(way, poses, "car")
    moving = seen_from(poses, flight)
    clouds = [
        ("lidar", stamp_ns, cloud, np.rint(times_s * 1e9).astype("i8"))
        for stamp_ns, cloud, times_s in zip(
            moving.stamps_ns, moving.clouds, moving.times_s, strict=True
        )
    ]
    folder = tmp_path / "recording" / "lidar"
    moved = rows_of(written(folder, moving), tmp_path / "m.csv", False, "--poses", way)
    if given == "recording":
        shutil.copy(way, folder.parent / "poses.tum")
        frames = unlidar.read(folder.parent)
        given_poses = frames.poses
        assert list(given_poses) == ["lidar"]
        (found,) = unlidar.track(frames)
    else:
        given_poses = way if "file" in given else poses
        if "named" in given:
            given_poses = {"lidar": given_poses}
        (found,) = unlidar.track(clouds, poses=given_poses)
    assert found.rows["timestamp_ns"].tolist() == [
        int(stamp.replace(".", "")) for stamp in moved.stamps
    ]
    np.testing.assert_allclose(found.rows["x"], moved.position_m[:, 0], atol=1e-6)
    engine = unlidar.Engine(poses=given_poses)
    events = [event for frame in clouds for event in engine.add(*frame)] + engine.close()
    rows = [event for event in events if isinstance(event, unlidar.Row)]
    assert len(rows) >= 0.95 * len(moved)
    times_s = np.array([row.timestamp / 1e9 for row in rows])
    assert rmse_m(np.array([(row.x, row.y, row.z) for row in rows]), truth_m(times_s)) < 0.15


def test_bad_poses_are_refused_by_name(tmp_path, program):
    poses = poses_of("car")
    with pytest.raises(unlidar.InputError, match=r"missing\.tum"):
        unlidar.Engine(poses=tmp_path / "missing.tum")
    with pytest.raises(unlidar.UsageError, match=r"^poses: 3, expected the name of a sensor"):
        unlidar.Engine(poses={3: poses})
    backwards = replace(poses, stamp_ns=poses.stamp_ns[::-1])
    with pytest.raises(unlidar.InputError, match=r"^poses of 'a', pose 1: .*rising stamps"):
        unlidar.Engine(poses={"a": backwards})
    lone = unlidar.Poses(poses.stamp_ns[:1], poses.position_m[:1], poses.rotation[:1])
    with pytest.raises(unlidar.InputError, match=r"^poses: 1 pose, expected at least two"):
        unlidar.Engine(poses=lone)
    with pytest.raises(unlidar.InputError, match=r"shape \(n,\) and dtype int64"):
        unlidar.Engine(poses=replace(poses, stamp_ns=poses.stamp_ns.astype(float)))
    with pytest.raises(unlidar.UsageError, match=r"^poses: 3, expected a TUM file"):
        unlidar.Engine(poses=3)
