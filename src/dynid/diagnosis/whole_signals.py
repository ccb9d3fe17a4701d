"""Whole signals that may be reversed, exchanged, turned by right angles, or free of gravity.

No column of the reference stands for them: each is put right on a thinned recording, with a plain
model.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np

from dynid.core import Array
from dynid.diagnosis.residual import SHAPES, Fits, Recording, Reference

POOR = 0.1
"""Share of a joint's torque that the reference may leave before these are tried."""
STRANGE = 2.5
"""... and how unlikely its inertial parameters may be before anything was measured [nats a joint]:
light links of another joint leave as little."""
LEAST_POWER = -0.05
"""Power of friction over all power of a joint: friction that drives says the same."""
DRIVES, IMPOSSIBLE = -0.2, 48.0
"""Power of friction, over all of a joint, that no friction has, and what it costs a fit [nats]."""
ROWS, EQUATIONS = 500, 3500
"""Most rows that are looked at, and equations of all joints."""
PAIRED = 7
"""Joints of which pairs are tried: those that are explained worst."""
SWEEPS = 4
WIDEST_S, STEP_S = 1.5, 0.06
"""Offsets between the clocks of torques and motion that are tried."""
_STEPS = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Components of the directions of gravity that are tried."""
_LEAST_TURN = 0.5
"""[rad] smaller tilts are linear."""
_WIDTH = 0.02
"""Smoothing velocity of the Coulomb column, share of the joint's usual top speed."""
_SPREAD = 0.5
"""Friction of a joint that is likely, share of its torque."""


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
    """The signal of each kind that explains most when it is put right, by a plain model.

    Args:
        ref: The reference.
        sums: Its sums.
        values: (p) its parameters.
        prior: Of the inertial parameters.
    """
    rec = ref.recording
    share = _share(ref, values)
    # The same for all joints: an exchange must not gain from joints that count differently.
    plain = _Plain(rec, prior, float(np.median(sums.counts)))
    own = plain.cost(rec)
    best: dict[str, WholeSignal] = {}
    for rival in _rivals(rec, sorted(np.argsort(-share)[:PAIRED].tolist())):
        drop = own - plain.cost(rival.recording)
        if drop > (best[rival.kind].score if rival.kind in best else 0.0):
            best[rival.kind] = replace(rival, score=drop)
    return list(best.values())


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
    return bool(strange or drives) or float(_share(ref, values).max()) > POOR


def friction_power(ref: Reference, values: Array) -> Array:
    """(n) power that friction takes, all of it or dry alone, over that of all torques.

    Of the way that it takes least: no friction drives a joint one way, to brake it the more the
    other way; that is gravity.
    """
    n = ref.recording.robot.joints
    every = values[10 * n : ref.shapes.stop].copy()
    names = ref.recording.model.names[10 * n :]
    every[[k for k, name in enumerate(names) if name.startswith("Im")]] = 0.0
    dry = every.copy()
    dry[[k for k, name in enumerate(names) if name.startswith("Fv")]] = 0.0
    growing = (ref.shapes.stop - ref.shapes.start) // SHAPES
    dry[len(dry) - growing :] = 0.0
    dq = ref.recording.average(ref.recording.dq.T)
    ways = np.array([np.maximum(dq, 0.0), np.minimum(dq, 0.0)])
    friction = np.tensordot([every, dry], ref.columns[10 * n : ref.shapes.stop], axes=1)
    taken = (friction[:, None] * ways).sum(axis=3)
    shares: Array = taken / np.maximum(np.abs(ref.torque * ways).sum(axis=2), 1e-300)
    return shares.min(axis=(0, 1))


def _rivals(rec: Recording, paired: list[int]) -> Iterator[WholeSignal]:
    robot, n = rec.robot, rec.robot.joints
    # A turned zero of the last joint is the same as another last link.
    turning = [j for j in range(n - 1) if not robot.prismatic[j]]
    changed = replace(rec, robot=replace(robot, gravity=1e-6 * robot.gravity))
    yield WholeSignal(recording=changed, kind="gravity_compensated", joints=(), value=1.0, unit="")
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
        changed = changed.with_motion(lambda values, order=order: values[:, order])
        yield WholeSignal(recording=changed, kind="exchanged", joints=(i, j), value=1.0, unit="")
    for j in turning:
        for by in (np.pi / 2, -np.pi / 2, np.pi):
            yield _turned(rec, {j: by})
    for i, j in combinations([j for j in turning[1:] if j in paired], 2):
        for a, b in product((np.pi / 2, -np.pi / 2), repeat=2):
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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Products:
    """Columns of a motion on the rows that are looked at, and their products."""

    columns: Array
    """(p, n, T) inertial, viscous and motor columns, then Coulomb's."""
    square: Array
    """(n, p, p)"""
    known: Array
    """(n, T) torques of counterbalances."""
    dq: Array
    """(n, T)"""
    fast: Array
    """(n) usual top speeds."""
    top: Array
    """(n) largest accelerations."""


class _Plain:
    """A plain model of a recording and of its rivals, on few rows.

    Many rivals share robot and motion of the recording, and so its columns.
    """

    def __init__(self, rec: Recording, prior: tuple[Array, Array], count: float) -> None:
        n = self.joints = rec.robot.joints
        most = min(ROWS, EQUATIONS // n)
        self.rows = np.linspace(0, len(rec.t) - 1, min(most, len(rec.t))).astype(int)
        self.counts = np.full(n, min(count, most))
        self.mean, self.precision = prior[0], np.linalg.inv(prior[1])
        self.rec, self.own = rec, self._products(rec)

    def _products(self, rec: Recording) -> _Products:
        q, dq, ddq = rec.q[self.rows], rec.dq[self.rows], rec.ddq[self.rows]
        n, every = self.joints, np.arange(self.joints)
        stack = rec.model.stack(q, dq, ddq)
        fast = np.maximum(np.percentile(np.abs(dq), 98, axis=0), 1e-6)
        columns = np.zeros((len(stack) + n, n, len(q)))
        columns[: len(stack)] = stack
        columns[len(stack) + every, every] = np.tanh(dq.T / (_WIDTH * fast)[:, None])
        return _Products(
            columns=columns,
            square=np.matmul(columns.transpose(1, 0, 2), columns.transpose(1, 2, 0)),
            known=rec.model.known_torque(q).T,
            dq=dq.T,
            fast=fast,
            top=np.maximum(np.abs(ddq).max(axis=0), 1e-9),
        )

    def cost(self, rec: Recording) -> float:
        """Negative log likelihood of the model and its prior at its best [nats]."""
        shared = ("robot", "q", "dq", "ddq")
        same = all(getattr(rec, x) is getattr(self.rec, x) for x in shared)
        of = self.own if same else self._products(rec)
        n, rows, counts = self.joints, len(self.rows), self.counts
        torque = rec.tau[self.rows].T + of.known
        cross = np.matmul(of.columns.transpose(1, 0, 2), torque[:, :, None])[:, :, 0]
        energy = np.square(torque).sum(axis=1)
        size = np.sqrt(energy / rows) + 1e-12
        # Motors that drive several joints have columns of their own between inertia and Coulomb.
        coupling = np.full(len(of.columns) - 13 * n, size.max() / of.fast.min())
        usual = np.concatenate([size / of.fast, size / of.top, coupling, size])
        mean = np.concatenate([self.mean, np.zeros(len(usual))])
        precision = np.zeros((len(mean), len(mean)))
        precision[: 10 * n, : 10 * n] = self.precision
        rest = np.arange(10 * n, len(mean))
        precision[rest, rest] = 1 / np.square(_SPREAD * usual)
        pulled = precision @ mean
        noise, values = energy / rows + 1e-18, mean
        for _ in range(SWEEPS):
            weights = counts / rows / noise
            matrix: Array = np.tensordot(weights, of.square, axes=1) + precision
            pull: Array = weights @ cross + pulled
            values = np.linalg.solve(matrix, pull)
            left = energy - 2 * cross @ values + (of.square @ values) @ values
            noise = np.maximum(left / rows, 1e-8 * energy / rows + 1e-18)
        away = values - mean
        dry = values[-n:, None] * of.columns[-n:].diagonal().T
        friction = values[10 * n : 11 * n, None] * of.dq + dry
        power = (friction * of.dq).sum(axis=1) / (np.abs(torque * of.dq).sum(axis=1) + 1e-300)
        unlikely = 0.5 * float(away @ precision @ away) + IMPOSSIBLE * int((power < DRIVES).sum())
        return 0.5 * float(counts @ np.log(noise)) + unlikely
