"""What the flange carries: solids against the arm, capsules that cover them against the scene.

Against the arm's capsules a box, cylinder or sphere is judged as it is. Against the scene's
solids it is a bundle of thin capsules that holds it and reaches beyond it by a third of their
spacing; against half-spaces a box is its four long edges, which is exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dynid.constraints.shapes import BOX, SPHERE, Shape, outer_half
from dynid.core.arrays import Array
from dynid.robot.capsule import Capsule
from dynid.robot.model import RobotModel

SPACING = 0.025
"""Of the capsules of a bundle, where that takes no more than `MOST` [m]."""
MOST = 36
"""Capsules of a bundle."""
_WIDER = 1.2
"""Radius of a capsule over that of the cell that it covers: its ends may then be drawn in."""
_ROUND = 32
"""Sides of the polygon around a cylinder."""
_EDGE = 1e-7
"""Radius of an edge [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Carried:
    """Capsules on the last link that stand for one shape."""

    solid: tuple[Capsule, ...]
    """That cover it."""
    edges: tuple[Capsule, ...]
    """That are the same to a half-space; none where `solid` serves there too."""


def carried_shapes(robot: RobotModel, payload: tuple[Shape, ...]) -> tuple[Shape, ...]:
    """The shapes (given in the flange's frame) in the joint frame of the last link."""
    return tuple(
        replace(shape, name=f"payload {shape.name}", pose=robot.flange @ shape.pose)
        for shape in payload
    )


def covering(robot: RobotModel, shape: Shape) -> Carried:
    """Capsules that hold a shape of `carried_shapes`."""
    axes, centre = shape.pose[:3, :3], shape.pose[:3, 3]

    def capsule(across: Array, reach: float, radius: float) -> Capsule:
        middle, way = centre + axes[:, order[:2]] @ across, axes[:, order[2]] * reach
        return Capsule(
            name=shape.name,
            link=robot.joints,
            start=middle - way,
            end=middle + way,
            radius=radius,
        )

    if shape.kind == SPHERE:
        order = [0, 1, 2]
        return Carried(solid=(capsule(np.zeros(2), 0.0, float(shape.size[0])),), edges=())
    half = outer_half(shape)
    order = [int(k) for k in np.argsort(half, kind="stable")]
    length, radius = float(half[order[2]]), float(shape.size[0])
    outline = half[order[:2]] * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    edges: tuple[Capsule, ...] = ()
    if shape.kind == BOX:
        edges = tuple(capsule(corner, length, _EDGE) for corner in outline)
    elif order[2] == 2:
        turns = 2 * np.pi * np.arange(_ROUND) / _ROUND
        outline = np.column_stack([np.cos(turns), np.sin(turns)])
        outline *= radius / math.cos(math.pi / _ROUND)
    solid: list[Capsule] = []
    for cell in _cells(outline):
        middle = (cell.min(axis=0) + cell.max(axis=0)) / 2
        inner = float(np.linalg.norm(cell - middle, axis=1).max())
        reach = length
        if shape.kind != BOX and order[2] != 2:
            # A disc: its capsules are chords.
            beside = cell[:, order.index(1 - order[2])]
            off = float(np.abs(beside).min()) if beside.min() * beside.max() > 0 else 0.0
            reach = math.sqrt(max(radius**2 - off**2, 0.0))
        # The rim of the cell's end (inner from the middle line) must lie within the cap.
        wide = _WIDER * inner
        drawn = max(reach - math.sqrt(wide**2 - inner**2), 0.0)
        solid.append(capsule(middle, drawn, max(wide, math.hypot(inner, reach - drawn))))
    return Carried(solid=tuple(solid), edges=edges)


def _cells(outline: Array) -> list[Array]:
    """The parts (., 2) of a convex outline (., 2) in the squares of a grid."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    spacing = SPACING
    while (counts := np.ceil((high - low) / spacing - 1e-9)).prod() > MOST:
        spacing *= 1.05
    x, y = (
        np.linspace(float(low[k]), float(high[k]), max(int(counts[k]), 1) + 1).tolist()
        for k in range(2)
    )
    found: list[Array] = []
    for left, right in pairwise(x):
        column = _clipped(_clipped(outline, 0, 1.0, right), 0, -1.0, -left)
        for below, above in pairwise(y):
            cell = _clipped(_clipped(column, 1, 1.0, above), 1, -1.0, -below)
            if len(cell):
                found.append(cell)
    return found


def _clipped(outline: Array, axis: int, sign: float, most: float) -> Array:
    """The part of a convex outline where sign * coordinate <= most."""
    over = sign * outline[:, axis] - most if len(outline) else np.empty(0)
    kept: list[Array] = []
    for k in range(len(outline)):
        last = k - 1
        if (over[k] > 0) != (over[last] > 0):
            share = over[last] / (over[last] - over[k])
            kept.append(outline[last] + share * (outline[k] - outline[last]))
        if over[k] <= 0:
            kept.append(outline[k])
    return np.array(kept).reshape(-1, 2)
