"""What the structure of a robot is, by pinocchio's regressor and plain linear algebra."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from dynid.reduction import BaseParametrization, reduce_model
from dynid.regressor import InverseDynamicModel, parse_terms
from dynid.robot import RobotModel, load_robot

Floats = NDArray[np.float64]
A2, A3, D4, D5, D6 = -0.425, -0.39225, 0.10915, 0.09465, 0.0823
"""The UR5's Denavit-Hartenberg lengths [m]."""
IN_PINOCCHIO = [0, 1, 2, 3, 4, 6, 9, 8, 7, 5]


class Classes(NamedTuple):
    rank: int
    alone: tuple[int, ...]
    combined: tuple[int, ...]
    unseen: tuple[int, ...]

    @property
    def counts(self) -> tuple[int, int, int, int]:
        return self.rank, len(self.alone), len(self.combined), len(self.unseen)


@cache
def reduced(
    robot: str = "ur5", frames: str = "dh", mount: str | None = None, terms: str = "fc,fv,im"
) -> BaseParametrization:
    return reduce(load_robot(robot, mount=mount), frames, terms)


def reduce(robot: RobotModel, frames: str = "dh", terms: str = "fc,fv,im") -> BaseParametrization:
    model = InverseDynamicModel(robot=robot, frames=frames, friction=parse_terms(terms))
    return reduce_model(model)


def found(base: BaseParametrization) -> Classes:
    kinds = base.classes
    assert kinds.rank == base.rank
    return Classes(base.rank, kinds.alone, kinds.combined, kinds.unidentifiable)


def names(base: BaseParametrization, columns: tuple[int, ...]) -> set[str]:
    return {base.model.names[i] for i in columns}


def _moved(frame: Floats, unit: Floats) -> Floats:
    """Our ten in `frame`, expressed about the joint frame in pinocchio's order."""
    m, first = unit[0], unit[1:4]
    xx, yy, zz, yz, xz, xy = unit[4:]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    pseudo = np.block(
        [
            [np.trace(inertia) / 2 * np.eye(3) - inertia, first[:, None]],
            [first[None], np.array([[m]])],
        ]
    )
    moved = frame @ pseudo @ frame.T
    about = np.trace(moved[:3, :3]) * np.eye(3) - moved[:3, :3]
    six = about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    return np.array([moved[3, 3], *moved[:3, 3], *six])


def observation(robot: RobotModel, frames: str, points: int = 60, seed: int = 11) -> Floats:
    """Rows of pinocchio's regressor at random states, then Coulomb, viscous, motor inertia."""
    model, parent, n = pin.Model(), 0, robot.joints
    for k in range(n):
        slides = robot.joint_types[k] == "prismatic"
        kind = pin.JointModelPrismaticUnaligned if slides else pin.JointModelRevoluteUnaligned
        parent = model.addJoint(parent, kind(robot.axes[k]), pin.SE3(robot.placements[k]), f"j{k}")
    model.gravity.linear = np.array(robot.gravity)
    data = model.createData()
    change = np.zeros((10 * n, 10 * n))
    for k, frame in enumerate(robot.parameter_frames[frames]):
        part = slice(10 * k, 10 * k + 10)
        change[part, part] = np.array([_moved(frame, unit) for unit in np.eye(10)]).T
    random = np.random.default_rng(seed)
    rows = []
    for _ in range(points):
        q, dq, ddq = random.uniform(-np.pi, np.pi, (3, n))
        theirs = np.atleast_2d(pin.computeJointTorqueRegressor(model, data, q, dq, 5 * ddq))
        friction = [np.diag(np.sign(dq)), np.diag(dq), np.diag(5 * ddq)]
        rows.append(np.hstack([theirs @ change, *friction]))
    return np.vstack(rows)


def classify(matrix: Floats, tolerance: float = 1e-9) -> Classes:
    _, s, vt = np.linalg.svd(matrix, full_matrices=False)
    rank = int((s > tolerance * s[0]).sum())
    row, null = vt[:rank], vt[rank:]
    unseen = np.square(row).sum(axis=0) < 1e-12
    alone = (np.linalg.norm(null, axis=0) < 1e-7) & ~unseen
    return Classes(
        rank, *(tuple(np.flatnonzero(k).tolist()) for k in (alone, ~alone & ~unseen, unseen))
    )


def first_come(matrix: Floats, tolerance: float = 1e-9) -> tuple[list[int], list[int], Floats]:
    """Columns not in the span of those before them, the others, and K, by Gram-Schmidt."""
    basis = np.zeros((len(matrix), 0))
    base: list[int] = []
    for j, column in enumerate(matrix.T):
        rest = column.copy()
        for _ in range(2):
            rest -= basis @ (basis.T @ rest)
        if np.linalg.norm(rest) > tolerance * max(1.0, float(np.linalg.norm(column))):
            base.append(j)
            basis = np.column_stack([basis, rest / np.linalg.norm(rest)])
    dependent = [j for j in range(matrix.shape[1]) if j not in base]
    k = np.linalg.lstsq(matrix[:, base], matrix[:, dependent], rcond=None)[0]
    return base, dependent, k
