from __future__ import annotations

import numpy as np
import pytest
from design_arms import Floats, arm, problem

from dynid.core import InputError
from dynid.excitation import (
    Candidate,
    DesignEvaluation,
    GeneticAlgorithm,
    MotionSearch,
    by_optimiser,
    random_numbers,
    region_of,
)
from dynid.excitation.gradient import judged

POPULATION, GENERATIONS = 40, 5


def evolved(seed: int, *, safe: bool = False) -> list[Candidate]:
    """Every individual, in order."""
    asked = problem(arm(torque=40.0), safe=safe)
    evaluation = DesignEvaluation(asked)
    seen: list[Candidate] = []

    def judge(x: Floats) -> Candidate:
        seen.append(judged(evaluation, x))
        return seen[-1]

    search = MotionSearch(
        problem=asked, region=region_of(asked), judge=judge, constrained=safe, seed=seed,
        stop=lambda: False,
    )  # fmt: skip
    assert GeneticAlgorithm(POPULATION, GENERATIONS).minimize(search) == GENERATIONS
    return seen


def test_a_seed_gives_the_same_generations_again_and_another_seed_others() -> None:
    first, again, other = (evolved(seed) for seed in (3, 3, 4))
    assert [c.objective for c in first] == [c.objective for c in again]
    assert [c.objective for c in first] != [c.objective for c in other]


def test_every_individual_is_on_its_tightest_limit_and_none_beyond() -> None:
    region = region_of(problem())
    for candidate in evolved(0):
        slack = region.slack(candidate.x).min(axis=(0, 1))
        np.testing.assert_allclose(slack, 0.0, atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_beats_as_many_random_motions(seed: int) -> None:
    seen = evolved(seed)
    evaluation = DesignEvaluation(problem())
    random = np.random.default_rng(1000 + seed)
    drawn = random_numbers(region_of(problem()), len(seen), random, fill=1.0)
    assert min(c.objective for c in seen) < min(evaluation.value(x) for x in drawn)


def test_feasible_individuals_win_over_better_criteria() -> None:
    seen = evolved(0, safe=True)
    fresh = POPULATION - 1
    shares = [
        np.mean([c.key[0] == 0.0 for c in seen[first : first + fresh]])
        for first in (0, len(seen) - fresh)
    ]
    assert shares[1] > shares[0]
    best = min(seen, key=lambda c: c.key)
    assert best.violation == 0.0
    assert any(c.objective < best.objective and c.violation > 0.0 for c in seen)


def test_the_whole_optimiser_certifies_its_best() -> None:
    done, search = by_optimiser(
        problem(arm(torque=40.0), safe=True), GeneticAlgorithm(20, 2), seed=0
    )
    assert done.certificate.holds
    assert search.ended_by == "generations"
    values = [entry.value for entry in search.history if entry.feasible]
    assert values == sorted(values, reverse=True)


def test_a_budget_for_no_motion_is_refused() -> None:
    with pytest.raises(InputError, match="budget is too short"):
        by_optimiser(problem(), GeneticAlgorithm(), seed=0, budget_s=1e-6)
