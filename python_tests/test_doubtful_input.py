"""Warnings of the program and the harness on ambiguous input."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from synthetic import (
    PERIOD_NS,
    PROGRAM,
    Flight,
    make_flight,
    read_traj,
    rmse_m,
    run_program,
    track,
    truth_m,
    write_frames,
)
from unlidar.cli import main
from unlidar.frame_clock import times_of_names
from unlidar.frames_io import list_frames

ASSUMED = "numbered_frames"


@pytest.fixture(scope="module")
def flight() -> Flight:
    """60 frames, 10 a second, the first at 0 s."""
    flight = make_flight()
    return Flight([i * PERIOD_NS for i in range(len(flight.clouds))], flight.clouds)


def changed(flight: Flight, change: Callable[[float, np.ndarray], np.ndarray]) -> Flight:
    """The same with `change(time_s, xyz_m)` as the points of each frame."""
    clouds = [
        change(stamp_ns * 1e-9, cloud).astype(np.float32)
        for stamp_ns, cloud in zip(flight.stamps_ns, flight.clouds, strict=True)
    ]
    return Flight(flight.stamps_ns, clouds)


def with_trunks(flight: Flight) -> Flight:
    """The same in a wood, so that there is something to tell motion by."""
    rng = np.random.default_rng(5)
    feet = rng.uniform(-35, 35, (150, 2))
    feet = np.repeat(feet[np.hypot(*feet.T) > 12], 8, axis=0)

    def add(_: float, xyz_m: np.ndarray) -> np.ndarray:
        trunks = np.column_stack([feet, rng.uniform(-2, 3, len(feet))])
        ground = np.column_stack([rng.uniform(-40, 40, (900, 2)), np.full(900, -2.0)])
        return np.concatenate([xyz_m, trunks, ground])

    return changed(flight, add)


def codes_of(frames: Path, out: Path, *arguments: str | Path) -> tuple[list[str], str]:
    """The codes in the summary, and what was said on stderr."""
    said = track(frames, out / "traj.csv", "--summary", out / "summary.json", *arguments)
    warnings = json.loads((out / "summary.json").read_text())["warnings"]
    for warning in warnings:
        assert "--quiet" in arguments or f"warning: {warning['text']}" in said
    return [warning["code"] for warning in warnings], said


def numbered(first: int = 0, step: int = 1, digits: int = 6) -> Callable[[int], str]:
    return lambda stamp_ns: f"{first + step * (stamp_ns // PERIOD_NS):0{digits}d}.pcd"


# --- frames that are numbered -------------------------------------------------------------------


@pytest.mark.parametrize("step", [1, 100, 100_000], ids=["frames", "ms", "us"])
def test_a_drone_in_numbered_frames_is_found_as_in_stamped_ones_and_the_rate_is_said(
    flight: Flight, tmp_path: Path, step: int
) -> None:
    stamped = write_frames(tmp_path / "stamped", flight)
    track(stamped, tmp_path / "stamped.csv")
    frames = write_frames(tmp_path / "frames", flight, numbered(step=step))
    codes, said = codes_of(frames, tmp_path)
    assert codes == [ASSUMED]
    assert "input.frame_rate_hz" in said
    assert (tmp_path / "traj.csv").read_text() == (tmp_path / "stamped.csv").read_text()
    assert len(read_traj(tmp_path / "traj.csv")) > 50
    assert codes_of(frames, tmp_path, "--quiet") == ([ASSUMED], "")


def test_a_rate_that_is_given_is_taken_and_nothing_is_said(flight: Flight, tmp_path: Path) -> None:
    frames = write_frames(tmp_path / "frames", flight, numbered())
    codes, said = codes_of(frames, tmp_path, "--set", "input.frame_rate_hz=20")
    assert codes == [] and "warning" not in said
    assert float(read_traj(tmp_path / "traj.csv").stamps[-1]) <= 59 / 20
    of_sensor = ("--set", "sensors.frames.frame_rate_hz=20", "--set", "input.frame_rate_hz=5")
    track([f"frames={frames}"], tmp_path / "sensor.csv", *of_sensor)
    assert (tmp_path / "sensor.csv").read_text() == (tmp_path / "traj.csv").read_text()


def test_a_missing_number_is_time_that_passes(flight: Flight, tmp_path: Path) -> None:
    name = numbered(first=500)
    frames = write_frames(tmp_path / "frames", flight, name)
    for stamp_ns in flight.stamps_ns[20:25]:
        (frames / name(stamp_ns)).unlink()
    codes_of(frames, tmp_path)
    traj = read_traj(tmp_path / "traj.csv")
    assert len(set(traj.track_id)) == 1
    assert rmse_m(traj.position_m, truth_m(traj.time_s, 50.0)) < 0.3


def test_numbers_that_mean_nothing_without_a_rate_are_refused(
    flight: Flight, tmp_path: Path
) -> None:
    frames = write_frames(tmp_path / "frames", flight, numbered(step=5_000))
    result = run_program("--frames", frames, "--out", tmp_path / "traj.csv")
    assert result.returncode == 4
    assert "5000 apart" in result.stderr and "input.frame_rate_hz" in result.stderr
    assert not (tmp_path / "traj.csv").exists()
    assert main(["convert", str(frames), str(tmp_path / "converted")]) == 4


def test_whole_numbers_in_a_list_of_times_are_those_of_the_frames(
    flight: Flight, tmp_path: Path
) -> None:
    frames = write_frames(tmp_path / "frames", flight, numbered())
    (tmp_path / "at.txt").write_text("".join(f"{k}\n" for k in range(30, 40)))
    codes_of(frames, tmp_path, "--at", tmp_path / "at.txt")
    traj = read_traj(tmp_path / "traj.csv")
    np.testing.assert_allclose(traj.time_s, np.arange(30, 40) / 10)
    (tmp_path / "at.txt").write_text("3.0\n4.0\n")
    codes_of(frames, tmp_path, "--at", tmp_path / "at.txt")
    np.testing.assert_allclose(read_traj(tmp_path / "traj.csv").time_s, [3.0, 4.0])
    (tmp_path / "at.txt").write_text("1706300003.5\n")
    assert codes_of(frames, tmp_path, "--at", tmp_path / "at.txt")[0] == [
        ASSUMED,
        "output_times_outside",
    ]


def test_sensors_of_different_times_or_rates_are_told(flight: Flight, tmp_path: Path) -> None:
    half = Flight(flight.stamps_ns[:30], flight.clouds[:30])
    all_numbers = write_frames(tmp_path / "all", flight, numbered())
    half_numbers = write_frames(tmp_path / "half", half, numbered())
    stamped = write_frames(tmp_path / "stamped", make_flight(frames=20))
    for second, code in ((half_numbers, "sensors_uneven"), (stamped, "sensors_apart")):
        summary = tmp_path / "summary.json"
        track([all_numbers, second], tmp_path / "traj.csv", "--summary", summary)
        assert code in [w["code"] for w in json.loads(summary.read_text())["warnings"]]


def test_numbered_frames_of_a_stream_are_those_of_a_folder(flight: Flight, tmp_path: Path) -> None:
    frames = write_frames(tmp_path / "lidar", flight, numbered(first=3))
    endless = ("--set", "live.delay_s=.inf")
    codes_of(frames, tmp_path)
    result = stream(tmp_path, frames, *endless)
    assert result.returncode == 0, result.stderr
    assert "warning: stdin: lidar: names are whole numbers" in result.stderr
    assert (tmp_path / "live.csv").read_text() == (tmp_path / "traj.csv").read_text()
    summary = json.loads((tmp_path / "live.json").read_text())
    assert [warning["code"] for warning in summary["warnings"]] == [ASSUMED]


def stream(tmp_path: Path, frames: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """The frames of a folder by stdin, in the order of their names."""
    sent = b"".join(
        f"frame lidar {path.stem} {path.stat().st_size}\n".encode() + path.read_bytes()
        for path in sorted(frames.iterdir())
    )
    outputs = ("--out", tmp_path / "live.csv", "--summary", tmp_path / "live.json")
    result = subprocess.run(
        [PROGRAM, "--stdin", *outputs, *arguments], input=sent, capture_output=True, timeout=120
    )
    said, told = (text.decode() for text in (result.stdout, result.stderr))
    return subprocess.CompletedProcess(result.args, result.returncode, said, told)


@pytest.mark.parametrize(
    "names",
    [
        ["000000", "000001", "000002", "000004"],
        ["500", "501", "503"],
        ["0", "100", "200", "300"],
        ["0", "100000", "200000"],
        ["900000000", "900100000", "900200000"],
        ["0.000000", "0.100000", "1"],
        ["1706255621", "1706255622", "1706255624"],
        ["1706255621614", "1706255621714", "1706255621814"],
    ],
    ids=lambda names: names[1],
)
def test_program_and_harness_read_names_alike(
    flight: Flight, tmp_path: Path, names: list[str]
) -> None:
    frames = tmp_path / "frames"
    few = Flight([], flight.clouds[: len(names)])
    for name, cloud in zip(names, few.clouds, strict=True):
        write_frames(frames / name, Flight([0], [cloud]), lambda _, n=name: f"{n}.pcd")
        (frames / name / f"{name}.pcd").rename(frames / f"{name}.pcd")
        (frames / name).rmdir()
    codes, _ = codes_of(frames, tmp_path)
    inputs = json.loads((tmp_path / "summary.json").read_text())["inputs"]
    times = times_of_names(frames, names)
    assert (codes == [ASSUMED]) == (times.note is not None)
    steps = np.diff([frame.stamp_ns for frame in list_frames(frames)])
    middle = sorted(steps)[(len(steps) - 1) // 2]
    assert inputs[0]["frame_period_s"] == pytest.approx(middle * 1e-9)


# --- coordinates that are not metres about the sensor ---------------------------------------------


@pytest.mark.parametrize(("unit_m", "word"), [(0.001, "millimetres"), (0.01, "centimetres")])
def test_coordinates_that_are_no_metres_are_refused_and_the_scale_reads_them(
    flight: Flight, tmp_path: Path, unit_m: float, word: str
) -> None:
    frames = write_frames(tmp_path / "lidar", changed(flight, lambda _, xyz: xyz / unit_m))
    result = run_program("--frames", frames, "--out", tmp_path / "traj.csv")
    assert result.returncode == 4
    assert word in result.stderr and f"input.scale_m={unit_m}" in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert not (tmp_path / "traj.csv").exists()
    live = stream(tmp_path, frames, "--set", "input.skip_bad_frames=true")
    assert live.returncode == 4 and word in live.stderr
    assert codes_of(frames, tmp_path, "--set", f"input.scale_m={unit_m}")[0] == []
    traj = read_traj(tmp_path / "traj.csv")
    assert len(traj) > 50 and rmse_m(traj.position_m, truth_m(traj.time_s, 0.0)) < 0.25


def test_coordinates_of_a_map_are_refused_by_their_name(flight: Flight, tmp_path: Path) -> None:
    place_m = np.array([465_000.0, 5_250_000.0, 400.0])
    frames = write_frames(tmp_path / "lidar", changed(flight, lambda _, xyz: xyz + place_m))
    result = run_program("--frames", frames, "--out", tmp_path / "traj.csv")
    assert result.returncode == 4 and "UTM" in result.stderr


def test_ranges_that_are_cut_on_purpose_are_no_error(flight: Flight, tmp_path: Path) -> None:
    frames = write_frames(tmp_path / "lidar", flight)
    assert codes_of(frames, tmp_path, "--set", "input.max_range_m=12")[0] == []


def test_packets_say_their_unit_themselves(tmp_path: Path) -> None:
    out = ("--out", tmp_path / "traj.csv")
    result = run_program("--livox", "127.0.0.1:0", *out, "--set", "input.scale_m=0.001")
    assert result.returncode == 3 and "input.scale_m" in result.stderr


# --- how the sensor stands ------------------------------------------------------------------------


def turned(axis: int, degrees: float) -> Callable[[float, np.ndarray], np.ndarray]:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    a, b = [k for k in range(3) if k != axis]
    turn = np.eye(3)
    turn[a, a], turn[a, b], turn[b, a], turn[b, b] = c, -s, s, c
    return lambda _, xyz: xyz @ turn.T


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (turned(0, 180), "upside_down"),
        (turned(0, 90), "z_not_up"),
        (turned(1, -90), "z_not_up"),
        (lambda t, xyz: xyz - [10.0 * t, 0, 0], "sensor_moves"),
        (lambda t, xyz: turned(2, 30 * t)(t, xyz), "sensor_moves"),
    ],
    ids=["upside down", "on its side", "on its other side", "on a car", "panning"],
)
def test_a_sensor_that_does_not_stand_upright_and_still_is_reported(
    flight: Flight, tmp_path: Path, change: Callable[[float, np.ndarray], np.ndarray], code: str
) -> None:
    frames = write_frames(tmp_path / "lidar", changed(with_trunks(flight), change))
    assert codes_of(frames, tmp_path)[0] == [code]
    live = stream(tmp_path, frames)
    assert live.returncode == 0
    warnings = json.loads((tmp_path / "live.json").read_text())["warnings"]
    assert [warning["code"] for warning in warnings] == [code]
    assert live.stderr.count("warning: ") == 1


def test_of_a_sensor_that_stands_upright_and_still_nothing_is_said(
    flight: Flight, tmp_path: Path
) -> None:
    frames = write_frames(tmp_path / "lidar", with_trunks(flight))
    assert codes_of(frames, tmp_path)[0] == []
    assert "warning" not in stream(tmp_path, frames).stderr


def test_the_pose_of_the_config_is_what_counts(flight: Flight, tmp_path: Path) -> None:
    frames = write_frames(tmp_path / "lidar", changed(with_trunks(flight), turned(0, 180)))
    source = [f"lidar={frames}"]
    said = track(source, tmp_path / "traj.csv", "--set", "sensors.lidar.rotation=[1, 0, 0, 0]")
    assert "warning" not in said


# --- unlidar run ----------------------------------------------------------------------------------


def test_run_prints_the_warnings_and_shows_them_in_its_page(
    flight: Flight, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch
) -> None:
    monkeypatch.setenv("UNLIDAR_TRACK", str(PROGRAM))
    frames = write_frames(tmp_path / "rec/lidar", flight, numbered())
    assert main(["run", str(frames.parent), "--out", str(tmp_path / "out")]) == 0
    assert "warning: " in capsys.readouterr().err
    page = (tmp_path / "out/report.html").read_text()
    assert "names are whole numbers (0 to 59, 1 apart)" in page
    assert main(["run", str(frames.parent), "--out", str(tmp_path / "out"), "--rate", "20"]) == 0
    assert "warning" not in capsys.readouterr().err
    assert "class='warnings'" not in (tmp_path / "out/report.html").read_text()
