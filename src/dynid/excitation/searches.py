"""Many starts of the gradient method, here and beside this process; the genetic algorithm.

An individual of the genetic algorithm (300 individuals, 5 generations, operators of our own) holds,
for each joint, the shape of its motion (its direction in the space of free numbers), the place of
the motion in the position range and how much of the tightest limit it uses. It is decoded by
scaling each joint onto its tightest bound of position, velocity and acceleration, so these are met
by every individual. Other constraints (torque, speed of the tool, collisions) are handled
feasibility first (Deb, 2000): of two individuals the feasible one wins, of two infeasible ones the
one that violates less, of two feasible ones the better criterion.
"""

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import ClassVar
from uuid import uuid4

import numpy as np

from dynid.core import Array, Value, WorkerLost, Workers, one_thread, result_of, told_to_stop
from dynid.excitation.evaluation import (
    Candidate,
    DesignEvaluation,
    ExcitationProblem,
    Search,
    SearchProgress,
    Stop,
)
from dynid.excitation.gradient import one_start
from dynid.excitation.region import MotionRegion, region_of, shape_basis

GRACE_S = 0.5
"""What workers may take after the deadline to tell what they have [s]."""


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
    """How long to search; starts or a budget, or both."""

    starts: int | None = None
    """How many starts; None for as many as fit into the time."""
    budget_s: float | None = None
    """Time [s]; None for no limit."""
    patience: int | None = None
    """Stop after so many starts without a better one; None to go on."""


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


TOURNAMENT = 3
"""Individuals that compete to become a parent."""
ELITE = 0.02
"""Share of the population that survives unchanged."""
EXCHANGE = 0.5
"""Chance of a child to take whole joints from both parents; the others are blended."""
BLEND = 0.3
"""How far blending goes beyond the parents (BLX-alpha)."""
MUTATED_JOINTS = 0.25
"""Chance of a joint to be mutated."""
MUTATION = 0.3
"""Spread of a mutation, genes having a spread of one."""
LEAST_FILL = 0.3
"""Least share of the tightest limit, where other constraints can make smaller motions better."""

# Genes of a population are (P, n, k + 2): the shape in k coordinates with a spread of one, the
# place within 0 and 1, the share of the tightest limit within `LEAST_FILL` and 1.


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionSearch(Value):
    """What an optimiser of designs searches: the numbers x (n, 1 + k) of a motion, see `Candidate`.

    The best motions that it judges are kept, and certified.
    """

    problem: ExcitationProblem
    """Robot, motions, criterion and limits."""
    region: MotionRegion
    """Bounds of position, velocity and acceleration; `random_numbers` draws within."""
    judge: Callable[[Array], Candidate]
    """The criterion and the broken limits of a motion x (n, 1 + k); smaller `key` is better."""
    constrained: bool
    """Whether there are limits beside those of the region."""
    seed: int
    """Of all random numbers."""
    stop: Stop
    """Whether the time is over, to be asked before each motion."""


class DesignOptimiser(ABC):
    """A way to search for a motion."""

    name: ClassVar[str] = "own"
    """Stands in the design in place of `--method`."""
    ends: ClassVar[str] = "optimiser"
    """What it ended by where neither time nor a person did."""

    @property
    def evaluations(self) -> int | None:
        """Motions that it will judge, for the progress; None: not known before."""
        return None

    @abstractmethod
    def minimize(self, search: MotionSearch) -> int:
        """Judge motions until the best one is good enough; how many rounds were finished."""


@dataclass(frozen=True)
class GeneticAlgorithm(DesignOptimiser):
    """The paper's: a random population, and what generations make of it; see the module."""

    name: ClassVar[str] = "ga"
    ends: ClassVar[str] = "generations"
    population: int = 300
    generations: int = 5

    @property
    def evaluations(self) -> int:
        """Of all generations."""
        return self.population + self.generations * (self.population - self._elite)

    def minimize(self, search: MotionSearch) -> int:
        """See `DesignOptimiser`: of the generations after a random one, how many were finished."""
        random, region = np.random.default_rng(search.seed), search.region
        basis, full = shape_basis(region).T, not search.constrained
        size = (self.population, len(region.middle), 1)
        shape, place = random.standard_normal((*size[:2], len(basis))), random.uniform(size=size)
        fill = np.ones(size) if full else random.uniform(LEAST_FILL, 1.0, size=size)
        genes = np.concatenate([shape, place, fill], axis=2)
        scores: list[Candidate] = []
        for generation in range(self.generations + 1):
            new = genes
            if generation > 0:
                new = _children(genes, self.population - self._elite, random, full)
            fresh: list[Candidate] = []
            for x in _decoded(new, region, basis):
                if search.stop():
                    return max(generation - 1, 0)
                fresh.append(search.judge(x))
            if generation > 0:
                genes = np.concatenate([genes[: self._elite], new])
            scores = scores[: self._elite] + fresh
            order = sorted(range(self.population), key=lambda i: scores[i].key)
            genes, scores = genes[order], [scores[i] for i in order]
        return self.generations

    @property
    def _elite(self) -> int:
        """How many survive a generation unchanged."""
        return max(1, round(ELITE * self.population))


def _decoded(genes: Array, region: MotionRegion, basis: Array) -> Array:
    fill = genes[..., -1]
    numbers = region.onto_limits(genes[..., :-2] @ basis, genes[..., -2])
    if (fill == 1.0).all():
        return numbers
    # Smaller about its own middle: it stays where it fits.
    swing = numbers[..., 1:] @ region.columns[0][:, 1:].T
    middle = (swing.max(axis=-1) + swing.min(axis=-1)) / 2
    if region.pose is None:
        numbers[..., 0] += (1.0 - fill) * middle
    numbers[..., 1:] *= fill[..., None]
    return numbers


def _children(genes: Array, count: int, random: np.random.Generator, full: bool) -> Array:
    """Children of a population sorted best first."""
    population, joints, width = genes.shape
    # The smallest rank of a few wins the tournament.
    parents = random.integers(population, size=(2, count, TOURNAMENT)).min(axis=2)
    swap = random.uniform(size=(count, 1)) < EXCHANGE
    from_other = (random.uniform(size=(count, joints)) < 0.5).astype(np.float64)
    blended = random.uniform(-BLEND, 1.0 + BLEND, size=(count, joints))
    share = np.where(swap, from_other, blended)[..., None]
    mutated = random.uniform(size=(count, joints, 1)) < MUTATED_JOINTS
    kinds = [random.standard_normal((count, joints, k)) for k in (width - 2, 1, 1)]
    noise = MUTATION * mutated * np.concatenate(kinds, axis=2)
    children = (1.0 - share) * genes[parents[0]] + share * genes[parents[1]] + noise
    # Only directions count; unit spread keeps mutations of one size through the generations.
    shape = children[..., :-2]
    shape /= np.sqrt(np.mean(np.square(shape), axis=-1, keepdims=True)) + 1e-300
    children[..., -2] = np.clip(children[..., -2], 0.0, 1.0)
    children[..., -1] = 1.0 if full else np.clip(children[..., -1], LEAST_FILL, 1.0)
    return children
