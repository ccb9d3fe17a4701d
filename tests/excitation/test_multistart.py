from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from typing import Any

import numpy as np
import pytest
from design_arms import arm, problem

from dynid.core import InputError, Workers, workers
from dynid.excitation import (
    DesignEvaluation,
    Effort,
    GeneticAlgorithm,
    MotionSearch,
    Search,
    by_gradient,
    region_of,
)
from dynid.excitation.gradient import judged
from dynid.excitation.searches import multistart, run_start


class Dying(Executor):
    """Workers that die: each task, or the pool itself."""

    def __init__(self, *, at_once: bool) -> None:
        self.at_once = at_once
        self.tasks = 0

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        self.tasks += 1
        if self.at_once:
            raise BrokenProcessPool("gone")
        future: Future[Any] = Future()
        future.set_exception(BrokenProcessPool("gone"))
        return future


class Immediate(Executor):
    """Runs each task in the calling thread."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        return future


class Waiting(Executor):
    """Keeps its tasks until it is told to run them."""

    def __init__(self) -> None:
        self.tasks: list[tuple[Future[Any], Callable[[], Any]]] = []

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.tasks.append((future, partial(fn, *args, **kwargs)))
        return future

    def run(self) -> None:
        for future, task in self.tasks:
            if not future.done():
                future.set_result(task())


def best(search: Search) -> tuple[float, np.ndarray]:
    assert search.best is not None
    return search.best.objective, search.best.x


def test_the_answer_does_not_depend_on_who_runs_the_starts() -> None:
    asked, effort = problem(), Effort(starts=3)
    alone = multistart(asked, effort, seed=1)
    assert (alone.ended_by, alone.starts) == ("starts", 3)
    with workers(2) as found:
        assert found.executor is not None
        beside = multistart(asked, effort, seed=1, beside=found)
    immediate = multistart(asked, effort, seed=1, beside=Workers(Immediate(), 2))
    for other in (beside, immediate):
        assert other.starts == 3
        assert best(other)[0] == best(alone)[0]
        np.testing.assert_array_equal(best(other)[1], best(alone)[1])
    assert beside.evaluations == alone.evaluations
    assert best(multistart(asked, effort, seed=2))[0] != best(alone)[0]


def test_no_worker_waits_for_the_start_that_runs_here() -> None:
    asked, waiting, handed = problem(), Waiting(), list[int]()

    def tell(search: Search, share: float) -> None:
        handed.append(len(waiting.tasks))
        waiting.run()

    search = multistart(asked, Effort(starts=6), seed=1, beside=Workers(waiting, 2), tell=tell)
    assert handed[0] == 4
    # The last start is run here: nobody is waited for who has not begun.
    assert handed[-1] == 4
    assert search.starts == 6
    assert best(search)[0] == best(multistart(asked, Effort(starts=6), seed=1))[0]


def test_a_search_without_patience_drops_the_starts_that_have_not_begun() -> None:
    waiting = Waiting()
    effort = Effort(starts=50, budget_s=60.0, patience=1)
    search = multistart(problem(), effort, seed=1, beside=Workers(waiting, 1))
    assert search.ended_by == "stagnation"
    assert search.wall_s < 60.0
    assert all(future.cancelled() for future, _ in waiting.tasks)


@pytest.mark.parametrize("at_once", [False, True])
def test_starts_of_dead_workers_are_run_here(at_once: bool) -> None:
    asked, effort = problem(), Effort(starts=3)
    dying = Dying(at_once=at_once)
    search = multistart(asked, effort, seed=1, beside=Workers(dying, 1))
    assert dying.tasks >= 1
    assert search.starts == 3
    assert best(search)[0] == best(multistart(asked, effort, seed=1))[0]


def test_interrupted_searches_keep_the_best_motion() -> None:
    told: list[str] = []

    def tell(search: Search, share: float) -> None:
        told.append(search.words())
        if len(told) == 4:
            raise KeyboardInterrupt

    search = multistart(problem(), Effort(starts=5), seed=1, tell=tell)
    assert search.ended_by == "interrupt"
    assert len(told) == 4
    assert search.best is not None
    assert best(search)[0] == pytest.approx(np.log(search.history[-1].value))


def test_no_patience_ends_a_search_that_does_not_get_better() -> None:
    search = multistart(problem(), Effort(starts=50, patience=2), seed=1)
    assert search.ended_by == "stagnation"
    assert 3 <= search.starts < 50


def test_the_history_only_gets_better() -> None:
    search = multistart(problem(), Effort(starts=3), seed=5)
    values = [entry.value for entry in search.history]
    assert values == sorted(values, reverse=True)
    counted = [entry.evaluations for entry in search.history]
    assert counted == sorted(counted)
    assert counted[0] > 0


def test_gradients_beat_the_genetic_algorithm_with_as_many_evaluations() -> None:
    asked = problem()
    search = multistart(asked, Effort(starts=2), seed=0)
    evaluation = DesignEvaluation(asked)
    seen: list[float] = []

    def judge(x: np.ndarray) -> Any:
        candidate = judged(evaluation, x)
        seen.append(candidate.objective)
        return candidate

    generations = 5
    rival = MotionSearch(
        problem=asked, region=region_of(asked), judge=judge, constrained=False, seed=0,
        stop=lambda: False,
    )  # fmt: skip
    GeneticAlgorithm(search.evaluations // generations, generations).minimize(rival)
    assert len(seen) >= search.evaluations
    assert best(search)[0] < min(seen) - 0.05


def test_a_start_without_time_brings_nothing() -> None:
    result = run_start(problem(), "a", 0, 1, 0.0)
    assert result.best is None
    assert result.evaluations == 0


def test_a_budget_for_no_motion_is_refused() -> None:
    with pytest.raises(InputError, match="budget is too short"):
        by_gradient(problem(), Effort(budget_s=1e-6), seed=0)


def test_designs_are_certified() -> None:
    done, search = by_gradient(problem(arm(torque=60.0), safe=True), Effort(starts=2), seed=0)
    assert done.certificate.holds
    assert done.certificate.margins["torque"] is not None
    assert search.best is not None
    np.testing.assert_array_equal(done.x, search.best.x)
