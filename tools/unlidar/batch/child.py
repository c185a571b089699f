"""The process of one job: `python -m unlidar.batch.child`, started by a Launcher."""

import os
import shutil
import sys
from pathlib import Path

from unlidar.batch.job import Job, digest, finished
from unlidar.conversion import Options
from unlidar.errors import OutputError, UsageError
from unlidar.output import complete_directory
from unlidar.pipeline import CONFIG, is_own, run
from unlidar.processes import serve
from unlidar.program import VARIABLE, find_program
from unlidar.record import is_result


def do(job: Job) -> None:
    """Writes the results of the job, all or none."""
    program = find_program()
    if digest(program) != job.program:
        raise UsageError(f"{os.uname().nodename}: {program} is another build than where run began")
    os.environ[VARIABLE] = str(program)
    out = Path(job.out)
    _refuse_foreign(out)
    try:
        with complete_directory(out, True, Path(job.recording), job.token) as work:
            os.chdir(work)  # paths inside the results become relative, so the folder can be moved
            settings = job.settings
            if settings.config is not None:
                Path(CONFIG).write_text(settings.config)
            options = settings.options_with(None if settings.config is None else CONFIG)
            reading = Options(
                truths=tuple(settings.truths),
                skip_bad=settings.skip_bad,
                rate_hz=settings.rate_hz,
                poses_topic=settings.poses_topic,
            )
            run(
                Path(job.recording),
                Path(),
                settings.sensors,
                options,
                reading,
                job.key,
                settings.report,
            )
    except Exception as error:
        if isinstance(error, OutputError) and finished(job) is not None:
            return  # a second worker with the same job finished first
        if is_result(out):  # results of other settings must not be mistaken for this run's
            shutil.rmtree(out, ignore_errors=True)
        raise


def _refuse_foreign(out: Path) -> None:
    """Refuses to replace a folder that no run wrote, or that holds files beside its results."""
    found = sorted(path.name for path in out.iterdir()) if out.is_dir() else []
    if found and not is_result(out):
        raise OutputError(f"{out}: holds no run.json of a run, so it is no earlier result")
    foreign = next((name for name in found if not is_own(name)), None)
    if foreign is not None:
        raise OutputError(f"{out / foreign}: was not written by this command, move it elsewhere")


if __name__ == "__main__":
    sys.exit(serve(do))
