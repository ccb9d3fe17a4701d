"""The linear problem: observation matrix and torques of a set of samples."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.reduction.base import BaseParametrization
from dynid.regressor.model import CHUNK, InverseDynamicModel
from dynid.signals.samples import Samples


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentificationProblem:
    """Find p_B with W p_B = tau for the base parameters of a model.

    Raises:
        InputError: The joints of samples and model differ, or there are fewer rows than
            parameters.
    """

    base: BaseParametrization
    samples: Samples
    state: Array | None = field(init=False)
    """(n, N) state of presliding friction along the samples, where the model has it."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "state", motion_state(self.base.model, self.samples))
        robot = self.base.model.robot
        if self.samples.joints != robot.joints:
            raise InputError("joints differ", value=self.samples.joints, limit=robot.joints)
        rows = self.blocks * robot.joints
        if rows <= self.base.rank:
            raise InputError(
                "fewer torque samples than parameters", value=rows, limit=f"> {self.base.rank}"
            )

    @property
    def blocks(self) -> int:
        """Rows a joint: samples over block length."""
        rows = self.samples.rows
        return (rows.stop - rows.start) // self.samples.block

    @property
    def rate_hz(self) -> float:
        """Rows a second."""
        return self.samples.rate_hz / self.samples.block

    def parts(self) -> Iterator[tuple[slice, slice]]:
        """Rows and samples of parts of the problem that fit in the cache."""
        used, block = self.samples.rows, self.samples.block
        step = max(1, chunk_size(self.samples) // block)
        for first in range(0, self.blocks, step):
            rows = slice(first, min(first + step, self.blocks))
            yield rows, slice(used.start + rows.start * block, used.start + rows.stop * block)

    def chunks(self) -> Iterator[tuple[slice, Array, Array]]:
        """Parts of the problem, torques and columns averaged alike.

        Yields:
            Rows covered, columns (r, n, T), torques (n, T) with known torques added.
        """
        model, samples, block = self.base.model, self.samples, self.samples.block
        columns = list(self.base.independent)
        for rows, part in self.parts():
            stack, torque = recorded_rows(model, samples, part, columns, self.state)
            yield rows, block_mean(stack, block), block_mean(torque, block)

    def residual(self, values: Array) -> Array:
        """Measured torque minus prediction (n, rows) [N.m or N]."""
        out = np.empty((self.samples.joints, self.blocks))
        for rows, columns, torque in self.chunks():
            out[:, rows] = torque - np.tensordot(values, columns, axes=1)
        return out


def chunk_size(samples: Samples) -> int:
    """Samples evaluated at once: what lies beside a chunk must not outweigh it."""
    reach = 0 if samples.torque_filter is None else samples.torque_filter.reach(samples.rate_hz)
    return max(CHUNK, 4 * reach)


def motion_state(model: InverseDynamicModel, samples: Samples) -> Array | None:
    """(n, N) state of presliding friction along samples; None without any."""
    # Only averaged periods know the scatter between them.
    return model.friction_state(samples.q, periodic=samples.noise is not None)


def recorded_rows(
    model: InverseDynamicModel,
    samples: Samples,
    part: slice,
    columns: list[int],
    state: Array | None,
) -> tuple[Array, Array]:
    """Columns (r, n, T) as the record would show them, and torques (n, T), known ones added."""
    wide, inner = samples.surroundings(part)
    q = samples.q[wide]
    now = None if state is None else state[:, wide]
    stack = model.stack(q, samples.dq[wide], samples.ddq[wide], state=now)[columns]
    known = samples.as_recorded(model.known_torque(q).T, wide)[:, inner]
    return samples.as_recorded(stack, wide)[..., inner], samples.tau[part].T + known


def block_mean(values: Array, block: int) -> Array:
    """Means over blocks of the last axis, whose length is a multiple of `block`."""
    if block == 1:
        return values
    return values.reshape(*values.shape[:-1], -1, block).mean(axis=-1)
