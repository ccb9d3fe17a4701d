"""Torques and motion that were stamped by different clocks: an offset in time."""

from __future__ import annotations

import numpy as np

from dynid.core.arrays import Array, Indices
from dynid.core.notices import Notice
from dynid.identification.diagnostics import DO_NOT_USE
from dynid.identification.estimate import Estimate
from dynid.identification.problem import chunk_size, recorded_rows
from dynid.reduction.base import reduce_model
from dynid.regressor.model import InverseDynamicModel
from dynid.signals.samples import Samples

WIDEST_S = 1.5
"""Offsets that are looked for."""
STEP_S = 0.02
LEAST_S = 0.08
"""Smaller ones are delays, and preset best finds those a joint."""
LEFT = 0.15
"""Share of the residual sum that has to go with the offset."""
MOST_ROWS = 1000
WIDEST_SHARE = 0.15
"""Of the record."""


def time_offset(estimate: Estimate, samples: Samples) -> float | None:
    """Seconds by which torques are stamped later than their motion.

    The model is fitted to the motion once, and torques of other instants are tried.

    Args:
        estimate: The estimate.
        samples: The record it was identified from.

    Returns:
        None where the torques belong where they are.
    """
    rate, used = samples.rate_hz, samples.rows
    most = int(min(WIDEST_S * rate, WIDEST_SHARE * (used.stop - used.start)))
    step = max(1, round(STEP_S * rate))
    if most < 3 * step:
        return None
    count = used.stop - used.start - 2 * most
    thin = max(1, count // MOST_ROWS)
    rows: Indices = np.arange(0, count, thin, dtype=np.intp) + used.start + most
    # The paper's terms: those that were chosen have made up for the offset as they could.
    base = reduce_model(
        InverseDynamicModel(robot=estimate.model.robot, frames=estimate.model.frames)
    )
    columns = list(base.independent)
    stacks: list[Array] = []
    torques: list[Array] = []
    # In parts: of five minutes at 500 Hz the columns alone would fill half a gigabyte.
    for part in (slice(int(x[0]), int(x[-1]) + 1) for x in _runs(rows, chunk_size(samples))):
        stack, torque = recorded_rows(base.model, samples, part, columns, None)
        stacks.append(stack[:, :, ::thin])
        torques.append(torque[:, ::thin])
    stack, known = np.concatenate(stacks, axis=2), np.concatenate(torques, axis=1)
    known -= samples.tau[rows].T
    scale = 1.0 / np.maximum(samples.tau.std(axis=0), 1e-12)
    width = len(columns)
    design = (stack * scale[None, :, None]).reshape(width, -1).T
    norms = np.linalg.norm(design, axis=0)
    basis = np.linalg.qr(design[:, norms > 0] / norms[norms > 0])[0]

    def left(shift: int) -> float:
        moved = (samples.tau[rows + shift].T + known) * scale[:, None]
        flat: Array = moved.ravel()
        return float(flat @ flat - np.square(basis.T @ flat).sum()) / float(flat @ flat)

    shifts = np.arange(-most, most + 1, step)
    sums = np.array([left(int(shift)) for shift in shifts])
    best = int(np.argmin(sums))
    # Delays that were found and taken off belong to it.
    known_s = float(np.mean(estimate.settings.delays_s or (0.0,)))
    total = float(shifts[best]) / rate + known_s
    if best in (0, len(shifts) - 1) or shifts[best] == 0 or abs(total) < LEAST_S:
        return None
    if sums[best] > LEFT * max(left(0), left(-round(known_s * rate))):
        return None
    near = range(int(shifts[best]) - step, int(shifts[best]) + step + 1)
    return min(near, key=left) / rate + known_s


def offset_notice(offset_s: float) -> Notice:
    """An offset from `time_offset` in words."""
    when = "later" if offset_s > 0 else "earlier"
    return Notice(
        "clock_mismatch",
        f"the torques were stamped {abs(offset_s):.2f} s {when} than the motion they belong to: "
        f"two clocks? Shift one of them in the file; {DO_NOT_USE}",
    )


def _runs(rows: Indices, samples: int) -> list[Indices]:
    """Rows (T) in runs that span about so many samples each."""
    count = 1 + int(rows[-1] - rows[0]) // samples
    return [run for run in np.array_split(rows, count) if len(run)]
