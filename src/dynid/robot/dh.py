"""Robots from Denavit-Hartenberg tables."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, RobotError, frozen
from dynid.robot.kinematics import mount_gravity
from dynid.robot.model import RobotModel, direct_drives, unknown_limits
from dynid.robot.transforms import (
    PARALLEL_WITHIN,
    inverse,
    link_frames,
    parameter_frames,
    poses_at_zero,
    rotation_x,
    rotation_z,
    translation,
)

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
    end = np.eye(4) if flange is None else flange
    return RobotModel(
        name=name,
        joint_names=tuple(joint_names or [f"joint_{k + 1}" for k in range(n)]),
        joint_types=tuple(joint_types or ["revolute"] * n),
        placements=placements,
        axes=axes,
        flange=end,
        parameter_frames=frames or parameter_frames(placements, axes, end),
        default_frames=default_frames,
        gravity=mount_gravity("floor"),
        limits=unknown_limits(n),
        drives=direct_drives(n),
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
        start = start @ translation(length_a[0], 0, 0) @ rotation_x(twist[0])
        length_a, twist = np.append(length_a[1:], 0.0), np.append(twist[1:], 0.0)
    up = _stack([translation(0, 0, height) for height in columns["d"]])
    along = _stack([translation(length_a[k], 0, 0) @ rotation_x(twist[k]) for k in range(n)])
    turned = _stack([rotation_z(angle) for angle in columns["theta"]])
    own = np.tile(np.eye(4), (n, 1, 1))
    near, turned = (own, turned @ up) if convention == "modified" else (up, turned)
    far = near @ along
    placements = _stack([start, *far[:-1]][:n]) @ turned
    axes = np.outer(signs, (0.0, 0.0, 1.0))
    tip = far[-1] @ end if n else end
    frames, notes = {"dh": far, "mdh": near, "urdf": own}, ()
    if _nearly_parallel(twist[:-1]):
        placements, tip = _brought_back(placements, axes, tip, convention)
        frames, notes = parameter_frames(placements, axes, tip), (_PLACED,)
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
    poses = poses_at_zero(placements)
    near, far = link_frames(poses, axes, tip)
    feet = near if convention == "modified" else np.concatenate([poses[:1], far[:-1]])
    slid = _stack([translation(0, 0, z) for z in (inverse(poses) @ feet)[:, 2, 3]])
    back = inverse(slid)
    before = _stack([np.eye(4), *back[:-1]])
    return before @ placements @ slid, back[-1] @ tip


def _stack(matrices: list[Array]) -> Array:
    return np.array(matrices, dtype=np.float64).reshape(len(matrices), 4, 4)


def _nearly_parallel(alpha: Array) -> bool:
    """Whether a twist [rad] is almost, but not exactly, a multiple of 180 degrees."""
    rest = np.abs(alpha - np.round(alpha / math.pi) * math.pi)
    return bool(((rest > _NOT_EXACT) & (rest < PARALLEL_WITHIN)).any())
