"""Faults that a record shows against a fit: clocks, contacts, friction that drifts."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dynid.core import Array, Finding, Indices, Mask
from dynid.identification import (
    Estimate,
    block_mean,
    chunk_size,
    motion_state,
    recorded_rows,
)
from dynid.reduction import reduce_model
from dynid.regressor import InverseDynamicModel
from dynid.signals import Samples
from dynid.validation.prediction import MOVING_SPEED, ValidationResult

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


WIDEST_S = 1.5
"""Offsets that are looked for."""
STEP_S = 0.02
LEAST_S = 0.08
"""Smaller ones are delays, and preset best finds those a joint."""
LEFT = 0.15
"""Share of the residual sum that has to go with the offset."""
MOST_ALIGNED_ROWS = 1000
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
    thin = max(1, count // MOST_ALIGNED_ROWS)
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


def offset_notice(offset_s: float) -> Finding:
    """An offset from `time_offset` in words."""
    when = "later" if offset_s > 0 else "earlier"
    return Finding(
        "clock_offset",
        f"the torques were stamped {abs(offset_s):.2f} s {when} than the motion they belong to",
        value=offset_s,
        unit="s",
        next_step="two clocks? Shift one of them in the file",
    )


def _runs(rows: Indices, samples: int) -> list[Indices]:
    """Rows (T) in runs that span about so many samples each."""
    count = 1 + int(rows[-1] - rows[0]) // samples
    return [run for run in np.array_split(rows, count) if len(run)]


RAISED = 4.0
"""Error of a joint in a window over that of its median window."""
STRUCK = 8.0
"""... of the hardest hit joint: friction that turns over stays below, or comes back often."""
LEAST_JOINTS = 2
"""A touch loads several joints, a friction that is not understood one at a time."""
APART = 2.0
"""A contact's error over the largest elsewhere: what comes back often is friction."""
LONGEST_SHARE = 0.1
"""Of the record, for all contacts together."""
LONGEST_TRIMMED = 0.2
"""... where the fit did without them."""
MOST = 3
"""Contacts that are told from a wrong model."""
LEAST_WINDOWS = 20


def disturbed(
    result: ValidationResult,
    names: tuple[str, ...],
    trimmed: tuple[Array, Array] | None = None,
) -> tuple[Finding, ...]:
    """Say where a few windows stand far above all others in several joints.

    Args:
        result: Prediction against measurement.
        names: (n) joint names.
        trimmed: Errors by window from `trimmed_errors`; None to take those of the result.
    """
    starts, ratio = trimmed or _raised_errors(result)
    longest = LONGEST_SHARE if trimmed is None else LONGEST_TRIMMED
    if len(starts) < LEAST_WINDOWS:
        return ()
    found: list[str] = []
    for first, stop in _contacts(ratio, longest):
        part = ratio[first:stop]
        worst = np.unravel_index(int(np.argmax(part)), part.shape)
        found.append(
            f"{starts[first]:.1f} to {starts[stop - 1] + WINDOW_S:.1f} s "
            f"({names[int(worst[1])]}, {part[worst]:.0f} times the usual error)"
        )
    if not found:
        return ()
    return (
        Finding(
            "contact",
            f"torques do not belong to the motion at {'; '.join(found)}: a contact biases every "
            "parameter",
            value=float(len(found)),
            next_step="leave them out with --from and --to, or record again",
        ),
    )


def _contacts(ratio: Array, longest: float) -> list[tuple[int, int]]:
    """Windows (first, one past last) of the stretches that stand apart from all others."""
    largest = ratio.max(axis=1)
    raised = np.flatnonzero(largest > RAISED)
    groups = np.split(raised, np.flatnonzero(np.diff(raised) > 1) + 1)
    groups = sorted((g for g in groups if len(g)), key=lambda g: -float(largest[g].max()))
    for count in range(1, min(MOST, len(groups)) + 1):
        chosen = np.concatenate(groups[:count])
        rest = np.delete(largest, chosen)
        weakest = min(float(largest[g].max()) for g in groups[:count])
        short = len(chosen) <= max(MOST, longest * len(largest))
        if short and weakest > max(STRUCK, APART * float(rest.max(initial=0.0))):
            several = [g for g in groups[:count] if _joints_hit(ratio[g]) >= LEAST_JOINTS]
            return sorted((int(g[0]), int(g[-1]) + 1) for g in several)
    return []


def _joints_hit(ratio: Array) -> int:
    return int((ratio > RAISED).sum(axis=1).max())


def _raised_errors(result: ValidationResult) -> tuple[Array, Array]:
    """(w) start of each window [s], and (w, n) its RMS error over the joint's median."""
    t = result.t - result.t[0]
    edges = np.searchsorted(t, np.arange(0.0, float(t[-1]), WINDOW_S))
    square = np.square(result.measured - result.predicted)
    kept = [(a, b) for a, b in pairwise(edges.tolist()) if b > a]
    if not kept:
        return np.zeros(0), np.zeros((0, square.shape[1]))
    rms = np.array([np.sqrt(square[a:b].mean(axis=0)) for a, b in kept])
    usual = np.maximum(np.median(rms, axis=0), 1e-300)
    return np.array([result.t[a] for a, _ in kept]), rms / usual


STRETCHES = 10
LEAST_ROWS = 20
LEAST_SHARE = 0.1
"""Variance of the friction's shape that a stretch must have: both directions of motion."""
CERTAIN = 6.0
"""Change over its standard deviation, of a joint; eight degrees of freedom, joints to choose."""
LEAST_CHANGE = 0.05
"""Share of the friction at the joint's usual speed."""
LEAST_DRIFTING_JOINTS = 0.5
"""Share of the joints: an arm warms up as a whole."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionDrift:
    """Change of each joint's friction from the record's start to its end."""

    change: Array
    """(n) share of the friction at the joint's usual speed; NaN where it cannot be told."""
    std: Array
    """(n) its standard deviation, from the scatter of stretches."""


def friction_drift(estimate: Estimate, result: ValidationResult) -> FrictionDrift:
    """How friction moves along a record.

    Args:
        estimate: The estimate.
        result: The record that it was identified from, reproduced.
    """
    error = result.measured - result.predicted
    joints = error.shape[1]
    cuts = np.linspace(0, len(error), STRETCHES + 1).astype(int)
    middle = (np.arange(STRETCHES) + 0.5) / STRETCHES
    change, std = np.full((2, joints), np.nan)
    pose = (estimate.motion.lower + estimate.motion.upper)[None] / 2
    for j in range(joints):
        moving = np.abs(result.dq[:, j]) > MOVING_SPEED
        if not moving.any():
            continue
        usual = float(np.sqrt(np.square(result.dq[moving, j]).mean()))
        speed = np.zeros((1, joints))
        speed[0, j] = usual
        both = [estimate.predict(pose, way * speed, 0 * speed)[0, j] for way in (1.0, -1.0)]
        friction = float(both[0] - both[1]) / 2
        found = np.full(STRETCHES, np.nan)
        for k, (a, b) in enumerate(pairwise(cuts.tolist())):
            rows = moving[a:b]
            if rows.sum() < LEAST_ROWS or friction <= 0:
                continue
            v, e = result.dq[a:b, j][rows], error[a:b, j][rows]
            # Friction opposes motion: of what is left, the part that turns with the speed.
            shape = (np.sign(v) + v / usual) / 2
            shape = shape - shape.mean()
            if shape @ shape > LEAST_SHARE * len(shape):
                found[k] = float(shape @ e / (shape @ shape)) / friction
        known = np.isfinite(found)
        if known.sum() < STRETCHES - 2:
            continue
        change[j], std[j] = _line(middle[known], found[known])
    return FrictionDrift(change=change, std=std)


def _line(x: Array, y: Array) -> tuple[float, float]:
    """Slope of a line and its standard deviation from the scatter about it."""
    x = x - x.mean()
    slope = float(x @ y / (x @ x))
    left = y - y.mean() - slope * x
    return slope, float(np.sqrt(left @ left / max(len(x) - 2, 1) / (x @ x)))


def drifting_friction(
    estimate: Estimate, result: ValidationResult, names: tuple[str, ...]
) -> tuple[Finding, ...]:
    """Say where the friction of most joints moves one way along the record."""
    drift = friction_drift(estimate, result)
    with np.errstate(invalid="ignore", divide="ignore"):
        sure = np.abs(drift.change) > np.maximum(CERTAIN * drift.std, LEAST_CHANGE)
    way = float(np.sign(np.nansum(np.where(sure, drift.change, 0.0))))
    agree = [int(j) for j in np.flatnonzero(sure & (np.sign(drift.change) == way))]
    if len(agree) < LEAST_DRIFTING_JOINTS * len(names):
        return ()
    words = ", ".join(f"{names[j]} {100 * drift.change[j]:+.0f} %" for j in agree)
    return (
        Finding(
            "friction_drift",
            f"friction changes along the record ({words} from its start to its end): the joints "
            f"grow {'warmer' if way < 0 else 'colder'}; the friction given is the record's mean",
            joints=tuple(agree),
            value=float(np.mean(drift.change[agree])),
            unit="1",
            next_step="move the arm until it no longer changes, or identify parts of the record "
            "with --from and --to",
        ),
    )
