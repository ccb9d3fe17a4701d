"""What an excitation design is asked for."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dynid.constraints.settings import ConstraintSettings
from dynid.core.arrays import Array, frozen
from dynid.core.errors import InputError
from dynid.excitation.criteria import Criterion
from dynid.reduction.base import BaseParametrization
from dynid.trajectory.family import MotionFamily

PAPER_RATE_HZ = 125.0
"""The UR5's sampling rate: 1250 samples in the paper's 10 s."""
AT_POSE = 1e-9
"""Rounding that a family may leave at its ends."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcitationProblem:
    """The motion of a family, within constraints, that makes a criterion smallest.

    Raises:
        InputError: Bounds for another number of joints, too few samples, noise that does not fit,
            or a start pose for a family that cannot start at one.
    """

    base: BaseParametrization
    """The base parameters; the robot and its columns are in `base.model`."""
    criterion: Criterion
    family: MotionFamily
    constraints: ConstraintSettings
    rate_hz: float = PAPER_RATE_HZ
    """Samples a second at which a design is judged."""
    noise: Array | None = None
    """(n) standard deviation of each joint's torque, by which its rows are divided; None for
    rows as they are [N.m or N]."""

    start_pose: Array | None = None
    """(n) where the motion starts and ends, for families that can; None to choose [rad or m]."""

    def __post_init__(self) -> None:
        joints = self.base.model.robot.joints
        if self.constraints.bounds.joints != joints:
            raise InputError(
                "joints of the bounds", value=self.constraints.bounds.joints, limit=joints
            )
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
            object.__setattr__(self, "noise", frozen(self.noise, shape=(joints,), name="noise"))
        if self.start_pose is not None:
            pose = frozen(self.start_pose, shape=(joints,), name="start pose")
            object.__setattr__(self, "start_pose", pose)
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
