"""Many starts of the gradient method, here and beside this process."""

import threading
import time
from collections.abc import Generator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass
from uuid import uuid4

from threadpoolctl import threadpool_limits  # pyright: ignore[reportMissingTypeStubs]

from dynid.core import InputError, WorkerLost, Workers, result_of, told_to_stop
from dynid.excitation.evaluation import DesignEvaluation
from dynid.excitation.gradient import one_start
from dynid.excitation.problem import Candidate, ExcitationProblem, Search, SearchProgress
from dynid.excitation.region import region_of

GRACE_S = 0.5
"""What workers may take after the deadline to tell what they have [s]."""


@contextmanager
def one_thread() -> Generator[None]:
    """Matrices of 50 columns gain nothing from more threads, which only wait for each other."""
    with threadpool_limits(limits=1, user_api="blas"):
        yield


class _Built(threading.local):
    """In a worker's thread: the last search's name and what was built for it."""

    token = ""
    evaluation: DesignEvaluation | None = None


_built = _Built()


@dataclass(frozen=True, slots=True)
class StartResult:
    """What one start brought."""

    number: int
    best: Candidate | None
    evaluations: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Effort:
    """How long to search.

    Raises:
        InputError: Neither starts nor a budget, or numbers that are not positive.
    """

    starts: int | None = None
    """How many starts; None for as many as fit into the time."""
    budget_s: float | None = None
    """Time [s]; None for no limit."""
    patience: int | None = None
    """Stop after so many starts without a better one; None to go on."""

    def __post_init__(self) -> None:
        if self.starts is None and self.budget_s is None:
            raise InputError("a search needs a number of starts or a time budget")
        for name, number in (("--starts", self.starts), ("--budget", self.budget_s)):
            if number is not None and not number > 0:
                raise InputError("must be positive", where=name, value=number)


def multistart(
    problem: ExcitationProblem,
    effort: Effort,
    *,
    seed: int,
    beside: Workers | None = None,
    tell: SearchProgress | None = None,
) -> Search:
    """Run starts until their number, the time or the patience is up.

    The calling process takes part, so that the first motion does not wait for others to begin.
    With a given number of starts the answer does not depend on who ran them. Ctrl-C ends the
    search with what was found.

    Args:
        problem: What to design.
        effort: How long.
        seed: Of all random numbers.
        beside: Who runs further starts; None to run all of them here.
        tell: Told the search after every candidate, and how far it is.
    """
    run = _StartRun(problem, effort, seed, beside or Workers(), tell)
    try:
        while run.more():
            # One more than they work on, so that none waits for this process, which keeps one.
            while len(run.pending) < 2 * run.beside.slots and run.several() and run.submit():
                pass
            if run.more():
                run.start_here()
            run.collect(wait_s=0.0)
        run.finish()
    except KeyboardInterrupt:
        run.search.ended_by = "interrupt"
        for future in run.pending:
            future.cancel()
    return run.search


def run_start(
    problem: ExcitationProblem, token: str, seed: int, number: int, deadline: float | None
) -> StartResult:
    """One start in another process, of a search named by its token, until the deadline.

    What its first start built serves its next ones. The deadline is by the machine's clock
    (`time.time`); None for never.
    """
    if _built.evaluation is None or _built.token != token:
        _built.token, _built.evaluation = token, DesignEvaluation(problem)
    evaluation = _built.evaluation
    before = evaluation.evaluations
    with one_thread():
        best = one_start(
            evaluation,
            region_of(problem),
            seed=seed,
            number=number,
            stop=lambda: told_to_stop() or (deadline is not None and time.time() >= deadline),
            found=lambda candidate: None,
        )
    return StartResult(number, best, evaluation.evaluations - before)


class _StartRun:
    """The state of one multistart."""

    def __init__(
        self,
        problem: ExcitationProblem,
        effort: Effort,
        seed: int,
        beside: Workers,
        tell: SearchProgress | None,
    ) -> None:
        self.problem, self.effort, self.seed, self.tell = problem, effort, seed, tell
        self.beside = beside
        self.evaluation = DesignEvaluation(problem)
        self.region = region_of(problem)
        self.evaluation.warm_up()
        # The clock runs from here: compiling kernels, once on every machine, is not searching.
        self.search = Search(problem=problem)
        self.pending: dict[Future[StartResult], int] = {}
        self.lost: list[int] = []
        self.begun = 0
        self.token = uuid4().hex
        self.idle = 0

    def over(self) -> bool:
        budget = self.effort.budget_s
        return budget is not None and self.search.wall_s >= budget

    def more(self) -> bool:
        """Whether to begin another start; if not, notes why."""
        effort = self.effort
        if self.over():
            self.search.ended_by = "budget"
        elif effort.starts is not None and self.begun >= effort.starts and not self.lost:
            self.search.ended_by = "starts"
        elif effort.patience is not None and self.idle >= effort.patience:
            self.search.ended_by = "stagnation"
        return not self.search.ended_by

    def several(self) -> bool:
        """Whether to begin another start and one more after it."""
        starts = self.effort.starts
        return self.more() and (starts is None or starts - self.begun + len(self.lost) > 1)

    def submit(self) -> bool:
        """Whether somebody took another start."""
        budget = self.effort.budget_s
        # Not the time left: a worker may need seconds before it begins.
        deadline = None if budget is None else time.time() + budget - self.search.wall_s
        number = self._next()
        future = self.beside.submit(
            run_start, self.problem, self.token, self.seed, number, deadline
        )
        if future is None:
            self.lost.append(number)
            return False
        self.pending[future] = number
        return True

    def start_here(self) -> None:
        number = self._next()
        evaluation, elsewhere = self.evaluation, self.search.evaluations
        before, best_before = evaluation.evaluations, self.search.best

        def found(candidate: Candidate) -> None:
            self.search.evaluations = elsewhere + evaluation.evaluations - before
            self._add(candidate, number)

        best = one_start(
            evaluation, self.region, seed=self.seed, number=number, stop=self.over, found=found
        )
        self.search.evaluations = elsewhere
        result = StartResult(number, best, evaluation.evaluations - before)
        self._take(result, best_before)

    def collect(self, wait_s: float | None) -> None:
        """Take in what other processes finished, waiting for the first so long."""
        for future in self.beside.finished(self.pending, wait_s):
            number = self.pending.pop(future)
            try:
                self._take(result_of(future), self.search.best)
            except WorkerLost:
                # A worker that died takes its start with it; it is begun again here.
                self.lost.append(number)

    def finish(self) -> None:
        """Take in the rest; where the time is up, what comes in a moment."""
        budget = self.effort.budget_s
        if self.search.ended_by == "stagnation":
            for future in [future for future in self.pending if future.cancel()]:
                del self.pending[future]
        while self.pending:
            left = None if budget is None else budget + GRACE_S - self.search.wall_s
            if left is not None and left <= 0:
                break
            self.collect(left)
        for future in self.pending:
            future.cancel()
        while self.lost and not self.over():
            self.start_here()

    def _next(self) -> int:
        if self.lost:
            return self.lost.pop()
        self.begun += 1
        return self.begun

    def _take(self, result: StartResult, before: Candidate | None) -> None:
        self.search.evaluations += result.evaluations
        self.search.starts += 1
        if result.best is not None:
            self._add(result.best, result.number)
        after = self.search.best
        better = after is not None and (before is None or after.key < before.key)
        self.idle = 0 if better else self.idle + 1

    def _add(self, candidate: Candidate, number: int) -> None:
        self.search.add(candidate, number)
        if self.tell is not None:
            shares = [0.0]
            if self.effort.starts is not None:
                shares.append(self.search.starts / self.effort.starts)
            if self.effort.budget_s is not None:
                shares.append(self.search.wall_s / self.effort.budget_s)
            self.tell(self.search, min(max(shares), 1.0))
