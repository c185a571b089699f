"""`--follow`, as the recorder beside it and the reader of its outputs rely on it."""

from __future__ import annotations

import itertools
import json
import os
import re
import shutil
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from live_program import (
    ENDLESS,
    Live,
    by_stamp,
    events_of,
    feed,
    messages,
    move_into,
    rows_of,
    wait_until,
    write_two_sensors,
)
from synthetic import (
    BEGIN_NS,
    NO_DRONE_TRAJ,
    PROGRAM,
    TRAJ_HEADER,
    Flight,
    make_flight,
    read_traj,
    rmse_m,
    run_program,
    seconds,
    track,
    truth_m,
    write_frames,
    write_pcd,
)


@pytest.fixture(scope="module")
def flight() -> Flight:
    return make_flight(frames=100)


@pytest.fixture(scope="module")
def frames(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_frames(tmp_path_factory.mktemp("flight") / "lidar", flight)


@pytest.fixture(scope="module")
def whole(frames: Path, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Trajectory of the flight as a recording."""
    out = tmp_path_factory.mktemp("whole") / "traj.csv"
    track([f"lidar={frames}"], out)
    return out.read_bytes()


class Station:
    """A program that follows folders below its own, with its outputs beside them."""

    def __init__(self, home: Path, *options: str, names: tuple[str, ...] = ("lidar",)) -> None:
        self.folders = {name: home / "frames" / name for name in names}
        self.trajectory, self.events = home / "traj.csv", home / "events.jsonl"
        sources = [p for name, f in self.folders.items() for p in ("--frames", f"{name}={f}")]
        outputs = ["--out", str(self.trajectory), "--events", str(self.events)]
        # However slow the machine is: frames are left out only where a test asks for it.
        patience = ("--set", "live.overload_s=600")
        self.live = Live("--follow", *sources, *outputs, *patience, *options)

    def __enter__(self) -> Station:
        # The events alone may be those of the run before.
        wait_until(
            lambda: self.code() is not None or (self.live.runs() and self.events.exists()),
            "it runs",
        )
        return self

    def __exit__(self, *error: object) -> None:
        self.live.__exit__(*error)

    def code(self) -> int | None:
        return self.live.process.poll()

    def told(self, kind: str) -> list[dict]:
        whole_lines = self.events.read_text().rpartition("\n")[0]
        return [e for e in events_of(whole_lines) if e["event"] == kind]

    def stop(self, number: signal.Signals = signal.SIGTERM) -> str:
        code, _, said = self.live.end(number)
        assert code == 0, said
        return said


def idle(live: Live) -> bool:
    """True if the program waits and has used no processor for a while."""

    def state_and_ticks() -> tuple[str, int]:
        fields = Path(f"/proc/{live.process.pid}/stat").read_text().rpartition(")")[2].split()
        return fields[0], sum(int(t) for t in fields[11:13])

    _, before = state_and_ticks()
    time.sleep(0.4)
    state, after = state_and_ticks()
    return state == "S" and after - before <= 2  # "R": it would work if it had a processor


def wait_idle(station: Station) -> None:
    wait_until(lambda: idle(station.live), "everything is worked off")


# --- frames -------------------------------------------------------------------------------------


def test_frames_that_are_there_and_frames_that_appear_give_the_rows_of_a_recording(
    frames: Path, whole: bytes, tmp_path: Path
) -> None:
    paths = by_stamp(frames)
    target = tmp_path / "frames/lidar"
    move_into(target, reversed(paths[:20]))
    with Station(tmp_path, *ENDLESS) as station:
        move_into(target, paths[20:40])
        for path in paths[40:]:
            shutil.copy(path, target)  # written in place, then closed
        wait_idle(station)
        said = station.stop()
    assert station.trajectory.read_bytes() == whole, said


def test_default_settings_give_the_rows_of_a_stream(flight: Flight, tmp_path: Path) -> None:
    folders = write_two_sensors(tmp_path / "recorded", flight)
    code, _, said = feed(b"".join(messages(**folders)), tmp_path / "stream.csv")
    assert code == 0, said
    with Station(tmp_path, names=("left", "right")) as station:
        arrivals = sorted((float(p.stem), name, p) for name in folders
                          for p in folders[name].glob("*.pcd"))  # fmt: skip
        for _, name, path in arrivals:
            move_into(station.folders[name], [path])
        wait_until(lambda: len(rows_of(station.trajectory)) > 20, "rows are there")
        wait_idle(station)
        station.stop()
    assert station.trajectory.read_bytes() == (tmp_path / "stream.csv").read_bytes()
    traj = read_traj(station.trajectory)
    assert rmse_m(traj.position_m, truth_m(traj.time_s)) < 0.25


def test_a_folder_may_be_absent_and_go_and_come_back(
    frames: Path, whole: bytes, tmp_path: Path
) -> None:
    paths = by_stamp(frames)
    target = tmp_path / "frames/lidar"
    with Station(tmp_path, *ENDLESS) as station:
        assert station.trajectory.read_text() == NO_DRONE_TRAJ
        move_into(target, paths[:25])
        wait_idle(station)
        shutil.rmtree(target)
        wait_idle(station)
        move_into(target, paths[25:40])
        wait_idle(station)
        shutil.rmtree(tmp_path / "frames")
        wait_idle(station)
        move_into(target, paths[40:])
        wait_idle(station)
        station.stop(signal.SIGINT)
    assert station.trajectory.read_bytes() == whole


def test_a_file_is_not_read_before_its_writer_closes_it(
    frames: Path, whole: bytes, tmp_path: Path
) -> None:
    paths = by_stamp(frames)
    target = tmp_path / "frames/lidar"
    target.mkdir(parents=True)
    halves = {}
    for path in paths[:1]:  # before it starts
        halves[path] = (target / path.name).open("wb", buffering=0)
        halves[path].write(path.read_bytes()[:1000])
    with Station(tmp_path, *ENDLESS) as station:
        for path in paths[1:]:
            file = (target / path.name).open("wb", buffering=0)
            file.write(path.read_bytes()[:1000])
            halves[path] = file
        wait_idle(station)
        for path, file in halves.items():
            file.write(path.read_bytes()[1000:])
            file.close()
        wait_idle(station)
        said = station.stop()
    assert station.trajectory.read_bytes() == whole, said


def test_files_that_are_gone_before_they_are_read_are_counted(frames: Path, tmp_path: Path) -> None:
    paths = by_stamp(frames)
    summary = tmp_path / "s.json"
    (tmp_path / "frames/lidar").mkdir(parents=True)
    with Station(tmp_path, *ENDLESS, "--summary", str(summary)) as station:
        wait_idle(station)
        station.live.signal(signal.SIGSTOP)
        move_into(tmp_path / "frames/lidar", paths)
        for path in paths[10:20]:
            (tmp_path / "frames/lidar" / path.name).unlink()
        station.live.signal(signal.SIGCONT)
        wait_idle(station)
        said = station.stop()
    assert "10 frames removed before it could be read" in said
    counts = json.loads(summary.read_text())["counts"]
    assert (counts["frames"], counts["vanished_frames"]) == (90, 10)
    assert station.told("state")[-1]["dropped"] == 10


def test_stamps_in_a_file_are_refused(frames: Path, tmp_path: Path) -> None:
    (tmp_path / "f").mkdir()
    (tmp_path / "f/timestamps.csv").write_text("file,timestamp\n")
    result = run_program("--follow", "--frames", tmp_path / "f", "--out", tmp_path / "traj.csv")
    assert result.returncode == 4
    assert "timestamps.csv: cannot be followed" in result.stderr
    with Station(tmp_path) as station:
        move_into(tmp_path / "frames/lidar", by_stamp(frames)[:3])
        (tmp_path / "frames/lidar/timestamps.csv").write_text("file,timestamp\n")
        assert station.live.process.wait(30) == 4


def test_a_bad_frame_ends_it_or_is_skipped_and_said(
    frames: Path, whole: bytes, tmp_path: Path
) -> None:
    paths = by_stamp(frames)
    bad = tmp_path / "1706300002.05.pcd"
    bad.write_bytes(b"# .PCD v0.7\nrubbish\n")
    unnamed = tmp_path / "roof.pcd"
    unnamed.write_bytes(paths[0].read_bytes())
    for broken in (bad, unnamed):
        home = tmp_path / broken.stem
        home.mkdir()
        with Station(home, *ENDLESS) as station:
            move_into(home / "frames/lidar", [*paths[:5], broken])
            assert station.live.process.wait(30) == 4
            said = station.live.process.stderr.read().decode()
        assert len(said.splitlines()) == 1 and broken.name in said
    with Station(tmp_path, *ENDLESS, "--set", "input.skip_bad_frames=true") as station:
        move_into(tmp_path / "frames/lidar", [*paths, bad, unnamed])
        wait_idle(station)
        said = station.stop()
    assert "2 frames could not be parsed and skipped" in said
    assert station.trajectory.read_bytes() == whole


def test_what_is_no_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    result = run_program("--follow", "--frames", tmp_path / "file", "--out", tmp_path / "traj.csv")
    assert result.returncode == 4
    assert "expected a folder" in result.stderr


# --- what the wall clock tells --------------------------------------------------------------------


def test_a_pulled_cable_is_reported_and_so_is_its_end(frames: Path, tmp_path: Path) -> None:
    paths = by_stamp(frames)
    with Station(tmp_path, "--set", "live.silent_s=0.5") as station:
        wait_until(lambda: station.told("sensor"), "nothing has come")
        assert [e["state"] for e in station.told("sensor")] == ["silent"]
        move_into(tmp_path / "frames/lidar", paths[:5])
        wait_until(lambda: len(station.told("sensor")) >= 3, "it is silent again")
        move_into(tmp_path / "frames/lidar", paths[5:8])
        wait_until(lambda: len(station.told("sensor")) >= 4, "it is back")
        assert [e["state"] for e in station.told("sensor")][:4] == ["silent", "ok"] * 2
        station.stop()


def test_frames_that_come_too_fast_are_left_out_evenly_and_it_says_so(tmp_path: Path) -> None:
    # Text with rays without a return: slow to read, nothing to track.
    header = (
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 60000\nHEIGHT 1\n"
        "POINTS 60000\nDATA ascii\n"
    )
    (tmp_path / "slow").write_text(header + "0.0000000 0.0000000 0.0000000\n" * 60_000)
    options = ("--set", "live.overload_s=0.1", "--summary", str(tmp_path / "s.json"))
    target = tmp_path / "frames/lidar"
    target.mkdir(parents=True)
    with Station(tmp_path, *options) as station:
        for i in range(1500):
            os.link(tmp_path / "slow", tmp_path / "next")
            (tmp_path / "next").rename(target / f"{seconds(BEGIN_NS + i * 100_000_000)}.pcd")
        wait_idle(station)
        said = station.stop()
    counts = json.loads((tmp_path / "s.json").read_text())["counts"]
    assert counts["overload_frames"] > 100
    assert counts["frames"] + counts["overload_frames"] == 1500
    assert "overloaded: one frame in 2 is worked off" in said
    told = [e for e in station.told("state") if e["state"] == "overloaded"]
    assert told
    assert station.told("state")[-1]["dropped"] == counts["overload_frames"]


def test_a_backlog_is_no_overload(frames: Path, whole: bytes, tmp_path: Path) -> None:
    move_into(tmp_path / "frames/lidar", by_stamp(frames))
    with Station(tmp_path, *ENDLESS, "--set", "live.overload_s=0.001") as station:
        wait_idle(station)
        station.stop()
    assert station.trajectory.read_bytes() == whole
    assert "overloaded" not in station.events.read_text()


# --- clocks that go back --------------------------------------------------------------------------


def an_hour_before(paths: list[Path], folder: Path) -> list[Path]:
    """The same frames with other stamps."""
    folder.mkdir()
    earlier = []
    for path in paths:
        earlier.append(folder / f"{float(path.stem) - 3600:.6f}.pcd")
        shutil.copy(path, earlier[-1])
    return earlier


def test_a_frame_of_another_time_costs_no_row(frames: Path, tmp_path: Path, flight: Flight) -> None:
    stray = tmp_path / "3960000000.0.pcd"
    paths = by_stamp(frames)
    stray.write_bytes(paths[0].read_bytes())
    with Station(tmp_path) as station:
        move_into(tmp_path / "frames/lidar", paths[:30])
        wait_idle(station)
        move_into(tmp_path / "frames/lidar", [stray])
        wait_idle(station)
        move_into(tmp_path / "frames/lidar", paths[30:])
        wait_idle(station)
        said = station.stop()
    code, _, _ = feed(b"".join(messages(lidar=frames)), tmp_path / "by_stdin.csv")
    assert code == 0
    assert station.trajectory.read_bytes() == (tmp_path / "by_stdin.csv").read_bytes()
    assert "1 frame astray and left out: the clock of lidar is " in said


def test_a_clock_that_goes_back_is_followed_and_said(frames: Path, tmp_path: Path) -> None:
    target = tmp_path / "frames/lidar"
    # More than it remembers: an old name is new all the same.
    long_before = [f"{seconds(BEGIN_NS - (1200 - i) * 100_000_000)}.pcd" for i in range(1200)]
    write_pcd(tmp_path / "empty", np.zeros((0, 3), np.float32))
    with Station(tmp_path) as station:
        wait_idle(station)
        target.mkdir(parents=True)
        for name in long_before:
            os.link(tmp_path / "empty", tmp_path / "next")
            (tmp_path / "next").rename(target / name)
        move_into(target, by_stamp(frames))
        # Of frames that wait the earliest is taken first.
        last_s = float(by_stamp(frames)[-1].stem)
        wait_until(lambda: stamps(station.trajectory)[-1:] > [last_s - 1.3], "all are worked off")
        wait_idle(station)
        move_into(target, an_hour_before(by_stamp(frames), tmp_path / "earlier"))
        wait_idle(station)
        said = station.stop()
    is_before = np.array(stamps(station.trajectory)) > BEGIN_NS * 1e-9 - 1800
    first, second = (np.array(ids(station.trajectory))[part] for part in (is_before, ~is_before))
    assert len(first) > 40 and len(second) > 40
    assert is_before[: len(first)].all() and not set(first) & set(second)
    told = [json.loads(line) for line in station.events.read_text().splitlines()]
    states = [e["state"] for e in told if e["event"] == "state"]
    # Each state is said again as long as it lasts.
    assert [state for state, _ in itertools.groupby(states)][:4] == ["warming_up", "running"] * 2
    assert said.count("begins anew at 17062964") == 1


def test_a_restart_after_the_clock_went_back_goes_on(frames: Path, tmp_path: Path) -> None:
    """Rows of an hour ahead, with which the run before ended, hide nothing."""
    old = f"{TRAJ_HEADER}\n{BEGIN_NS // 10**9 + 3600}.000000000,41,1,2,3,0,0,0,0.1,0.1,0.1,5\n"
    (tmp_path / "traj.csv").write_text(old)
    (tmp_path / "frames/lidar").mkdir(parents=True)
    with Station(tmp_path) as station:
        wait_idle(station)
        move_into(tmp_path / "frames/lidar", by_stamp(frames))
        wait_idle(station)
        station.stop()
    assert station.trajectory.read_text().startswith(old)
    assert len(rows_of(station.trajectory)) > 40
    assert set(ids(station.trajectory)[1:]) == {42}


def test_one_row_of_another_time_hides_no_frame_from_a_restart(
    frames: Path, tmp_path: Path
) -> None:
    """Also where it is not the last."""
    first_s = BEGIN_NS // 10**9
    row = "{}.000000000,{},1,2,3,0,0,0,0.1,0.1,0.1,5\n"
    old = f"{TRAJ_HEADER}\n" + "".join(
        row.format(*at) for at in [(first_s - 9000, 3), (3_960_000_000, 4), (first_s - 8000, 5)]
    )
    (tmp_path / "traj.csv").write_text(old)
    move_into(tmp_path / "frames/lidar", by_stamp(frames))
    with Station(tmp_path) as station:
        wait_idle(station)
        station.stop()
    assert station.trajectory.read_text().startswith(old)
    assert len(rows_of(station.trajectory)) > 40


def test_what_an_earlier_run_has_worked_off_is_counted_and_said(
    frames: Path, tmp_path: Path
) -> None:
    later_s = BEGIN_NS // 10**9 + 3600
    (tmp_path / "traj.csv").write_text(
        f"{TRAJ_HEADER}\n{later_s}.000000000,41,1,2,3,0,0,0,0.1,0.1,0.1,5\n"
    )
    move_into(tmp_path / "frames/lidar", by_stamp(frames))
    with Station(tmp_path, "--summary", str(tmp_path / "summary.json")) as station:
        wait_idle(station)
        said = station.stop()
    count = len(by_stamp(frames))
    told = json.loads((tmp_path / "summary.json").read_text())["counts"]
    assert told["worked_off_frames"] == count
    assert f"{count} frames passed over: worked off by an earlier run" in said


def test_names_that_are_written_again_are_said_at_once(frames: Path, tmp_path: Path) -> None:
    """A ring of files: the second time round each has the stamp of the first."""
    (tmp_path / "frames/lidar").mkdir(parents=True)
    with Station(tmp_path) as station:
        wait_idle(station)
        for _ in range(2):
            for number, path in enumerate(by_stamp(frames)[:20]):
                shutil.copy(path, tmp_path / "next")
                (tmp_path / "next").rename(tmp_path / f"frames/lidar/{number:03}.pcd")
            wait_idle(station)
        station.live.process.kill()  # so that nothing is summed up
        said = station.live.process.communicate()[1].decode()
    # Each time the count has doubled: at 16 of these 20, or later where several come at once.
    counts = re.findall(r"(\d+) frames? passed over: the stamp had come before", said)
    assert 16 <= int(counts[-1]) <= 20


# --- outputs --------------------------------------------------------------------------------------


def ids(path: Path) -> list[int]:
    return [int(row.split(",")[1]) for row in rows_of(path)]


def stamps(path: Path) -> list[float]:
    return [float(row.split(",")[0]) for row in rows_of(path)]


@pytest.mark.parametrize("tail", ["", "1706300003.12", "1706300003.1,0,1.5,2"])
def test_a_run_that_is_killed_is_taken_up_where_it_stopped(
    tail: str, frames: Path, tmp_path: Path
) -> None:
    paths = by_stamp(frames)
    target = tmp_path / "frames/lidar"
    with Station(tmp_path) as station:
        move_into(target, paths[:70])
        wait_until(lambda: len(rows_of(station.trajectory)) > 15, "rows are there")
        wait_idle(station)
        station.live.signal(signal.SIGKILL)
        station.live.process.wait()
    killed = station.trajectory.read_bytes()
    killed_events = station.events.read_bytes()
    assert killed.endswith(b"\n")
    last_s = stamps(station.trajectory)[-1]
    assert float(paths[69].stem) - last_s < 1.0 + 0.3  # at most the last delay is lost
    with station.trajectory.open("a") as file:
        file.write(tail)
    move_into(target, paths[70:75])  # while nobody looks
    with Station(tmp_path) as station:
        move_into(target, paths[75:])
        wait_idle(station)
        said = station.stop()
    assert station.trajectory.read_bytes().startswith(killed)
    assert station.events.read_bytes().startswith(killed_events)
    assert ("its last line was not finished" in said) == bool(tail)
    rows = len(killed.splitlines()) - 1
    assert set(ids(station.trajectory)[:rows]) == {0}
    assert set(ids(station.trajectory)[rows:]) == {1}
    times = stamps(station.trajectory)
    assert (np.diff(times) > 0).all()
    assert np.diff(times).max() < 0.1001  # without a hole
    assert times[-1] > float(paths[-1].stem) - 0.15


def test_ids_go_on_even_if_the_old_rows_are_of_other_times(frames: Path, tmp_path: Path) -> None:
    old = f"{TRAJ_HEADER}\n1600000000.000000000,41,1,2,3,0,0,0,0.1,0.1,0.1,5\n"
    (tmp_path / "traj.csv").write_text(old)
    code, _, said = feed(b"".join(messages(lidar=frames)), tmp_path / "traj.csv", *ENDLESS)
    assert code == 0, said
    assert (tmp_path / "traj.csv").read_text().startswith(old)
    assert set(ids(tmp_path / "traj.csv")[1:]) == {42}


@pytest.mark.parametrize(
    "foreign", ["a,b,c\n1,2,3\n", "hello", f"{TRAJ_HEADER}\nnot a row\n", f"{TRAJ_HEADER}\n1,2\n"]
)
def test_a_file_that_is_no_trajectory_is_left_alone(foreign: str, tmp_path: Path) -> None:
    (tmp_path / "traj.csv").write_text(foreign)
    code, _, said = feed(b"", tmp_path / "traj.csv")
    assert code == 5
    assert len(said.splitlines()) == 1
    assert (tmp_path / "traj.csv").read_text() == foreign


def test_two_programs_cannot_write_one_trajectory(tmp_path: Path) -> None:
    with Station(tmp_path) as station:
        code, _, said = feed(b"", station.trajectory)
        assert code == 5
        assert "another process is writing it" in said


def test_sighup_opens_rotated_outputs_again(frames: Path, tmp_path: Path) -> None:
    paths = by_stamp(frames)
    target = tmp_path / "frames/lidar"
    with Station(tmp_path) as station:
        move_into(target, paths[:70])
        wait_until(lambda: len(rows_of(station.trajectory)) > 10, "rows are there")
        wait_idle(station)
        station.trajectory.rename(tmp_path / "traj.csv.1")
        station.events.rename(tmp_path / "events.jsonl.1")
        station.live.signal(signal.SIGHUP)
        wait_until(lambda: station.trajectory.exists() and station.events.exists(), "it reopens")
        assert station.trajectory.read_text() == NO_DRONE_TRAJ
        station.live.signal(signal.SIGHUP)  # nothing was moved: nothing changes
        move_into(target, paths[70:])
        wait_until(lambda: rows_of(station.trajectory), "rows go on")
        wait_idle(station)
        station.stop()
    first, second = (rows_of(tmp_path / name) for name in ("traj.csv.1", "traj.csv"))
    assert first and second
    (tmp_path / "both.csv").write_text("\n".join([TRAJ_HEADER, *first, *second, ""]))
    times = stamps(tmp_path / "both.csv")
    assert set(ids(tmp_path / "both.csv")) == {0}
    assert (np.diff(times) > 0).all() and np.diff(times).max() < 0.1001
    both = [*events_of(tmp_path / "events.jsonl.1"), *events_of(tmp_path / "events.jsonl")]
    assert [e["event"] for e in both].count("row") == len(times)


# A small disk of its own, filled up while the program runs; $1 the folder, $2 the program, the rest
# its options. "more" decides what happens then.
FULL_DISK = """
    set -e
    mount -t tmpfs -o size=16k none "$1/room"
    cd "$1"
    [ "$2" ] || exit 0
    mkfifo pipe
    program=$2
    shift 2
    "$program" --stdin --out room/traj.csv "$@" < pipe 2> said > /dev/null & pid=$!
    exec 3> pipe
    while [ ! -s room/traj.csv ]; do sleep 0.02; done
    head -c 12000 /dev/zero > room/filler
    cat stream >&3
    if [ -e wait_for_room ]; then
      while ! grep -q "disk is full" said; do sleep 0.02; done
      rm room/filler
      while ! grep -q "there is room again" said; do sleep 0.02; done
    fi
    exec 3>&-
    code=0; wait $pid || code=$?
    cp room/traj.csv full.csv
    exit $code
"""


@pytest.fixture
def on_a_full_disk(frames: Path, tmp_path: Path):
    """Runs the program on a disk that is full, and gives its exit code."""
    (tmp_path / "room").mkdir()
    (tmp_path / "stream").write_bytes(b"".join(messages(lidar=frames)))

    def run(*arguments: str | Path) -> int:
        command = ["unshare", "-Urm", "sh", "-c", FULL_DISK, "sh", tmp_path, *arguments]
        return subprocess.run(command, capture_output=True, timeout=60).returncode

    if run("") != 0:
        pytest.skip("no file system can be mounted here")
    return run


def test_a_disk_that_is_full_to_the_end_loses_whole_rows_and_says_so(
    on_a_full_disk, tmp_path: Path
) -> None:
    assert on_a_full_disk(PROGRAM, *ENDLESS) == 5
    assert "No space left on device, lost: " in (tmp_path / "said").read_text()
    assert (tmp_path / "full.csv").read_text() == NO_DRONE_TRAJ


def test_rows_wait_while_the_disk_is_full(on_a_full_disk, tmp_path: Path) -> None:
    (tmp_path / "wait_for_room").touch()
    assert on_a_full_disk(PROGRAM) == 0
    code, _, _ = feed((tmp_path / "stream").read_bytes(), tmp_path / "roomy.csv")
    assert code == 0
    assert (tmp_path / "full.csv").read_bytes() == (tmp_path / "roomy.csv").read_bytes()


def test_pipes_take_both_outputs(frames: Path, whole: bytes, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "rows")
    with Live("--stdin", "--out", tmp_path / "rows", "--events", "-", *ENDLESS) as live:
        with (tmp_path / "rows").open("rb") as rows:
            live.send(b"".join(messages(lidar=frames)))
            live.process.stdin.close()
            assert rows.read() == whole
        assert live.process.wait(30) == 0
        assert events_of(live.process.stdout.read().decode())[-1]["event"] == "state"


def test_a_reader_that_sleeps_does_not_hold_up_the_end(frames: Path, tmp_path: Path) -> None:
    with Live("--stdin", "--out", tmp_path / "traj.csv", "--events", "-", *ENDLESS) as live:
        live.send(b"".join(messages(lidar=frames)) * 1)
        live.process.stdin.close()
        time.sleep(0.3)  # nobody reads its stdout, which holds 64 kB
        live.signal(signal.SIGTERM)
        assert live.process.wait(30) in (0, 5)


def test_a_dense_recording_played_fast_keeps_its_memory(tmp_path: Path) -> None:
    """Names of frames are all that waits for its turn."""
    target = tmp_path / "frames/lidar"
    target.mkdir(parents=True)
    write_pcd(tmp_path / "empty.pcd", np.zeros((20_000, 3), np.float32))
    with Station(tmp_path) as station:
        wait_idle(station)
        station.live.signal(signal.SIGSTOP)
        for i in range(3000):
            os.link(tmp_path / "empty.pcd", target / f".{i}")
            (target / f".{i}").rename(target / f"{seconds(BEGIN_NS + i * 100_000_000)}.pcd")
        station.live.signal(signal.SIGCONT)
        wait_idle(station)
        status = (Path("/proc") / str(station.live.process.pid) / "status").read_text()
        peak_kb = int(status.split("VmHWM:")[1].split()[0])
        station.stop()
    assert peak_kb < 100_000
