"""One start of the gradient method: a random motion, improved with exact derivatives.

The extreme eigenvalues are smoothed less and less and the barrier of the bounds gets lower stage
by stage (`smoothing`, `descent`); limits beside the bounds are a penalty that grows, held a
little tighter than asked because they are seen at samples only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from dynid.core.arrays import Array
from dynid.excitation.candidate import Candidate, Found, Stop
from dynid.excitation.descent import Descent, descend
from dynid.excitation.evaluation import DesignEvaluation
from dynid.excitation.region import MotionRegion
from dynid.excitation.smoothing import smoothed
from dynid.excitation.starts import random_numbers

BATCH = 30
"""Random motions of which a start takes the best."""
TIGHTEN = 0.02
"""Share by which limits beside the bounds shrink during the search."""
IDLE = 1e-4
"""Steps that gain less, in the logarithm of the criterion, end a stage."""
FILLS = (0.2, 0.9)
"""Share of the limits that random motions use; all of it where nothing but bounds is held."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """One descent."""

    barrier: float
    """Weight of the barrier of the bounds."""
    sharpness: float
    """Exponent of the smoothed eigenvalues."""
    penalty: float
    """Weight of broken limits."""
    iterations: int = 100
    """Most steps."""


STAGES = (
    Stage(barrier=1e-3, sharpness=2, penalty=1.0),
    Stage(barrier=1e-4, sharpness=5, penalty=10.0),
    Stage(barrier=1e-5, sharpness=20, penalty=100.0),
    Stage(barrier=1e-6, sharpness=100, penalty=1000.0),
)


def one_start(
    evaluation: DesignEvaluation,
    region: MotionRegion,
    *,
    seed: int,
    number: int,
    stop: Stop,
    found: Found,
) -> Candidate | None:
    """Random motions, and the best of them improved; a little violation can be descended from.

    Args:
        evaluation: Judges motions.
        region: The bounds.
        seed: Seed of the whole search.
        number: Which start this is; each has random numbers of its own.
        stop: Asked before every evaluation.
        found: Told a candidate after the batch and after every stage.

    Returns:
        The best candidate; None if there was no time for a single motion.
    """
    random = np.random.default_rng([seed, number])
    best: Array | None = None
    least = math.inf
    for _ in range(BATCH):
        if stop():
            break
        fill = float(random.uniform(*FILLS)) if evaluation.constrained else FILLS[1]
        x = random_numbers(region, 1, random, fill=fill)[0]
        value = evaluation.value(x) + evaluation.search_violation(x, TIGHTEN)
        if best is None or value < least:
            best, least = x, value
    if best is None:
        return None
    drawn = judged(evaluation, best)
    found(drawn)
    return improve(evaluation, region, drawn, stop=stop, found=found)


def improve(
    evaluation: DesignEvaluation,
    region: MotionRegion,
    start: Candidate,
    *,
    stop: Stop,
    found: Found,
    stages: tuple[Stage, ...] = STAGES,
    tighten: float = TIGHTEN,
) -> Candidate:
    """Descend from a motion, stage by stage; the best candidate is kept.

    Args:
        evaluation: Judges motions.
        region: The bounds; the start may lie outside and is then made smaller.
        start: Where to begin.
        stop: Asked before every evaluation.
        found: Told the candidate of every stage.
        stages: What to do.
        tighten: Share by which limits beside the bounds shrink.
    """
    x = start.x
    if not (region.slack(x) > 0).all():
        x = region.pulled_inside(x)
    state = Descent(x=x)
    best = start
    for stage in stages:
        objective = partial(
            evaluation.search,
            criterion=smoothed(evaluation.problem.criterion, stage.sharpness),
            penalty=stage.penalty,
            tighten=tighten,
        )
        descend(
            objective,
            region,
            state,
            weight=stage.barrier,
            iterations=stage.iterations,
            tolerance=IDLE,
            stop=stop,
        )
        reached = judged(evaluation, state.x)
        if reached.key < best.key:
            best = reached
        found(reached)
        if stop():
            break
    return best


def judged(evaluation: DesignEvaluation, x: Array) -> Candidate:
    """A motion as a candidate."""
    return Candidate(x=x, objective=evaluation.value(x), violation=evaluation.violation(x))
