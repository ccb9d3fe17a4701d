"""Which rows of a recording an arm carries something in, and how often that changes.

Robots at work pick objects up and put them down, so that no single row says when a payload changes.
"""

import numpy as np

from dynid.core import Array, Indices, Mask, scipy_part
from dynid.diagnosis.events import WINDOW_S
from dynid.diagnosis.residual import Reference, correlation_length, solution

PARTS, PART_S, SWEEPS = (48, 192), 1.0, 8
"""Fewest and most parts of a recording whose loads are changed first, how long they are [s], and
how many times the rows are chosen again."""
REPEATED = 20
"""Part of a repetition to which a change comes back at the same place of the next."""


def changes_of(rows: Mask, period: int) -> tuple[Indices, int]:
    """Rows at which a load changes, and how many of them do not come back in the next repetition.

    Args:
        rows: (T) rows with it.
        period: Rows after which the motion repeats; 0 where it does not.
    """
    changes: Indices = np.flatnonzero(np.diff(rows)) + 1
    again = np.abs(changes + period - changes[:, None]) <= period // REPEATED
    again &= rows[changes] == rows[changes, None]
    return changes, len(changes) - int(again.any(axis=1).sum()) if period else len(changes)


def loaded(ref: Reference, values: Array, body: Array, width: Array) -> Mask:
    """(T) rows in which an arm carries what it does not carry in the first row.

    Stretches of the recording change their load as long as less is left; then each row goes to the
    load that leaves less of it. All parameters are fitted anew with each choice.

    Args:
        ref: A reference.
        values: (p) its parameters.
        body: (m, n, T) torques of a body at the flange, of sizes one.
        width: (m) standard deviations of its sizes.
    """
    rec, prior = ref.recording, np.diag(1 / np.square(width))
    columns, body, torque = (rec.measured(x) for x in (ref.columns, body, ref.torque))
    flat, bodies = columns.reshape(len(columns), -1), body.reshape(len(body), -1)
    products = np.matmul(columns.transpose(1, 0, 2), columns.transpose(1, 2, 0))
    span = max(1, round(WINDOW_S / (rec.block * float(rec.t[1] - rec.t[0]))))
    weights, now = _weights(ref.left(values), ref.period), None
    for sweep in range(SWEEPS):
        weighted = weights[:, None] * body
        matrix: Array = np.asarray(np.tensordot(weights, products, axes=1), np.float64)
        matrix += ref.precision
        right = flat @ (weights[:, None] * torque).ravel() + ref.precision @ ref.mean
        if now is None:
            parts = min(len(torque.T), round(float(np.clip(np.ptp(rec.t) / PART_S, *PARTS))))
            now = _parts_loaded(columns, torque, body, weighted, matrix, right, prior, parts)
        at = (weighted * now).reshape(bodies.shape)
        both = np.column_stack([flat @ at.T, right])
        solved = solution(matrix, both)
        inner = at @ bodies.T - both[:, :-1].T @ solved[:, :-1] + prior
        sizes = np.linalg.solve(inner, at @ torque.ravel() - both[:, :-1].T @ solved[:, -1])
        without = torque - np.tensordot(solved @ np.append(-sizes, 1.0), columns, axes=1)
        with_it = without - np.tensordot(sizes, body, axes=1)
        weights = _weights(np.where(now, with_it, without), ref.period)
        costs = 0.5 * weights @ (np.square(with_it) - np.square(without))
        before, now = now, _in_turns(costs, span, free=sweep == 0)
        if sweep and np.array_equal(before, now):
            break
    return np.zeros(len(torque.T), dtype=np.bool_) if now is None else now != now[0]


def _weights(error: Array, period: int) -> Array:
    """(n) one over variance and correlation length of errors (n, T)."""
    length = correlation_length(error, period, within=True)
    return 1 / np.maximum(np.square(error).mean(axis=1) * length, 1e-12)


def _parts_loaded(
    columns: Array,
    torque: Array,
    body: Array,
    weighted: Array,
    matrix: Array,
    right: Array,
    prior: Array,
    parts: int,
) -> Mask:
    """(T) rows of so many parts that leave least when they carry a body.

    As long as that leaves less, the stretch of parts is changed that gains most. Of the columns of
    the arm (p, n, T), the torque (n, T), those of the body (m, n, T), `weighted` by joint, the
    arm's normal matrix (p, p) with its prior, its right side (p), the body's precision (m, m).
    """
    m, count = len(body), torque.shape[1]
    each = np.arange(parts)
    edges = np.arange(parts + 1) * count // parts
    starts = edges[:-1]
    mixed: Array = np.add.reduceat(np.einsum("pjt,ajt->tap", columns, weighted), starts)
    inner: Array = np.add.reduceat(np.einsum("ajt,bjt->tab", body, weighted), starts)
    cross: Array = np.add.reduceat(np.einsum("jt,ajt->ta", torque, weighted), starts)
    flat = mixed.reshape(parts * m, -1)
    solved = solution(matrix, np.column_stack([flat.T, right]))
    normal = -(flat @ solved[:, :-1]).reshape(parts, m, parts, m).transpose(0, 2, 1, 3)
    normal[each, each] += inner
    vector = cross - (flat @ solved[:, -1]).reshape(parts, m)
    now, gain = np.zeros(parts), 0.0
    first, last = np.triu_indices(parts + 1, k=1)
    while True:
        # Each stretch of parts with their loads changed, from sums up to each part.
        change = 1 - 2 * now
        half = np.tensordot(normal, now, axes=((1,), (0,)))
        inside = _up_to(_up_to(change[:, None, None, None] * normal * change[:, None, None], 0), 1)
        across = _up_to(change[:, None, None] * half, 0)
        across = across[last] - across[first]
        sums = inside[last, last] - inside[first, last] - inside[last, first] + inside[first, first]
        sums += np.tensordot(now, half, axes=1) + across + across.transpose(0, 2, 1) + prior
        sides = _up_to(change[:, None] * vector, 0)
        sides = now @ vector + sides[last] - sides[first]
        gains = np.sum(sides * np.linalg.solve(sums, sides[:, :, None])[:, :, 0], axis=1)
        best = int(gains.argmax())
        if not gains[best] > gain:  # Nor is no number, as of torques that overflow.
            return np.repeat(now > 0, np.diff(edges))
        gain, part = float(gains[best]), slice(first[best], last[best])
        now[part] = 1 - now[part]


def _up_to(values: Array, axis: int) -> Array:
    """Sums of values before each place along an axis, and of all."""
    shape = [1 if k == axis else size for k, size in enumerate(values.shape)]
    return np.concatenate([np.zeros(shape), np.cumsum(values, axis=axis)], axis=axis)


def _in_turns(costs: Array, span: int, free: bool) -> Mask:
    """(T) rows that cost (T) least together: windows of so many rows, then rows about a change."""
    starts = np.arange(0, len(costs), span)
    rough = _cheapest(np.add.reduceat(costs, starts), free)
    rough = np.repeat(rough, np.diff(np.append(starts, len(costs))))
    changes = np.diff(rough, prepend=rough[0])
    near: Mask = scipy_part("ndimage").maximum_filter1d(changes, 1 + 2 * span)
    sure = np.where(rough, -1.0, 1.0) * (1 + np.abs(costs).sum())
    return _cheapest(np.where(near, costs, sure), free)


def _cheapest(costs: Array, free: bool) -> Mask:
    """(K) places that cost (K) least together with their changes (Viterbi 1967).

    A change costs as much as to say where it is, or is `free`: what is found first leaves much.
    """
    off = on = 0.0
    change = 0.0 if free else float(np.log(len(costs)))
    came = np.empty((len(costs), 2), dtype=np.bool_)
    for k, cost in enumerate(costs.tolist()):
        came[k] = on + change < off, off + change < on
        off, on = min(off, on + change), min(on, off + change) + cost
    out, state = np.empty(len(costs), dtype=np.bool_), on < off
    for k in range(len(costs) - 1, -1, -1):
        out[k] = state
        state = state != came[k, int(state)]
    return out
