"""The process of one job: `python -m unlidar_tools.batch.child PARENT_PID <job.json`.

It ends when the process that started it does, also when that one is killed.
"""

import ctypes
import json
import os
import shutil
import signal
import sys
import time
from pathlib import Path

from unlidar_tools.batch.job import Job, digest, finished
from unlidar_tools.cli import report_errors
from unlidar_tools.convert import Options
from unlidar_tools.errors import OutputError, UsageError
from unlidar_tools.output import RUN_MARKER, complete_directory
from unlidar_tools.program import VARIABLE, find_program
from unlidar_tools.run import run
from unlidar_tools.truth import read_tracks

_CONFIG = "config.yaml"
_PR_SET_PDEATHSIG = 1  # <linux/prctl.h>


def main() -> int:
    """Does the job on stdin; returns the exit code."""
    _end_with(int(sys.argv[1]))
    return report_errors(lambda: _do(Job.from_json(sys.stdin.read())))


def _do(job: Job) -> None:
    program = find_program()
    if digest(program) != job.program:
        raise UsageError(f"{os.uname().nodename}: {program} is another build than where run began")
    os.environ[VARIABLE] = str(program)
    out = Path(job.out)
    if out.exists() and any(out.iterdir()) and not (out / RUN_MARKER).is_file():
        raise OutputError(f"{out}: holds no {RUN_MARKER}, so it is no earlier result to replace")
    try:
        with complete_directory(out, force=True, source=Path(job.recording)) as work:
            os.chdir(work)  # what the results say of their own files holds wherever they lie
            _write_results(job)
    except Exception as error:
        if isinstance(error, OutputError) and finished(job) is not None:
            return  # another worker was given the same job and was faster
        if (out / RUN_MARKER).is_file():  # of other settings: not to be taken for this run's
            shutil.rmtree(out, ignore_errors=True)
        raise


def _write_results(job: Job) -> None:
    begin = time.perf_counter()
    settings = job.settings
    if settings.config is not None:
        Path(_CONFIG).write_text(settings.config)
    options = settings.options_with(None if settings.config is None else _CONFIG)
    reading = Options(truths=tuple(settings.truths), skip_bad=settings.skip_bad)
    result = run(Path(job.recording), Path(), settings.sensors, options, reading)
    record = {
        "key": job.key,
        "recording": job.recording,
        "sensors": list(result.recording.sensors),
        "messages": result.outcome.messages.splitlines(),
        "time_s": round(time.perf_counter() - begin, 3),
        "tracks": len(set(read_tracks(result.outcome.trajectory).track_id)),
        "measures": result.measures,
        "notes": result.recording.notes,
        "broken": result.recording.broken,
        "preset": None if result.preset is None else result.preset.name,
    }
    Path(RUN_MARKER).write_text(json.dumps(record, indent=2) + "\n")


def _end_with(parent: int) -> None:
    """Asks the kernel to end this process, as by SIGTERM, when its parent is gone."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # gone already
        sys.exit(1)


if __name__ == "__main__":
    sys.exit(main())
