"""Jobs side by side on the cores of this machine."""

from contextlib import closing

from unlidar.benchmark.job import Job, Result, folders
from unlidar.errors import ForwardedError
from unlidar.pipeline import refuse_foreign
from unlidar.processes import Ended, Launcher, side_by_side
from unlidar.progress import with_progress


def run_jobs(jobs: list[Job], at_once: int) -> list[Result]:
    """Runs the jobs and returns their results in the order of the jobs.

    Throws ForwardedError if a job's own process fails; a failure of the program is a result.
    """
    for job in jobs:
        for folder in folders(job):
            refuse_foreign(folder)
    launcher = Launcher("unlidar.benchmark.child")

    def do(job: Job) -> Ended:
        return launcher(job, _name(job))

    by_scene = {}
    with (
        closing(side_by_side(do, jobs, at_once, launcher.stop)) as done,
        closing(with_progress(done, len(jobs), "Benchmark")) as shown,
    ):
        for job, ended in shown:
            if ended.exit_code != 0:
                why, exit_code = ended.failure
                raise ForwardedError(f"{_name(job)}: {why}", exit_code)
            by_scene[job.scene] = ended.result
    return [result for job in jobs for result in by_scene[job.scene]]


def _name(job: Job) -> str:
    return f"{job.scene.scene}, seed {job.scene.seed or '-'}"
