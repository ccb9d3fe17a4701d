"""Whole signals that may be reversed, exchanged, turned by right angles, or free of gravity.

No column of the reference stands for them: each is put right on a thinned recording, with a plain
model.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np

from dynid.core import Array
from dynid.diagnosis.residual import Fits, Recording, Reference

POOR = 0.12
"""Share of a joint's torque that the reference may leave before these are tried."""
STRANGE = 2.5
"""... and how unlikely its inertial parameters may be before anything was measured [nats a joint]:
light links of another joint leave as little."""
LEAST_POWER = -0.05
"""Power of friction over all power of a joint: friction that drives says the same."""
ROWS, EQUATIONS = 500, 3500
"""Most rows that are looked at, and equations of all joints."""
PAIRED = 7
"""Joints of which pairs are tried: those that are explained worst."""
WHOLE_LOOKS = 3
"""Kinds that get a fit of the reference."""
SWEEPS = 4
WIDEST_S, STEP_S = 1.5, 0.06
"""Offsets between the clocks of torques and motion that are tried."""
_STEPS = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Components of the directions of gravity that are tried."""
_LEAST_TURN = 0.5
"""[rad] smaller tilts are linear."""
_WIDTH = 0.02
"""Smoothing velocity of the Coulomb column, share of the joint's usual top speed."""
_FRICTION = 0.2
"""Friction expected of a joint, share of its torque; as uncertain as `_SPREAD`."""
_SPREAD = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class WholeSignal:
    """A recording with one signal put right."""

    recording: Recording
    kind: str
    joints: tuple[int, ...]
    value: float
    unit: str
    score: float = 0.0
    """Drop of the negative log likelihood [nats]."""


def whole_signals(
    ref: Reference, sums: Fits, values: Array, prior: tuple[Array, Array]
) -> list[WholeSignal]:
    """The signals that explain most when they are put right, one of a kind, by a plain model.

    Args:
        ref: The reference.
        sums: Its sums.
        values: (p) its parameters.
        prior: Of the inertial parameters.

    Returns:
        The best first, at most `WHOLE_LOOKS`.
    """
    rec, n = ref.recording, ref.recording.robot.joints
    share = _share(ref, values)
    # The same for all joints: an exchange must not gain from joints that count differently.
    rows = _rows(rec)
    counts = np.full(n, min(float(np.median(sums.counts)), rows))
    own = _objective(_thin(rec), prior, counts)
    best: dict[str, WholeSignal] = {}
    for rival in _rivals(rec, sorted(np.argsort(-share)[:PAIRED].tolist())):
        drop = own - _objective(_thin(rival.recording), prior, counts)
        if drop > (best[rival.kind].score if rival.kind in best else 0.0):
            best[rival.kind] = replace(rival, score=drop)
    return sorted(best.values(), key=lambda found: -found.score)[:WHOLE_LOOKS]


def _share(ref: Reference, values: Array) -> Array:
    """(n) RMS torque that the reference leaves, over that of the joint."""
    error = np.square(ref.left(values)).mean(axis=1)
    return np.sqrt(error / np.maximum(np.square(ref.torque).mean(axis=1), 1e-300))


def doubtful(ref: Reference, values: Array) -> bool:
    """Whether the reference leaves much, or its inertias or friction are strange."""
    away, n = values - ref.mean, ref.recording.robot.joints
    away[10 * n :] = 0.0
    strange = 0.5 * float(away @ ref.precision @ away) > STRANGE * n
    drives = friction_power(ref, values).min() < LEAST_POWER
    return strange or drives or float(_share(ref, values).max()) > POOR


def friction_power(ref: Reference, values: Array) -> Array:
    """(n) power that friction takes, over that of all torques of the joint."""
    n = ref.recording.robot.joints
    rest = values[10 * n :].copy()
    rest[n : 2 * n] = 0.0  # motor inertia
    dq = ref.recording.average(ref.recording.dq.T)
    friction = np.tensordot(rest, ref.columns[10 * n :], axes=1) * dq
    return friction.mean(axis=1) / np.maximum(np.abs(ref.torque * dq).mean(axis=1), 1e-300)


def _rivals(rec: Recording, paired: list[int]) -> Iterator[WholeSignal]:
    robot, n = rec.robot, rec.robot.joints
    # A turned zero of the last joint is the same as another last link.
    turning = [j for j in range(n - 1) if not robot.prismatic[j]]
    light = replace(rec, robot=replace(robot, gravity=1e-6 * robot.gravity))
    yield WholeSignal(recording=light, kind="gravity_compensated", joints=(), value=1.0, unit="")
    size = float(np.linalg.norm(robot.gravity))
    ways = {tuple(np.round(_unit(np.array(w)), 9)) for w in product(_STEPS, repeat=3)}
    for way in sorted(ways) if size > 0 else ():
        down = np.array(way)
        if not down.any():
            continue
        angle = angle_between(down, robot.gravity)
        if angle > _LEAST_TURN:
            changed = replace(rec, robot=replace(robot, gravity=size * down))
            yield WholeSignal(
                recording=changed, kind="mounting", joints=(), value=angle, unit="rad"
            )
    # Whole samples: between two of them noise averages out, and every offset explains more.
    step = float(rec.t[1] - rec.t[0])
    for offset in np.arange(-WIDEST_S, WIDEST_S + STEP_S, STEP_S).tolist():
        by = step * round(offset / step)
        if abs(by) < STEP_S / 2 or abs(by) > 0.15 * (rec.t[-1] - rec.t[0]):
            continue
        signals: list[Array] = [rec.tau[:, j] for j in range(n)]
        late: Array = np.column_stack([np.interp(rec.t + by, rec.t, x) for x in signals])
        changed = replace(rec, tau=late)
        yield WholeSignal(recording=changed, kind="clock_offset", joints=(), value=by, unit="s")
    for joints in (*((j,) for j in range(n)), tuple(range(n))):
        sign = np.ones(n)
        sign[list(joints)] = -1.0
        changed = replace(rec, tau=rec.tau * sign)
        yield WholeSignal(recording=changed, kind="reversed", joints=joints, value=-1.0, unit="1")
    for i, j in combinations(paired, 2):
        if robot.prismatic[i] != robot.prismatic[j]:
            continue
        order = list(range(n))
        order[i], order[j] = j, i
        tau = rec.tau[:, order]
        apart = None if rec.apart is None else rec.apart[:, order]
        changed = replace(rec, tau=tau, apart=apart)
        yield WholeSignal(
            recording=changed, kind="exchanged_torques", joints=(i, j), value=1.0, unit=""
        )
        motion = {name: getattr(rec, name)[:, order] for name in ("q", "dq", "ddq")}
        changed = replace(changed, **motion)
        yield WholeSignal(recording=changed, kind="exchanged", joints=(i, j), value=1.0, unit="")
    for j in turning:
        for by in (np.pi / 2, -np.pi / 2, np.pi):
            yield _turned(rec, {j: by})
    for i, j in combinations([j for j in turning[1:] if j in paired], 2):
        for a in (np.pi / 2, -np.pi / 2):
            for b in (np.pi / 2, -np.pi / 2):
                yield _turned(rec, {i: a, j: b})


def _unit(vector: Array) -> Array:
    return vector / max(float(np.linalg.norm(vector)), 1e-9)


def angle_between(one: Array, other: Array) -> float:
    """Between two vectors [rad]."""
    return float(np.arccos(np.clip(_unit(one) @ _unit(other), -1, 1)))


def _turned(rec: Recording, by: dict[int, float]) -> WholeSignal:
    q = rec.q.copy()
    for j, angle in by.items():
        q[:, j] -= angle
    return WholeSignal(
        recording=replace(rec, q=q),
        kind="encoder_zero",
        joints=tuple(by),
        value=next(iter(by.values())),
        unit="rad",
    )


def _rows(rec: Recording) -> int:
    return min(ROWS, EQUATIONS // rec.robot.joints)


def _thin(rec: Recording) -> Recording:
    rows = np.linspace(0, len(rec.t) - 1, min(_rows(rec), len(rec.t))).astype(int)
    parts = {name: getattr(rec, name)[rows] for name in ("t", "q", "dq", "ddq", "tau")}
    return replace(rec, **parts, block=1, apart=None)


def _objective(thin: Recording, prior: tuple[Array, Array], counts: Array) -> float:
    """Negative log likelihood of a plain model and its prior at its best [nats]."""
    model, n, rows = thin.model, thin.robot.joints, len(thin.t)
    stack = model.stack(thin.q, thin.dq, thin.ddq)
    fast = np.maximum(np.percentile(np.abs(thin.dq), 98, axis=0), 1e-6)
    columns = np.zeros((len(stack) + n, n, rows))
    columns[: len(stack)] = stack
    every = np.arange(n)
    columns[len(stack) + every, every] = np.tanh(thin.dq.T / (_WIDTH * fast)[:, None])
    torque = thin.tau.T + model.known_torque(thin.q).T
    square = np.matmul(columns.transpose(1, 0, 2), columns.transpose(1, 2, 0))
    cross = np.matmul(columns.transpose(1, 0, 2), torque[:, :, None])[:, :, 0]
    energy = np.square(torque).sum(axis=1)
    size = np.sqrt(energy / rows) + 1e-12
    top = np.maximum(np.abs(thin.ddq).max(axis=0), 1e-9)
    # Motors that drive several joints have columns of their own between inertia and Coulomb.
    coupling = np.full(len(stack) - 12 * n, size.max() / fast.min())
    mean = np.concatenate(
        [prior[0], _FRICTION * size / fast, 0 * size, 0 * coupling, _FRICTION * size]
    )
    precision = np.zeros((len(columns), len(columns)))
    precision[: 10 * n, : 10 * n] = np.linalg.inv(prior[1])
    rest = np.arange(10 * n, len(columns))
    precision[rest, rest] = 1 / np.square(
        _SPREAD * np.concatenate([size / fast, size / top, coupling, size])
    )
    noise, value = energy / rows + 1e-18, 0.0
    for _ in range(SWEEPS):
        weights = counts / rows / noise
        matrix = np.tensordot(weights, square, axes=1) + precision
        right: Array = weights @ cross + precision @ mean
        values: Array = np.asarray(np.linalg.inv(matrix), dtype=np.float64) @ right
        left = energy - 2 * cross @ values + (square @ values) @ values
        noise = np.maximum(left / rows, 1e-8 * energy / rows + 1e-18)
        away = values - mean
        value = 0.5 * float(counts @ np.log(noise)) + 0.5 * float(away @ precision @ away)
    return value
