"""Recordings of a UR5 with known parameters, made with pinocchio and not with our regressor."""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin
from scipy.signal import lfilter

from dynid import identify
from dynid.core import Array
from dynid.recording import ExperimentRecord
from dynid.robot import RobotModel, load_robot
from dynid.trajectory import FourierSeries, random_excitation
from dynid.workflow import Identification

COULOMB = np.array([7.7, 8.4, 8.3, 1.9, 1.8, 1.8])
VISCOUS = np.array([10.8, 8.8, 5.5, 2.8, 1.9, 1.4])
MOTOR = np.array([2.0, 2.2, 1.1, 0.3, 0.3, 0.3])
NOISE = np.array([2.0, 2.5, 1.5, 0.4, 0.4, 0.3])
"""Torque noise of methods.md [N.m]."""
MASSES = (3.7, 8.393, 2.33, 1.219, 1.219, 0.1879)
CENTRES = (
    (0, -0.02561, 0.00193),
    (0.2125, 0, 0.11336),
    (0.15, 0, 0.0265),
    (0, -0.0018, 0.01634),
    (0, 0.0018, 0.01634),
    (0, 0, -0.001159),
)


@cache
def ur5() -> RobotModel:
    return load_robot("ur5")


@cache
def oracle() -> tuple[pin.Model, Array]:
    """A pinocchio model with DH link frames, and the truth (78) in the paper's order."""
    robot = ur5()
    model, parent = pin.Model(), 0
    inertial = np.zeros((6, 10))
    for i in range(6):
        mass, centre = MASSES[i], np.array(CENTRES[i], dtype=float)
        body = pin.Inertia(mass, centre, np.diag([0.02, 0.03, 0.015]) * mass)
        inertial[i] = body.toDynamicParameters()[[0, 1, 2, 3, 4, 6, 9, 8, 7, 5]]
        parent = model.addJoint(
            parent,
            pin.JointModelRevoluteUnaligned(robot.axes[i]),
            pin.SE3(robot.placements[i]),
            robot.joint_names[i],
        )
        model.appendBodyToJoint(parent, body, pin.SE3(robot.parameter_frames["dh"][i]))
    model.gravity.linear = robot.gravity
    model.armature = MOTOR
    return model, np.concatenate([inertial.ravel(), COULOMB, VISCOUS, MOTOR])


def torques(series: FourierSeries, t: Array, width: float = 0.001) -> Array:
    model, _ = oracle()
    data = model.createData()
    motion = series.evaluate(t)
    rigid = np.array(
        [
            pin.rnea(model, data, *state)
            for state in zip(motion.q, motion.dq, motion.ddq, strict=True)
        ]
    )
    return rigid + COULOMB * np.tanh(motion.dq / width) + VISCOUS * motion.dq


def recording(
    seed: int,
    *,
    noise: float = 1.0,
    correlation: float = 0.0,
    period: float = 10.0,
    seconds: float | None = None,
    rate: float = 125.0,
    position_noise: float = 0.0,
    delay_samples: Array | None = None,
    width: float = 0.001,
    offset: Array | float = 0.0,
    velocities: bool = False,
) -> ExperimentRecord:
    generator = np.random.default_rng(seed)
    series = random_excitation(ur5().limits, seed=seed, period_s=period, acceleration=5.5 * np.pi)
    t = np.arange(round((seconds or period) * rate)) / rate
    motion = series.evaluate(t)
    lag = np.zeros(6) if delay_samples is None else delay_samples
    effort = np.column_stack(
        [torques(series, t - d / rate, width)[:, j] for j, d in enumerate(lag)]
        if lag.any()
        else torques(series, t, width).T
    )
    white = generator.normal(size=(len(t) + 1000, 6))
    coloured = lfilter([np.sqrt(1 - correlation**2)], [1, -correlation], white, axis=0)[1000:]
    signals = {
        "q": motion.q + position_noise * generator.normal(size=motion.q.shape),
        "effort": effort + offset + noise * NOISE * coloured,
    }
    if velocities:
        signals["qd"] = motion.dq + 1e-3 * generator.normal(size=motion.q.shape)
    return ExperimentRecord(t=t, signals=signals)


@cache
def identified() -> Identification:
    """The plain arm identified once, with all that is chosen by itself."""
    return identify([recording(0)], ur5(), validation=recording(1))
