"""Where starts run beside this process: local processes, or a Dask cluster."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Generator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.synchronize import Event
from typing import Any, NamedTuple

from dynid.core.errors import InputError
from dynid.core.optional import require

DASK_TIMEOUT_S = 10.0
"""A scheduler that does not answer by then is none."""
_enough: Event | None = None
"""In a worker: set when the search is over."""


class Workers(NamedTuple):
    """An executor and how many tasks it takes at a time."""

    executor: Executor | None
    slots: int


@contextmanager
def workers(jobs: int, dask: str | None = None) -> Generator[Workers]:
    """Open workers, and close them when the search is over.

    Args:
        jobs: Processes on this machine, the calling one included; 1 opens none.
        dask: Address of a Dask scheduler, whose workers are taken instead.

    Yields:
        The workers.

    Raises:
        InputError: Jobs below 1, or no scheduler at the address.
        MissingExtraError: Dask is not installed.
    """
    if jobs < 1:
        raise InputError("must be at least 1", where="--jobs", value=jobs)
    if dask is not None:
        with _dask_workers(dask) as found:
            yield found
        return
    if jobs == 1:
        yield Workers(None, 0)
        return
    # Spawned, not forked: threads of BLAS and Numba do not survive a fork.
    context = multiprocessing.get_context("spawn")
    enough = context.Event()
    pool = ProcessPoolExecutor(
        jobs - 1, mp_context=context, initializer=_begin_worker, initargs=(enough,)
    )
    try:
        with _single_threaded():
            yield Workers(pool, jobs - 1)
    finally:
        enough.set()
        pool.shutdown(wait=True, cancel_futures=True)


def told_to_stop() -> bool:
    """In a worker: whether the search is over and its start no longer wanted."""
    return _enough is not None and _enough.is_set()


@contextmanager
def _dask_workers(address: str) -> Generator[Workers]:
    distributed: Any = require("distributed", "dask")
    try:
        client = distributed.Client(address, timeout=DASK_TIMEOUT_S)
    except (OSError, ValueError) as error:
        raise InputError(
            "no Dask scheduler answers", where="--dask", value=address, limit=str(error) or None
        ) from error
    try:
        slots = sum(client.nthreads().values())
        if not slots:
            raise InputError("the Dask cluster has no workers", where="--dask", value=address)
        yield Workers(client.get_executor(), slots)
    finally:
        client.close()


@contextmanager
def _single_threaded() -> Generator[None]:
    """Workers that begin now keep their numerical libraries to one thread."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _begin_worker(enough: Event) -> None:
    global _enough
    _enough = enough
    # Ctrl-C reaches the whole process group; the calling process decides what ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
