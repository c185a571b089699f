"""Jobs side by side on this machine."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed

from unlidar_tools.batch.job import Job, Launcher, Row


def run_here(jobs: list[Job], at_once: int) -> Iterator[Row]:
    """The rows in the order in which they are done; what runs is ended when the caller is."""
    launcher = Launcher()
    with ThreadPoolExecutor(at_once) as pool:  # its threads only wait for processes
        futures = [pool.submit(launcher, job) for job in jobs]
        try:
            for future in as_completed(futures):
                yield future.result()
        finally:
            launcher.stop()
