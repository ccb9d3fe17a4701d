"""Denavit-Hartenberg frames of any chain, from where its axes are at q = 0.

Each link i lies between axis i and axis i + 1. Its common normal has a foot on either axis:
the modified frame (`mdh`) stands at the near foot with z along axis i, the standard frame
(`dh`) at the far foot with z along axis i + 1; both have x along the normal.

Where the axes are parallel the normal through the previous origin is taken, so that d = 0.
Axes within `PARALLEL_WITHIN` count as parallel and normals below `MEET_WITHIN` as none:
a calibrated arm, whose parallel axes meet somewhere hundreds of metres away, keeps its frames
where the nominal arm has them. The last link has no next axis: both its frames stand on its
own axis, at the height of the flange. Only the direction of a sliding axis is physical; its
place is taken where the file puts the joint.
"""

from __future__ import annotations

import math

import numpy as np

from dynid.core.arrays import Array
from dynid.robot.transforms import from_axes, inverse

PARALLEL_WITHIN = math.radians(0.5)
"""Factory calibrations of the UR5 tilt parallel axes by up to 0.37 degrees [rad]."""
MEET_WITHIN = 3e-3
"""Factory calibrations move crossing axes apart by less than this [m]."""

# A normal this close to square with the previous x has no side of its own to prefer.
_NO_PREFERENCE = -1e-2


def poses_at_zero(placements: Array) -> Array:
    """The joint frames (n, 4, 4) in the base frame at q = 0."""
    poses = np.empty_like(placements)
    pose = np.eye(4)
    for k, placement in enumerate(placements):
        pose = pose @ placement
        poses[k] = pose
    return poses


def link_frames(poses: Array, axes: Array, flange: Array) -> tuple[Array, Array]:
    """The near (`mdh`) and far (`dh`) frames of every link in the base frame at q = 0.

    Args:
        poses: (n, 4, 4) joint frames in the base frame at q = 0 [m].
        axes: (n, 3) unit axes in the joint frames.
        flange: (4, 4) the chain's end in the last joint frame [m].

    Returns:
        Two arrays (n, 4, 4).
    """
    points = poses[:, :3, 3]
    directions = np.einsum("kij,kj->ki", poses[:, :3, :3], axes)
    near, far = np.empty_like(poses), np.empty_like(poses)
    origin = points[0] - (points[0] @ directions[0]) * directions[0]
    x = _across(np.array([1.0, 0, 0]), directions[0])
    for k in range(len(poses) - 1):
        z, z_next = directions[k], directions[k + 1]
        foot, origin, x = _common_normal(origin, z, points[k + 1], z_next, x)
        near[k] = from_axes(x, z, foot)
        x = _across(x, z_next)
        far[k] = from_axes(x, z_next, origin)
    z = directions[-1]
    end = (poses[-1] @ flange)[:3, 3]
    near[-1] = far[-1] = from_axes(x, z, points[-1] + ((end - points[-1]) @ z) * z)
    return near, far


def parameter_frames(placements: Array, axes: Array, flange: Array) -> dict[str, Array]:
    """The `dh`, `mdh` and `urdf` frames of every link, in its joint frame.

    The `urdf` frames are the joint frames themselves.

    Args:
        placements: (n, 4, 4) joint frames in the previous ones at q = 0 [m].
        axes: (n, 3) unit axes in the joint frames.
        flange: (4, 4) the chain's end in the last joint frame [m].

    Returns:
        Convention to (n, 4, 4).
    """
    poses = poses_at_zero(placements)
    near, far = link_frames(poses, axes, flange)
    back = inverse(poses)
    own = np.tile(np.eye(4), (len(poses), 1, 1))
    return {"dh": tidy(back @ far), "mdh": tidy(back @ near), "urdf": own}


def tidy(matrices: Array) -> Array:
    """Transforms without rounding residues: entries within 1e-12 of an integer are it."""
    rounded = np.round(matrices)
    return np.where(np.abs(matrices - rounded) < 1e-12, rounded, matrices) + 0.0


def _common_normal(
    origin: Array, z: Array, point: Array, z_next: Array, x: Array
) -> tuple[Array, Array, Array]:
    """Feet on the axis (through `origin`) and on the next (through `point`), and direction."""
    across = np.cross(z, z_next)
    sine = float(np.linalg.norm(across))
    if sine <= math.sin(PARALLEL_WITHIN):
        foot = point + ((origin - point) @ z) / (z_next @ z) * z_next
        gap = foot - origin
        length = float(np.linalg.norm(gap))
        return origin, foot, _across(gap if length > MEET_WITHIN else x, z)
    normal = across / sine
    offset = point - origin
    along = np.cross(offset, z_next) @ across / sine**2
    along_next = np.cross(offset, z) @ across / sine**2
    gap = float(offset @ normal)
    if abs(gap) > MEET_WITHIN:
        side = math.copysign(1.0, gap)
    else:
        side = 1.0 if normal @ x > _NO_PREFERENCE else -1.0
    return origin + along * z, point + along_next * z_next, side * normal


def _across(vector: Array, axis: Array) -> Array:
    """The unit part of `vector` square to `axis`, or any such direction if there is none."""
    part = vector - (vector @ axis) * axis
    length = float(np.linalg.norm(part))
    if length > 1e-6:
        return part / length
    return _across(np.eye(3)[int(np.argmin(np.abs(axis)))], axis)
