"""What an excitation design is asked for, and what an optimiser found so far."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from dynid.constraints import MotionConstraints
from dynid.core import Array, InputError, Value, freeze
from dynid.excitation.criteria import Criterion
from dynid.reduction import BaseParametrization
from dynid.trajectory import MotionFamily

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

    base: BaseParametrization
    """The base parameters; the robot and its columns are in `base.model`."""
    criterion: Criterion
    family: MotionFamily
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
