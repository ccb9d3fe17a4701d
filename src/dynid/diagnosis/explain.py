"""Which faults explain what the reference model leaves of a recording: the best, and its rivals.

No column stands for whole signals that are reversed, exchanged, turned by right angles, or free of
gravity: each of these is tried on a thinned recording, with a plain model.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np

from dynid.core import Array, scipy_part
from dynid.diagnosis.hypotheses import Hypothesis, Scored, drops, hypotheses, left_out, score
from dynid.diagnosis.residual import (
    BLOCKS,
    Fits,
    Recording,
    Reference,
    fits,
    inertial_prior,
    reference,
    settled,
    sums_of,
)

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


def _doubtful(ref: Reference, values: Array) -> bool:
    """Whether the reference leaves much, or its inertias or friction are strange."""
    away, n = values - ref.mean, ref.recording.robot.joints
    away[10 * n :] = 0.0
    strange = 0.5 * float(away @ ref.precision @ away) > STRANGE * n
    drives = _friction_power(ref, values).min() < LEAST_POWER
    return strange or drives or float(_share(ref, values).max()) > POOR


def _friction_power(ref: Reference, values: Array) -> Array:
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
        angle = _angle(down, robot.gravity)
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


def _angle(one: Array, other: Array) -> float:
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


LIKELY, EVIDENT = 11.0, 5.0
"""Drop of the left-out negative log likelihood that an explanation needs, and log of its Bayes
factor over none [nats]."""
BY_CHANCE = 0.01
"""... and the chance (Student's t of the blocks left out) by which one of its sizes is that large
where there is none."""
WORTH_A_LOOK, LOOKS = 4.0, 8
"""Drop of the negative log likelihood from which a rival gets its own fit, and how many do."""
WHOLE_LIKELY, OFFSET_LIKELY = 24.0, 40.0
"""Drop that a signal needs that is reversed or exchanged: there are hundreds to choose from; and
one that was shifted in time, which short motions without repetition bear better [nats]."""
DRIVES, IMPOSSIBLE = -0.2, 48.0
"""Power of friction, over all of a joint, that no friction has, and what it costs a fit [nats]."""
EQUAL = 0.8
"""Share of the best explanation's score from which another cannot be told from it."""
ALONE_SWEEPS = 4
"""Sweeps of such a fit, from where the reference ended."""
ROUNDS = 6
"""Passes: a large fault takes two or three until it is undone."""
MOST = 3
"""Faults that are looked for one after the other."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation:
    """One fault that a recording shows."""

    kind: str
    """A kind of finding."""
    joints: tuple[int, ...]
    """Empty for the arm as a whole."""
    value: float
    std: float
    unit: str
    score: float
    """Drop of the negative log likelihood [nats]."""
    rivals: tuple["Explanation", ...] = ()
    """Explanations that cannot be told from it, the best first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Explained:
    """What was found in a recording, and what is left of it."""

    found: tuple[Explanation, ...]
    reference: Reference
    """With all that was found undone."""
    values: Array
    """(p) its parameters."""
    left: Array
    """(n) RMS error that it leaves in blocks left out [N.m or N]."""


def explain(
    recording: Recording, prior: tuple[Array, Array] | None = None, offsets: bool = True
) -> Explained:
    """Look for faults one after the other; each is undone before the next is looked for.

    Args:
        recording: The recording.
        prior: Of its robot, from `inertial_prior`; None to have it made.
        offsets: Whether clocks of torques and motion may be apart.
    """
    told = recording
    prior = inertial_prior(recording.robot) if prior is None else prior
    n = recording.robot.joints
    found: list[Explanation] = []
    added: list[Hypothesis] = []
    fitted = _fitted(recording, prior, added)
    rounds, right = 0, False
    while True:
        ref, _, values = fitted
        likely, left = _ranked(fitted)
        admitted = [s for s in likely if _physical(s, found)]
        if not right and len(found) < MOST and (likely or _doubtful(ref, values)):
            whole = _whole(fitted, prior, added, admitted[:1], offsets)
            if whole is not None:
                right = True
                found.append(whole[0])
                fitted = whole[1]
                recording = fitted[0].recording
                continue
        if not admitted:
            break
        best = admitted[0].hypothesis
        before = next((e for e in found if _same(e, best)), None)
        if before is None and len(found) == MOST:
            break
        rounds += 1
        if rounds > ROUNDS or (before is not None and best.undo is None):
            break
        if before is not None:
            found.remove(before)
        found.append(_explanation(admitted[0], admitted[1:], before))
        if best.undo is None:
            added.append(best)
        else:
            recording = best.undo(recording, admitted[0].values)
        fitted = _fitted(recording, prior, added, values[: 10 * n])
    if any(e.kind == "clock_offset" and abs(e.value) < STEP_S / 2 for e in found):
        # Corrected until nothing was left of it: it was none.
        return explain(told, prior, offsets=False)
    # Turns about several axes do not add up.
    turn = _angle(told.robot.gravity, ref.recording.robot.gravity)
    found = [replace(e, value=turn) if e.kind == "mounting" else e for e in found]
    return Explained(found=tuple(found), reference=ref, values=values, left=left)


_Fitted = tuple[Reference, Fits, Array]
"""A reference, its own sums, and (p) its parameters."""


def _whole(
    start: _Fitted,
    prior: tuple[Array, Array],
    added: list[Hypothesis],
    best: list[Scored],
    offsets: bool,
) -> tuple[Explanation, _Fitted] | None:
    """The signal that explains most when it is put right, and the fit then."""
    ref, sums, values = start
    wholes = whole_signals(ref, sums, values, prior)
    wholes = [w for w in wholes if offsets or w.kind != "clock_offset"]
    most, out = 0.0, None
    # It has to explain more than a fault of some size does.
    for rival in best if wholes else ():
        known = rival.hypothesis
        undone = known.undo(ref.recording, rival.values) if known.undo else ref.recording
        other = _fitted(undone, prior, added if known.undo else [*added, known])
        most = max(0.0, _drop(start, other))
    for whole in wholes:
        other = _fitted(whole.recording, prior, added)
        drop = _drop(start, other)
        least = OFFSET_LIKELY if whole.kind == "clock_offset" else WHOLE_LIKELY
        if drop > max(most, least):
            most = drop
            now = Explanation(
                kind=whole.kind, joints=whole.joints, value=whole.value, std=0.0,
                unit=whole.unit, score=drop,
            )  # fmt: skip
            out = now, other
    return out


def _ranked(fitted: _Fitted) -> tuple[list[Scored], Array]:
    """Explanations of some size that are likely, the best first.

    Also (n) the RMS error that the reference leaves in blocks left out [N.m or N].
    """
    ref, own, values = fitted
    rivals = hypotheses(ref, values)
    sums = replace(own, sums=sums_of(ref, *(rival.columns for rival in rivals)))
    ranked = sorted(zip(drops(sums, rivals), range(len(rivals)), strict=True), reverse=True)
    worth = [k for drop, k in ranked[:LOOKS] if drop > WORTH_A_LOOK]
    firsts = np.cumsum([len(ref.columns), *(len(rival.columns) for rival in rivals)])
    alone = (_alone(ref, rivals[k], sums, int(firsts[k])) for k in worth)
    likely = sorted((s for s in alone if _likely(s)), key=lambda s: -s.score)
    return likely, np.sqrt(left_out(sums)[0] / sums.rows)


def _drop(one: _Fitted, other: _Fitted) -> float:
    """Drop of the negative log likelihood and prior from one fit to another [nats].

    All joints count alike: an exchange must not gain from joints that count differently; nor does
    a gain, by torques that are smaller.
    """
    count = float(np.median(other[1].counts))

    def cost(ref: Reference, sums: Fits, values: Array) -> float:
        left = np.square(ref.left(values)).mean(axis=1) + 1e-18
        left = left / (np.square(ref.recording.tau).mean(axis=0) + 1e-18)
        driven = int((_friction_power(ref, values) < DRIVES).sum())
        unlikely = sums.penalty(values) + IMPOSSIBLE * driven
        return 0.5 * count * float(np.log(left).sum()) + unlikely

    return cost(*one) - cost(*other)


def _alone(ref: Reference, rival: Hypothesis, sums: Fits, first: int) -> Scored:
    """A rival with the noise that is left where it is true, not where it is not.

    Its columns are among those of the sums from `first` on.
    """
    p, m = len(ref.columns), len(rival.columns)
    wide = np.diag(1 / np.square(rival.width))
    none = np.zeros((p, m))
    widened = replace(
        ref,
        columns=np.concatenate([ref.columns, rival.columns]),
        mean=np.concatenate([ref.mean, np.zeros(m)]),
        precision=np.block([[ref.precision, none], [none.T, wide]]),
    )
    kept = [*range(p), *range(first, first + m), sums.sums.shape[-1] - 1]
    start = replace(
        sums,
        sums=sums.sums[:, :, kept][:, :, :, kept],
        own=p + m,
        mean=widened.mean,
        precision=np.block([[sums.precision, none], [none.T, wide]]),
    )
    found, _ = settled(widened, start, ALONE_SWEEPS)
    return score(replace(found, own=p, mean=ref.mean, precision=found.precision[:p, :p]), rival)


def _same(found: Explanation, now: Hypothesis) -> bool:
    """Whether a fault adds to one that was found before."""
    if found.kind == "clock_offset":
        return now.kind == "delay" and len(now.joints) > 1
    return (found.kind, found.joints) == (now.kind, now.joints)


def _fitted(
    recording: Recording,
    prior: tuple[Array, Array],
    added: list[Hypothesis],
    inertial: Array | None = None,
) -> _Fitted:
    """A fit; without parameters (10 n) that the load is taken from, with those of a first one."""
    if inertial is None:
        first = _fitted(recording, prior, added, prior[0])[2]
        inertial = first[: 10 * recording.robot.joints]
    columns = np.concatenate([h.columns for h in added]) if added else None
    spread = np.concatenate([h.width for h in added]) if added else None
    ref = reference(recording, prior, inertial, columns, spread)
    sums, values = fits(ref)
    return ref, sums, values


def _likely(scored: Scored) -> bool:
    known = scored.hypothesis
    # Several sizes: one of them is large by chance more often.
    tail = 0.5 * BY_CHANCE / known.free
    certain = -float(scipy_part("special").stdtrit(BLOCKS - 1, tail))
    sure = scored.certainty > certain and abs(scored.value) > known.least
    return sure and scored.score > LIKELY and scored.evidence > EVIDENT


def _physical(scored: Scored, found: list[Explanation]) -> bool:
    # A size that was found before may be corrected downwards.
    known = scored.hypothesis
    return scored.value > known.lowest or any(_same(item, known) for item in found)


def _explanation(best: Scored, others: list[Scored], before: Explanation | None) -> Explanation:
    now, *rivals = (
        Explanation(
            kind=s.hypothesis.kind,
            joints=s.hypothesis.joints,
            value=s.value,
            std=s.std,
            unit=s.hypothesis.unit,
            score=s.score,
        )
        for s in (best, *others)
        if s.score >= EQUAL * best.score
    )
    if before is None:
        return replace(now, rivals=tuple(rivals))
    gain = now.kind in ("drive_gain", "gain_all")
    value = (1 + before.value) * (1 + now.value) - 1 if gain else before.value + now.value
    return replace(before, value=value, std=now.std, score=before.score + now.score)
