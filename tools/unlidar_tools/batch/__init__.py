"""Many recordings in, their results and one table out."""

import fcntl
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from unlidar_tools.batch.cluster import run_on_cluster
from unlidar_tools.batch.discovery import Found, find_recordings
from unlidar_tools.batch.job import DONE_BEFORE, Row, Settings, digest, finished, make_job
from unlidar_tools.batch.pool import run_here
from unlidar_tools.errors import OutputError, UsageError, reason
from unlidar_tools.program import check_options, find_program
from unlidar_tools.progress import with_progress

_LOCK = ".lock"


def run_many(
    root: Path, out: Path, settings: Settings, at_once: int, scheduler: str | None = None
) -> list[Row]:
    """Runs every recording below `root`, each to its own folder of `out`; a row for each.

    What an earlier run has done with the same input, settings and program is not done again. A
    recording that fails does not stop the others. Throws UsageError or ConfigError for what would
    fail everywhere.
    """
    check_options(settings.options_with(settings.config_file))
    program = digest(find_program())
    if out.resolve() == root.resolve():
        raise UsageError(f"--out {out}: is the folder of the recordings, choose another")
    found = find_recordings(root, out)
    _refuse_inside(out, found)
    jobs = [make_job(f.name, f.path, out / f.name, settings, program) for f in found]
    with _alone(out):
        _remove_unfinished(out)
        earlier = [finished(job) for job in jobs]
        rows = {row.name: replace(row, status=DONE_BEFORE) for row in earlier if row is not None}
        left = [job for job in jobs if job.name not in rows]
        done = run_on_cluster(left, scheduler) if scheduler else run_here(left, at_once)
        for row in with_progress(done, len(left), f"Running {root.resolve().name}"):
            rows[row.name] = row
    return [rows[job.name] for job in jobs]


def _refuse_inside(out: Path, found: list[Found]) -> None:
    for recording in found:
        if recording.path.resolve() in (out.resolve(), *out.resolve().parents):
            raise UsageError(f"--out {out}: lies in the recording {recording.path}")


@contextmanager
def _alone(out: Path) -> Iterator[None]:
    """Keeps a second run away from these results; the system frees the lock of a killed one."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        with (out / _LOCK).open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise UsageError(f"--out {out}: another run is writing to it") from error
            yield
    except OSError as error:
        raise OutputError(f"{out}: cannot be written: {reason(error)}") from error


def _remove_unfinished(out: Path) -> None:
    """What a killed run left; a folder with its final name is complete."""
    for kind in ("partial", "old"):
        for folder in out.rglob(f".*.{kind}-*"):
            shutil.rmtree(folder, ignore_errors=True)
