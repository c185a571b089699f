"""Programs that are run to be measured."""

import json
import os
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from unlidar.errors import ProgramError

_TIME = "/usr/bin/time"  # GNU's


@dataclass(frozen=True)
class Usage:
    """Of one process from its start to its end."""

    wall_s: float
    cpu_s: float
    memory_mb: float  # most that it had resident


def run(command: Sequence[str | Path]) -> Usage:
    """Throws ProgramError with what it said last if it fails."""
    return start(command).wait()


def start(command: Sequence[str | Path]) -> "Running":
    """With a pipe to its stdin."""
    return Running([str(part) for part in command])


class Running:
    """A process at work."""

    def __init__(self, command: list[str]) -> None:
        self._command = command
        self._said = tempfile.TemporaryFile()  # noqa: SIM115 (open until it has ended)
        self._begin = time.perf_counter()
        # The kernel counts the memory of this process to what it starts, so another one starts it.
        self._memory = tempfile.NamedTemporaryFile()  # noqa: SIM115
        options = ["--format=%M", f"--output={self._memory.name}", "--"]
        self._process = subprocess.Popen(
            [_TIME, *options, *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=self._said,
        )

    @property
    def stdin(self) -> BinaryIO:
        """Unbuffered."""
        assert self._process.stdin is not None
        return self._process.stdin

    def wait(self) -> Usage:
        """Closes its stdin and waits for its end."""
        self.stdin.close()
        _, status, used = os.wait4(self._process.pid, 0)
        wall_s = time.perf_counter() - self._begin
        self._process.returncode = os.waitstatus_to_exitcode(status)
        with self._said as said:
            said.seek(0)
            last = (said.read().decode(errors="replace").splitlines() or ["no message"])[-1]
        if self._process.returncode != 0:
            raise ProgramError(f"{self._command[0]}: {last}", 1)
        with self._memory as memory:
            memory_kb = int(memory.read().split()[-1])
        return Usage(wall_s, used.ru_utime + used.ru_stime, memory_kb / 1024)


def google_benchmark(program: Path, arguments: Sequence[str | Path], least_s: float) -> dict:
    """The results of a program of src/bench by name; each benchmark runs for at least so long."""
    with tempfile.NamedTemporaryFile(suffix=".json") as out:
        options = [f"--benchmark_min_time={least_s}", f"--benchmark_out={out.name}"]
        run([program, *arguments, *options])
        found = json.loads(Path(out.name).read_bytes())
    return {one["name"]: one for one in found["benchmarks"]}


def cpu_ms(result: dict) -> float:
    """Time of the processor of one iteration."""
    return result["cpu_time"] * {"ns": 1e-6, "us": 1e-3, "ms": 1.0, "s": 1e3}[result["time_unit"]]
