"""Several records of one robot at once: what they share, and what each has of its own.

Inertias are the same in every record; friction is not (cold, warm, another day). Ordered record
by record, the observation matrix has its own columns in blocks on the diagonal and the shared
columns beside them. QR of each record removes its own columns; what is left of all records gives
the shared parameters; back-substitution gives the rest. No matrix is larger than one record's.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import InputError, JobError
from dynid.core.linalg import solve_upper, upper_triangle
from dynid.identification.problem import IdentificationProblem, block_mean, recorded_rows

INERTIAS = ("Im", "Imm")
"""Columns after the links' that belong to the robot, not to its friction."""
PAYLOAD = 10
"""Inertial parameters of a payload."""
SINGULAR = 1e-11
"""Smallest pivot over the largest, columns of unit norm, that counts as resolved."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedProblem:
    """Records of one robot, some of them with one and the same payload on its last link.

    Raises:
        InputError: No records, models whose base parameters differ, or not one flag a record.
    """

    problems: tuple[IdentificationProblem, ...]
    """One a record; the models may differ in the shapes of their friction columns only."""
    loaded: tuple[bool, ...] = ()
    """For each record, whether it carries the payload; empty for none."""

    def __post_init__(self) -> None:
        if not self.problems:
            raise InputError("needs at least one record")
        first = self.problems[0].base
        for other in self.problems[1:]:
            same = other.base.model.frames == first.model.frames
            if other.base.names != first.names or not same:
                raise InputError(
                    "records with other base parameters cannot share them",
                    value=sorted(set(other.base.names) ^ set(first.names)),
                    limit=f"frames {first.model.frames}",
                )
        if self.loaded and len(self.loaded) != len(self.problems):
            raise InputError("one flag a record", value=len(self.loaded), limit=len(self.problems))

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.problems[0].samples.joints

    @property
    def own(self) -> tuple[int, ...]:
        """(f) base parameters that each record has of its own: its friction."""
        base = self.problems[0].base
        links = 10 * self.joints
        return tuple(
            k
            for k, (column, name) in enumerate(zip(base.independent, base.names, strict=True))
            if column >= links and name.rstrip("0123456789") not in INERTIAS
        )

    @property
    def common(self) -> tuple[int, ...]:
        """(s) base parameters that the records share."""
        own = set(self.own)
        return tuple(k for k in range(self.problems[0].base.rank) if k not in own)

    @property
    def payload(self) -> int:
        """Payload parameters among the shared ones: ten, or none."""
        return PAYLOAD if any(self.loaded) else 0

    @property
    def shared(self) -> int:
        """Number of shared parameters: `common`, then those of the payload."""
        return len(self.common) + self.payload

    def chunks(self, record: int) -> Iterator[tuple[slice, Array, Array]]:
        """Parts of a record as `IdentificationProblem.chunks`, its own columns first.

        Args:
            record: Which record.

        Yields:
            Rows covered, columns (f + shared, n, T) with zeros for a payload that the record
            does not carry, torques (n, T).
        """
        problem = self.problems[record]
        model, samples, block = problem.base.model, problem.samples, problem.samples.block
        carries = bool(self.loaded) and self.loaded[record]
        last = 10 * (self.joints - 1)
        tail = list(range(last, last + self.payload))
        order = [problem.base.independent[k] for k in (*self.own, *self.common)]
        for rows, part in problem.parts():
            columns, torque = recorded_rows(model, samples, part, order + tail, problem.state)
            if tail and not carries:
                columns[-PAYLOAD:] = 0.0
            yield rows, block_mean(columns, block), block_mean(torque, block)

    def factors(self, record: int) -> Array:
        """(n, w + 1, w + 1) triangular factors of a record's joints, w = f + shared."""
        width = len(self.own) + self.shared + 1
        found = np.zeros((self.joints, width, width))
        for _, columns, torque in self.chunks(record):
            for j in range(self.joints):
                rows = np.vstack([columns[:, j], torque[j]]).T
                found[j] = upper_triangle(np.vstack([found[j], rows]))
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedSolution:
    """A solution for given weights."""

    own: Array
    """(R, f) parameters of each record's own."""
    shared: Array
    """(s) shared parameters."""
    information: Array
    """(R f + s, R f + s) upper triangular root: own of each record in turn, then shared."""

    def local(self, record: int) -> Array:
        """(f + s) parameters in the order of a record's columns."""
        return np.concatenate([self.own[record], self.shared])


def solve_shared(factors: Array, weights: Array, own: int) -> SharedSolution:
    """Solve by elimination of each record's own parameters.

    Args:
        factors: (R, n, w + 1, w + 1) of each record and joint.
        weights: (R, n) weight of each record's joints [1/(N.m)].
        own: f, how many columns come first and belong to a record alone.

    Raises:
        JobError: A parameter that no record shows, or a singular problem.
    """
    records, width = len(factors), factors.shape[-1] - 1
    rows = (factors * weights[:, :, None, None]).reshape(records, -1, width + 1)
    own_scale = np.linalg.norm(rows[:, :, :own], axis=1)
    shared_scale = np.linalg.norm(rows[:, :, own:width], axis=(0, 1))
    if (own_scale == 0).any() or (shared_scale == 0).any():
        raise JobError(
            "a parameter has no effect on any torque of these recordings",
            next_step="A motion stands still or moves too few joints: record more.",
        )
    tops: list[Array] = []
    rests: list[Array] = []
    for k in range(records):
        scale = np.concatenate([own_scale[k], shared_scale, [1.0]])
        upper = upper_triangle(rows[k] / scale)
        tops.append(upper[:own])
        rests.append(upper[own:, own:])
    count = width - own
    left = upper_triangle(np.vstack(rests))
    pivots = np.abs(
        np.concatenate([np.diag(left)[:count], *[np.diag(top[:, :own]) for top in tops]])
    )
    if pivots.min() < SINGULAR * pivots.max():
        raise JobError(
            "the records together are singular to working precision",
            value=f"smallest pivot {pivots.min():.1e}",
            next_step="Record motions that excite every joint.",
        )
    shared = solve_upper(left[:count, :count], left[:count, count])
    solved = [solve_upper(t[:, :own], t[:, width] - t[:, own:width] @ shared) for t in tops]
    size = records * own + count
    root = np.zeros((size, size))
    for k, top in enumerate(tops):
        here = slice(k * own, (k + 1) * own)
        root[here, here] = top[:, :own] * own_scale[k]
        root[here, records * own :] = top[:, own:width] * shared_scale
    root[records * own :, records * own :] = left[:count, :count] * shared_scale
    return SharedSolution(
        own=np.array(solved).reshape(records, own) / own_scale,
        shared=shared / shared_scale,
        information=root,
    )
