"""One recording of many: its job, the check for finished results, and the run itself.

A job runs in a process of its own, so that one that crashes or is killed takes no other with it.
Its folder of results appears complete or not at all, and holds the key of what it was made from.
"""

import hashlib
import json
import time
from dataclasses import dataclass
from pathlib import Path

from unlidar import __version__
from unlidar.errors import InputError, UnlidarError, reason, shortened
from unlidar.presets import MMAUD
from unlidar.processes import Launcher
from unlidar.program import SUMMARY
from unlidar.record import MEASURES, read_finished, read_object

DONE, DONE_BEFORE, FAILED = "done", "done before", "failed"


@dataclass(frozen=True)
class Settings:
    """The settings that all recordings of a run share."""

    sensors: list[str] | None
    config_file: str | None
    config: str | None  # the text of the file, so that workers need not read it
    options: list[str]  # further options of the program
    threads: int  # of the program, for each recording
    truths: list[str]  # topics of bags, as of `convert`
    skip_bad: bool
    report: bool  # True if figure and page are made
    rate_hz: float | None = None  # frame rate of numbered frames
    poses_topic: str | None = None  # of bags, as of `convert`

    def options_with(self, config: str | None) -> list[str]:
        """All options of the program, with the configuration read from the file `config`."""
        chosen = [] if config is None else ["--config", config]
        return [*chosen, *self.options, "--threads", str(self.threads)]


@dataclass(frozen=True)
class Job:
    """One recording, where its results go, and the key of both."""

    name: str
    recording: str
    out: str
    settings: Settings
    program: str  # digest of the binary; machines with different builds are detected
    key: str
    token: str  # of this run, for the names of temporary folders


@dataclass(frozen=True)
class Row:
    """The outcome of a job: a row of the table."""

    name: str
    status: str
    time_s: float | None = None
    tracks: int | None = None
    measures: dict | None = None  # None without truth
    reason: str = ""  # why it failed
    exit_code: int = 0
    preset: str | None = None  # as in RunResult
    broken: bool = False  # True if the recording is damaged and only its readable part was tracked
    warnings: tuple[str, ...] = ()  # codes of the program's warnings


def make_job(
    name: str, recording: Path, out: Path, settings: Settings, program: str, token: str
) -> Job:
    """The job with the key of its input, its settings and the program's version.

    The key covers names, sizes and modification times of the input files, not their bytes, and
    not the number of threads, which changes no result.
    """
    parts = {
        "input": _files(recording),
        "sensors": settings.sensors,
        "config": settings.config,
        "options": settings.options,
        "truths": settings.truths,
        "skip_bad": settings.skip_bad,
        "poses_topic": settings.poses_topic,
        "report": settings.report,
        "preset": MMAUD.read_text() if settings.config is None else None,
        "program": program,
        "harness": __version__,
    }
    key = hashlib.sha256(json.dumps(parts).encode()).hexdigest()
    where = str(recording.absolute()), str(out.absolute())
    return Job(name, *where, settings, program, key, token)


def digest(program: Path) -> str:
    """A hash that distinguishes builds of the program that have the same version."""
    try:
        return hashlib.sha256(program.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(f"{program}: cannot be read: {reason(error)}") from error


def finished(job: Job) -> Row | None:
    """The row of an earlier run with the same key, if its results still exist."""
    out = Path(job.out)
    try:
        record = read_finished(out)
        if record.key != job.key:
            return None
        measures = None if record.truth is None else read_object(out / MEASURES)
        warnings = read_object(out / SUMMARY).get("warnings", [])
    except InputError:
        return None
    return Row(
        job.name,
        DONE,
        record.total_s,
        record.tracks,
        measures,
        preset=record.preset,
        broken=record.broken,
        warnings=tuple(sorted({str(warning["code"]) for warning in warnings})),
    )


def failed(name: str, error: UnlidarError) -> Row:
    """The row of a recording that could not be started."""
    return Row(name, FAILED, reason=shortened(str(error)), exit_code=error.exit_code)


class JobLauncher:
    """Does jobs in processes of their own, from any number of threads."""

    def __init__(self) -> None:
        self._launch = Launcher("unlidar.batch.child")
        self.stop = self._launch.stop

    def __call__(self, job: Job) -> Row:
        """Runs the job and returns its row; a failure is a row, too."""
        begin = time.perf_counter()
        ended = self._launch(job, job.name)
        row = finished(job) if ended.exit_code == 0 else None
        if row is not None:
            return row
        why, exit_code = ended.failure
        time_s = round(time.perf_counter() - begin, 3)
        return Row(job.name, FAILED, time_s, reason=why, exit_code=exit_code)


def launch(job: Job) -> Row:
    """Entry point of a cluster's worker: runs one job; repeated if a worker was lost."""
    return finished(job) or JobLauncher()(job)


def _files(recording: Path) -> list[tuple[str, int, int]]:
    """Name, size and time of change in ns of every file, the links followed."""
    files: list[tuple[str, int, int]] = []
    seen: set[Path] = set()
    waiting = [recording]
    try:
        while waiting:
            path = waiting.pop()
            if not path.is_dir():
                status = path.stat() if path.exists() else path.lstat()
                name = path.relative_to(recording).as_posix()
                files.append((name, status.st_size, status.st_mtime_ns))
            elif path.resolve() not in seen:
                seen.add(path.resolve())
                waiting += path.iterdir()
    except OSError as error:
        raise InputError(f"{recording}: cannot be read: {reason(error)}") from error
    return sorted(files)
