"""What a design is asked for, and criterion and constraints of a motion with their derivatives.

The Gram matrix G = W_B' Omega^-1 W_B holds all that the criteria ask of a motion. It is summed
joint by joint from panels that leave structural zeros out; the derivative of a function of G with
dL = tr(S dG) goes back through the regressor with the weights 2 Omega^-1 W_B S, in one pass
whatever S is.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np

from dynid import reduction, regressor, trajectory
from dynid.constraints import MotionConstraints, Proximity, certify
from dynid.core import Array, InputError, Value, freeze
from dynid.excitation.criteria import Criterion

PAPER_RATE_HZ = 125.0
"""The UR5's sampling rate: 1250 samples in the paper's 10 s."""
AT_POSE = 1e-9
"""Rounding that a family may leave at its ends."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcitationProblem:
    """The motion of a family, within constraints, that makes a criterion smallest.

    Raises:
        InputError: Too few samples, noise that does not fit, or a start pose for a family that
            cannot start at one.
    """

    base: reduction.BaseParametrization
    """The base parameters; the robot and its columns are in `base.model`."""
    criterion: Criterion
    family: trajectory.MotionFamily
    constraints: MotionConstraints
    """What a motion is held to, built once for all searches."""
    rate_hz: float = PAPER_RATE_HZ
    """Samples a second at which a design is judged."""
    noise: Array | None = None
    """(n) standard deviation of each joint's torque, by which its rows are divided; None for
    rows as they are [N.m or N]."""

    start_pose: Array | None = None
    """(n) where the motion starts and ends, for families that can; None to choose [rad or m]."""

    def __post_init__(self) -> None:
        joints = self.base.model.robot.joints
        if not (math.isfinite(self.rate_hz) and self.rate_hz > 0):
            raise InputError("the sampling rate must be positive", value=self.rate_hz)
        if self.samples * joints < 2 * self.base.rank:
            raise InputError(
                "too few samples for the base parameters",
                value=f"{self.samples} samples",
                limit=f"{-(-2 * self.base.rank // joints)} or more",
                next_step="Take a longer period or a higher rate.",
            )
        if self.noise is not None:
            freeze(self, noise=(joints,))
        if self.start_pose is not None:
            freeze(self, start_pose=(joints,))
            if np.abs(self.family.basis(np.zeros(1))[0]).max() > AT_POSE:
                raise InputError(
                    "this kind of motion does not start at a given pose",
                    where="--start",
                    value=self.family.name,
                    next_step="Take --trajectory modified-fourier, fourier-quintic or bspline.",
                )

    @property
    def samples(self) -> int:
        """Samples of one run through the motion."""
        return round(self.family.duration * self.rate_hz)

    @property
    def times(self) -> Array:
        """(N) their times [s]."""
        return np.arange(self.samples) / self.rate_hz


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate(Value):
    """Numbers of a motion and what they are worth."""

    x: Array
    """(n, 1 + k) offset and free numbers of each joint [rad or m]."""
    objective: float
    """The criterion as optimisers see it, on the full grid."""
    violation: float
    """How much limits are broken at the samples that were looked at; 0 where they are not."""

    @property
    def key(self) -> tuple[float, float]:
        """For comparison, smaller is better: feasible first, then the criterion."""
        return (self.violation, self.objective)


Stop = Callable[[], bool]
"""True when the time is over."""
Found = Callable[[Candidate], None]
"""Told each candidate as soon as it is there."""


KEPT = 5
"""Candidates kept for the certificate, best first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HistoryEntry:
    """When the best motion changed."""

    wall_s: float
    """Since the search began [s]."""
    evaluations: int
    """Motions evaluated by then, as far as they were reported."""
    value: float
    """The criterion of the new best one."""
    feasible: bool
    """Whether it kept every limit on the search grid."""


@dataclass(slots=True, kw_only=True)
class Search:
    """The candidates of a search, and how they were found."""

    problem: ExcitationProblem
    began: float = field(default_factory=time.monotonic)
    candidates: list[tuple[Candidate, int]] = field(default_factory=list[tuple[Candidate, int]])
    """The best ones with the number of their start or individual, best first."""
    history: list[HistoryEntry] = field(default_factory=list[HistoryEntry])
    evaluations: int = 0
    starts: int = 0
    """Starts that ended."""
    ended_by: str = ""
    """`starts`, `generations`, `optimiser`, `stagnation`, `budget` or `interrupt`; empty while it
    runs."""

    @property
    def best(self) -> Candidate | None:
        """The best candidate so far."""
        return self.candidates[0][0] if self.candidates else None

    @property
    def wall_s(self) -> float:
        """Since the search began [s]."""
        return time.monotonic() - self.began

    def add(self, candidate: Candidate, number: int) -> None:
        """Take in a candidate of a start (the order of equals), and note when it is the best."""
        before = self.best
        worst = self.candidates[-1][0].key if len(self.candidates) == KEPT else None
        if worst is not None and candidate.key > worst:
            return
        self.candidates.append((candidate, number))
        self.candidates.sort(key=lambda item: (*item[0].key, item[1]))
        del self.candidates[KEPT:]
        if before is None or candidate.key < before.key:
            self.history.append(
                HistoryEntry(
                    wall_s=self.wall_s,
                    evaluations=self.evaluations,
                    value=reported(self.problem, candidate),
                    feasible=candidate.key[0] == 0.0,
                )
            )

    def words(self) -> str:
        """The state of the search for a progress bar."""
        best = self.best
        if best is None:
            return "no motion yet"
        value = f"{self.problem.criterion.name} {reported(self.problem, best):.4g}"
        return value if best.key[0] == 0.0 else f"{value}, limits not met yet"


SearchProgress = Callable[[Search, float], None]
"""Told the search, its best motion and words, and how far it is (0 to 1)."""


def reported(problem: ExcitationProblem, candidate: Candidate) -> float:
    """The criterion of a candidate as it is reported, not as optimisers see it."""
    if not problem.criterion.positive:
        return candidate.objective
    return math.exp(min(candidate.objective, 700.0))


DESIGN_WIDTH = 0.05
"""Width of the Coulomb step inside an optimiser [rad/s or m/s]: its slope can be followed."""


class GramKernel:
    """Gram matrices of many motions of one robot, in memory that is used again.

    One caller at a time: each worker makes its own. A search limits BLAS to one thread for all its
    calls: such small products gain nothing from more, and to set the limit costs as much as one.

    Args:
        base: The base parameters; the columns are the first-come ones.
        noise: (n) standard deviation of each joint's torque [N.m or N], by which its rows are
            divided; None for rows as they are.
        coulomb_width: Width of the Coulomb step [rad/s or m/s]; None for the model's own.

    Raises:
        InputError: Columns without a derivative, noise that is not positive, or a width below 0.
    """

    def __init__(
        self,
        base: reduction.BaseParametrization,
        *,
        noise: Array | None = None,
        coulomb_width: float | None = DESIGN_WIDTH,
    ) -> None:
        model, n = base.model, base.model.robot.joints
        regressor.check_differentiable(model)
        sigma = np.ones(n) if noise is None else np.asarray(noise, dtype=np.float64)
        if sigma.shape != (n,) or not (np.isfinite(sigma) & (sigma > 0)).all():
            raise InputError(
                "noise needs a positive standard deviation a joint", value=noise, limit=n
            )
        self._model = model if coulomb_width is None else model.with_coulomb_width(coulomb_width)
        self._layout = reduction.gram_layout(self._model, base)
        self._weights = 1.0 / np.square(sigma)
        sizes = [len(panel.columns) for panel in self._layout.panels]
        self._entries = np.concatenate(
            [(c[:, None] * base.rank + c).ravel() for c in (p.columns for p in self._layout.panels)]
        )
        self._sums = np.empty(len(self._entries))
        ends = np.cumsum(np.square(sizes))[:-1]
        self._products = [
            part.reshape(size, size)
            for part, size in zip(np.split(self._sums, ends), sizes, strict=True)
        ]
        self._samples = -1

    def gram(self, q: Array, dq: Array, ddq: Array) -> Array:
        """G (b, b) of a motion: positions [rad or m], velocities, accelerations, each (N, n).

        Raises:
            InputError: Shapes that do not fit the robot or each other.
        """
        state = self._state = regressor.in_lanes(self._model.motion(q, dq, ddq))
        if len(q) != self._samples:
            self._allocate(len(q), state.shape)
        turn = self._turn = regressor.turns(state[0])
        regressor.inertial_rows(
            *self._model.constants, turn, state, self._rows, self._layout.places
        )
        self._model.fill_beside(state[1], state[2], self._beside)
        for j, panel in enumerate(self._layout.panels):
            rows = self._rows[panel.rows, : self._samples]
            for row, column in zip(rows, panel.beside, strict=False):
                row[:] = self._beside[column, j, : self._samples]
            np.matmul(rows, rows.T, out=self._products[j])
            self._products[j] *= self._weights[j]
        rank = self._layout.rank
        entries = np.bincount(self._entries, self._sums, minlength=rank**2)
        return np.asarray(entries, dtype=np.float64).reshape(rank, rank)

    def pullback(self, s: Array) -> regressor.Gradient:
        """The derivatives of tr(S G) by q, dq and ddq, each (N, n), for the last motion of `gram`.

        Args:
            s: (b, b) S.
        """
        samples = self._samples
        for j, panel in enumerate(self._layout.panels):
            rows, bars = (a[panel.rows, :samples] for a in (self._rows, self._bars))
            part = s[np.ix_(panel.columns, panel.columns)]
            np.matmul(2.0 * self._weights[j] * part, rows, out=bars)
            for bar, column in zip(bars, panel.beside, strict=False):
                self._beside_bars[column, j, :samples] = bar
        regressor.regressor_pullback(
            *self._model.constants, self._turn, self._state, self._bars,
            self._layout.places, self._out,
        )  # fmt: skip
        self._model.pull_beside(self._state, self._beside_bars, self._out)
        return regressor.by_sample(self._out, samples)

    def _allocate(self, samples: int, shape: tuple[int, ...]) -> None:
        n, length = shape[1:]
        beside = (len(self._model.columns) - 10 * n, n, length)
        self._samples = samples
        self._out = np.zeros(shape)
        self._rows = np.zeros((self._layout.rows, length))
        self._bars = np.zeros((self._layout.rows, length))
        self._beside = np.zeros(beside)
        self._beside_bars = np.zeros(beside)


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
    """Motions of a problem's family at fixed times (N) [s]."""

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
    """

    def __init__(self, problem: ExcitationProblem) -> None:
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
        self._kernel = GramKernel(problem.base, noise=problem.noise, coulomb_width=None)
        self._smooth = GramKernel(problem.base, noise=problem.noise)
        self.constraints: MotionConstraints = problem.constraints
        """The judge of the limits."""
        self._known = self.constraints.proximity(count)
        others = (self.constraints.torque, self.constraints.surroundings)
        self.constrained = bool(self.constraints.points) or any(o is not None for o in others)
        """Whether anything beside position, velocity and acceleration is held."""

    @cached_property
    def _dense(self) -> MotionGrid:
        family = self.problem.family
        count = math.ceil(DENSE_RATE_HZ * family.duration)
        times = np.arange(count, dtype=np.float64) * (family.duration / count)
        return MotionGrid(self.problem, np.sort(np.concatenate([times, family.corners])))

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
        """How much limits tightened by a share and larger clearances are broken on the search grid.

        Of the numbers (n, 1 + k) of a motion; beyond `most` it does not matter how much.
        """
        if not self.constrained:
            return 0.0
        motion, known = self._search.motion(x), self._known
        return self.constraints.violation(
            *motion, tighten=tighten, caution=CAUTION, known=known, most=most
        )[0]

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
        gram = self._share * self._smooth.gram(*motion)
        value, slope = criterion.objective_and_gradient(gram)
        if not math.isfinite(value):
            return math.inf, partial(np.zeros_like, x)
        grid, bars = self._search, None
        if penalty > 0.0 and self.constrained:
            share, known = 1.0, self._known
            if fine:
                grid, share, known = self._dense, FINE_SHARE, self._dense_known
                penalty *= len(motion[0]) / len(grid.basis[0])
                motion = grid.motion(x)
            broken, *bars = self.constraints.violation(
                *motion, tighten=share * tighten, caution=share * CAUTION, known=known
            )
            value += penalty * broken

        def gradient() -> Array:
            found = self._search.pulled_back(*self._smooth.pullback(slope * self._share))
            return found if bars is None else found + penalty * grid.pulled_back(*bars)

        return value, gradient
