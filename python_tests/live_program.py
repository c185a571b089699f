"""Helpers for tests of live runs: the framing, the program as a process, its events."""

from __future__ import annotations

import array
import contextlib
import fcntl
import json
import re
import signal
import subprocess
import termios
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import pytest
from synthetic import BEGIN_NS, PERIOD_NS, PROGRAM, TRAJ_HEADER, Flight, seconds, write_pcd

ENDLESS = ("--set", "live.delay_s=.inf", "--set", "live.window_s=.inf")
PATIENCE_S = 60.0
KIND = {"drone", "bird_like", "unknown"}
STATE = ("track", "timestamp", "x", "y", "z", "vx", "vy", "vz", "sigma_x", "sigma_y", "sigma_z")
FIELDS = {
    "track": {"event", "at", "track", "first_evidence", *KIND},
    "row": {
        *("event", "at", "support", "late"),
        *STATE,
        *KIND,
    },
    "now": {"event", "at", "unseen_s", *STATE},
    "end": {"event", "at", "track", "timestamp", *KIND},
    "sensor": {"event", "at", "name", "state"},
    "returns": {"event", "at", "name", "timestamp", "step_m", "xyz"},
    "state": {"event", "at", "state", "frames", "dropped"},
}
OPTIONAL = {"sensor": {"clock"}}  # with --livox


def message(name: str, stamp: str, pcd: bytes) -> bytes:
    return f"frame {name} {stamp} {len(pcd)}\n".encode() + pcd


def messages(**directories: Path) -> list[bytes]:
    """The frames of directories of one sensor each, in the order of their stamps."""
    frames = [
        (float(path.stem), order, name, path)
        for order, (name, directory) in enumerate(directories.items())
        for path in directory.glob("*.pcd")
    ]
    return [message(name, path.stem, path.read_bytes()) for _, _, name, path in sorted(frames)]


class Live:
    """A running program with both ends of its pipes."""

    def __init__(self, *arguments: str | Path) -> None:
        assert PROGRAM.is_file(), f"{PROGRAM} is not built; UNLIDAR_TRACK names another place"
        self.process = subprocess.Popen(
            [PROGRAM, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )

    def __enter__(self) -> Live:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout, self.process.stderr):
            with contextlib.suppress(BrokenPipeError):  # what it did not take
                pipe.close()

    def send(self, data: bytes) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(data)
        self.process.stdin.flush()

    def runs(self) -> bool:
        """True once the program takes signals where it waits: before, they kill it."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        blocked = int(status.partition("SigBlk:")[2].split()[0], 16)
        return bool(blocked >> (signal.SIGTERM - 1) & 1)

    def signal(self, number: signal.Signals) -> None:
        wait_until(lambda: self.process.poll() is not None or self.runs(), "it runs")
        self.process.send_signal(number)

    def end(self, number: signal.Signals | None = None) -> tuple[int, str, str]:
        """Ends stdin, or sends a signal, and returns exit code, stdout, stderr."""
        if number is not None:
            self.signal(number)
            code = self.process.wait(PATIENCE_S)
            out, said = self.process.communicate(timeout=PATIENCE_S)
        else:
            out, said = self.process.communicate(timeout=PATIENCE_S)
            code = self.process.returncode
        return code, out.decode(), said.decode()


def feed(data: bytes, out: Path, *arguments: str | Path) -> tuple[int, str, str]:
    """Pipes the bytes in at once and returns exit code, stdout, stderr."""
    done = subprocess.run(
        [PROGRAM, "--stdin", "--out", out, *arguments],
        input=data,
        capture_output=True,
        timeout=300,
    )
    return done.returncode, done.stdout.decode(), done.stderr.decode()


def wait_until(holds: Callable[[], Any], what: str) -> None:
    end = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < end, f"waited in vain until {what}"
        time.sleep(0.02)


def rows_of(path: Path) -> list[str]:
    """The whole rows that are there now."""
    lines = path.read_text().splitlines(keepends=True) if path.exists() else []
    if not lines:
        return []
    assert lines[0] == TRAJ_HEADER + "\n"
    return [line.rstrip("\n") for line in lines[1:] if line.endswith("\n")]


def events_of(text: str | Path) -> list[dict]:
    """All events, each checked against the contract."""
    lines = (text.read_text() if isinstance(text, Path) else text).splitlines()
    events = []
    for line in lines:
        event = json.loads(line)
        assert set(event) - OPTIONAL.get(event["event"], set()) == FIELDS[event["event"]], line
        if "drone" in event:
            assert sum(event[key] for key in KIND) == pytest.approx(1, abs=1e-9), line
        for key in ("at", "timestamp", "first_evidence"):
            if key in event:
                assert re.search(rf'"{key}":-?\d+\.\d{{9}}[,}}]', line), line
        events.append(event)
    assert [e["at"] for e in events] == sorted(e["at"] for e in events)
    return events


def write_two_sensors(directory: Path, flight: Flight) -> dict[str, Path]:
    """The flight as two sensors see it: every other return each, stamps 40 ms apart."""
    shift_ns = 40_000_000
    folders = {}
    for part, name in enumerate(("left", "right")):
        folders[name] = directory / name
        folders[name].mkdir(parents=True)
        for stamp_ns, cloud in zip(flight.stamps_ns, flight.clouds, strict=True):
            path = folders[name] / f"{seconds(stamp_ns + part * shift_ns)}.pcd"
            write_pcd(path, cloud[part::2])
    return folders


def move_into(directory: Path, frames: Iterable[Path]) -> None:
    """Makes files appear in one piece."""
    directory.mkdir(parents=True, exist_ok=True)
    for path in frames:
        temporary = directory / f".{path.name}.part"
        temporary.write_bytes(path.read_bytes())
        temporary.rename(directory / path.name)


def by_stamp(directory: Path) -> list[Path]:
    return sorted(directory.glob("*.pcd"), key=lambda path: float(path.stem))


def end_of(flight: Flight) -> float:
    return (BEGIN_NS + len(flight.stamps_ns) * PERIOD_NS) * 1e-9


def pieces(data: bytes, size: int) -> Sequence[bytes]:
    return [data[i : i + size] for i in range(0, len(data), size)]


def unread_bytes(live: Live) -> int:
    """Bytes that were sent and not read yet."""
    assert live.process.stdin is not None
    count = array.array("i", [0])
    fcntl.ioctl(live.process.stdin.fileno(), termios.FIONREAD, count)
    return count[0]
