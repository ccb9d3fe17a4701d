"""One start of the gradient method: a random motion, improved with exact derivatives.

Quasi-Newton descent inside a polytope: the barrier's exact curvature, BFGS for the rest. The
extreme eigenvalues are smoothed less and less and the barrier gets lower stage by stage; limits
beside the bounds are a penalty that grows, held tighter than asked as they are seen at samples.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from dynid.core import Array
from dynid.excitation.criteria import smoothed
from dynid.excitation.evaluation import Candidate, DesignEvaluation, Found, Stop
from dynid.excitation.region import MotionRegion, free_poses, grown_motion, random_numbers

Objective = Callable[[Array], tuple[float, Callable[[], Array]]]
"""Value at numbers (n, 1 + k), and its gradient (n, 1 + k) when asked before the next ones."""

SUFFICIENT = 1e-4
"""Share of the promised decrease that a step must bring (Armijo)."""
LEAST, MOST = 0.1, 0.5
"""Of a step that was too long, what is tried next."""
TRIALS = 8
RIDGES = (1e-13, 1e-10, 1e-7, 1e-4)
"""Of the largest diagonal entry, tried in this order."""


@dataclass(slots=True)
class Descent:
    """Where a descent stands; BFGS's curvature is kept from one stage to the next."""

    x: Array
    curvature: Array | None = None
    """(D, D) of the objective, without the barrier."""
    first: bool = True
    """Whether the curvature has no scale yet."""


def descend(
    objective: Objective,
    region: MotionRegion,
    state: Descent,
    *,
    weight: float,
    iterations: int,
    tolerance: float,
    stop: Callable[[], bool],
) -> None:
    """Minimise objective + weight * barrier; `state` is moved to the best point found.

    The barrier's Hessian is exact and cheap (a small block a joint), so that only the objective's
    curvature has to be learnt from gradients (damped BFGS: Nocedal and Wright, procedure 18.2).
    Small weights let the motion closer to its bounds; the start lies strictly inside, every point
    stays there. The descent ends after so many iterations, after two steps that bring less than the
    tolerance, or when `stop`, asked before each evaluation, says so.
    """
    x, shape = state.x, state.x.shape
    value, slope_of = objective(x)
    gradient = slope_of()
    slack = region.slack(x)
    total = value + weight * region.barrier_value(slack)
    idle = 0
    fixed = region.pose is not None
    for _ in range(iterations):
        pull, bend = region.barrier_slopes(slack)
        if state.curvature is None:
            state.curvature = np.eye(x.size)
        slope = gradient + weight * pull
        if fixed:
            slope[:, 0] = 0.0
        direction = _newton(state.curvature, weight * bend, slope.ravel(), fixed=fixed)
        step = direction.reshape(shape)
        promised = float(slope.ravel() @ direction)
        length = region.longest_step(slack, step)
        for _ in range(TRIALS):
            if stop():
                return
            trial = x + length * step
            trial_slack = region.slack(trial)
            trial_value, slope_of = objective(trial)
            reached = trial_value + weight * region.barrier_value(trial_slack)
            if math.isfinite(reached) and reached <= total + SUFFICIENT * length * promised:
                break
            # The least of a parabola through the values and the slope at the start.
            above = reached - total - length * promised
            ideal = -length * promised / (2 * above) if math.isfinite(above) else 0.0
            length *= min(max(ideal, LEAST), MOST)
        else:
            return
        trial_gradient = slope_of()
        moved, change = (trial - x).ravel(), (trial_gradient - gradient).ravel()
        if state.first and float(moved @ change) > 0:
            state.curvature *= float(change @ change) / float(moved @ change)
            state.first = False
        state.curvature = _damped_update(state.curvature, moved, change)
        gained = total - reached
        x, gradient, slack, total = trial, trial_gradient, trial_slack, reached
        state.x = x
        idle = idle + 1 if gained < tolerance else 0
        if idle == 2:
            return


def _newton(curvature: Array, blocks: Array, slope: Array, *, fixed: bool) -> Array:
    """The step - (curvature + blocks)^-1 slope, with no change of offsets if they are fixed."""
    matrix = curvature.copy()
    width = blocks.shape[1]
    for j, block in enumerate(blocks):
        part = slice(j * width, (j + 1) * width)
        matrix[part, part] += block
    if fixed:
        matrix[::width], matrix[:, ::width] = 0.0, 0.0
        matrix[range(0, len(matrix), width), range(0, len(matrix), width)] = 1.0
    # Sums of positive definite matrices, but for rounding where some directions are very flat.
    diagonal = np.diag(matrix).copy()
    for ridge in RIDGES:
        np.fill_diagonal(matrix, diagonal + ridge * np.max(diagonal))
        try:
            step = np.asarray(np.linalg.solve(matrix, -slope), dtype=np.float64)
        except np.linalg.LinAlgError:
            continue
        if slope @ step < 0:
            return step
    return -slope / np.maximum(diagonal, 1e-300)


def _damped_update(curvature: Array, step: Array, change: Array) -> Array:
    """BFGS, with Powell's damping so that the matrix stays positive definite."""
    image = curvature @ step
    bend, seen = float(step @ image), float(step @ change)
    if not bend > 0:
        return curvature
    if seen < 0.2 * bend:
        share = 0.8 * bend / (bend - seen)
        change = share * change + (1 - share) * image
        seen = float(step @ change)
    return curvature - np.outer(image, image) / bend + np.outer(change, change) / seen


BATCH = 30
"""Random motions of which a start takes the best."""
GROWN = 6
"""Motions that a start grows out of free poses beside them."""
STEPS = 100
"""Most of one descent."""
TIGHTEN = 0.02
"""Share by which limits beside the bounds shrink during the search."""
FILLS = (0.2, 0.9)
"""Share of the limits that random motions use; all of it where nothing but bounds is held."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DescentStage:
    """One descent."""

    barrier: float
    """Weight of the barrier of the bounds."""
    sharpness: float
    """Exponent of the smoothed eigenvalues."""
    penalty: float
    """Weight of broken limits."""
    tolerance: float
    """Steps that gain less, in the logarithm of the criterion, end it."""
    fine: bool = False
    """Whether limits are looked at on a fine grid, which needs less of a reserve."""


STAGES = (
    DescentStage(barrier=1e-3, sharpness=2, penalty=1.0, tolerance=2e-3),
    DescentStage(barrier=1e-4, sharpness=5, penalty=10.0, tolerance=1e-3),
    DescentStage(barrier=1e-5, sharpness=20, penalty=100.0, tolerance=1e-3),
    DescentStage(barrier=1e-6, sharpness=100, penalty=1000.0, tolerance=3e-4, fine=True),
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

    Each number of a start has random numbers of its own. `stop` is asked before every evaluation,
    `found` told a candidate after the batch and after every stage. None if there was no time for a
    single motion.
    """
    random = np.random.default_rng([seed, number])
    evaluation.forget()
    best: Array | None = None
    least = math.inf
    for x in _drawn(evaluation, region, random):
        if stop():
            break
        value = evaluation.rough_value(x)
        value += evaluation.search_violation(x, TIGHTEN, least - value)
        if best is None or value < least:
            best, least = x, value
    if best is None:
        return None
    drawn = judged(evaluation, best)
    found(drawn)
    return improve(evaluation, region, drawn, stop=stop, found=found)


def _drawn(
    evaluation: DesignEvaluation, region: MotionRegion, random: np.random.Generator
) -> Iterator[Array]:
    """Random motions; where more than bounds is held, first some that grew out of free poses.

    Beside those, most random motions are known to be worse before their distances are measured.
    """
    if evaluation.constrained:
        poses = free_poses(evaluation.constraints, region, random)
        for _ in range(GROWN if len(poses) else 0):
            pose = poses[random.integers(len(poses))]
            x = grown_motion(evaluation, region, pose, random, fill=FILLS[1], tighten=TIGHTEN)
            if x is not None:
                yield x
    for _ in range(BATCH):
        fill = float(random.uniform(*FILLS)) if evaluation.constrained else FILLS[1]
        yield random_numbers(region, 1, random, fill=fill)[0]


def improve(
    evaluation: DesignEvaluation,
    region: MotionRegion,
    start: Candidate,
    *,
    stop: Stop,
    found: Found,
    stages: tuple[DescentStage, ...] = STAGES,
    tighten: float = TIGHTEN,
) -> Candidate:
    """Descend from a motion, stage by stage; the best candidate is kept.

    A start outside the region is made smaller first. `found` is told the candidate of every stage;
    limits beside the bounds shrink by the share `tighten`.
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
            fine=stage.fine,
        )
        descend(
            objective,
            region,
            state,
            weight=stage.barrier,
            iterations=STEPS,
            tolerance=stage.tolerance,
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
