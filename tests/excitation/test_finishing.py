from __future__ import annotations

import numpy as np
from design_arms import arm, problem

from dynid.excitation.candidate import Candidate
from dynid.excitation.evaluation import DesignEvaluation
from dynid.excitation.finishing import Finished, finish
from dynid.excitation.gradient import judged
from dynid.excitation.problem import ExcitationProblem
from dynid.excitation.region import region_of
from dynid.excitation.search import Search
from dynid.excitation.starts import random_numbers


def too_fast(asked: ExcitationProblem, count: int = 1) -> list[Candidate]:
    """Motions that keep the bounds and break something else."""
    evaluation = DesignEvaluation(asked)
    random = np.random.default_rng(0)
    found: list[Candidate] = []
    while len(found) < count:
        x = random_numbers(region_of(asked), 1, random, fill=1.0)[0]
        candidate = judged(evaluation, x)
        if candidate.violation > 0.5:
            found.append(candidate)
    return found


def finished(asked: ExcitationProblem, candidates: list[Candidate], *, stop: bool) -> Finished:
    search = Search(problem=asked)
    for number, candidate in enumerate(candidates):
        search.add(candidate, number)
    return finish(search, DesignEvaluation(asked), region_of(asked), stop=lambda: stop)


def test_a_motion_that_breaks_a_limit_is_improved_until_it_passes() -> None:
    asked = problem(arm(torque=60.0), safe=True)
    found = finished(asked, too_fast(asked), stop=False)
    assert found.repair == "tightened"
    assert found.certificate.feasible


def test_without_time_it_is_made_as_small_as_it_must_be() -> None:
    asked = problem(arm(torque=60.0), safe=True)
    (candidate,) = too_fast(asked)
    found = finished(asked, [candidate], stop=True)
    assert found.repair == "smaller"
    assert found.certificate.feasible
    ratio = found.x[:, 1:] / candidate.x[:, 1:]
    np.testing.assert_allclose(ratio, ratio[0, 0], rtol=1e-12)
    # Not smaller than it must be: some limit is nearly used up.
    margins = [m for k, m in found.certificate.margins.items() if m is not None and k != "position"]
    assert min(margins) < 0.1


def test_a_worse_candidate_that_passes_is_taken_before_repairs() -> None:
    asked = problem(arm(torque=60.0), safe=True)
    slow = random_numbers(region_of(asked), 1, np.random.default_rng(3), fill=0.05)[0]
    good = judged(DesignEvaluation(asked), slow)
    assert good.violation == 0.0
    # Seen at too few samples, the fast one passed for feasible.
    fast = Candidate(x=too_fast(asked)[0].x, objective=0.0, violation=0.0)
    found = finished(asked, [fast, good], stop=False)
    assert found.repair == ""
    np.testing.assert_array_equal(found.x, slow)


def test_what_cannot_be_repaired_comes_back_with_its_verdict() -> None:
    # The arm cannot even hold itself.
    asked = problem(arm(torque=0.5), safe=True)
    found = finished(asked, too_fast(asked), stop=True)
    assert not found.certificate.feasible
    assert "torque" in found.certificate.broken
