"""Finding and calling the program `unlidar_track`."""

import os
import shutil
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from unlidar_tools.errors import InputError, ProgramError, UsageError, reason
from unlidar_tools.output import clear_results

NAME = "unlidar_track"
VARIABLE = "UNLIDAR_TRACK"
TRAJECTORY, SUMMARY, TARGET_RETURNS = "traj.csv", "summary.json", "target_returns.pcd"
CLUSTERS = "clusters.csv"
# Where a build in the source tree puts it, seen from there and from the tree's folders.
_BUILDS = (Path(__file__).parents[2] / "build", Path("build"), Path("../build"))


@dataclass(frozen=True)
class Outcome:
    """What a call of the program left behind."""

    trajectory: Path
    summary: Path
    target_returns: Path
    messages: str  # its stderr
    wall_s: float


def find_program() -> Path:
    """From the environment variable UNLIDAR_TRACK, else on PATH, else in a build folder."""
    named = os.environ.get(VARIABLE)
    if named:
        if not os.access(named, os.X_OK) or Path(named).is_dir():
            raise UsageError(f"{VARIABLE}={named}: is no program that can be run")
        return Path(named).absolute()
    on_path = shutil.which(NAME)
    if on_path:
        return Path(on_path)
    for build in _BUILDS:
        if os.access(build / NAME, os.X_OK):
            return (build / NAME).absolute()
    raise UsageError(
        f"{NAME} was found neither through {VARIABLE} nor on PATH nor in {_BUILDS[0]}; "
        "build it with tools/demo.sh"
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
    messages = _call(command)
    wall_s = time.perf_counter() - begin
    for path in (trajectory, summary, target_returns, clusters):
        if not path.is_file():
            raise ProgramError(f"{command[0]}: ended well but did not write {path}", 1)
    return Outcome(trajectory, summary, target_returns, messages, wall_s)


def check_options(options: list[str]) -> None:
    """Throws ProgramError if the program refuses these options, whatever the frames."""
    with tempfile.TemporaryDirectory() as empty:
        command = [str(find_program()), "--frames", f"{empty}/absent", "--out", f"{empty}/out"]
        try:
            _call([*command, *options])
        except ProgramError as error:
            if error.exit_code != InputError.exit_code:  # that is due to the frames
                raise


def _call(command: list[str]) -> str:
    """Runs the program and returns what it says on stderr."""
    try:
        done = subprocess.run(command, stderr=subprocess.PIPE, text=True, errors="replace")
    except OSError as error:
        raise ProgramError(f"{command[0]}: cannot be run: {reason(error)}", 1) from error
    if done.returncode < 0:
        raise ProgramError(f"{command[0]}: was ended by signal {-done.returncode}", 1)
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["without a message"])[-1]
        said = last.removeprefix(f"{NAME}: ").removeprefix("error: ")
        raise ProgramError(f"{NAME} ended with code {done.returncode}: {said}", done.returncode)
    return done.stderr
