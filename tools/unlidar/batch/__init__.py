"""Many recordings in, their results and one table out."""

from collections.abc import Generator, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from unlidar.batch.cluster import run_on_cluster
from unlidar.batch.discovery import Found, common_folder, find_recordings
from unlidar.batch.job import (
    DONE_BEFORE,
    Job,
    JobLauncher,
    Row,
    Settings,
    digest,
    failed,
    finished,
    make_job,
)
from unlidar.batch.register import registered
from unlidar.batch.table import table_files, write_tables
from unlidar.errors import InputError, UsageError
from unlidar.processes import side_by_side
from unlidar.program import check_options, find_program
from unlidar.progress import with_progress


def run_many(
    given: Sequence[Path],
    out: Path,
    settings: Settings,
    at_once: int,
    scheduler: str | None = None,
) -> list[Row]:
    """Runs the recordings given and all below, each to its own folder of `out`; a row for each.

    Results of an earlier run with the same input, settings and program are kept. A recording that
    fails does not stop the others. Throws UsageError or ConfigError for faults that every
    recording would meet.
    """
    check_options(settings.options_with(settings.config_file))
    program = digest(find_program())
    root = common_folder(given)
    if out.resolve() == root.resolve():
        raise UsageError(f"--out {out}: is the folder of the recordings, choose another")
    found = find_recordings(given, out)
    _refuse_inside(out, found)
    with registered(out, [f.name for f in found], table_files(out)) as token:
        rows: dict[str, Row] = {}
        left: list[Job] = []
        for one in found:
            try:
                job = make_job(one.name, one.path, out / one.name, settings, program, token)
            except InputError as error:  # not even its key can be computed
                rows[one.name] = failed(one.name, error)
                continue
            row = finished(job)
            if row is None:
                left.append(job)
            else:
                rows[one.name] = replace(row, status=DONE_BEFORE)
        done = run_on_cluster(left, scheduler) if scheduler else _run_here(left, at_once)
        with closing(done):
            for row in with_progress(done, len(left), f"Running {root.resolve().name}"):
                rows[row.name] = row
        in_order = [rows[one.name] for one in found]
        write_tables(in_order, out)
    return in_order


def _run_here(jobs: list[Job], at_once: int) -> Generator[Row, None, None]:
    """Runs the jobs on this machine and yields their rows in the order of completion."""
    launcher = JobLauncher()
    with closing(side_by_side(launcher, jobs, at_once, launcher.stop)) as done:
        for _, row in done:
            yield row


def _refuse_inside(out: Path, found: list[Found]) -> None:
    for recording in found:
        if recording.path.resolve() in (out.resolve(), *out.resolve().parents):
            raise UsageError(f"--out {out}: lies in the recording {recording.path}")
