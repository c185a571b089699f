"""Files that have no end, are no files, or take no more: every run ends soon, in bounded memory."""

from __future__ import annotations

import json
import os
import resource
import subprocess
from pathlib import Path

import pytest
from synthetic import (
    PROGRAM,
    Flight,
    decimal_name,
    make_flight,
    read_traj,
    run_program,
    seconds,
    write_frames,
)

USAGE, CONFIG, INPUT, OUTPUT = 2, 3, 4, 5
MEMORY = 500 << 20  # of addresses; half of it is libraries


@pytest.fixture(scope="module")
def flight() -> Flight:
    return make_flight(frames=20)


@pytest.fixture
def frames(flight: Flight, tmp_path: Path) -> Path:
    return write_frames(tmp_path / "in" / "frames", flight)


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """A place in a folder of its own."""
    (tmp_path / "out").mkdir()
    return tmp_path / "out" / "traj.csv"


def assert_refused(result: subprocess.CompletedProcess[str], code: int, *named: object) -> None:
    assert result.returncode == code, result.stderr
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1 and len(lines[0]) < 2000, result.stderr[:10_000]
    assert [n for n in map(str, named) if n not in lines[0]] == [], lines[0]


@pytest.mark.parametrize(("option", "code"), [("--config", CONFIG), ("--at", INPUT)])
def test_an_endless_file_is_refused(frames: Path, out: Path, option: str, code: int) -> None:
    result = run_program("--frames", frames, "--out", out, option, "/dev/zero", memory_bytes=MEMORY)
    assert_refused(result, code, "/dev/zero")


@pytest.mark.parametrize("text", [",", ",\n", "input: {}\n,", "[" * 200_000, "? " * 100_000])
def test_a_text_that_the_parser_never_passes_is_refused(
    frames: Path, out: Path, tmp_path: Path, text: str
) -> None:
    config = tmp_path / "config.yaml"
    config.write_text(text)
    base = ("--frames", frames, "--out", out)
    assert_refused(run_program(*base, "--config", config, memory_bytes=MEMORY), CONFIG, config)
    setting = f"input.max_range_m={text[:100_000]}"
    assert_refused(run_program(*base, "--set", setting, memory_bytes=MEMORY), CONFIG)


@pytest.mark.parametrize(
    "arguments",
    [
        ["--rate", "1" * 100_000],
        ["--threads", "x" * 100_000],
        ["--format", "x" * 100_000],
        ["--set", "x" * 100_000],
        ["--" + "x" * 100_000],
        ["x" * 100_000],
    ],
)
def test_what_a_message_quotes_is_shortened(frames: Path, out: Path, arguments: list[str]) -> None:
    assert_refused(run_program("--frames", frames, "--out", out, *arguments), USAGE)


def test_a_value_of_megabytes_in_a_file_is_shortened(
    frames: Path, out: Path, tmp_path: Path
) -> None:
    at = tmp_path / "at.csv"
    at.write_text("x" * 60_000)
    assert_refused(run_program("--frames", frames, "--out", out, "--at", at), INPUT, at)
    at.write_text("x" * 3_000_000)
    assert_refused(run_program("--frames", frames, "--out", out, "--at", at), INPUT, at)
    (frames / "timestamps.csv").write_text("file,timestamp\n" + "x" * 60_000 + ",1\n")
    result = run_program("--frames", frames, "--out", out)
    assert_refused(result, INPUT, frames / "timestamps.csv")


def test_stamps_in_a_pipe_that_nobody_writes_are_refused(frames: Path, out: Path) -> None:
    os.mkfifo(frames / "timestamps.csv")
    result = run_program("--frames", frames, "--out", out)
    assert_refused(result, INPUT, frames / "timestamps.csv")


def test_output_times_are_read_from_a_pipe(flight: Flight, frames: Path, out: Path) -> None:
    text = "".join(f"{seconds(stamp_ns)}\n" for stamp_ns in flight.stamps_ns[5:15])
    subprocess.run(
        [PROGRAM, "--frames", frames, "--out", out, "--at", "/dev/stdin"],
        input=text,
        text=True,
        check=True,
    )
    assert "".join(f"{stamp}\n" for stamp in read_traj(out).stamps) == text


def test_an_endless_frame_is_a_bad_frame(flight: Flight, frames: Path, out: Path) -> None:
    endless = frames / decimal_name(flight.stamps_ns[-1] + 10**8)
    with endless.open("wb") as file:
        file.truncate(100 << 30)
    base = ("--frames", frames, "--out", out)
    assert_refused(run_program(*base, memory_bytes=MEMORY), INPUT, endless)
    summary = out.with_name("summary.json")
    skip = ("--set", "input.skip_bad_frames=true", "--summary", summary)
    assert run_program(*base, *skip, memory_bytes=MEMORY).returncode == 0
    assert json.loads(summary.read_text())["counts"]["bad_frames"] == 1


def test_rows_take_no_memory(frames: Path) -> None:
    def peak_kib(rate_hz: int) -> int:
        process = subprocess.Popen(
            [PROGRAM, "--frames", frames, "--out", "/dev/null", "--rate", str(rate_hz), "--quiet"]
        )
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        assert process.returncode == 0
        return used.ru_maxrss

    # 400,000 rows: as numbers and as text they would take 100 MB.
    assert peak_kib(200_000) < peak_kib(10) + 5_000


def test_sensors_farther_apart_than_64_bits_reach_are_refused(
    flight: Flight, out: Path, tmp_path: Path
) -> None:
    def ends_of_time(sign: int) -> Path:
        folder = tmp_path / f"side{sign}"
        name = "{}3999999999.{:09d}.pcd"
        prefix = "-" if sign < 0 else ""
        names = iter(name.format(prefix, i * 10**7) for i in range(len(flight.clouds)))
        return write_frames(folder, flight, name=lambda _: next(names))

    sources = [f"{name}={ends_of_time(sign)}" for name, sign in (("a", 1), ("b", -1))]
    options = [part for source in sources for part in ("--frames", source)]
    offsets = [f"sensors.{name}.time_offset_s={value}" for name, value in (("a", 1e9), ("b", -1e9))]
    settings = [part for offset in offsets for part in ("--set", offset)]
    assert_refused(run_program(*options, *settings, "--out", out), INPUT, tmp_path, "time offset")


def test_a_reader_that_has_gone_is_an_output_that_cannot_be_written(frames: Path) -> None:
    read_end, write_end = os.pipe()
    os.close(read_end)
    for arguments in (["--out", "/dev/stdout"], ["--out", "/dev/null"], ["--help"]):
        done = subprocess.run(
            [PROGRAM, "--frames", frames, *arguments],
            stdout=write_end,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert done.returncode == OUTPUT, done
        assert done.stderr.endswith("cannot be written: Broken pipe\n")
        assert done.stderr.count("\n") == 1
    os.close(write_end)


def test_a_limit_of_file_sizes_is_an_output_that_cannot_be_written(frames: Path, out: Path) -> None:
    out.write_text("old")
    done = subprocess.run(
        [PROGRAM, "--frames", frames, "--out", out, "--rate", "1000"],
        capture_output=True,
        text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096)),
    )
    assert_refused(done, OUTPUT, out, "File too large")
    assert {p.name: p.read_text() for p in out.parent.iterdir()} == {out.name: "old"}
