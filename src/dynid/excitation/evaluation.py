"""Criterion and constraints of a motion, on all samples or with derivatives on fewer.

Criteria of extreme eigenvalues, smoothed for an optimiser.

Where several eigenvalues share the smallest place, as they do near every optimum, the smallest
one has a kink and a gradient method stops there. Norms take its place: with p the sharpness,
(sum lambda^p)^(1/p) for the largest and (sum lambda^-p)^(-1/p) for the smallest, which are
smooth, bound the true ones, and meet them as p grows. p = 1 for the smallest is A-optimality.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from dynid.constraints import MotionConstraints, Proximity, certify
from dynid.core import Array
from dynid.excitation.criteria import (
    Condition,
    ConditionAndSigma,
    Criterion,
    EOptimal,
    eigenvectors,
)
from dynid.excitation.gram import DESIGN_WIDTH, GramKernel
from dynid.excitation.problem import ExcitationProblem

Extreme = tuple[float, Array]
"""Logarithm of a soft extreme, and its derivative (b) by the logarithms of the eigenvalues."""


def smoothed(criterion: Criterion, sharpness: float) -> Criterion:
    """The smooth relative of a criterion; criteria that are smooth come back as they are.

    Args:
        criterion: Any criterion.
        sharpness: The exponent p; the larger, the nearer to the criterion.
    """
    scale, previous = criterion.scale, criterion.previous
    match criterion:
        case Condition():
            return SmoothCondition(scale=scale, previous=previous, sharpness=sharpness)
        case EOptimal():
            return SmoothEOptimal(scale=scale, previous=previous, sharpness=sharpness)
        case ConditionAndSigma():
            weight = criterion.weight
            return SmoothConditionAndSigma(
                scale=scale, previous=previous, sharpness=sharpness, weight=weight
            )
        case _:
            return criterion


@dataclass(frozen=True, kw_only=True)
class SmoothCondition(Condition):
    """The condition number with norms for the extreme eigenvalues."""

    sharpness: float

    def evaluate(self, matrix: Array, *, slope: bool) -> tuple[float, Array] | None:
        """See `Criterion`."""

        def ratio(largest: Extreme, smallest: Extreme) -> tuple[float, Array]:
            value = math.exp((largest[0] - smallest[0]) / 2)
            return value, value / 2 * (largest[1] - smallest[1])

        return _of_extremes(matrix, self.sharpness, ratio)


@dataclass(frozen=True, kw_only=True)
class SmoothEOptimal(EOptimal):
    """1 / lambda_min with a norm for the smallest eigenvalue."""

    sharpness: float

    def evaluate(self, matrix: Array, *, slope: bool) -> tuple[float, Array] | None:
        """See `Criterion`."""

        def inverse(_largest: Extreme, smallest: Extreme) -> tuple[float, Array]:
            value = math.exp(-smallest[0])
            return value, -value * smallest[1]

        return _of_extremes(matrix, self.sharpness, inverse)


@dataclass(frozen=True, kw_only=True)
class SmoothConditionAndSigma(ConditionAndSigma):
    """cond + weight / sigma_min with norms for the extreme eigenvalues."""

    sharpness: float

    def evaluate(self, matrix: Array, *, slope: bool) -> tuple[float, Array] | None:
        """See `Criterion`."""

        def both(largest: Extreme, smallest: Extreme) -> tuple[float, Array]:
            condition = math.exp((largest[0] - smallest[0]) / 2)
            sigma = self.weight * math.exp(-smallest[0] / 2)
            slopes = condition / 2 * (largest[1] - smallest[1]) - sigma / 2 * smallest[1]
            return condition + sigma, slopes

        return _of_extremes(matrix, self.sharpness, both)


def _of_extremes(
    matrix: Array, sharpness: float, combine: Callable[[Extreme, Extreme], tuple[float, Array]]
) -> tuple[float, Array] | None:
    """A function of the soft extremes, and its derivative by the matrix; None if singular.

    Args:
        matrix: (b, b) symmetric.
        sharpness: The exponent p.
        combine: From the largest and the smallest to the value, and its derivative (b) by the
            logarithms of the eigenvalues.
    """
    found = eigenvectors(matrix)
    if found is None:
        return None
    values, vectors = found
    value, slopes = combine(*_extremes(values, sharpness))
    return value, (vectors * (slopes / values)) @ vectors.T


def _extremes(values: Array, p: float) -> tuple[Extreme, Extreme]:
    """Logarithms of the soft largest and smallest of (b), and d log / d log values (b) of each."""
    logs = np.log(values)
    high, low = np.exp(p * (logs - logs[-1])), np.exp(-p * (logs - logs[0]))
    largest = float(logs[-1] + math.log(high.sum()) / p)
    smallest = float(logs[0] - math.log(low.sum()) / p)
    return (largest, high / high.sum()), (smallest, low / low.sum())


SEARCH_PER_NUMBER = 12
"""Samples of the search grid for each free number of a joint (24 a harmonic)."""
SEARCH_RATE_HZ = 12.0
"""Its least rate: sines of joint angles at full speed turn faster than any harmonic."""
CAUTION = 0.002
"""Added to clearances in the search: bodies come nearer between its samples [m]."""
DENSE_RATE_HZ = 50.0
"""Samples a second at which a candidate's limits are looked at."""
DENSE_TIGHTEN = 0.003
"""Share by which limits shrink there."""
FINE_SHARE = 0.4
"""Of what the search keeps free, what is kept where it looks at the dense grid."""


class MotionGrid:
    """Motions of a family at fixed times.

    Args:
        problem: Whose family.
        times: (N) [s].
    """

    def __init__(self, problem: ExcitationProblem, times: Array) -> None:
        self.basis = tuple(np.ascontiguousarray(b) for b in problem.family.basis(times))

    def motion(self, x: Array) -> tuple[Array, Array, Array]:
        """q, dq, ddq (N, n) for numbers (n, 1 + k)."""
        free = x[:, 1:].T
        q, dq, ddq = (b @ free for b in self.basis)
        return q + x[:, 0], dq, ddq

    def pulled_back(self, q_bar: Array, dq_bar: Array, ddq_bar: Array) -> Array:
        """The gradient (n, 1 + k) from derivatives by q, dq, ddq."""
        b0, b1, b2 = self.basis
        free = q_bar.T @ b0 + dq_bar.T @ b1 + ddq_bar.T @ b2
        return np.concatenate([q_bar.sum(axis=0)[:, None], free], axis=1)


class DesignEvaluation:
    """Judges motions of one problem; counts how many.

    One thread, one caller at a time: each worker makes its own.

    Args:
        problem: The problem.
    """

    def __init__(self, problem: ExcitationProblem) -> None:
        model = problem.base.model
        samples = problem.samples
        count = max(
            SEARCH_PER_NUMBER * (problem.family.free_count + 2),
            math.ceil(SEARCH_RATE_HZ * problem.family.duration),
        )
        count = min(count, samples)
        duration = problem.family.duration
        self.problem = problem
        self.evaluations = 0
        """Criterion values computed so far, with or without derivatives."""
        self._share = samples / count
        self._full = MotionGrid(problem, problem.times)
        times = np.arange(count, dtype=np.float64) * (duration / count)
        self._search = MotionGrid(problem, times)
        self._kernel = GramKernel(model, problem.base, noise=problem.noise, coulomb_width=None)
        self._smooth = GramKernel(
            model, problem.base, noise=problem.noise, coulomb_width=DESIGN_WIDTH
        )
        self.constraints: MotionConstraints = problem.constraints
        """The judge of the limits."""
        self._known = self.constraints.proximity(count)
        others = (self.constraints.torque, self.constraints.surroundings)
        self.constrained = bool(self.constraints.points) or any(o is not None for o in others)
        """Whether anything beside position, velocity and acceleration is held."""

    @cached_property
    def _dense(self) -> MotionGrid:
        duration = self.problem.family.duration
        count = math.ceil(DENSE_RATE_HZ * duration)
        return MotionGrid(self.problem, np.arange(count, dtype=np.float64) * (duration / count))

    def warm_up(self) -> None:
        """Load, and on the first use on a machine compile, every kernel that a search needs."""
        bounds = self.problem.constraints.settings.bounds
        width = 1 + self.problem.family.free_count
        still = np.zeros((bounds.joints, width))
        still[:, 0] = np.clip(0.0, bounds.lower, bounds.upper)
        self.search(still + 1e-3, criterion=self.problem.criterion, penalty=1.0)
        family = self.problem.family
        certify(family.trajectory(still[:, 0], still[:, 1:]), self.constraints)
        self.evaluations = 0

    @cached_property
    def _dense_known(self) -> Proximity | None:
        return self.constraints.proximity(len(self._dense.basis[0]))

    def forget(self) -> None:
        """Begin anew: what follows does not depend on the motions before, not even in rounding."""
        for known in (self._known, self._dense_known):
            if known is not None:
                known.forget()

    def value(self, x: Array) -> float:
        """The objective of the motion (n, 1 + k): every sample, Coulomb steps as they are."""
        self.evaluations += 1
        return self.problem.criterion.objective(self.gram(x))

    def rough_value(self, x: Array) -> float:
        """The objective on the search grid with smooth steps: a fifth of the work of `value`."""
        self.evaluations += 1
        gram = self._smooth.gram(*self._search.motion(x))
        return self.problem.criterion.objective(self._share * gram)

    def gram(self, x: Array) -> Array:
        """The Gram matrix (b, b) on the full grid."""
        return self._kernel.gram(*self._full.motion(x))

    def violation(self, x: Array) -> float:
        """How much limits are broken on a dense grid; 0 where nothing is."""
        if not self.constrained:
            return 0.0
        motion = self._dense.motion(x)
        return self.constraints.violation(*motion, tighten=DENSE_TIGHTEN, known=self._dense_known)[
            0
        ]

    def search_violation(self, x: Array, tighten: float, most: float = math.inf) -> float:
        """How much tightened limits and larger clearances are broken on the search grid.

        Args:
            x: (n, 1 + k) numbers of the motion.
            tighten: Share by which limits shrink.
            most: A sum beyond which it does not matter how much.
        """
        if not self.constrained:
            return 0.0
        return self._broken(self._search.motion(x), tighten, most)[0]

    def _broken(
        self, motion: tuple[Array, Array, Array], tighten: float, most: float = math.inf
    ) -> tuple[float, Array, Array, Array]:
        return self.constraints.violation(
            *motion, tighten=tighten, caution=CAUTION, known=self._known, most=most
        )

    def search(
        self,
        x: Array,
        *,
        criterion: Criterion,
        penalty: float = 0.0,
        tighten: float = 0.0,
        fine: bool = False,
    ) -> tuple[float, Callable[[], Array]]:
        """Criterion and penalty, on the search grid with smooth steps, and their gradient.

        The gradient is a function, for motions that are worth it: to be called before the next
        motion.

        Args:
            x: (n, 1 + k) numbers of the motion.
            criterion: What to evaluate: the problem's, or a smoother relative.
            penalty: Weight of the broken limits.
            tighten: Share by which limits shrink.
            fine: Look at the limits on the dense grid, with less of a reserve.
        """
        self.evaluations += 1
        motion = self._search.motion(x)
        gram, pullback = self._smooth.gram_and_pullback(*motion)
        value, slope = criterion.objective_and_gradient(self._share * gram)
        if not math.isfinite(value):
            return math.inf, partial(np.zeros_like, x)
        grid, bars = self._search, None
        if penalty > 0.0 and self.constrained:
            if fine:
                grid = self._dense
                penalty *= len(motion[0]) / len(grid.basis[0])
                broken, *bars = self.constraints.violation(
                    *grid.motion(x),
                    tighten=FINE_SHARE * tighten,
                    caution=FINE_SHARE * CAUTION,
                    known=self._dense_known,
                )
            else:
                broken, *bars = self._broken(motion, tighten)
            value += penalty * broken

        def gradient() -> Array:
            found = self._search.pulled_back(*pullback(slope * self._share))
            return found if bars is None else found + penalty * grid.pulled_back(*bars)

        return value, gradient
