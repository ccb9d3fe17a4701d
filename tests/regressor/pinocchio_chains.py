"""Random chains, and what pinocchio says about them.

The frame change is written out here once more, so that the truth shares no code with the library.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from dynid.robot import Drives, JointLimits, RobotModel

Floats = NDArray[np.float64]

# Where our m, mx, my, mz, Jxx, Jyy, Jzz, Jyz, Jxz, Jxy stand in pinocchio's ten.
IN_PINOCCHIO = [0, 1, 2, 3, 4, 6, 9, 8, 7, 5]


def random_pose(random: np.random.Generator, reach: float = 0.6) -> Floats:
    pose = np.eye(4)
    turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
    pose[:3, :3] = turn * np.sign(np.linalg.det(turn))
    pose[:3, 3] = random.uniform(-reach, reach, 3)
    return pose


def random_chain(
    seed: int,
    joints: int,
    kinds: tuple[str, ...] = ("revolute", "prismatic"),
    gravity: tuple[float, float, float] | None = None,
) -> RobotModel:
    random = np.random.default_rng(seed)
    axes = random.normal(size=(joints, 3))
    poses = [np.array([random_pose(random) for _ in range(joints)]) for _ in range(3)]
    nan = np.full(joints, np.nan)
    return RobotModel(
        name=f"chain {seed}",
        joint_names=tuple(f"j{k + 1}" for k in range(joints)),
        joint_types=tuple(str(kind) for kind in random.choice(kinds, joints)),
        placements=poses[0],
        axes=axes / np.linalg.norm(axes, axis=1, keepdims=True),
        parameter_frames={
            "dh": poses[1],
            "mdh": poses[2],
            "urdf": np.tile(np.eye(4), (joints, 1, 1)),
        },
        default_frames="dh",
        gravity=random.uniform(-10, 10, 3) if gravity is None else np.array(gravity),
        limits=JointLimits(lower=nan, upper=nan, velocity=nan, acceleration=nan, torque=nan),
        drives=Drives(gain=nan, gear_ratio=nan),
        inertias=np.full((joints, 10), np.nan),
    )


def random_states(seed: int, samples: int, joints: int) -> tuple[Floats, Floats, Floats]:
    random = np.random.default_rng(seed)
    q, dq, ddq = random.uniform(-1, 1, (3, samples, joints))
    return np.pi * q, 3 * dq, 15 * ddq


def random_parameters(seed: int, joints: int) -> Floats:
    """(10 n) parameters of bodies made of point masses, in any frame."""
    random = np.random.default_rng(seed)
    values = np.empty((joints, 10))
    for link in values:
        masses, places = random.uniform(0.1, 2, 5), random.uniform(-0.3, 0.3, (5, 3))
        second = np.einsum("k,ki,kj", masses, places, places)
        inertia = np.trace(second) * np.eye(3) - second
        link[0], link[1:4] = masses.sum(), masses @ places
        link[4:7] = np.diag(inertia)
        link[7:] = inertia[1, 2], inertia[0, 2], inertia[0, 1]
    return values.ravel()


def frame_change(frame: Floats) -> Floats:
    """A (10, 10), ours: parameters about the joint frame = A parameters about `frame`."""
    columns = []
    for unit in np.eye(10):
        xx, yy, zz, yz, xz, xy = unit[4:]
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        pseudo = np.zeros((4, 4))
        pseudo[:3, :3] = np.trace(inertia) / 2 * np.eye(3) - inertia
        pseudo[:3, 3] = pseudo[3, :3] = unit[1:4]
        pseudo[3, 3] = unit[0]
        moved = frame @ pseudo @ frame.T
        second = moved[:3, :3]
        about = np.trace(second) * np.eye(3) - second
        off = about[1, 2], about[0, 2], about[0, 1]
        columns.append([moved[3, 3], *moved[:3, 3], *np.diag(about), *off])
    return np.array(columns).T


def pinocchio_model(robot: RobotModel) -> pin.Model:
    model = pin.Model()
    parent = 0
    for k in range(robot.joints):
        slides = robot.joint_types[k] == "prismatic"
        kind = pin.JointModelPrismaticUnaligned if slides else pin.JointModelRevoluteUnaligned
        placement = pin.SE3(robot.placements[k])
        parent = model.addJoint(parent, kind(robot.axes[k]), placement, f"j{k}")
    model.gravity.linear = np.array(robot.gravity)
    return model


def regressor(robot: RobotModel, frames: str, q: Floats, dq: Floats, ddq: Floats) -> Floats:
    """(N, n, 10 n) pinocchio's regressor for parameters in `frames`, in our order."""
    model = pinocchio_model(robot)
    data = model.createData()
    changes = [frame_change(frame) for frame in robot.parameter_frames[frames]]
    rows = []
    for state in zip(q, dq, ddq, strict=True):
        # For one joint pinocchio returns a plain row.
        theirs = np.atleast_2d(pin.computeJointTorqueRegressor(model, data, *state))
        links = [theirs[:, 10 * k : 10 * k + 10][:, IN_PINOCCHIO] for k in range(robot.joints)]
        rows.append(np.hstack([link @ change for link, change in zip(links, changes, strict=True)]))
    return np.array(rows)


def torques(
    robot: RobotModel, frames: str, parameters: Floats, q: Floats, dq: Floats, ddq: Floats
) -> Floats:
    """(N, n) pinocchio's recursive Newton-Euler torques for parameters given in `frames`."""
    model = pinocchio_model(robot)
    for k, link in enumerate(parameters.reshape(-1, 10)):
        moved = frame_change(robot.parameter_frames[frames][k]) @ link
        theirs = np.empty(10)
        theirs[IN_PINOCCHIO] = moved
        model.inertias[k + 1] = pin.Inertia.FromDynamicParameters(theirs)
    data = model.createData()
    states = zip(q, dq, ddq, strict=True)
    return np.array([pin.rnea(model, data, *state) for state in states])
