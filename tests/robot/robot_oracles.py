"""Independent answers from pinocchio, and the places of test data."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

from dynid.robot import RobotModel, frame_map, joint_poses

PROJECT = Path(__file__).parents[2]
EXAMPLES = PROJECT / "examples" / "robots"
SHARED = PROJECT.parent / "shared" / "data"
DATA = Path(sys.prefix) / (
    f"lib/python3.{sys.version_info.minor}/site-packages/"
    "cmeel.prefix/share/example-robot-data/robots"
)
needs_models = pytest.mark.skipif(
    not DATA.is_dir(), reason="the package example-robot-data is not installed"
)

UR5_DH: dict[str, Any] = {
    "a": [0, -0.425, -0.39225, 0, 0, 0],
    "d": [0.089159, 0, 0, 0.10915, 0.09465, 0.0823],
    "alpha": [np.pi / 2, 0, 0, np.pi / 2, -np.pi / 2, 0],
}


def from_pinocchio(parameters: np.ndarray) -> np.ndarray:
    """Our parameters of its `toDynamicParameters`: m, mx, my, mz, xx, xy, yy, xz, yz, zz."""
    return parameters[..., [0, 1, 2, 3, 4, 6, 9, 8, 7, 5]]


def pinocchio_model(robot: RobotModel) -> pin.Model:
    model = pin.Model()
    parent = 0
    for k in range(robot.joints):
        kind = pin.JointModelPrismaticUnaligned if robot.prismatic[k] else None
        joint = (kind or pin.JointModelRevoluteUnaligned)(robot.axes[k])
        parent = model.addJoint(parent, joint, pin.SE3(robot.placements[k]), f"j{k}")
    model.gravity.linear = np.array(robot.gravity)
    return model


def observation(robot: RobotModel, frames: str, points: int = 25) -> NDArray[np.float64]:
    """13 columns a joint at random states: 10 inertial, then Coulomb, viscous, motor inertia."""
    model = pinocchio_model(robot)
    data = model.createData()
    n = robot.joints
    maps = [frame_map(frame) for frame in robot.parameter_frames[frames]]
    random = np.random.default_rng(0)
    rows = []
    for _ in range(points):
        q, v, a = random.uniform(-np.pi, np.pi, (3, n))
        theirs = pin.computeJointTorqueRegressor(model, data, q, v, 5 * a)
        blocks = [
            from_pinocchio(theirs[:, 10 * k : 10 * k + 10]) @ matrix
            for k, matrix in enumerate(maps)
        ]
        friction = [np.diag(np.tanh(v / 1e-3)), np.diag(v), np.diag(5 * a)]
        rows.append(np.hstack(blocks + friction))
    return np.vstack(rows)


def classes(robot: RobotModel, frames: str) -> tuple[int, int, int, int]:
    """Rank; identifiable alone, in combination, not at all."""
    matrix = observation(robot, frames)
    _, s, vt = np.linalg.svd(matrix, full_matrices=False)
    rank = int((s > 1e-9 * s[0]).sum())
    null, row = vt[rank:].T, vt[:rank]
    alone = np.linalg.norm(null, axis=1) < 1e-7
    unseen = (row**2).sum(axis=0) < 1e-12
    return rank, int(alone.sum()), int((~alone & ~unseen).sum()), int(unseen.sum())


def flange_pose(robot: RobotModel, q: Any) -> NDArray[np.float64]:
    return joint_poses(robot, q)[..., -1, :, :] @ robot.flange
