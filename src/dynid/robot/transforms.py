"""Rigid transforms, Denavit-Hartenberg frames of any chain, and inertias in other frames.

The order of a link's ten inertial parameters is the paper's, `PARAMETERS`; the tensor is about the
frame's origin, not about the centre of mass. As a symmetric 4x4 pseudo-inertia the ten change by
congruence, J_a = H J_b H' with H the frame b in frame a, which makes the change linear in the ten.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, RobotError, frozen, read_only

PARAMETERS = ("m", "mx", "my", "mz", "Jxx", "Jyy", "Jzz", "Jyz", "Jxz", "Jxy")
"""The paper's order."""
PARAMETER_UNITS = ("kg", *("kg.m",) * 3, *("kg.m^2",) * 6)


def tensor(parameters: Array) -> Array:
    """The inertia tensors (..., 3, 3) about the frame's origin [kg.m^2]."""
    xx, yy, zz, yz, xz, xy = np.moveaxis(parameters[..., 4:], -1, 0)
    rows = [np.stack(row, axis=-1) for row in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))]
    return np.stack(rows, axis=-2)


def to_pseudo_inertia(parameters: Array) -> Array:
    """The pseudo-inertias (..., 4, 4): [[trace(J)/2 I - J, h], [h', m]]."""
    full = tensor(parameters)
    result = np.empty((*parameters.shape[:-1], 4, 4))
    half_trace = np.trace(full, axis1=-2, axis2=-1)[..., None, None] / 2
    result[..., :3, :3] = half_trace * np.eye(3) - full
    result[..., :3, 3] = result[..., 3, :3] = parameters[..., 1:4]
    result[..., 3, 3] = parameters[..., 0]
    return result


def from_pseudo_inertia(matrix: Array) -> Array:
    """The parameters (..., 10) of pseudo-inertias (..., 4, 4)."""
    second = matrix[..., :3, :3]
    full = np.trace(second, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - second
    return np.concatenate(
        [
            matrix[..., 3, 3:],
            matrix[..., :3, 3],
            np.stack([full[..., 0, 0], full[..., 1, 1], full[..., 2, 2]], axis=-1),
            np.stack([full[..., 1, 2], full[..., 0, 2], full[..., 0, 1]], axis=-1),
        ],
        axis=-1,
    )


PSEUDO_INERTIA_BASIS = read_only(to_pseudo_inertia(np.eye(10)))
"""(10, 4, 4) the pseudo-inertia of each inertial parameter."""


def frame_map(frame: ArrayLike) -> Array:
    """The matrix A (10, 10) with parameters_outer = A parameters_inner.

    The frame (4, 4) is the inner one in the outer one, rotation and translation [m].

    Raises:
        InputError: `frame` is not a finite (4, 4) array.
    """
    placed = frozen(frame, shape=(4, 4), name="frame")
    return from_pseudo_inertia(placed @ PSEUDO_INERTIA_BASIS @ placed.T).T


def move(parameters: Array, frame: ArrayLike) -> Array:
    """Parameters (10) given in a frame (4, 4), expressed in the frame around it.

    What is unknown (NaN) stays unknown; a known mass and known first moments stay known.

    Raises:
        InputError: `frame` is not a finite (4, 4) array.
    """
    matrix = frame_map(frame)
    return np.concatenate(
        [parameters[:1], matrix[1:4, :4] @ parameters[:4], matrix[4:] @ parameters]
    )


def from_body(mass: float, centre: ArrayLike, central: ArrayLike) -> Array:
    """The parameters (10) of a body.

    Args:
        mass: Mass [kg], not negative.
        centre: (3) centre of mass in the frame [m].
        central: (3, 3) symmetric tensor about the centre of mass, in the frame's directions
            [kg.m^2]; NaN where unknown.

    Raises:
        RobotError: A negative or infinite mass, or a tensor that is not symmetric.
        InputError: Wrong shapes, or a centre of mass that is not finite.
    """
    lever = frozen(centre, shape=(3,), name="centre of mass")
    about = frozen(central, shape=(3, 3), name="inertia tensor", finite=False)
    if not np.isfinite(mass) or mass < 0:
        raise RobotError("a mass must be finite and not negative", value=mass)
    known = about[~np.isnan(about)]
    scale = float(np.abs(known).max(initial=0.0))
    if not np.allclose(about, about.T, rtol=0, atol=1e-9 * scale, equal_nan=True):
        raise RobotError("an inertia tensor must be symmetric", value=about.tolist())
    full = about + mass * (lever @ lever * np.eye(3) - np.outer(lever, lever))
    six = [full[0, 0], full[1, 1], full[2, 2], full[1, 2], full[0, 2], full[0, 1]]
    return np.array([mass, *(mass * lever), *six])


def is_physical(parameters: Array, tolerance: float = 1e-9) -> bool:
    """Whether parameters (10) belong to some distribution of positive mass.

    That is the case exactly when the pseudo-inertia has no negative eigenvalue.
    """
    values = np.linalg.eigvalsh(to_pseudo_inertia(parameters))
    return bool(values[0] >= -tolerance * max(float(values[-1]), 1e-12))


_EXACT_WITHIN = 1e-12
"""Angles this close to a multiple of 90 degrees are that multiple [rad]: a float pi/2 is not."""


def cos_sin(angle: float) -> tuple[float, float]:
    """Cosine and sine of an angle [rad], with exact zeros and ones at multiples of 90 degrees."""
    quarter = round(angle / (math.pi / 2))
    if abs(angle - quarter * math.pi / 2) <= _EXACT_WITHIN:
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[quarter % 4]
    return math.cos(angle), math.sin(angle)


def translation(x: float, y: float, z: float) -> Array:
    """A pure translation [m]."""
    matrix = np.eye(4)
    matrix[:3, 3] = (x, y, z)
    return matrix


def rotation_x(angle: float) -> Array:
    """A rotation about x by `angle` [rad]."""
    c, s = cos_sin(angle)
    return np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]], dtype=np.float64)


def rotation_y(angle: float) -> Array:
    """A rotation about y by `angle` [rad]."""
    c, s = cos_sin(angle)
    return np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]], dtype=np.float64)


def rotation_z(angle: float) -> Array:
    """A rotation about z by `angle` [rad]."""
    c, s = cos_sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], dtype=np.float64)


def require_rigid(matrices: Array, where: str) -> None:
    """Refuse transforms (N, 4, 4) that scale, shear or mirror.

    Raises:
        RobotError: One is not a rotation and a translation.
    """
    rotations = matrices[:, :3, :3]
    gram = rotations @ rotations.transpose(0, 2, 1)
    rigid = np.allclose(gram, np.eye(3), atol=1e-6, rtol=0) and (np.linalg.det(rotations) > 0).all()
    if not rigid or not np.array_equal(matrices[:, 3], np.tile([0.0, 0, 0, 1], (len(matrices), 1))):
        raise RobotError("a placement is not a rotation and a translation", where=where)


def from_xyz_rpy(xyz: Sequence[float], rpy: Sequence[float]) -> Array:
    """The transform of a URDF `origin`: three coordinates [m], then roll, pitch and yaw [rad].

    These turn about the fixed axes x, y, z, in that order.
    """
    return (
        translation(xyz[0], xyz[1], xyz[2])
        @ rotation_z(rpy[2])
        @ rotation_y(rpy[1])
        @ rotation_x(rpy[0])
    )


def from_axes(x: Array, z: Array, origin: Array) -> Array:
    """The frame with these x (3) and z (3) axes and this origin (3) [m]."""
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = x, np.cross(z, x), z
    matrix[:3, 3] = origin
    return matrix


def inverse(matrix: Array) -> Array:
    """The inverse of rigid transforms (..., 4, 4)."""
    rotation = matrix[..., :3, :3].swapaxes(-1, -2)
    result = np.zeros_like(matrix)
    result[..., :3, :3] = rotation
    result[..., :3, 3] = -(rotation @ matrix[..., :3, 3:])[..., 0]
    result[..., 3, 3] = 1.0
    return result


def joint_motion(axis: Array, prismatic: bool, position: Array | float) -> Array:
    """The transforms (..., 4, 4) that a joint makes at positions (...) [rad or m].

    It slides along the unit axis (3) if it is prismatic, else it turns about it.
    """
    position = np.asarray(position, dtype=np.float64)
    result = np.zeros((*position.shape, 4, 4))
    result[..., 3, 3] = 1.0
    if prismatic:
        result[..., :3, :3] = np.eye(3)
        result[..., :3, 3] = position[..., None] * axis
        return result
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=np.float64)
    sine, cosine = np.sin(position), np.cos(position)
    result[..., :3, :3] = (
        cosine[..., None, None] * np.eye(3)
        + sine[..., None, None] * cross
        + (1 - cosine)[..., None, None] * np.outer(axis, axis)
    )
    return result


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
    """The near (`mdh`) and far (`dh`) frames (n, 4, 4) of every link in the base frame at q = 0.

    Of joint frames (n, 4, 4) there [m], unit axes (n, 3) in them, and the chain's end (4, 4) in the
    last.
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
    """The `dh`, `mdh` and `urdf` frames (n, 4, 4) of every link, in its joint frame.

    The `urdf` frames are the joint frames themselves. Of joint frames (n, 4, 4) in the previous
    ones at q = 0 [m], unit axes (n, 3) in them, and the chain's end (4, 4) in the last.
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
