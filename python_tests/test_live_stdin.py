"""`--stdin`, as the program that feeds it relies on it."""

from __future__ import annotations

import itertools
import json
import signal
from pathlib import Path

import numpy as np
import pytest
from live_program import (
    ENDLESS,
    Live,
    by_stamp,
    events_of,
    feed,
    message,
    messages,
    pieces,
    rows_of,
    unread_bytes,
    wait_until,
    write_two_sensors,
)
from synthetic import (
    BEGIN_NS,
    NO_DRONE_TRAJ,
    Flight,
    make_flight,
    read_traj,
    rmse_m,
    run_program,
    track,
    truth_m,
    write_frames,
    write_pcd,
)


@pytest.fixture(scope="module")
def flight() -> Flight:
    return make_flight()


@pytest.fixture(scope="module")
def frames(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_frames(tmp_path_factory.mktemp("flight") / "lidar", flight)


@pytest.fixture(scope="module")
def stream(frames: Path) -> list[bytes]:
    return messages(lidar=frames)


@pytest.fixture(scope="module")
def whole(frames: Path, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Trajectory of the flight as a recording."""
    out = tmp_path_factory.mktemp("whole") / "traj.csv"
    track([f"lidar={frames}"], out)
    return out.read_bytes()


@pytest.fixture(scope="module")
def plain(stream: list[bytes], tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, str]:
    """Trajectory and events of the flight with default settings."""
    folder = tmp_path_factory.mktemp("plain")
    code, out, said = feed(b"".join(stream), folder / "traj.csv", "--events", "-")
    assert code == 0, said
    return (folder / "traj.csv").read_bytes(), out


# --- the law ----------------------------------------------------------------------------------


def test_an_endless_window_and_delay_give_what_a_recording_gives(
    frames: Path, stream: list[bytes], tmp_path: Path
) -> None:
    for options in ([], ["--rate", "7"], ["--set", "input.stamp=end"]):
        track([f"lidar={frames}"], tmp_path / "batch.csv", *options)
        (tmp_path / "live.csv").unlink(missing_ok=True)
        code, _, said = feed(b"".join(stream), tmp_path / "live.csv", *ENDLESS, *options)
        assert code == 0, said
        assert (tmp_path / "live.csv").read_bytes() == (tmp_path / "batch.csv").read_bytes()
        assert len(rows_of(tmp_path / "live.csv")) > 20


def test_summaries_of_both_have_the_report_of_ceres_and_live_ones_have_none(
    frames: Path, stream: list[bytes], tmp_path: Path
) -> None:
    def splines(summary: Path) -> list[dict | None]:
        return [t.get("spline") for t in json.loads(summary.read_text())["tracks"]]

    track([f"lidar={frames}"], tmp_path / "a.csv", "--summary", tmp_path / "a.json")
    for name, options in (("b", ENDLESS), ("c", [])):
        summary = ("--summary", tmp_path / f"{name}.json")
        code, _, said = feed(b"".join(stream), tmp_path / f"{name}.csv", *options, *summary)
        assert code == 0, said
    (spline,) = splines(tmp_path / "a.json")
    assert spline["solver"] == "ceres" and spline["termination"] == "CONVERGENCE"
    assert spline["iterations"] > 0
    assert 0 < spline["final_cost"] <= spline["initial_cost"]
    assert splines(tmp_path / "b.json") == [spline]
    assert splines(tmp_path / "c.json") == [None]


def test_so_do_frames_of_several_sensors_with_poses_and_clocks(
    flight: Flight, tmp_path: Path
) -> None:
    folders = write_two_sensors(tmp_path, flight)
    pose = [
        *("--set", "sensors.right.translation_m=[1, 2, 0.5]", "--set", "sensors.left.rotation="),
        *("--set", "sensors.right.time_offset_s=0.01"),
    ]
    pose[3] += "[0, 0, 0.6, 0.8]"
    track([f"{name}={folder}" for name, folder in folders.items()], tmp_path / "a.csv", *pose)
    data = b"".join(messages(**folders))
    code, _, said = feed(data, tmp_path / "b.csv", *ENDLESS, *pose)
    assert code == 0, said
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_so_do_frames_with_point_times_and_rows_that_are_no_returns(
    flight: Flight, tmp_path: Path
) -> None:
    frames = tmp_path / "lidar"
    frames.mkdir()
    for stamp_ns, cloud, times_s in zip(
        flight.stamps_ns, flight.clouds, flight.times_s, strict=True
    ):
        points = cloud.copy()
        points[::50] = 0
        points[7::90] = np.nan
        write_pcd(frames / f"{stamp_ns}.pcd", points, t=(times_s * 1e9).astype(np.uint32))
    track([f"lidar={frames}"], tmp_path / "a.csv")
    data = b"".join(messages(lidar=frames))
    code, _, said = feed(data, tmp_path / "b.csv", *ENDLESS)
    assert code == 0, said
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


@pytest.mark.parametrize("scenario", ["near", "two", "empty_sky"])
def test_so_do_simulated_scenes(scenario: str, tmp_path: Path, program: Path) -> None:
    from unlidar.simulate import load_scenario, simulate

    known = load_scenario(scenario)
    simulate(known, tmp_path / "scene", seed=3)
    folders = {f.name: f for f in sorted((tmp_path / "scene").iterdir()) if f.is_dir()}
    first = min(folders, key=lambda name: float(by_stamp(folders[name])[0].stem))
    order = [first, *(name for name in folders if name != first)]
    track([f"{name}={folders[name]}" for name in order], tmp_path / "a.csv")
    data = b"".join(messages(**{name: folders[name] for name in order}))
    code, _, said = feed(data, tmp_path / "b.csv", *ENDLESS)
    assert code == 0, said
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


# --- time is that of the stamps -----------------------------------------------------------------


@pytest.mark.parametrize("size", [97, 4096, 1_000_003])
def test_pieces_of_any_size_give_the_same_rows_and_events(
    size: int, stream: list[bytes], plain: tuple[bytes, str], tmp_path: Path
) -> None:
    data = b"".join(stream)
    with Live("--stdin", "--out", tmp_path / "traj.csv", "--events", tmp_path / "events") as live:
        for piece in pieces(data, size):
            live.send(piece)
        code, _, said = live.end()
    assert code == 0, said
    assert (tmp_path / "traj.csv").read_bytes() == plain[0]
    assert (tmp_path / "events").read_text() == plain[1]


def test_frames_that_come_slowly_give_the_same_rows(
    stream: list[bytes], plain: tuple[bytes, str], tmp_path: Path
) -> None:
    with Live("--stdin", "--out", tmp_path / "traj.csv") as live:
        for k, data in enumerate(stream):
            half = len(data) // 2
            live.send(data[:half])
            signal.sigtimedwait([], 0.05 if k % 10 == 0 else 0.0)
            live.send(data[half:])
        code, _, said = live.end()
    assert code == 0, said
    assert (tmp_path / "traj.csv").read_bytes() == plain[0]


def test_frames_that_are_late_by_less_than_reorder_s_change_nothing(
    stream: list[bytes], plain: tuple[bytes, str], tmp_path: Path
) -> None:
    shuffled = list(stream)
    for i in range(1, len(shuffled) - 2, 3):
        shuffled[i : i + 3] = reversed(shuffled[i : i + 3])
    assert shuffled != stream
    code, _, said = feed(b"".join(shuffled), tmp_path / "traj.csv")
    assert code == 0, said
    assert (tmp_path / "traj.csv").read_bytes() == plain[0]
    assert "later than live.reorder_s" not in said


def test_later_frames_are_counted_and_dropped(stream: list[bytes], tmp_path: Path) -> None:
    late = stream[:20] + stream[21:35] + [stream[20]] + stream[35:]
    code, out, said = feed(b"".join(late), tmp_path / "a.csv", "--events", "-")
    assert code == 0, said
    assert "1 frame later than live.reorder_s and dropped" in said
    code, _, _ = feed(b"".join(stream[:20] + stream[21:]), tmp_path / "b.csv")
    assert code == 0
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    last = [e for e in events_of(out) if e["event"] == "state"][-1]
    assert last["frames"] == len(stream) - 1
    assert last["dropped"] == 1


# --- clocks ---------------------------------------------------------------------------------------


def said_of(data: list[bytes], out: Path) -> tuple[str, dict]:
    """Standard error and the counts of a run that ends well."""
    summary = out.with_suffix(".json")
    code, _, said = feed(b"".join(data), out, "--summary", summary)
    assert code == 0, said
    return said, json.loads(summary.read_text())["counts"]


@pytest.mark.parametrize("glitch_s", ["3960000000.0", "1706300021.5", "1706300065.0", "12.0"])
def test_a_sensor_that_glitches_and_dies_costs_no_row(
    glitch_s: str, stream: list[bytes], plain: tuple[bytes, str], tmp_path: Path
) -> None:
    glitch = message("other", glitch_s, stream[20].partition(b"\n")[2])
    said, counts = said_of([*stream[:20], glitch, *stream[20:]], tmp_path / "traj.csv")
    assert (tmp_path / "traj.csv").read_bytes() == plain[0]
    assert counts["late_frames"] == 0
    assert counts["astray_frames"] == 1
    assert "1 frame astray and left out: the clock of other is " in said


def test_a_glitch_before_the_first_frame_is_outvoted(
    stream: list[bytes], plain: tuple[bytes, str], tmp_path: Path
) -> None:
    glitch = message("other", "3960000000.0", stream[0].partition(b"\n")[2])
    said, counts = said_of([glitch, *stream], tmp_path / "traj.csv")
    rows = (tmp_path / "traj.csv").read_text().splitlines()
    expected = plain[0].decode().splitlines()
    assert counts["late_frames"] == counts["astray_frames"] == 0
    assert "begins anew" in said
    # Output times are those of the other for as long as it may be silent.
    assert len(rows) > len(expected) - 25
    assert [row.split(",")[0] for row in rows][-20:] == [r.split(",")[0] for r in expected][-20:]


@pytest.mark.parametrize("apart_s", [-7200, -3, 3, 7200])
def test_sensors_whose_clocks_are_apart_do_not_stop_each_other(
    apart_s: int, stream: list[bytes], plain: tuple[bytes, str], tmp_path: Path
) -> None:
    both = []
    for one in stream:
        head, _, pcd = one.partition(b"\n")
        both += [one, message("other", f"{float(head.split()[2]) + apart_s:.6f}", pcd)]
    said, counts = said_of(both, tmp_path / "traj.csv")
    assert (tmp_path / "traj.csv").read_bytes() == plain[0]
    _, events, _ = feed(b"".join(both), tmp_path / "again.csv", "--events", "-")
    told = [json.loads(line) for line in events.splitlines()]
    assert [e["state"] for e in told if e.get("name") == "other"] == ["silent"]
    assert counts["late_frames"] + counts["astray_frames"] == len(stream)
    assert "dropped" in said or "the clock of other is" in said


def test_a_pause_loses_no_frame(stream: list[bytes], tmp_path: Path) -> None:
    data = []
    for k, one in enumerate(stream):
        head, _, pcd = one.partition(b"\n")
        data.append(message("lidar", f"{float(head.split()[2]) + (20 if k > 30 else 0):.6f}", pcd))
    _, counts = said_of(data, tmp_path / "traj.csv")
    assert counts["frames"] == len(stream)
    assert counts["late_frames"] == counts["astray_frames"] == 0


# --- a trajectory that is there -------------------------------------------------------------------


def test_a_trajectory_of_later_rows_is_left_alone_and_one_of_earlier_rows_goes_on(
    stream: list[bytes], plain: tuple[bytes, str], tmp_path: Path
) -> None:
    header, first, *_ = plain[0].decode().splitlines(keepends=True)
    out, events = tmp_path / "traj.csv", tmp_path / "events.jsonl"
    later = header + "1706390000.0" + first[first.index(",") :]
    out.write_text(later)
    code, _, said = feed(b"".join(stream), out, "--events", events)
    assert code == 5
    assert "holds rows until 1706390000.000000000, and those of stdin begin before" in said
    assert len(said.splitlines()[-1]) <= 250
    assert out.read_text() == later
    told = events.read_text()
    assert '"warming_up"' in told and '"track"' not in told
    earlier = header + "1706200000.0" + first[first.index(",") :]
    out.write_text(earlier)
    said, _ = said_of(stream, out)
    assert "appends to it, it holds rows until 1706200000.000000000" in said
    assert len(rows_of(out)) == len(plain[0].splitlines())
    once = out.read_bytes()
    code, _, said = feed(b"".join(stream), out)  # the same once more
    assert code == 5 and "those of stdin begin before" in said
    assert out.read_bytes() == once


# --- rows and events ----------------------------------------------------------------------------


def test_the_drone_is_tracked(plain: tuple[bytes, str], tmp_path: Path) -> None:
    (tmp_path / "traj.csv").write_bytes(plain[0])
    traj = read_traj(tmp_path / "traj.csv")
    assert set(traj.track_id) == {0}
    assert len(traj) > 25
    assert rmse_m(traj.position_m, truth_m(traj.time_s)) < 0.25
    assert (np.diff(traj.time_s) > 0).all()


def test_rows_are_there_before_the_stream_ends(stream: list[bytes], tmp_path: Path) -> None:
    with Live("--stdin", "--out", tmp_path / "traj.csv", "--events", tmp_path / "events") as live:
        trajectory = tmp_path / "traj.csv"  # there a moment before its header
        wait_until(lambda: trajectory.exists() and trajectory.read_text(), "the header is there")
        assert trajectory.read_text() == NO_DRONE_TRAJ
        live.send(b"".join(stream))
        wait_until(lambda: len(rows_of(tmp_path / "traj.csv")) > 20, "rows are there")
        before = (tmp_path / "traj.csv").read_bytes()
        code, _, said = live.end()
    assert code == 0, said
    assert (tmp_path / "traj.csv").read_bytes().startswith(before)


def test_rows_of_a_confirmed_track_come_within_the_delay(plain: tuple[bytes, str]) -> None:
    rows = [e for e in events_of(plain[1]) if e["event"] == "row"]
    in_time = [e for e in rows if not e["late"]]
    assert len(in_time) > 15
    assert max(e["at"] - e["timestamp"] for e in in_time) < 1.0 + 0.1 + 1e-6
    for e in rows:
        if e["late"]:
            assert e["at"] - e["timestamp"] > 1.0


def test_events_report_the_rows_of_the_trajectory_and_their_track(plain: tuple[bytes, str]) -> None:
    events = events_of(plain[1])
    kinds = [e["event"] for e in events]
    assert kinds.count("track") == 1 and kinds.count("end") == 1
    assert kinds.index("track") < kinds.index("row")
    assert len(kinds) - 1 - kinds[::-1].index("row") < kinds.index("end")
    told = [
        ",".join(
            f"{e[key]:.9f}" if key == "timestamp" else str(e[key]) if key in ("track", "support")
            else f"{e[key]:.6f}"
            for key in ("timestamp", "track", "x", "y", "z", "vx", "vy", "vz", "sigma_x",
                        "sigma_y", "sigma_z", "support")
        ).split(",", 1)[1]
        for e in events if e["event"] == "row"
    ]  # fmt: skip
    written = [line.split(",", 1)[1] for line in plain[0].decode().splitlines()[1:]]
    assert told == written
    confirmed = events[kinds.index("track")]
    assert confirmed["first_evidence"] <= confirmed["at"]


def test_events_report_sensors_and_states(plain: tuple[bytes, str]) -> None:
    events = events_of(plain[1])
    assert [(e["name"], e["state"]) for e in events if e["event"] == "sensor"] == [("lidar", "ok")]
    states = [e["state"] for e in events if e["event"] == "state"]
    assert states[0] == "warming_up"
    assert set(states) <= {"warming_up", "running"}


def test_a_sensor_that_falls_silent_is_reported_by_the_stamps(
    flight: Flight, tmp_path: Path
) -> None:
    folders = write_two_sensors(tmp_path, flight)
    right = by_stamp(folders["right"])
    for path in right[10:45]:
        path.unlink()
    code, out, said = feed(b"".join(messages(**folders)), tmp_path / "o.csv", "--events", "-")
    assert code == 0, said
    told = [(e["name"], e["state"]) for e in events_of(out) if e["event"] == "sensor"]
    assert told == [("left", "ok"), ("right", "ok"), ("right", "silent"), ("right", "ok")]
    silent = next(e for e in events_of(out) if e.get("state") == "silent")
    assert 2.0 <= silent["at"] - float(right[9].stem) < 2.2


def write_yard(folder: Path, covered_from: int) -> list[Path]:
    """15 s in a round yard with a wall; from some frame on nothing returns."""
    rng = np.random.default_rng(1)
    folder.mkdir(parents=True)
    paths = [folder / f"{1_706_300_000 + i / 10:.6f}.pcd" for i in range(150)]
    for i, path in enumerate(paths):
        azimuth = rng.uniform(-np.pi, np.pi, 0 if i >= covered_from else 800)
        wall = [20 * np.cos(azimuth), 20 * np.sin(azimuth), rng.uniform(-2, 4, len(azimuth))]
        write_pcd(path, np.stack(wall, axis=1))
    return paths


def test_a_covered_window_is_reported_live_and_of_a_recording(tmp_path: Path) -> None:
    folders = {"left": tmp_path / "left", "right": tmp_path / "right"}
    write_yard(folders["left"], 150)
    right = write_yard(folders["right"], 80)
    options = ("--events", "-", "--summary", tmp_path / "live.json")
    code, out, said = feed(b"".join(messages(**folders)), tmp_path / "o.csv", *options)
    assert code == 0, said
    told = [(e["name"], e["state"]) for e in events_of(out) if e["event"] == "sensor"]
    assert told == [("left", "ok"), ("right", "ok"), ("right", "blinded")]
    blinded = next(e for e in events_of(out) if e.get("state") == "blinded")
    assert 2.5 <= blinded["at"] - float(right[79].stem) <= 4.5
    assert said.count("right: blinded: ") == 1
    sources = [f"{name}={folder}" for name, folder in folders.items()]
    said = track(sources, tmp_path / "batch.csv", "--summary", tmp_path / "batch.json")
    assert said.count("right: blinded for ") == 1
    for kind in ("live", "batch"):
        inputs = json.loads((tmp_path / f"{kind}.json").read_text())["inputs"]
        assert [i["blinded_s"] > 0 for i in inputs] == [False, True]


def test_summary_accounts_for_every_frame(stream: list[bytes], tmp_path: Path) -> None:
    data = b"".join([*stream[:30], *stream[31:50], stream[30], *stream[50:]])
    data += message("lidar", "1706300999.0", b"no PCD")
    options = ("--set", "input.skip_bad_frames=true", "--summary", tmp_path / "s.json")
    code, _, said = feed(data, tmp_path / "o.csv", *options)
    assert code == 0, said
    summary = json.loads((tmp_path / "s.json").read_text())
    counts = summary["counts"]
    assert (counts["frames"], counts["late_frames"], counts["bad_frames"]) == (59, 1, 1)
    assert summary["inputs"] == [
        {"name": "lidar", "directory": "", "frames": 60, "blinded_s": 0.0, "sway_deg": 0.0}
    ]
    assert counts["trajectory_rows"] == sum(t["rows"] for t in summary["tracks"])
    assert counts["trajectory_rows"] == len(rows_of(tmp_path / "o.csv"))
    assert summary["config"]["live"]["delay_s"] == 1.0
    times = summary["frame_cpu_ms"]
    assert 0 < times["p50"] <= times["p99"] <= times["max"]


# --- ends ---------------------------------------------------------------------------------------


def test_an_empty_stream_gives_the_header_and_one_line_on_stderr(tmp_path: Path) -> None:
    code, out, said = feed(b"", tmp_path / "traj.csv")
    assert code == 0
    assert (tmp_path / "traj.csv").read_text() == NO_DRONE_TRAJ
    assert len(said.splitlines()) == 1, said
    assert out.startswith(f"{tmp_path / 'traj.csv'}: 0 tracks, 0 rows, from 0 frames")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("options", [(), ENDLESS])
def test_a_signal_writes_what_is_pending(
    number: signal.Signals, options: tuple[str, ...], stream: list[bytes], tmp_path: Path
) -> None:
    half_a_message = stream[-1][: len(stream[-1]) // 2]
    with Live("--stdin", "--out", tmp_path / "traj.csv", "--events", "-", *options) as live:
        live.send(b"".join(stream[:-1]) + half_a_message)
        wait_until(lambda: unread_bytes(live) == 0, "all is read")
        code, out, said = live.end(number)
    assert code == 0, said
    code, _, _ = feed(b"".join(stream[:-1]), tmp_path / "whole.csv", *options)
    assert code == 0
    assert (tmp_path / "traj.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()
    assert '"event":"end"' in out


def test_a_reader_that_leaves_ends_it(stream: list[bytes], tmp_path: Path) -> None:
    with Live("--stdin", "--out", tmp_path / "traj.csv", "--events", "-") as live:
        live.process.stdout.close()
        assert live.process.wait(30) == 5
        assert b"error: " in live.process.stderr.read()


# --- what is wrong ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("tail", "expected"),
    [
        (b"frame lidar 1706300009.5 1000\nabc", "message 61 ends after 3 bytes"),
        (b"frame lidar", "message 61 ends within its line: 'frame lidar'"),
        (b"\x00\x01\x02\x03 garbage\n", "message 61 begins with '???? garbage'"),
        (b"frame lidar soon 3\nabc", "message 61 has the STAMP 'soon'"),
        (b"frame lidar 1706300009.5 -3\nabc", "message 61 has the LENGTH '-3'"),
        (b"frame lidar 1706300009.5 99999999999\n", "message 61 has the LENGTH '99999999999'"),
        (b"frame ../x 1706300009.5 3\nabc", "message 61 has the NAME '../x'"),
        (b"frame lidar 1706300009.5\n", "message 61 has the line 'frame lidar 1706300009.5'"),
        (b"x" * 100_000, "message 61 begins with 'xxx"),
        (b"frame " + b"x" * 100_000, "no newline within 512 bytes"),
        (b"frame lidar 1706300009.5 3\nabc", "message 61 (lidar 1706300009.5): "),
    ],
)
def test_a_broken_stream_is_reported_in_one_line_after_what_was_pending(
    tail: bytes, expected: str, stream: list[bytes], whole: bytes, tmp_path: Path
) -> None:
    code, _, said = feed(b"".join(stream) + tail, tmp_path / "traj.csv", *ENDLESS)
    assert code == 4
    assert len(said.splitlines()) == 1, said
    assert said.startswith("unlidar_track: error: stdin: ")
    assert expected in said
    assert ", expected " in said
    assert (tmp_path / "traj.csv").read_bytes() == whole


def test_frames_that_cannot_be_decoded_may_be_skipped(
    stream: list[bytes], whole: bytes, tmp_path: Path
) -> None:
    bad = [message("lidar", f"17063000{n:02d}.5", b"# .PCD v0.7\nrubbish") for n in range(10)]
    mixed = list(itertools.chain(*zip(stream[:10], bad, strict=True))) + stream[10:]
    skip = ("--set", "input.skip_bad_frames=true")
    code, _, said = feed(b"".join(mixed), tmp_path / "traj.csv", *skip, *ENDLESS)
    assert code == 0
    assert "10 frames could not be parsed and skipped (input.skip_bad_frames)" in said
    assert len(said.splitlines()) < 8
    assert (tmp_path / "traj.csv").read_bytes() == whole


def test_a_stamp_that_comes_twice_is_an_error_or_skipped(
    stream: list[bytes], whole: bytes, tmp_path: Path
) -> None:
    data = b"".join([*stream[:5], stream[4], *stream[5:]])
    code, _, said = feed(data, tmp_path / "a.csv")
    assert code == 4
    assert "message 6" in said
    skip = ("--set", "input.skip_bad_frames=true")
    code, _, said = feed(data, tmp_path / "b.csv", *skip, *ENDLESS)
    assert code == 0, said
    assert (tmp_path / "b.csv").read_bytes() == whole


def test_the_number_of_sensors_is_bounded(stream: list[bytes], tmp_path: Path) -> None:
    pcd = stream[0].partition(b"\n")[2]
    data = b"".join(message(f"s{n}", f"170630000{n % 10}.5", pcd) for n in range(65))
    code, _, said = feed(data, tmp_path / "traj.csv")
    assert code == 4
    assert "message 65" in said and "expected at most 64" in said


def test_more_frames_than_may_wait_for_their_order_are_left_out_and_said(tmp_path: Path) -> None:
    write_pcd(tmp_path / "empty.pcd", np.zeros((0, 3), np.float32))
    pcd = (tmp_path / "empty.pcd").read_bytes()
    stream = b"".join(message("a", str(BEGIN_NS + k), pcd) for k in range(5000))
    summary = tmp_path / "summary.json"
    code, _, said = feed(stream, tmp_path / "traj.csv", "--summary", str(summary))
    assert code == 0, said
    counts = json.loads(summary.read_text())["counts"]
    assert counts["surplus_frames"] > 800
    assert counts["frames"] + counts["surplus_frames"] == 5000
    assert "left out: more than may wait for live.reorder_s" in said


def test_a_sensor_that_the_config_does_not_name_is_said(
    stream: list[bytes], tmp_path: Path
) -> None:
    pose = ("--set", "sensors.lidr.time_offset_s=0.5")
    code, _, said = feed(b"".join(stream), tmp_path / "traj.csv", *pose, *ENDLESS)
    assert code == 0
    assert "the config has no sensors.lidar" in said


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--stdin", "--follow", "--frames", "f"], "excludes"),
        (["--stdin", "--frames", "f"], "--frames f: expected none with --stdin"),
        (["--follow"], "--frames is required"),
        ([], "--frames is required"),
        (["--frames", "f", "--events", "-"], "--events -: expected with --follow, --stdin or"),
        (["--stdin", "--at", "stamps.csv"], "--at stamps.csv: not with --stdin"),
        (["--stdin", "--clusters", "c.csv"], "--clusters c.csv: not with --stdin"),
        (["--stdin", "--points", "p.pcd"], "--points p.pcd: not with --stdin"),
        (["--stdin", "--format", "tum"], "--format tum: not with --stdin"),
        (["--stdin", "--rate", "0"], "--rate '0'"),
        (["--follow", "--frames", "f", "--at", "s"], "--at s: not with --follow"),
        (["--stdin", "--events", "traj.csv"], "the same file as --out"),
    ],
)
def test_what_does_not_go_together_is_refused(
    options: list[str], expected: str, tmp_path: Path
) -> None:
    result = run_program(*options, "--out", "traj.csv", cwd=tmp_path)
    assert result.returncode == 2, result.stderr
    assert expected in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_stdout_is_for_one_output(tmp_path: Path) -> None:
    code, out, said = feed(b"", Path("/dev/stdout"), "--events", "-")
    assert (code, out) == (2, "")
    assert "stdout holds nothing but the events" in said
    code, out, said = feed(b"", Path("/dev/stdout"), "--quiet")
    assert (code, out) == (0, NO_DRONE_TRAJ), said


def test_the_papers_score_needs_the_whole_stream(
    frames: Path, stream: list[bytes], tmp_path: Path
) -> None:
    paper = ("--set", "method=paper")
    code, _, said = feed(b"".join(stream), tmp_path / "a.csv", *paper)
    assert code == 3
    assert "method: 'paper', expected robust" in said
    assert not (tmp_path / "a.csv").exists()
    code, _, said = feed(b"".join(stream), tmp_path / "b.csv", *paper, *ENDLESS)
    assert code == 0, said
    track([f"lidar={frames}"], tmp_path / "c.csv", *paper)
    assert (tmp_path / "b.csv").read_bytes() == (tmp_path / "c.csv").read_bytes()
