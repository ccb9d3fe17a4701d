"""The base columns that can differ from zero, joint by joint, and where kernels keep them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core import Array, Indices
from dynid.reduction.base import BaseParametrization
from dynid.regressor import InverseDynamicModel, Places


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnPanel:
    """The base columns that can differ from zero in the rows of one joint."""

    rows: slice
    """Their rows in the kernel's memory: columns beside the inertial ones, then tip to base."""
    columns: Indices
    """Their base columns, in the order of the rows."""
    beside: Indices
    """The columns beside the inertial ones, counted from the first of those in the model."""

    def block(self, matrix: Array) -> Array:
        """Their rows and columns (k, k) of a (b, b) matrix."""
        return matrix[self.columns[:, None], self.columns]


@dataclass(frozen=True, slots=True, kw_only=True)
class GramLayout:
    """A panel a joint. A link loads only the joints before it: the panels shrink to the tip."""

    panels: tuple[ColumnPanel, ...]
    places: Places
    """(n, n, 10), see `regressor.inertial.inertial_rows`."""
    rows: int
    """R, rows of memory."""
    rank: int
    """b, base columns."""


def gram_layout(
    model: InverseDynamicModel, base: BaseParametrization, spare: int = 0
) -> GramLayout:
    """The layout of the base columns of a model.

    Args:
        model: The model.
        base: Its base parameters.
        spare: Rows of memory that are left free before each panel.
    """
    n = model.robot.joints
    inertial = 10 * n
    links = [c for c in base.independent if c < inertial]
    first = len(links)
    acting = acting_joints(model)
    beside = [
        [c - inertial for c in base.independent if c >= inertial and acting[c - inertial, j]]
        for j in range(n)
    ]
    width = max(map(len, beside)) + first + spare
    places = np.full((n, n, 10), -1, dtype=np.int64)
    panels: list[ColumnPanel] = []
    position = {column: k for k, column in enumerate(base.independent)}
    for j in range(n):
        begin = j * width + width - first - len(beside[j])
        # Tip to base: what joint j does not carry comes last and is left out.
        carried = [c for c in reversed(links) if c // 10 >= j]
        for k, column in enumerate(carried):
            places[column // 10, j, column % 10] = begin + len(beside[j]) + k
        count = len(beside[j]) + len(carried)
        columns = [position[c + inertial] for c in beside[j]] + [position[c] for c in carried]
        panels.append(
            ColumnPanel(
                rows=slice(begin, begin + count),
                columns=np.array(columns, dtype=np.intp),
                beside=np.array(beside[j], dtype=np.intp),
            )
        )
    return GramLayout(panels=tuple(panels), places=places, rows=n * width, rank=base.rank)


def acting_joints(model: InverseDynamicModel) -> Array:
    """(p - 10 n, n) 1 where a column beside the inertial ones acts on a joint, else 0."""
    robot = model.robot
    # What is zero at two unrelated states of full speed is zero everywhere.
    speed = np.random.default_rng(0).uniform(0.5, 1.0, (2, robot.joints, 2))
    out = np.zeros((len(model.columns) - 10 * robot.joints, robot.joints, 2))
    fill_beside(model, speed[0], speed[1], out)
    # Load-dependent friction and ripple act on the joint that they are named after.
    first = sum(model.counts)
    for k, column in enumerate(model.columns[10 * robot.joints + first :], start=first):
        out[k, column.joint] = 1.0
    return np.asarray((out != 0).any(axis=2), dtype=np.float64)


def fill_beside(model: InverseDynamicModel, dq: Array, ddq: Array, out: Array) -> None:
    """Write the columns beside the inertial ones for dq, ddq (n, N) into out (p - 10 n, n, N).

    Args:
        model: The model.
        dq: (n, N) velocities.
        ddq: (n, N) accelerations.
        out: (p - 10 n, n, N) to be written.
    """
    first = 0
    for block, count in zip(model.blocks, model.counts, strict=True):
        block.fill(model.robot, dq, ddq, out[first : first + count])
        first += count
