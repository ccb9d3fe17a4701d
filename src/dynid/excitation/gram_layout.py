"""Where a Gram kernel keeps the entries of the observation matrix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array, Indices
from dynid.reduction.base import BaseParametrization
from dynid.regressor.inertial_kernel import Places
from dynid.regressor.model import InverseDynamicModel


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
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

    panels: tuple[Panel, ...]
    places: Places
    """(n, n, 10), see `regressor.inertial.inertial_rows`."""
    rows: int
    """R, rows of memory."""
    rank: int
    """b, base columns."""


def gram_layout(model: InverseDynamicModel, base: BaseParametrization) -> GramLayout:
    """The layout of the base columns of a model."""
    n = model.robot.joints
    inertial = 10 * n
    links = [c for c in base.independent if c < inertial]
    first = len(links)
    acting = acting_joints(model)
    beside = [
        [c - inertial for c in base.independent if c >= inertial and acting[c - inertial, j]]
        for j in range(n)
    ]
    width = max(map(len, beside)) + first
    places = np.full((n, n, 10), -1, dtype=np.int64)
    panels: list[Panel] = []
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
            Panel(
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
    return np.asarray((out != 0).any(axis=2), dtype=np.float64)


def beside_counts(model: InverseDynamicModel) -> tuple[int, ...]:
    """Number of columns of each block beside the inertial ones."""
    return tuple(len(block.columns(model.robot)) for block in model.blocks)


def fill_beside(
    model: InverseDynamicModel,
    dq: Array,
    ddq: Array,
    out: Array,
    counts: tuple[int, ...] | None = None,
) -> None:
    """Write the columns beside the inertial ones for dq, ddq (n, N) into out (p - 10 n, n, N).

    Args:
        model: The model.
        dq: (n, N) velocities.
        ddq: (n, N) accelerations.
        out: (p - 10 n, n, N) to be written.
        counts: `beside_counts(model)`, where it is at hand: asking costs as much as filling.
    """
    first = 0
    for block, count in zip(model.blocks, counts or beside_counts(model), strict=True):
        block.fill(model.robot, dq, ddq, out[first : first + count])
        first += count
