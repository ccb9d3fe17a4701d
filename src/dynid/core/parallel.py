"""Where the tasks of a long job run: here, in processes beside this one, or on a Dask cluster.

`workers` opens what `--jobs` and `--dask` ask for, `each` runs one task for every item. A worker
that ends early costs time, not results: its tasks run again, here if nobody else is left.
"""

import ctypes
import multiprocessing
import os
import signal
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterator, Sequence
from concurrent import futures
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from multiprocessing.synchronize import Event
from typing import Any, TypeVar

from dynid.core.errors import InputError, require
from dynid.core.findings import Progress

Item = TypeVar("Item")
Result = TypeVar("Result")

DASK_TIMEOUT_S = 10.0
"""A scheduler that does not answer by then is none."""
POLL_S = 2.0
"""How often a cluster that has finished nothing is asked whether it still has workers [s]."""
GONE_S = 20.0
"""A cluster without any worker for so long will not get one again [s]."""
HANDED_S = 0.5
"""Duration of the items that a worker gets at a time, estimated from the last one run here [s]."""
KEPT_BYTES = 128 << 20
"""Freed memory that a worker keeps."""
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""Parameters of `mallopt` (malloc.h)."""
MOST_REOPENED = 20
"""Pools of local processes that are opened in place of broken ones."""
_enough: Event | None = None
"""In a worker: set when the job is over."""


class WorkerLost(Exception):
    """A task has no result because its worker died."""


@dataclass(slots=True)
class Workers:
    """Workers beside the calling process.

    `executor` is None where there are none, or none any more.
    """

    executor: futures.Executor | None = None
    slots: int = 0
    """Tasks that they take at a time."""
    reopen: Callable[[], futures.Executor] | None = None
    """Opens local processes again: one that is killed breaks all of them."""
    present: Callable[[], int] | None = None
    """How many workers a cluster has now."""
    reopened: int = 0

    def submit(self, task: Callable[..., Result], *words: Any) -> futures.Future[Result] | None:
        """Hand a task, which other processes can import, to the workers; None if there are none."""
        while self.executor is not None:
            # A process that is being started inherits the mask: Ctrl-C is for the caller alone.
            mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            try:
                return self.executor.submit(_run, task, *words)
            except (RuntimeError, *_losses_of_dask()):
                again = self.reopen is not None and self.reopened < MOST_REOPENED
                self.executor = self.reopen() if again and self.reopen is not None else None
                self.reopened += 1
            finally:
                signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        return None

    def finished(
        self, pending: Collection[futures.Future[Result]], wait_s: float | None
    ) -> set[futures.Future[Result]]:
        """Tasks that are done or lost, waiting for the first so long [s]; None for no limit."""
        until = None if wait_s is None else time.monotonic() + wait_s
        without = 0.0
        while pending:
            left = POLL_S if until is None else min(POLL_S, until - time.monotonic())
            begun = time.monotonic()
            done, _ = futures.wait(
                pending, timeout=max(left, 0.0), return_when=futures.FIRST_COMPLETED
            )
            if done or (until is not None and time.monotonic() >= until):
                return done
            empty = self.present is not None and self.present() == 0
            without = without + time.monotonic() - begun if empty else 0.0
            if without >= GONE_S:
                self.executor = None
                for future in pending:
                    future.cancel()
                return set(pending)
        return set()


def result_of(future: futures.Future[Result]) -> Result:
    """The result of a task that `Workers.finished` gave.

    Raises:
        WorkerLost: Its worker died. What the task itself raises is raised as it is.
    """
    try:
        return future.result()
    except (futures.BrokenExecutor, futures.CancelledError, *_losses_of_dask()) as error:
        raise WorkerLost from error


def _losses_of_dask() -> tuple[type[Exception], ...]:
    """What is raised where a cluster lost a worker, or this process its scheduler."""
    distributed: Any = sys.modules.get("distributed")
    if distributed is None:
        return ()
    return distributed.KilledWorker, distributed.client.ClosedClientError


def each(
    task: Callable[[Item], Result],
    items: Sequence[Item],
    beside: Workers,
    *,
    tell: Progress | None = None,
    words: str = "",
) -> Iterator[tuple[int, Result]]:
    """Run a task for each item, here and beside; the results come as they are ready.

    Args:
        task: A function that other processes can import; what it raises is raised here.
        items: Its arguments.
        beside: Who takes part.
        tell: Told how many are done.
        words: What is being done, for `tell`.

    Yields:
        Number of the item, and its result.
    """
    todo = deque(range(len(items)))
    pending: dict[futures.Future[list[Result]], list[int]] = {}
    done, own_s = 0, HANDED_S

    def told(number: int, result: Result) -> tuple[int, Result]:
        nonlocal done
        done += 1
        if tell is not None:
            tell(words, done / len(items))
        return number, result

    try:
        while todo or pending:
            # One more than they work on, so that none waits for this process, which keeps one.
            while len(todo) > 1 and len(pending) < 2 * beside.slots:
                # Fewer towards the end, so that all are done at about the same time.
                size = min(int(HANDED_S / max(own_s, 1e-6)), len(todo) // (4 * beside.slots))
                numbers = [todo.popleft() for _ in range(max(size, 1))]
                future = beside.submit(_several, task, [items[number] for number in numbers])
                if future is None:
                    todo.extendleft(reversed(numbers))
                    break
                pending[future] = numbers
            if todo:
                number, begun = todo.popleft(), time.monotonic()
                result = task(items[number])
                own_s = time.monotonic() - begun
                yield told(number, result)
            for future in beside.finished(pending, 0.0 if todo else None):
                numbers = pending.pop(future)
                try:
                    results = result_of(future)
                except WorkerLost:
                    todo.extend(numbers)
                    continue
                for number, result in zip(numbers, results, strict=True):
                    yield told(number, result)
    finally:
        for future in pending:
            future.cancel()


@contextmanager
def workers(jobs: int = 1, dask: str | None = None) -> Generator[Workers]:
    """Open workers, and close them when the job is over.

    Args:
        jobs: Processes on this machine, the calling one included; 1 opens none.
        dask: Address of a Dask scheduler, whose workers are taken instead.

    Yields:
        The workers.

    Raises:
        InputError: Jobs below 1, or no scheduler at the address.
        MissingExtraError: Dask is not installed.
    """
    if jobs < 1 or jobs % 1:
        raise InputError("must be a whole number, at least 1", where="--jobs", value=jobs)
    if dask is not None:
        with _dask_workers(dask) as found:
            yield found
        return
    if jobs == 1:
        yield Workers()
        return
    # Spawned, not forked: threads of BLAS and Numba do not survive a fork.
    context = multiprocessing.get_context("spawn")
    enough = context.Event()
    pools: list[futures.ProcessPoolExecutor] = []

    def opened() -> futures.Executor:
        pools.append(
            futures.ProcessPoolExecutor(
                jobs - 1, mp_context=context, initializer=_begin_worker, initargs=(enough,)
            )
        )
        return pools[-1]

    try:
        with _single_threaded():
            yield Workers(opened(), jobs - 1, reopen=opened)
    finally:
        enough.set()
        for pool in pools:
            pool.shutdown(wait=True, cancel_futures=True)


def _run(task: Callable[..., Result], *words: Any) -> Result:
    """Run a task in a worker."""
    _keep_memory()
    return task(*words)


@cache
def _keep_memory() -> None:
    """Have this process keep the memory that arrays free, for the next ones.

    Dask lets its workers give all of it back at once (`MALLOC_TRIM_THRESHOLD_`), so every array
    is paged in anew: 44 ms of CPU for a recording of a fleet instead of 24.
    """
    allocate = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if allocate is not None:
        for parameter, size in ((_TRIM_THRESHOLD, KEPT_BYTES), (_MMAP_THRESHOLD, KEPT_BYTES >> 2)):
            allocate(parameter, size)


def _several(task: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
    return [task(item) for item in items]


def told_to_stop() -> bool:
    """In a worker: whether the job is over and the task's result no longer wanted."""
    return _enough is not None and _enough.is_set()


@contextmanager
def _dask_workers(address: str) -> Generator[Workers]:
    distributed: Any = require("distributed", "dask")
    scheme, _, place = address.rpartition("://")
    if scheme != "inproc":
        _require_port(address, scheme, place)
    try:
        client = distributed.Client(address, timeout=DASK_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            "no Dask scheduler answers", where="--dask", value=address, limit=str(error) or None
        ) from error

    def present() -> int:
        try:
            return len(client.nthreads())
        except (OSError, TimeoutError, *_losses_of_dask()):
            return 0

    try:
        slots = sum(client.nthreads().values())
        if not slots:
            raise InputError(
                "the Dask cluster has no workers",
                where="--dask",
                value=address,
                next_step=f"Start one: dask worker {address} --nthreads 1",
            )
        # Not by name of their arguments: to hash a whole problem costs more than to send it.
        yield Workers(client.get_executor(pure=False), slots, present=present)
    finally:
        client.close()


def _require_port(address: str, scheme: str, place: str) -> None:
    """Whether somebody listens: a client that finds nobody prints a traceback when it ends."""
    host, _, port = place.partition("/")[0].rpartition(":")
    if (
        scheme not in ("", "tcp", "tls", "ws", "wss", "ucx", "ucxx")
        or not host
        or not port.isdecimal()
    ):
        raise InputError(
            "no address of a Dask scheduler", where="--dask", value=address, limit="HOST:PORT"
        )
    try:
        socket.create_connection((host.strip("[]"), int(port)), DASK_TIMEOUT_S).close()
    except (OSError, OverflowError, ValueError) as error:
        raise InputError(
            f"no Dask scheduler answers: {error}", where="--dask", value=address
        ) from error


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
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A worker whose parent was killed would wait for tasks for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
