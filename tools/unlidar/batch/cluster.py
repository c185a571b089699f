"""Jobs on a cluster of Dask workers, which see the same files under the same names."""

import logging
from collections.abc import Generator

from unlidar.batch.job import FAILED, Job, Row, launch
from unlidar.errors import UsageError, reason
from unlidar.extras import advice

_PATIENCE_S = 30


def run_on_cluster(jobs: list[Job], scheduler: str) -> Generator[Row, None, None]:
    """Yields the rows in the order of completion.

    The jobs of a worker that is lost are given to others. Throws UsageError if there is no such
    scheduler or no worker joins it.
    """
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise UsageError(f"--scheduler needs the extra [cluster]: {advice('cluster')}") from error
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # errors are reported in rows
    try:
        client = Client(scheduler, timeout=_PATIENCE_S)
    except (OSError, ValueError) as error:
        raise UsageError(f"--scheduler {scheduler}: no answer: {reason(error)}") from error
    with client:
        try:
            client.wait_for_workers(1, timeout=_PATIENCE_S)
        except TimeoutError as error:
            raise UsageError(
                f"--scheduler {scheduler}: no worker has joined it within {_PATIENCE_S} s"
            ) from error
        # Dask would reuse an earlier answer, but its folder of results may have been removed since.
        futures = {client.submit(launch, job, pure=False): job for job in jobs}
        for future in as_completed(futures):
            yield _row(future, futures[future])


def _row(future, job: Job) -> Row:
    try:
        return future.result()
    except Exception as error:  # a failure of the cluster itself; failures of jobs are rows
        why = f"{type(error).__name__}: {reason(error)}"
        return Row(job.name, FAILED, reason=why, exit_code=1)
