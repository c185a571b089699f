"""Every system call of a run fails once, is interrupted once, and is the last one once.

The shim (src/tests/fault_shim.cpp) makes the n-th call of a function go wrong, for every n until a
run makes fewer calls. Whatever happens, the outputs are the old ones or complete, nothing is left
beside them, and there is one line and the exit code of its kind, or full success.
"""

from __future__ import annotations

import errno
import os
import signal
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from synthetic import PROGRAM, Flight, make_flight, write_frames

SHIM = PROGRAM.parent / "src" / "tests" / "libfault_shim.so"
pytestmark = pytest.mark.skipif(not SHIM.is_file(), reason=f"{SHIM} is not built")

INTERNAL, CONFIG, INPUT, OUTPUT = 1, 3, 4, 5
OUTPUTS = {"traj.csv": "--out", "clusters.csv": "--clusters", "target.pcd": "--points"}
OLD = {"traj.csv": b"old", "clusters.csv": b"old"}  # the points are new
MODE = 0o640  # of the old ones


@dataclass
class Ended:
    """A run and what it left in the folder of its outputs."""

    code: int
    said: str
    files: dict[str, bytes]
    happened: bool  # there was such a call


@dataclass
class Program:
    folder: Path
    arguments: list[str | Path]

    def run(self, call: str = "", nth: int = 0, **fault: int) -> Ended:
        out = self.folder / "out"
        out.mkdir(exist_ok=True)
        for file in out.iterdir():
            file.unlink()
        for name, content in OLD.items():
            (out / name).write_bytes(content)
            (out / name).chmod(MODE)
        mark = self.folder / "mark"
        mark.unlink(missing_ok=True)
        settings = {"FAULT_CALL": call, "FAULT_NTH": nth, "FAULT_MARK": mark, **fault}
        done = subprocess.run(
            [PROGRAM, *self.arguments],
            env=os.environ | {"LD_PRELOAD": str(SHIM)} | {k: str(v) for k, v in settings.items()},
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            timeout=60,
        )
        files = {file.name: file.read_bytes() for file in out.iterdir()}
        for name in OLD:
            assert (out / name).stat().st_mode & 0o777 == MODE, name
        return Ended(done.returncode, done.stdout + done.stderr, files, mark.exists())

    def run_each(self, call: str, **fault: int) -> Iterator[Ended]:
        """Runs until there is no n-th call any more; there is at least one."""
        nth = 1
        while (ended := self.run(call, nth, **fault)).happened:
            yield ended
            nth += 1
        assert nth > 1, f"{call} is never called"


def program_on(folder: Path, flight: Flight, method: str) -> Program:
    """With every kind of input that there is: configuration, frames, their stamps, output times."""
    rng = np.random.default_rng(0)
    clouds = [c[(c[:, 2] > 5) | (rng.random(len(c)) < 0.1)] for c in flight.clouds]
    frames = write_frames(folder / "frames", Flight(flight.stamps_ns, clouds))
    names = sorted(path.name for path in frames.iterdir())
    rows = "".join(f"{name},{name.removesuffix('.pcd')}\n" for name in names)
    (frames / "timestamps.csv").write_text("file,timestamp\n" + rows)
    (folder / "config.yaml").write_text(f"method: {method}\n")
    (folder / "at.csv").write_text("file,timestamp\n" + rows)
    outputs = [part for name, option in OUTPUTS.items() for part in (option, folder / "out" / name)]
    inputs = ["--frames", frames, "--config", folder / "config.yaml", "--at", folder / "at.csv"]
    return Program(folder, [*inputs, *outputs, "--quiet"])


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Program:
    """Finds a drone, in no time."""
    return program_on(tmp_path_factory.mktemp("faults"), make_flight(frames=4), "paper")


@pytest.fixture(scope="module")
def complete(program: Program) -> dict[str, bytes]:
    """The outputs without a fault."""
    ended = program.run()
    assert (ended.code, ended.said) == (0, "")
    assert ended.files.keys() == OUTPUTS.keys()
    assert ended.files["traj.csv"].count(b"\n") == 5
    return ended.files


def assert_old_or_complete(ended: Ended, complete: dict[str, bytes]) -> None:
    assert ended.files.keys() - complete.keys() == set(), "something is left"
    for name, content in ended.files.items():
        assert content in (OLD.get(name, complete[name]), complete[name]), name


def assert_one_line(ended: Ended) -> None:
    assert ended.said.startswith("unlidar_track: error: ") and ended.said.count("\n") == 1, ended


READING = ["read", "fstat", "opendir", "readdir"]
WRITING = ["write", "fsync", "fchmod", "rename"]
BOTH = ["open", "close", "stat", "lstat", "realpath"]


@pytest.mark.parametrize(
    ("call", "error"),
    [(call, errno.EIO) for call in (*READING, *WRITING, *BOTH)]
    + [(call, errno.ENOSPC) for call in ("open", "write", "fsync", "close", "rename")],
)
def test_a_call_that_fails_is_reported_or_does_not_matter(
    program: Program, complete: dict[str, bytes], call: str, error: int
) -> None:
    codes = set()
    for ended in program.run_each(call, FAULT_ERRNO=error):
        codes.add(ended.code)
        assert_old_or_complete(ended, complete)
        if ended.code == 0:
            assert (ended.said, ended.files) == ("", complete)
        else:
            assert_one_line(ended)
            assert os.strerror(error) in ended.said
    if call in READING:
        assert codes <= {CONFIG, INPUT}
    elif call in WRITING:
        assert codes == {OUTPUT}
    else:
        assert OUTPUT in codes and codes <= {0, CONFIG, INPUT, OUTPUT}


@pytest.mark.parametrize("call", ["open", "read", "write", "fsync", "close", "unlink"])
def test_a_call_that_a_signal_interrupts_is_made_again(
    program: Program, complete: dict[str, bytes], call: str
) -> None:
    for ended in program.run_each(call, FAULT_ERRNO=errno.EINTR):
        assert (ended.code, ended.said, ended.files) == (0, "", complete)


@pytest.mark.parametrize("call", ["read", "write"])
def test_a_call_that_does_half_of_the_work_is_continued(
    program: Program, complete: dict[str, bytes], call: str
) -> None:
    for ended in program.run_each(call, FAULT_SHORT=1):
        assert (ended.code, ended.said, ended.files) == (0, "", complete)


@pytest.mark.parametrize("call", ["open", "write", "fsync", "close", "rename", "unlink"])
def test_a_signal_ends_a_run_without_a_trace(
    program: Program, complete: dict[str, bytes], call: str
) -> None:
    for ended in program.run_each(call, FAULT_SIGNAL=signal.SIGTERM):
        assert (ended.code, ended.said) == (-signal.SIGTERM, "")
        assert_old_or_complete(ended, complete)


@pytest.mark.parametrize("call", ["write", "fsync", "rename", "unlink"])
def test_a_run_that_is_killed_leaves_no_half_output(
    program: Program, complete: dict[str, bytes], call: str
) -> None:
    for ended in program.run_each(call, FAULT_SIGNAL=signal.SIGKILL):
        assert ended.code == -signal.SIGKILL
        ended.files = {n: c for n, c in ended.files.items() if not n.startswith(".unlidar_track-")}
        assert_old_or_complete(ended, complete)


def test_memory_that_ends_is_reported(tmp_path: Path) -> None:
    """In too few frames for a track, so that nothing is fitted."""
    program = program_on(tmp_path, make_flight(frames=3), "robust")
    complete = program.run().files
    program.arguments += ["--summary", tmp_path / "summary.json"]  # with times
    last = 1
    while program.run("malloc", 2 * last, FAULT_ERRNO=errno.ENOMEM).happened:
        last *= 2
    early, evenly = np.geomspace(1, last, 30), np.linspace(1, 2 * last, 60)
    for nth in np.unique(np.concatenate([early, evenly]).astype(int)):
        ended = program.run("malloc", int(nth), FAULT_ERRNO=errno.ENOMEM)
        if not ended.happened:
            break
        assert_old_or_complete(ended, complete)
        if ended.code == 0:  # a library that does without
            assert (ended.said, ended.files.keys()) == ("", complete.keys())
            continue
        assert_one_line(ended)
        no_memory = "out of memory", os.strerror(errno.ENOMEM), "internal"
        assert ended.code in (INTERNAL, INPUT, OUTPUT)
        assert any(words in ended.said for words in no_memory), ended
