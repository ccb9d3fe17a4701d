"""A UR5 whose parameters are known exactly, and motions on which to predict it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from dynid.core import Array, provenance
from dynid.identification import Estimate, MotionRange
from dynid.recording import ExperimentRecord
from dynid.reduction import reduce_model
from dynid.regressor import InverseDynamicModel
from dynid.robot import load_robot
from dynid.signals import ProcessingSettings, Samples

RATE = 125.0


@cache
def estimate() -> Estimate:
    """Random base parameters; the motion range is that of `samples()`."""
    base = reduce_model(InverseDynamicModel(robot=load_robot("ur5")))
    random = np.random.default_rng(1)
    motion = samples_without_torque(np.arange(2000) / RATE)
    return Estimate(
        model=base.model,
        independent=base.independent,
        expressions=base.expressions,
        values=random.normal(size=base.rank),
        covariance=np.eye(base.rank),
        naive_std=np.ones(base.rank),
        noise=np.ones(6),
        condition_number=10.0,
        scaled_condition_number=5.0,
        motion_condition_number=5.0,
        samples=2000,
        estimator="wls",
        preset="best",
        settings=ProcessingSettings(cutoff_hz=10.0, decimate=True, velocity="measured"),
        essential=(),
        motion=MotionRange(
            lower=motion.q.min(axis=0),
            upper=motion.q.max(axis=0),
            speed=np.abs(motion.dq).max(axis=0),
            acceleration=np.abs(motion.ddq).max(axis=0),
        ),
        provenance=provenance(),
    )


def samples_without_torque(
    t: Array, size: float = 1.0, speed: float = 1.0, stop: bool = True
) -> Samples:
    """All joints moving, each in its own time; at a stop joint 6 rests for the second half."""
    turn = speed * np.array([1.1, 1.3, 1.7, 1.9, 2.3, 2.9])
    angle = np.outer(t, turn) + np.arange(6)
    q, dq, ddq = size * np.sin(angle), size * turn * np.cos(angle), -size * turn**2 * np.sin(angle)
    if stop:
        half = len(t) // 2
        q[half:, 5] = q[half, 5]
        dq[half:, 5] = ddq[half:, 5] = 0.0
    return Samples(t=t, q=q, dq=dq, ddq=ddq, tau=np.zeros_like(q), rate_hz=RATE, cutoff_hz=10.0)


def samples(error: Array | float = 0.0, size: float = 1.0, speed: float = 1.0) -> Samples:
    """2000 samples whose torque is the estimate's prediction plus an error (N, 6) [N.m]."""
    motion = samples_without_torque(np.arange(2000) / RATE, size, speed)
    torque = estimate().predict(motion.q, motion.dq, motion.ddq)
    return replace(motion, tau=torque + error)


def record(seconds: float = 16.0, velocities: bool = True) -> ExperimentRecord:
    """A recording of the motion, torque as predicted."""
    motion = samples_without_torque(np.arange(int(seconds * RATE)) / RATE, stop=False)
    torque = estimate().predict(motion.q, motion.dq, motion.ddq)
    signals = {"q": motion.q, "effort": torque}
    if velocities:
        signals["qd"] = motion.dq
    return ExperimentRecord(t=40 + motion.t, signals=signals)
