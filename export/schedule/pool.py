"""Where jobs run: processes of this machine, or those of a dask cluster."""

import contextlib
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from pathlib import Path

from edge_runtime.errors import ConfigError, EdgeError
from export.schedule.job import Job, run

CONNECT_S = 10


@contextlib.contextmanager
def pool(at_once: int, address: str | None) -> Iterator[tuple[Executor, int]]:
    """Yield what runs jobs, and how many at once: so many here, or one a thread of the cluster at ADDRESS.

    Its workers need this software and see the same directories.

    Raises:
        ConfigError: if dask is not installed, nobody answers at the address, or no worker has joined.
    """
    if address is None:
        threads = ThreadPoolExecutor(at_once)
        try:
            yield threads, at_once
        finally:
            threads.shutdown(cancel_futures=True)  # what has not begun stays so after an interruption
        return
    try:
        from distributed import Client  # noqa: PLC0415  # an extra
    except ImportError as error:
        raise ConfigError("--dask needs dask.distributed: pip install 'cfpg-edge[dask]'") from error
    try:
        client = Client(address, timeout=CONNECT_S)
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"--dask {address}: no scheduler answers there ({error}); start dask scheduler"
        ) from error
    with client:
        threads_there = sum(client.nthreads().values())
        if not threads_there:
            raise ConfigError(
                f"--dask {address}: no worker has joined; start dask worker {address} --nthreads 1"
            )
        with client.get_executor(pure=False, retries=0) as executor:
            yield executor, threads_there


def work_off(open_jobs: Sequence[Job], executor: Executor) -> Iterator[tuple[Job, str]]:
    """Run jobs, each after what it begins with; yield each with what went wrong, as they end."""
    waiting, running = list(open_jobs), dict[Future[str], Job]()
    while waiting or running:
        held = {job.directory for job in (*waiting, *running.values())}
        for job in [job for job in waiting if not _waits(job, held)]:
            waiting.remove(job)
            running[executor.submit(_attempt, job)] = job
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            yield running.pop(future), future.result()


def _waits(job: Job, held: set[Path]) -> bool:
    return job.predecessor is not None and job.predecessor.directory in held


def _attempt(job: Job) -> str:
    """Run a job; returns what went wrong."""
    try:
        run(job)
    except EdgeError as error:
        return str(error)
    return ""
