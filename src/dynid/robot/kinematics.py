"""Robots from axes and DH tables; their poses, mounting and nominal geometry."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, RobotError, frozen
from dynid.robot import transforms
from dynid.robot.model import STANDARD_GRAVITY, Drives, JointLimits, RobotModel

MAX_JOINTS = 64
"""More joints than this are a mistake in the file, not an arm."""


def robot_from_chain(
    *,
    placements: Array,
    axes: Array,
    name: str = "robot",
    joint_names: Sequence[str] | None = None,
    joint_types: Sequence[str] | None = None,
    flange: Array | None = None,
    frames: Mapping[str, Array] | None = None,
    default_frames: str = "urdf",
    notes: tuple[str, ...] = (),
) -> RobotModel:
    """A robot standing on the floor, with limits, drives and inertias left unknown.

    Args:
        placements: (n, 4, 4) joint frames in the previous ones at q = 0 [m].
        axes: (n, 3) unit axes in the joint frames.
        name: Name of the robot.
        joint_names: n names; None for joint_1 ... joint_n.
        joint_types: n times `revolute` or `prismatic`; None for all revolute.
        flange: (4, 4) the chain's end in the last joint frame; None for the same.
        frames: Convention to (n, 4, 4) parameter frames in the joint frames; None to compute
            `dh`, `mdh` and `urdf` from the geometry.
        default_frames: The convention used when none is asked for.
        notes: What was decided while reading.

    Raises:
        RobotError: No joints, too many, or names, types, axes or transforms that do not fit.
        InputError: Arrays of a wrong shape or not finite.
    """
    n = len(placements)
    if not 0 < n <= MAX_JOINTS:
        raise RobotError("number of joints", where=name, value=n, limit=f"1 to {MAX_JOINTS}")
    end, nan = np.eye(4) if flange is None else flange, np.full(n, np.nan)
    return RobotModel(
        name=name,
        joint_names=tuple(joint_names or [f"joint_{k + 1}" for k in range(n)]),
        joint_types=tuple(joint_types or ["revolute"] * n),
        placements=placements,
        axes=axes,
        flange=end,
        parameter_frames=frames or transforms.parameter_frames(placements, axes, end),
        default_frames=default_frames,
        gravity=mount_gravity("floor"),
        limits=JointLimits(lower=nan, upper=nan, velocity=nan, acceleration=nan, torque=nan),
        drives=Drives(gain=nan, gear_ratio=nan),
        inertias=np.full((n, 10), np.nan),
        notes=notes,
    )


CONVENTIONS = ("standard", "modified")
_NOT_EXACT = 1e-9
_PLACED = (
    "axes that are nearly parallel: the joint, dh and mdh frames were placed as if they were"
    " parallel, not where the table puts them"
)


def robot_from_dh(
    *,
    a: ArrayLike,
    d: ArrayLike,
    alpha: ArrayLike,
    theta: ArrayLike | None = None,
    convention: str = "standard",
    joint_types: Sequence[str] | None = None,
    sign: ArrayLike | None = None,
    base: ArrayLike | None = None,
    flange: ArrayLike | None = None,
    name: str = "robot",
    joint_names: Sequence[str] | None = None,
) -> RobotModel:
    """A robot from a Denavit-Hartenberg table; limits, drives and inertias are left unknown.

    Row i of a standard table is Rz(theta + q) Tz(d) Tx(a) Rx(alpha); of a modified one
    Rx(alpha) Tx(a) Rz(theta + q) Tz(d). A prismatic joint adds q to d instead. Joint i turns
    about z of its frame, which is frame i - 1 of a standard table (turned by theta) and frame
    i of a modified one. The `mdh` frame stands d up that axis, the `dh` frame at the far end
    of the link. Multiples of 90 degrees give exact zeros and ones.

    Args:
        a: (n) lengths [m].
        d: (n) offsets [m].
        alpha: (n) twists [rad].
        theta: (n) joint angles at q = 0 [rad]; None for zero.
        convention: `standard` or `modified` (Craig, Khalil).
        joint_types: n times `revolute` or `prismatic`; None for all revolute.
        sign: (n) 1, or -1 where the joint counts against z; None for all 1.
        base: (4, 4) frame 0 of the table in the base frame; None for the same.
        flange: (4, 4) flange in the last frame of the table; None for the same.
        name: Name of the robot.
        joint_names: n names; None for joint_1 ... joint_n.

    Raises:
        RobotError: Unknown convention, or columns that are not equally long.
        InputError: Columns that are not finite numbers.
    """
    if convention not in CONVENTIONS:
        raise RobotError("unknown DH convention", value=convention, limit=", ".join(CONVENTIONS))
    length_a = frozen(a, shape=(None,), name="dh a")
    n = len(length_a)
    columns = {
        key: frozen(np.zeros(n) if value is None else value, shape=(n,), name=f"dh {key}")
        for key, value in (("d", d), ("alpha", alpha), ("theta", theta))
    }
    signs = frozen(np.ones(n) if sign is None else sign, shape=(n,), name="dh sign")
    if not np.isin(signs, (1.0, -1.0)).all():
        raise RobotError("dh sign", value=signs.tolist(), limit="1 or -1")
    start = frozen(np.eye(4) if base is None else base, shape=(4, 4), name="base")
    end = frozen(np.eye(4) if flange is None else flange, shape=(4, 4), name="flange")
    twist = columns["alpha"]
    if convention == "modified" and n:
        # Rx(alpha) Tx(a) belong to the link before: the standard table, one row later.
        start = start @ transforms.translation(length_a[0], 0, 0) @ transforms.rotation_x(twist[0])
        length_a, twist = np.append(length_a[1:], 0.0), np.append(twist[1:], 0.0)
    up = _stack([transforms.translation(0, 0, height) for height in columns["d"]])
    along = _stack(
        [
            transforms.translation(length_a[k], 0, 0) @ transforms.rotation_x(twist[k])
            for k in range(n)
        ]
    )
    turned = _stack([transforms.rotation_z(angle) for angle in columns["theta"]])
    own = np.tile(np.eye(4), (n, 1, 1))
    near, turned = (own, turned @ up) if convention == "modified" else (up, turned)
    far = near @ along
    placements = _stack([start, *far[:-1]][:n]) @ turned
    axes = np.outer(signs, (0.0, 0.0, 1.0))
    tip = far[-1] @ end if n else end
    frames, notes = {"dh": far, "mdh": near, "urdf": own}, ()
    if _nearly_parallel(twist[:-1]):
        placements, tip = _brought_back(placements, axes, tip, convention)
        frames, notes = transforms.parameter_frames(placements, axes, tip), (_PLACED,)
    return robot_from_chain(
        name=name,
        joint_names=joint_names,
        joint_types=joint_types,
        placements=placements,
        axes=axes,
        flange=tip,
        frames=frames,
        default_frames="dh",
        notes=notes,
    )


def _brought_back(
    placements: Array, axes: Array, tip: Array, convention: str
) -> tuple[Array, Array]:
    """The same arm with its joint frames slid along their axes to where the links are.

    Where axes nearly meet, a table's frames stand at the meeting point, hundreds of metres off.
    """
    poses = transforms.poses_at_zero(placements)
    near, far = transforms.link_frames(poses, axes, tip)
    feet = near if convention == "modified" else np.concatenate([poses[:1], far[:-1]])
    slid = _stack(
        [transforms.translation(0, 0, z) for z in (transforms.inverse(poses) @ feet)[:, 2, 3]]
    )
    back = transforms.inverse(slid)
    before = _stack([np.eye(4), *back[:-1]])
    return before @ placements @ slid, back[-1] @ tip


def _stack(matrices: list[Array]) -> Array:
    return np.array(matrices, dtype=np.float64).reshape(len(matrices), 4, 4)


def _nearly_parallel(alpha: Array) -> bool:
    """Whether a twist [rad] is almost, but not exactly, a multiple of 180 degrees."""
    rest = np.abs(alpha - np.round(alpha / math.pi) * math.pi)
    return bool(((rest > _NOT_EXACT) & (rest < transforms.PARALLEL_WITHIN)).any())


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
        motion = transforms.joint_motion(robot.axes[k], robot.prismatic[k], positions[..., k])
        pose = pose @ robot.placements[k] @ motion
        poses[..., k, :, :] = pose
    return poses


def joint_turns(robot: RobotModel) -> Array:
    """(3, n, 3, 3) A, B, C of rotations A + B cos q + C sin q of the joints; 1 where they slide."""
    axes, still = robot.axes, np.array(robot.prismatic)[:, None, None]
    along = axes[:, :, None] * axes[:, None]
    turning = along, np.eye(3) - along, np.cross(np.eye(3), axes[:, None])
    return np.array(
        [np.where(still, x, y) for x, y in zip((np.eye(3), 0.0, 0.0), turning, strict=True)]
    )


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
    c, s = transforms.cos_sin(math.radians(degrees))
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
    poses = transforms.poses_at_zero(robot.placements)
    near, far = transforms.link_frames(poses, robot.axes, robot.flange)
    in_near = transforms.inverse(near) @ poses
    joint_frames = np.array([_snap(pose) for pose in in_near])
    placements = np.empty_like(poses)
    placements[0] = _snap(near[0]) @ joint_frames[0]
    for k in range(1, robot.joints):
        step = _link(near[k - 1], far[k - 1]) @ _joint(far[k - 1], near[k])
        placements[k] = transforms.inverse(joint_frames[k - 1]) @ step @ joint_frames[k]
    placements = transforms.tidy(placements)
    back = transforms.inverse(joint_frames)
    frames = {
        name: transforms.tidy(back @ np.array([_snap(pose) for pose in in_near @ values]))
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
        axes=transforms.tidy(np.einsum("kij,kj->ki", moves[:, :3, :3], robot.axes)),
        flange=moves[-1] @ robot.flange,
        parameter_frames=frames,
        inertias=np.array(
            [transforms.move(p, t) for p, t in zip(robot.inertias, moves, strict=True)]
        ),
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
    aligned = transforms.tidy(math.copysign(1.0, float(axis @ gravity)) * axis) * size
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
    return transforms.translation(_met(length), 0, 0) @ transforms.rotation_x(twist)


def _joint(far: Array, near: Array) -> Array:
    """The nominal way along an axis, from one link's far frame to the next near frame."""
    step = transforms.inverse(far) @ near
    angle = math.atan2(step[1, 0], step[0, 0])
    exact = _right(abs(angle))
    if exact is not None:
        angle = math.copysign(exact, angle)
    return transforms.rotation_z(angle) @ transforms.translation(0, 0, _met(float(step[2, 3])))


def _met(distance: float) -> float:
    return 0.0 if abs(distance) < transforms.MEET_WITHIN else distance


def _right(angle: float) -> float | None:
    """The multiple of 90 degrees near `angle`, if there is one."""
    exact = round(angle / (math.pi / 2)) * math.pi / 2
    return exact if abs(angle - exact) < transforms.PARALLEL_WITHIN else None


def _snap(pose: Array) -> Array:
    """A pose with its rotation and its small coordinates made exact where they nearly are."""
    result = pose.copy()
    rotation = np.round(pose[:3, :3])
    off = np.abs(pose[:3, :3] - rotation).max()
    if off < math.sin(transforms.PARALLEL_WITHIN) and np.array_equal(
        rotation @ rotation.T, np.eye(3)
    ):
        result[:3, :3] = rotation
    small = np.abs(pose[:3, 3]) < transforms.MEET_WITHIN
    result[:3, 3][small] = 0.0
    return result
