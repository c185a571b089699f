"""`unlidar play` and `unlidar run --live`: a recording as a live source."""

from __future__ import annotations

import io
import json
import math
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from live_program import ENDLESS, Live, messages, wait_until, write_two_sensors
from synthetic import (
    BEGIN_NS,
    PERIOD_NS,
    make_flight,
    seconds,
    track,
    truth_m,
    write_frames,
    write_pcd,
)
from unlidar.cli import main
from unlidar.play import FolderSink, MessageSink, PlayedFrame, frames_in_order, play


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recording")
    write_two_sensors(folder, make_flight(frames=30))
    return folder


def unlidar(*arguments: str | Path, **options) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "unlidar", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, timeout=60, **options)


def played_bytes(sensors: dict[str, Path], **options) -> bytes:
    stream = io.BytesIO()
    play(frames_in_order(sensors, **options), MessageSink(stream), math.inf)
    return stream.getvalue()


def test_the_stream_is_the_framing_of_the_program_in_order_of_stamps(recording: Path) -> None:
    sensors = {"left": recording / "left", "right": recording / "right"}
    assert played_bytes(sensors) == b"".join(messages(**sensors))
    done = unlidar("play", recording, "--rate", "inf")
    assert done.returncode == 0
    assert done.stdout == b"".join(messages(**sensors))
    assert done.stderr.startswith(b"played 60 frames in ")


def test_the_sensor_that_is_named_first_begins(recording: Path) -> None:
    done = unlidar("play", recording, "--rate", "inf", "--sensors", "right,left")
    names = re.findall(rb"frame (left|right) 17", done.stdout)
    assert names[:3] == [b"right", b"left", b"left"]
    assert len(names) == 60


def test_stamps_may_come_from_a_table(recording: Path, tmp_path: Path) -> None:
    write_pcd(tmp_path / "b.pcd", make_flight(frames=1).clouds[0])
    write_pcd(tmp_path / "a.pcd", make_flight(frames=1, seed=2).clouds[0])
    (tmp_path / "timestamps.csv").write_text("file,timestamp\nb.pcd,7\na.pcd,8000000000000\n")
    frames = list(frames_in_order({"lidar": tmp_path}))
    assert [(f.path.name, f.stamp_ns) for f in frames] == [
        ("b.pcd", 7 * 10**9),
        ("a.pcd", 8 * 10**18),
    ]


def test_frames_are_sent_when_they_are_due(recording: Path) -> None:
    class Clock:
        times: list[float] = []  # noqa: RUF012

        def send(self, frame: PlayedFrame, pcd: bytes) -> None:
            self.times.append(time.monotonic() - begin - frame.due_s / 10)
            assert pcd == frame.path.read_bytes()

    begin = time.monotonic()
    played = play(frames_in_order({"left": recording / "left"}), Clock(), rate=10)
    assert played.frames == 30
    assert played.wall_s > 2.9 / 10
    assert min(Clock.times) >= 0
    assert sorted(Clock.times)[15] < 0.1


def test_a_recording_may_be_repeated_with_stamps_that_go_on(recording: Path) -> None:
    frames = list(frames_in_order({"left": recording / "left"}, repeat=3))
    assert [f.stamp_ns for f in frames] == [BEGIN_NS + i * PERIOD_NS for i in range(90)]
    assert frames[89].due_s == pytest.approx(8.9)
    assert frames[60].path == frames[0].path


def test_files_appear_in_one_piece_in_a_folder_for_each_sensor(
    recording: Path, tmp_path: Path
) -> None:
    for _ in range(2):  # what is there already is replaced
        assert main(["play", str(recording), "--rate", "inf", "--into", str(tmp_path / "in")]) == 0
    for name in ("left", "right"):
        sent = {p.name: p.read_bytes() for p in (tmp_path / "in" / name).iterdir()}
        assert sent == {p.name: p.read_bytes() for p in (recording / name).iterdir()}
    frame = PlayedFrame("left", 5 * 10**9, next((recording / "left").iterdir()), 0.0)
    FolderSink(tmp_path / "x").send(frame, b"bytes")
    assert [p.name for p in (tmp_path / "x/left").iterdir()] == ["5.000000000.pcd"]


def test_the_exit_code_of_a_command_is_handed_on(recording: Path, fails) -> None:
    assert main(["play", str(recording), "--rate", "inf", "--to", "wc -c"]) == 0
    said = fails(7, "play", recording, "--rate", "inf", "--to", "sh -c 'exit 7'")
    assert "ended with code 7" in said


def test_a_reader_that_leaves_ends_it(recording: Path) -> None:
    command = [sys.executable, "-m", "unlidar", "play", str(recording), "--rate", "inf"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.read(100)
        process.stdout.close()
        assert process.wait(30) == 5
        assert process.stderr.read() == b""


def test_what_cannot_be_played_is_reported(recording: Path, tmp_path: Path, fails) -> None:
    assert "is no folder" in fails(4, "play", tmp_path / "absent")
    assert "holds no frames" in fails(4, "play", tmp_path)
    assert "has no sensor 'top'" in fails(2, "play", recording, "--sensors", "top")
    assert "the recording itself" in fails(2, "play", recording, "--into", recording)
    assert "cannot be run" in fails(2, "play", recording, "--to", "/absent/program")
    assert "expected a number above 0" in fails(2, "play", recording, "--rate", "0")


def test_a_folder_whose_name_is_none_of_a_sensor_is_played_under_one_like_it(
    tmp_path: Path,
) -> None:
    odd = write_frames(tmp_path / "odd/my lidar", make_flight(frames=1)).parent
    assert main(["play", str(odd), "--rate", "inf", "--into", str(tmp_path / "in")]) == 0
    assert [folder.name for folder in (tmp_path / "in").iterdir()] == ["my_lidar"]


def test_a_followed_folder_that_is_played_into_gives_the_rows_of_the_recording(
    recording: Path, tmp_path: Path, program: Path
) -> None:
    sources = [
        part for name in ("left", "right") for part in ("--frames", f"{name}={tmp_path / name}")
    ]
    out, events = tmp_path / "traj.csv", tmp_path / "events"
    options = [*ENDLESS, "--set", "live.overload_s=600", "--events", events]
    with Live("--follow", *sources, "--out", out, *options) as live:
        wait_until(events.exists, "it runs")
        assert main(["play", str(recording), "--rate", "20", "--into", str(tmp_path)]) == 0
        last = f'"at":{seconds(BEGIN_NS + 29 * PERIOD_NS + 40_000_000)}'
        time.sleep(0.5)
        code, _, said = live.end(signal.SIGTERM)
    assert code == 0, said
    assert last in events.read_text().splitlines()[-1]
    track([f"{n}={recording / n}" for n in ("left", "right")], tmp_path / "whole.csv")
    assert out.read_bytes() == (tmp_path / "whole.csv").read_bytes()


def test_run_live_judges_the_live_rows_beside_those_of_the_recording(
    tmp_path: Path, program: Path, capsys
) -> None:
    folder = tmp_path / "flight"
    frames = write_frames(folder / "lidar", make_flight())
    rows = [
        f"{t / 1e9:.9f}," + ",".join(f"{v:.4f}" for v in truth_m([t / 1e9])[0])
        for t in range(BEGIN_NS, BEGIN_NS + 59 * PERIOD_NS, PERIOD_NS)
    ]
    (folder / "ground_truth.csv").write_text("\n".join(["timestamp,x,y,z", *rows, ""]))
    out = tmp_path / "out"
    for _ in range(2):
        assert main(["run", str(folder), "--out", str(out), "--live", *ENDLESS]) == 0
    printed = capsys.readouterr().out
    assert "within 1 m" in printed and "p99 delay" in printed
    assert len(re.findall(r"^ *(?:recording|live) .* %", printed, re.MULTILINE)) == 2 * 2
    assert (out / "live.csv").read_bytes() == (out / "traj.csv").read_bytes()
    counts = json.loads((out / "live_summary.json").read_text())["counts"]
    assert counts["frames"] == len(list(frames.iterdir()))


def test_run_live_is_for_one_recording(tmp_path: Path, recording: Path, fails) -> None:
    many = tmp_path / "many"
    for name in ("a", "b"):
        write_frames(many / name / "lidar", make_flight(frames=1))
    assert "--live is for one recording" in fails(2, "run", many, "--live")
