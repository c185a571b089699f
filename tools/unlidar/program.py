"""Finding and calling the program `unlidar_track`."""

import os
import re
import shlex
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from unlidar.errors import InputError, ProgramError, UsageError, reason
from unlidar.output import clear_results
from unlidar.progress import on_terminal, show_stages
from unlidar.reporting import is_verbose, stage

NAME = "unlidar_track"
PACKAGE = "unlidar-track"  # tools/package.sh makes it
VARIABLE = "UNLIDAR_TRACK"
TRAJECTORY, SUMMARY, TARGET_RETURNS = "traj.csv", "summary.json", "target_returns.pcd"
CLUSTERS = "clusters.csv"
_STAGE = re.compile(rf"{NAME}: (.+: .+) \([0-9.]+ s\)")  # a stage in its --verbose output
_VERBOSITY_OPTIONS = {"--quiet", "--verbose"}
_OWN = Path(__file__).parent / "bin" / NAME  # of a wheel, by setup.py
# Build folders, relative to the source tree and to the working directory.
_BUILDS = (Path(__file__).parents[2] / "build", Path("build"), Path("../build"))


@dataclass(frozen=True)
class Outcome:
    """Outputs of a call of the program."""

    trajectory: Path
    summary: Path
    target_returns: Path
    answer: str  # its stdout
    messages: tuple[str, ...]  # its stderr, a line each, without the stages
    wall_s: float


def warnings_of(summary: dict) -> list[str]:
    """Texts of the warnings in a summary of the program; empty for older programs."""
    return [str(warning["text"]) for warning in summary.get("warnings", [])]


def find_program() -> Path:
    """The program: from UNLIDAR_TRACK, else this wheel's own, else PATH, else a build folder.

    UsageError if absent.
    """
    named = os.environ.get(VARIABLE)
    if named:
        if not os.access(named, os.X_OK) or Path(named).is_dir():
            raise UsageError(f"{VARIABLE}={named}: is no program that can be run")
        return Path(named).absolute()
    if os.access(_OWN, os.X_OK):
        return _OWN
    on_path = shutil.which(NAME)
    if on_path:
        return Path(on_path)
    for build in _BUILDS:
        if os.access(build / NAME, os.X_OK):
            return (build / NAME).absolute()
    raise UsageError(
        f"{NAME} was found neither through {VARIABLE} nor on PATH nor in a folder build/; "
        f"install the Debian package {PACKAGE}, or build it with tools/demo.sh of the project"
    )


def run_program(sensors: dict[str, Path], out: Path, options: list[str]) -> Outcome:
    """Tracks these sensors' frames; trajectory, summary, target returns and clusters go to `out`.

    Throws ProgramError with the program's own message and exit code if it fails.
    """
    names = (TRAJECTORY, SUMMARY, TARGET_RETURNS, CLUSTERS)
    clear_results(out, names)
    trajectory, summary, target_returns, clusters = (out / name for name in names)
    command = [str(find_program())]
    for name, directory in sensors.items():
        command += ["--frames", f"{name}={directory}"]
    command += ["--out", str(trajectory), "--summary", str(summary)]
    command += ["--points", str(target_returns), "--clusters", str(clusters), *options]
    begin = time.perf_counter()
    answer, messages = _call(command, "Tracking")
    wall_s = time.perf_counter() - begin
    for path in (trajectory, summary, target_returns, clusters):
        if not path.is_file():
            raise ProgramError(f"{command[0]}: ended well but did not write {path}", 1)
    return Outcome(trajectory, summary, target_returns, answer, messages, wall_s)


def check_options(options: list[str]) -> None:
    """Throws UsageError without the program, ProgramError if it refuses these options.

    The program parses options before it looks for frames, so it is called with missing frames.
    """
    with tempfile.TemporaryDirectory() as empty:
        command = [str(find_program()), "--frames", f"{empty}/absent", "--out", f"{empty}/out"]
        try:
            _call([*command, *options])
        except ProgramError as error:
            if error.exit_code != InputError.exit_code:  # the expected error: missing frames
                raise


def _call(command: list[str], description: str | None = None) -> tuple[str, tuple[str, ...]]:
    """Runs the program; returns its stdout and the lines of its stderr.

    With a `description`, stages are shown as they end, on a terminal or with --verbose.
    """
    asked = _VERBOSITY_OPTIONS.intersection(command)
    shown = description is not None and not asked and (is_verbose() or on_terminal())
    if description is not None:
        stage(f"command: {shlex.join(command)}")
    lines: list[str] = []
    with (
        tempfile.TemporaryFile("w+", errors="replace") as answer,
        show_stages(description if shown else None) as ended,
        _started([*command, *(["--verbose"] if shown else [])], answer) as process,
    ):
        for line in process.stderr:
            line = line.rstrip("\n")
            if shown and (found := _STAGE.fullmatch(line)):
                ended(found[1])
                stage(line)
            else:
                lines.append(line)
        exit_code = process.wait()
        answer.seek(0)
        answered = answer.read()
    if exit_code < 0:
        raise ProgramError(f"{command[0]}: was ended by signal {-exit_code}", 1)
    if exit_code != 0:
        last = next((line for line in reversed(lines) if line.strip()), "without a message")
        message = last.removeprefix(f"{NAME}: ").removeprefix("error: ")
        raise ProgramError(f"{NAME} ended with code {exit_code}: {message}", exit_code)
    return answered, tuple(lines)


@contextmanager
def _started(command: list[str], answer: TextIO) -> Iterator[subprocess.Popen]:
    """The running program, killed on an interrupt."""
    try:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=answer,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
        )
    except OSError as error:
        raise ProgramError(f"{command[0]}: cannot be run: {reason(error)}", 1) from error
    with process:
        try:
            yield process
        except BaseException:
            process.kill()
            raise
