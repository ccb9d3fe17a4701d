"""Errors of a record against what most of it says: a fit without the stretches that fit worst.

A contact bends the parameters of an ordinary fit until its error is spread over the whole
record. Least trimmed squares over windows (Rousseeuw and Van Driessen 2006) fits the windows that
agree, and shows the others as they are.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from dynid.core.arrays import Array, Mask
from dynid.identification.estimate import Estimate
from dynid.identification.problem import block_mean, chunk_size, motion_state, recorded_rows
from dynid.signals.samples import Samples

WINDOW_S = 0.3
KEPT = 0.75
"""Share of the windows that a fit is made from."""
STEPS = 8
MOST_ROWS = 3000
"""Rows a joint; longer records are averaged, torques and columns alike."""
COLOUR = 4.0
"""Variance of a fit over what it were if noise was white: at least this, or as the estimate says.
"""


def trimmed_errors(estimate: Estimate, samples: Samples) -> tuple[Array, Array]:
    """(w) start of each window [s], and (w, n) its RMS error over the usual one.

    Args:
        estimate: Its model is fitted anew.
        samples: The record, not averaged over periods.
    """
    t, columns, torque = _rows(estimate, samples)
    edges = np.searchsorted(t, np.arange(t[0], t[-1], WINDOW_S)).tolist()
    parts = [(a, b) for a, b in pairwise(edges) if b - a > 1]
    joints = samples.joints
    if len(parts) < 2:
        return np.zeros(0), np.zeros((0, joints))
    scale = 1.0 / np.maximum(np.sqrt(np.einsum("rjt,rjt->r", columns, columns)), 1e-12)
    columns = columns * scale[:, None, None]
    square = np.array([np.einsum("rjt,sjt->jrs", x, x) for x in _cut(columns, parts)])
    cross = np.array(
        [
            np.einsum("rjt,jt->jr", x, y)
            for x, y in zip(_cut(columns, parts), _cut(torque, parts), strict=True)
        ]
    )
    noise = np.maximum(np.sqrt(np.square(torque).mean(axis=1)), 1e-12)
    with np.errstate(divide="ignore", invalid="ignore"):
        colour = max(COLOUR, float(np.nanmedian(np.square(estimate.std / estimate.naive_std))))
    kept: Mask = np.ones(len(parts), dtype=np.bool_)
    error = spread = np.zeros((len(parts), joints))
    for _ in range(STEPS):
        weight = 1.0 / np.square(noise)
        matrix = np.einsum("j,wjrs->rs", weight, square[kept])
        matrix += 1e-9 * np.trace(matrix) * np.eye(len(matrix)) / len(matrix)
        inverse: Array = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
        values = inverse @ np.einsum("j,wjr->r", weight, cross[kept])
        left = torque - np.tensordot(values, columns, axes=1)
        error = np.array([np.sqrt(np.square(x).mean(axis=1)) for x in _cut(left, parts)])
        noise = np.maximum(np.sqrt(np.square(error[kept]).mean(axis=0)), 1e-12)
        count = np.array([b - a for a, b in parts])
        # What the fit does not know of a window that it left out is no error of the window.
        spread = np.sqrt(colour * np.einsum("wjrs,sr->wj", square, inverse) / count[:, None])
        raised = error / np.hypot(noise, spread)
        order = np.argsort(raised.max(axis=1), kind="stable")
        chosen = np.zeros_like(kept)
        chosen[order[: int(np.ceil(KEPT * len(parts)))]] = True
        if (chosen == kept).all():
            break
        kept = chosen
    usual = np.maximum(np.median(error, axis=0), 1e-12)
    starts = np.array([t[a] for a, _ in parts])
    return starts, error / np.hypot(usual, spread)


def _cut(values: Array, parts: list[tuple[int, int]]) -> list[Array]:
    return [values[..., a:b] for a, b in parts]


def _rows(estimate: Estimate, samples: Samples) -> tuple[Array, Array, Array]:
    """Times (T), columns (r, n, T) and torques (n, T), averaged where there are many."""
    used, model = samples.rows, estimate.model
    state = motion_state(model, samples)
    block = max(1, -(-samples.count // MOST_ROWS))
    stop = used.start + (used.stop - used.start) // block * block
    step = max(1, chunk_size(samples) // block) * block
    stacks: list[Array] = []
    torques: list[Array] = []
    for first in range(used.start, stop, step):
        part = slice(first, min(first + step, stop))
        stack, torque = recorded_rows(model, samples, part, list(estimate.independent), state)
        stacks.append(block_mean(stack, block))
        torques.append(block_mean(torque, block))
    times = block_mean(samples.t[used.start : stop], block)
    return times, np.concatenate(stacks, axis=-1), np.concatenate(torques, axis=-1)
