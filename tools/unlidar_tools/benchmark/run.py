"""Jobs side by side on the cores of this machine."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool

from unlidar_tools.benchmark.job import Job, Result, do
from unlidar_tools.errors import UnlidarError
from unlidar_tools.progress import with_progress


def run_jobs(jobs: list[Job], at_once: int) -> list[Result]:
    """The results in the order of the jobs, whichever is done first."""
    # Spawned, as a fork would copy the thread of the progress bar in whatever state it is.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(at_once, len(jobs)), context)
    try:
        futures = {pool.submit(do, job): index for index, job in enumerate(jobs)}
        done = with_progress(as_completed(futures), len(jobs), "Benchmark")
        by_job = {futures[future]: future.result() for future in done}
    except BrokenProcessPool as error:
        raise UnlidarError("a process of the benchmark was ended from outside") from error
    finally:
        pool.shutdown(cancel_futures=True)
    return [result for index in range(len(jobs)) for result in by_job[index]]
