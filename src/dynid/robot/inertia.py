"""The ten inertial parameters of a link, and how they change with the frame.

The order is the paper's, `PARAMETERS`; the tensor is about the frame's origin, not about the
centre of mass. As a symmetric 4x4 pseudo-inertia the ten change by congruence,
J_a = H J_b H' with H the frame b in frame a, which makes the change linear in the ten.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, RobotError, frozen, read_only

PARAMETERS = ("m", "mx", "my", "mz", "Jxx", "Jyy", "Jzz", "Jyz", "Jxz", "Jxy")
"""The paper's order."""

# Position of each of our parameters in pinocchio's order m, mx, my, mz, xx, xy, yy, xz, yz, zz.
_IN_PINOCCHIO = np.array([0, 1, 2, 3, 4, 6, 9, 8, 7, 5])
_FROM_PINOCCHIO = np.argsort(_IN_PINOCCHIO)


def to_pinocchio(parameters: Array) -> Array:
    """Parameters (..., 10) in the order of pinocchio's `toDynamicParameters`."""
    return parameters[..., _FROM_PINOCCHIO]


def from_pinocchio(parameters: Array) -> Array:
    """Parameters (..., 10) from the order of pinocchio's `toDynamicParameters`."""
    return parameters[..., _IN_PINOCCHIO]


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


@functools.cache
def _basis() -> Array:
    return read_only(to_pseudo_inertia(np.eye(10)))


def frame_map(frame: ArrayLike) -> Array:
    """The matrix A (10, 10) with parameters_outer = A parameters_inner.

    Args:
        frame: (4, 4) inner frame in the outer frame, rotation and translation [m].

    Raises:
        InputError: `frame` is not a finite (4, 4) array.
    """
    placed = frozen(frame, shape=(4, 4), name="frame")
    return from_pseudo_inertia(placed @ _basis() @ placed.T).T


def move(parameters: Array, frame: ArrayLike) -> Array:
    """Parameters (10) given in `frame`, expressed in the frame around it.

    What is unknown (NaN) stays unknown; a known mass and known first moments stay known.

    Args:
        parameters: (10) parameters in the inner frame.
        frame: (4, 4) inner frame in the outer frame.

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
