"""Solid shapes that stand in the base frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array, frozen
from dynid.core.errors import InputError

HALF_SPACE, BOX, CYLINDER, SPHERE = 0, 1, 2, 3
KINDS = ("half-space", "box", "cylinder", "sphere")


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """A convex solid.

    A half-space is what lies below its own xy plane; a cylinder stands along its own z axis.

    Raises:
        InputError: An unknown kind, or sizes that are not positive and finite.
    """

    name: str
    kind: int
    """One of HALF_SPACE, BOX, CYLINDER, SPHERE."""
    pose: Array
    """(4, 4) the shape's frame in the base frame [m]."""
    size: Array
    """(3) a box: half its sides; a cylinder: radius, half its length, 0; a sphere: radius,
    0, 0; a half-space: zeros [m]."""

    def __post_init__(self) -> None:
        if self.kind not in range(len(KINDS)):
            raise InputError("unknown kind of shape", where=self.name, value=self.kind)
        object.__setattr__(self, "pose", frozen(self.pose, shape=(4, 4), name="shape pose"))
        object.__setattr__(self, "size", frozen(self.size, shape=(3,), name="shape size"))
        needed = (0, 3, 2, 1)[self.kind]
        if not all(math.isfinite(x) and x > 0 for x in self.size[:needed]):
            raise InputError("sizes must be positive", where=self.name)


def outer_half(shape: Shape) -> Array:
    """(3) half the sides of the box around a solid along its own axes; zeros for a sphere [m]."""
    if shape.kind == SPHERE:
        return np.zeros(3)
    return np.array(shape.size if shape.kind == BOX else shape.size[[0, 0, 1]])


def outermost(shape: Shape) -> Array:
    """(8, 3) points whose hull, widened by a sphere's radius, holds a solid that is no half-space.

    In the frame that the shape stands in: corners of the box around it, a sphere's centre [m].
    """
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return shape.pose[:3, 3] + (signs * outer_half(shape)) @ shape.pose[:3, :3].T


def packed(shapes: tuple[Shape, ...]) -> Array:
    """(S, 16) kind, rotation base to shape (row-major), origin, size: what the kernels read."""
    rows = np.zeros((len(shapes), 16))
    for row, shape in zip(rows, shapes, strict=True):
        row[0] = shape.kind
        row[1:10] = shape.pose[:3, :3].T.ravel()
        row[10:13] = shape.pose[:3, 3]
        row[13:16] = shape.size
    return rows
