"""Forward kinematics, the mounting of the base, and the nominal geometry of a calibrated arm."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, RobotError
from dynid.robot.model import STANDARD_GRAVITY, RobotModel
from dynid.robot.transforms import (
    MEET_WITHIN,
    PARALLEL_WITHIN,
    cos_sin,
    inverse,
    joint_motion,
    link_frames,
    move,
    poses_at_zero,
    rotation_x,
    rotation_z,
    tidy,
    translation,
)


def joint_poses(robot: RobotModel, q: ArrayLike) -> Array:
    """The joint frames (..., n, 4, 4) in the base frame [m] at positions q (..., n) [rad or m].

    Raises:
        RobotError: The last axis of `q` is not n long.
    """
    positions = np.asarray(q, dtype=np.float64)
    if positions.shape[-1:] != (robot.joints,):
        raise RobotError(
            "joint positions do not fit the robot", value=positions.shape, limit=robot.joints
        )
    poses = np.empty((*positions.shape, 4, 4))
    pose: Array = np.eye(4)
    for k in range(robot.joints):
        motion = joint_motion(robot.axes[k], robot.prismatic[k], positions[..., k])
        pose = pose @ robot.placements[k] @ motion
        poses[..., k, :, :] = pose
    return poses


MOUNTS = ("floor", "wall", "ceiling", "tilt:DEG")
"""The words that `--mount` takes; DEG is a number of degrees about the base's x axis."""


def mount_gravity(mount: str) -> Array:
    """Gravity in the base frame (3) [m/s^2] for `floor`, `wall`, `ceiling` or `tilt:DEG`.

    `tilt:DEG` turns the floor's gravity about the base's x axis: 0 is the floor, 90 the wall,
    180 the ceiling.

    Raises:
        RobotError: None of these, or DEG is not a number within -360 and 360.
    """
    fixed = {"floor": 0.0, "wall": 90.0, "ceiling": 180.0}
    kind, _, number = mount.partition(":")
    if mount in fixed:
        degrees = fixed[mount]
    elif kind == "tilt":
        degrees = _degrees(number)
    else:
        raise RobotError("unknown mounting", value=mount, limit=", ".join(MOUNTS))
    c, s = cos_sin(math.radians(degrees))
    # The sum turns a negative zero into zero.
    return np.array([0.0, -s, -c]) * STANDARD_GRAVITY + 0.0


def with_mount(robot: RobotModel, mount: str) -> RobotModel:
    """The same robot mounted otherwise.

    Raises:
        RobotError: The mounting is not known.
    """
    return replace(robot, gravity=mount_gravity(mount), mount=mount)


def _degrees(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) <= 360:
        raise RobotError(
            "tilt needs degrees, as in tilt:45", where="mount", value=text, limit="-360 to 360"
        )
    return value


_WORTH_A_NOTE = 1e-9
_SAME = 1e-12
_GRAVITY_WITHIN = math.radians(1.0)


def nominal_geometry(robot: RobotModel) -> RobotModel:
    """A copy whose axes are exactly parallel, square or crossing where they nearly are.

    Angles within 0.5 degrees of a multiple of 90 degrees become it, distances below 3 mm
    become zero. The parameter frames, inertias and bodies follow. A robot that is exact
    already is returned as it is.
    """
    poses = poses_at_zero(robot.placements)
    near, far = link_frames(poses, robot.axes, robot.flange)
    in_near = inverse(near) @ poses
    joint_frames = np.array([_snap(pose) for pose in in_near])
    placements = np.empty_like(poses)
    placements[0] = _snap(near[0]) @ joint_frames[0]
    for k in range(1, robot.joints):
        step = _link(near[k - 1], far[k - 1]) @ _joint(far[k - 1], near[k])
        placements[k] = inverse(joint_frames[k - 1]) @ step @ joint_frames[k]
    placements = tidy(placements)
    back = inverse(joint_frames)
    frames = {
        name: tidy(back @ np.array([_snap(pose) for pose in in_near @ values]))
        for name, values in robot.parameter_frames.items()
    }
    differences = [placements - robot.placements]
    differences += [frames[name] - values for name, values in robot.parameter_frames.items()]
    if max(float(np.abs(values).max()) for values in differences) <= _SAME:
        return robot
    moves = back @ in_near
    return replace(
        robot,
        placements=placements,
        axes=tidy(np.einsum("kij,kj->ki", moves[:, :3, :3], robot.axes)),
        flange=moves[-1] @ robot.flange,
        parameter_frames=frames,
        inertias=np.array([move(p, t) for p, t in zip(robot.inertias, moves, strict=True)]),
        bodies=tuple(
            replace(
                body,
                points=body.points @ moves[body.link - 1, :3, :3].T + moves[body.link - 1, :3, 3],
            )
            if body.link
            else body
            for body in robot.bodies
        ),
    )


def structural_gravity(robot: RobotModel) -> tuple[Array, str | None]:
    """Gravity for structural questions: exactly along joint axis 1 where it nearly is.

    A base that stands 0.1 degrees off makes two more parameters identifiable in theory, and
    none in practice.

    Returns:
        Gravity (3) in the base frame [m/s^2], and what was changed in words, or None.
    """
    gravity = robot.gravity
    size = float(np.linalg.norm(gravity))
    axis = robot.placements[0, :3, :3] @ robot.axes[0]
    across = float(np.linalg.norm(np.cross(axis, gravity)))
    angle = math.atan2(across, abs(float(axis @ gravity)))
    if size == 0 or angle > _GRAVITY_WITHIN:
        return gravity, None
    aligned = tidy(math.copysign(1.0, float(axis @ gravity)) * axis) * size
    if angle <= _WORTH_A_NOTE:
        return aligned, None
    return aligned, (
        f"gravity is {math.degrees(angle):.2g} deg off the axis of joint 1 and was taken as"
        " parallel to it"
    )


def _link(near: Array, far: Array) -> Array:
    """The nominal way along a link, from its near to its far frame."""
    z, z_next = near[:3, 2], far[:3, 2]
    length = float((far[:3, 3] - near[:3, 3]) @ near[:3, 0])
    twist = math.atan2(float(np.cross(z, z_next) @ near[:3, 0]), float(z @ z_next))
    # Nearly parallel axes need not lean about the normal: their true angle decides.
    exact = _right(math.atan2(float(np.linalg.norm(np.cross(z, z_next))), float(z @ z_next)))
    if exact is not None:
        twist = math.copysign(exact, twist)
    return translation(_met(length), 0, 0) @ rotation_x(twist)


def _joint(far: Array, near: Array) -> Array:
    """The nominal way along an axis, from one link's far frame to the next near frame."""
    step = inverse(far) @ near
    angle = math.atan2(step[1, 0], step[0, 0])
    exact = _right(abs(angle))
    if exact is not None:
        angle = math.copysign(exact, angle)
    return rotation_z(angle) @ translation(0, 0, _met(float(step[2, 3])))


def _met(distance: float) -> float:
    return 0.0 if abs(distance) < MEET_WITHIN else distance


def _right(angle: float) -> float | None:
    """The multiple of 90 degrees near `angle`, if there is one."""
    exact = round(angle / (math.pi / 2)) * math.pi / 2
    return exact if abs(angle - exact) < PARALLEL_WITHIN else None


def _snap(pose: Array) -> Array:
    """A pose with its rotation and its small coordinates made exact where they nearly are."""
    result = pose.copy()
    rotation = np.round(pose[:3, :3])
    off = np.abs(pose[:3, :3] - rotation).max()
    if off < math.sin(PARALLEL_WITHIN) and np.array_equal(rotation @ rotation.T, np.eye(3)):
        result[:3, :3] = rotation
    small = np.abs(pose[:3, 3]) < MEET_WITHIN
    result[:3, 3][small] = 0.0
    return result
