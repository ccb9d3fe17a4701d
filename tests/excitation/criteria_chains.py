"""Random chains in motion, and what pinocchio says about them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from dynid.reduction import BaseParametrization, reduce_model
from dynid.regressor import FrictionTerms, InverseDynamicModel
from dynid.regressor.terms import PAPER_TERMS
from dynid.robot import Drives, RobotModel, robot_from_chain
from dynid.trajectory import FourierSeries, harmonic_basis

Floats = NDArray[np.float64]
PERIOD = 10.0
HARMONICS = 3
# Where our m, mx, my, mz, Jxx, Jyy, Jzz, Jyz, Jxz, Jxy stand in pinocchio's ten.
IN_PINOCCHIO = [0, 1, 2, 3, 4, 6, 9, 8, 7, 5]


def chain(seed: int, joints: int, *, wall: bool = False, coupled: bool = False) -> RobotModel:
    """A chain of turning and sliding joints; parameters in the joint frames."""
    random = np.random.default_rng(seed)
    placements = np.tile(np.eye(4), (joints, 1, 1))
    for pose in placements:
        turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
        pose[:3, :3] = turn * np.sign(np.linalg.det(turn))
        pose[:3, 3] = random.uniform(-0.5, 0.5, 3)
    axes = random.normal(size=(joints, 3))
    kinds = random.choice(["revolute", "revolute", "prismatic"], joints)
    robot = robot_from_chain(
        placements=placements,
        axes=axes / np.linalg.norm(axes, axis=1, keepdims=True),
        joint_types=[str(kind) for kind in kinds],
        frames={"urdf": np.tile(np.eye(4), (joints, 1, 1))},
    )
    if wall:
        robot = replace(robot, gravity=np.array([9.81, 0.0, 0.0]))
    if coupled:
        coupling = np.diag(np.linspace(80.0, 120.0, joints))
        coupling[-1, -2], coupling[-2, 0] = 30.0, -20.0
        nan = np.full(joints, np.nan)
        robot = replace(robot, drives=Drives(gain=nan, gear_ratio=nan, coupling=coupling))
    return robot


def reduced(robot: RobotModel, width: float = 0.001) -> BaseParametrization:
    terms = tuple((term, None) for term in PAPER_TERMS)
    return reduce_model(
        InverseDynamicModel(robot=robot, friction=FrictionTerms(terms=terms, width=width))
    )


def coefficients(seed: int, joints: int) -> Floats:
    """(n, 1 + 2 H) offset, a and b of a lively motion."""
    numbers = np.random.default_rng(seed).normal(size=(joints, 1 + 2 * HARMONICS))
    numbers[:, 1:] *= 0.8
    return numbers


def motion(numbers: Floats, samples: int) -> tuple[Floats, Floats, Floats]:
    series = FourierSeries(
        period=PERIOD,
        offset=numbers[:, 0],
        a=numbers[:, 1 : 1 + HARMONICS],
        b=numbers[:, 1 + HARMONICS :],
    )
    found = series.evaluate(np.arange(samples) * PERIOD / samples)
    return found.q.copy(), found.dq.copy(), found.ddq.copy()


def by_coefficients(bars: tuple[Floats, Floats, Floats]) -> Floats:
    """(n, 1 + 2 H) the gradient by the coefficients, from the one by q, dq, ddq."""
    samples = len(bars[0])
    basis = harmonic_basis(np.arange(samples) * PERIOD / samples, PERIOD, HARMONICS)
    free = sum(bar.T @ part for bar, part in zip(bars, basis, strict=True))
    return np.hstack([bars[0].sum(axis=0)[:, None], free])


def base_columns(base: BaseParametrization, width: float, *state: Floats) -> Floats:
    """(N, n, b) from pinocchio's regressor and the definition of the paper's friction terms."""
    robot = base.model.robot
    model, parent = pin.Model(), 0
    for k in range(robot.joints):
        slides = robot.joint_types[k] == "prismatic"
        kind = pin.JointModelPrismaticUnaligned if slides else pin.JointModelRevoluteUnaligned
        parent = model.addJoint(parent, kind(robot.axes[k]), pin.SE3(robot.placements[k]), f"j{k}")
    model.gravity.linear = np.array(robot.gravity)
    data = model.createData()
    inertial = []
    for at in zip(*state, strict=True):
        theirs = pin.computeJointTorqueRegressor(model, data, *at)
        inertial.append(
            np.hstack(
                [theirs[:, 10 * k : 10 * k + 10][:, IN_PINOCCHIO] for k in range(robot.joints)]
            )
        )
    own = np.eye(robot.joints)
    _, dq, ddq = state
    beside = [x[:, :, None] * own for x in (np.tanh(dq / width), dq, ddq)]
    return np.concatenate([np.array(inertial), *beside], axis=2)[:, :, list(base.independent)]
