"""What a recording shows at single places or signals: contacts, ripple, clipping, its clock."""

from dataclasses import dataclass, replace

import numpy as np

from dynid.core import Array, Indices, Mask, scipy_part
from dynid.diagnosis import residual
from dynid.diagnosis.residual import Recording, Reference
from dynid.identification import wave_power
from dynid.robot import RobotModel
from dynid.signals import GAP_STEPS, find_period

WINDOW_S = 0.2
USUAL = ((70.0, 1.036), (90.0, 1.645), (90.0, 1.645))
"""Percentile of the windows' errors that counts as usual, and how many standard deviations it is
of errors that are normal: while a joint moves what remains may be contacts, while it turns back
or stands also friction."""
REVERSAL = 0.06
"""Share of a joint's usual top speed below which friction hides the torque."""
STRUCK = 40.0
"""Sum over joints of squared errors over usual ones that a contact exceeds."""
EASE = 3.0
"""Factor by which limits are lower for stretches that are left out of the second fit."""
APART = 3.0
"""... and how many times that of the windows that come nearest."""
COMMON = (20.0, 80.0)
"""Percentiles of repetitions, or along a standstill, between which an error is common to all."""
STILL = 0.05
"""Share of the largest motion of a joint below which another one counts as standing."""
REST = 0.002
"""Share of its range that a joint at rest stays within during a window."""
ENDS = 5
"""Windows at the ends of a rest in which friction may still change."""
FEWEST = 10
"""Windows of a kind whose errors tell what is usual."""
KNOWN = 0.05
"""Standard deviation to which friction is known at best, share of it."""
LOADED = 4.0
"""Error over the usual one of a joint that a contact loads."""
RARE = 3.0
"""Errors of windows with hardly any like them, over those of all others."""
SETTLED = 0.02
"""Share of its range after which a joint's friction is known."""
NEXT_S = 0.5
"""Windows closer to each other belong to one contact."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Contact:
    """A stretch whose torques do not belong to the motion."""

    start_s: float
    stop_s: float
    joints: tuple[int, ...]
    """Joints that it loads."""
    size: float
    """Largest torque that is left over [N.m or N]."""


def contacts(
    rec: Recording, error: Array, held: Array, ease: float = 1.0, unsure: Array | None = None
) -> tuple[Contact, ...]:
    """Stretches that stand far above all others.

    Friction is least known near standstill and at the start: windows there are compared with
    their like; of a joint at rest only changes count that friction cannot hold, and of one that
    creeps nothing. What comes back in each repetition of a motion belongs to the motion.

    Args:
        rec: The recording.
        error: (N, n) torques that the model leaves [N.m or N].
        held: (n) torques that friction may hold at rest [N.m or N].
        ease: Factor by which the limits are lower: above 1 for stretches that may be contacts.
        unsure: (N, n) standard deviations of the model's torques [N.m or N]; None for zero.
    """
    step = float(rec.t[1] - rec.t[0])
    width = max(2, round(WINDOW_S / step))
    starts = np.arange(0, len(error) - width + 1, max(1, width // 2))
    if len(starts) < 20:
        return ()
    single = _without_repetitions(rec, error, 1 / step)
    mean, whole = _means(single, starts, width), _means(error, starts, width)
    fast = np.maximum(np.percentile(np.abs(rec.dq), 98, axis=0), 1e-9)
    slow = np.abs(rec.dq) < REVERSAL * fast
    # 0: moves throughout, 1: turns back, starts or stops, 2: is at rest, 3: creeps.
    kinds = np.array(
        [slow[a : a + width].any(axis=0) * 1 + slow[a : a + width].all(axis=0) * 2 for a in starts]
    )
    went = np.array([np.ptp(rec.q[a : a + width], axis=0) for a in starts])
    still = (kinds == 3) & (went < REST * np.ptp(rec.q, axis=0))
    kinds[scipy_part("ndimage").minimum_filter1d(still, 1 + 2 * ENDS, axis=0)] = 2
    model = np.zeros_like(mean) if unsure is None else _means(unsure, starts, width)
    ratio = np.zeros_like(mean)
    for j in range(mean.shape[1]):
        kind = kinds[:, j]
        mean[:, j] = _without_holding(mean[:, j], kind == 2, held[j])
        size = np.abs(mean[:, j])
        moves = kind < 2 if (kind < 2).sum() >= FEWEST else np.ones_like(kind, dtype=bool)
        # What repeats is no contact, but it tells how well the model knows this joint.
        everywhere = float(np.percentile(np.abs(whole[moves, j]), USUAL[0][0])) / USUAL[0][1]
        for k, (percentile, deviations) in enumerate(USUAL):
            # Too few of a kind to know what is usual: friction may do much there.
            enough = (kind == k).sum() >= FEWEST
            own = np.percentile(size[kind == k], percentile) / deviations if enough else np.inf
            own = min(max(own, everywhere), RARE * everywhere)
            # At rest only changes count, and errors of parameters stay the same.
            own = float(np.hypot(max(own, 1e-12), KNOWN * held[j]))
            expected = np.hypot(own, model[kind == k, j] if k < 2 else 0.0)
            ratio[kind == k, j] = size[kind == k] / expected
    total = np.square(ratio).sum(axis=1)
    raised = np.flatnonzero(total > STRUCK / ease)
    groups = np.split(raised, np.flatnonzero(np.diff(starts[raised]) * step > NEXT_S) + 1)
    groups = sorted((g for g in groups if len(g)), key=lambda g: -float(total[g].max()))
    found: list[Contact] = []
    rest = np.ones(len(total), dtype=np.bool_)
    for group in groups:
        rest[max(group[0] - ENDS, 0) : group[-1] + ENDS + 1] = False
    near = float(np.percentile(total[rest], 98)) if rest.sum() > 10 else np.inf
    for group in groups:
        around = ratio[max(group[0] - 1, 0) : group[-1] + 2]
        loaded = np.flatnonzero((around > LOADED).sum(axis=0) > 1)
        if total[group].max() < APART / ease * near:
            break
        if len(loaded) == 0:
            continue
        # What one joint shows alone where it turns back or rests, and less than its friction, may
        # be its friction.
        others = np.sort(ratio[group].max(axis=0))[:-1]
        pushed = np.abs(mean[group]) > held * (kinds[group] > 0)
        if not (others > LOADED).any() and not pushed[:, loaded].any():
            continue
        found.append(
            Contact(
                start_s=float(rec.t[starts[group[0]]]),
                stop_s=float(rec.t[starts[group[-1]] + width - 1]),
                joints=tuple(int(j) for j in loaded),
                size=float(np.abs(mean[group][:, loaded]).max()),
            )
        )
    return tuple(sorted(found, key=lambda c: c.start_s))


def _means(values: Array, starts: Indices, width: int) -> Array:
    """(W, n) means of values (N, n) over windows."""
    sums = np.vstack([np.zeros(values.shape[1]), np.cumsum(values, axis=0)])
    return (sums[starts + width] - sums[starts]) / width


def contact_stretches(
    robot: RobotModel, t: Array, dq: Array, error: Array, held: Array
) -> tuple[tuple[float, float], ...]:
    """Start and end [s] of the contacts in a prediction.

    Args:
        robot: The robot.
        t: (N) instants, evenly spaced [s].
        dq: (N, n) velocities [rad/s or m/s].
        error: (N, n) measured less predicted torques [N.m or N].
        held: (n) torques that friction may hold at rest [N.m or N].
    """
    # Where the joints started does not matter: positions only tell whether they moved since.
    q = np.cumsum(dq, axis=0) * (t[1] - t[0])
    rec = Recording(
        robot=robot, t=t, q=q, dq=dq, ddq=np.zeros_like(dq), friction_q=q, tau=error, block=1
    )
    return tuple((one.start_s, one.stop_s) for one in contacts(rec, error, held))


def untouched(ref: Reference, values: Array) -> tuple[Array, tuple[Contact, ...]]:
    """Torques (N, n) that a model leaves which was fitted without contacts, and the contacts.

    A contact biases a fit until its error is spread over the whole recording: stretches that may
    be one are left out of a second fit (least trimmed squares, Rousseeuw 1984).

    Args:
        ref: The reference.
        values: (p) its parameters.
    """
    rec = ref.recording
    error = rec.tau - ref.predicted(values)
    held = _held(ref, values)
    suspected = contacts(rec, error, held, EASE)
    if not suspected:
        return error, ()
    rest = replace(ref, recording=rec.without(rows_of(suspected, rec.t)))
    _, values = residual.fits(rest)
    error = rec.tau - ref.predicted(values)
    return error, contacts(rec, error, _held(ref, values), unsure=torque_deviations(rest, values))


def rows_of(touched: tuple[Contact, ...], t: Array) -> Mask:
    """(N) instants t (N) [s] in contacts."""
    out = np.zeros(len(t), dtype=np.bool_)
    for one in touched:
        out |= (t >= one.start_s) & (t <= one.stop_s)
    return out


def torque_deviations(ref: Reference, values: Array) -> Array:
    """(N, n) standard deviations of the torques of a fit, from its parameters (p).

    A motion that the recording shows once is known less well than one that it shows often.
    """
    rows, columns = ref.left(values), ref.recording.measured(ref.columns)
    noise = np.square(rows).mean(axis=1) * residual.correlation_length(rows, ref.period)
    noise = np.maximum(noise, residual.NO_ERROR)
    sums = np.matmul(columns.transpose(1, 0, 2), columns.transpose(1, 2, 0))
    root = np.linalg.cholesky(np.tensordot(1 / noise, sums, axes=1) + ref.precision)
    turned = np.linalg.solve(root, ref.columns.reshape(len(root), -1))
    spread = np.sqrt(np.square(turned).sum(axis=0)).reshape(rows.shape)
    whole = np.repeat(spread, ref.recording.block, axis=1).T
    lacking = len(ref.recording.t) - len(whole)
    return np.pad(whole, ((0, lacking), (0, 0)), mode="edge")


def _held(ref: Reference, values: Array) -> Array:
    """(n) friction of moving joints but for what grows with speed: as much is held at rest."""
    rec, first = ref.recording, ref.shapes.start
    last = first + residual.STEPPED * (ref.shapes.stop - first) // residual.SHAPES
    friction = np.tensordot(values[first:last], ref.columns[first:last], axes=1)
    speed = rec.average(np.abs(rec.dq.T))
    slowest = REVERSAL * np.percentile(speed, 98, axis=1)
    moves = speed > slowest[:, None]
    return (moves * np.abs(friction)).sum(axis=1) / np.maximum(moves.sum(axis=1), 1)


def _without_holding(mean: Array, stands: Mask, held: float) -> Array:
    """Errors of a joint less what friction holds at rest.

    A controller that corrects the last of a position error, or other joints that move, shift
    torque between motor and friction though nothing turns.
    """
    out = mean.copy()
    edges = np.flatnonzero(np.diff(np.concatenate([[False], stands, [False]])))
    for first, stop in edges.reshape(-1, 2):
        rest = mean[first:stop] - _common(mean[first:stop])
        out[first:stop] = np.sign(rest) * np.maximum(np.abs(rest) - held, 0.0)
    return out


def _common(values: Array) -> Array:
    """What nearly all of the first axis show: a hand may push more than once.

    NaN stands for what is not known; one value alone shows nothing that is common.
    """
    ordered, known = np.sort(values, axis=0), np.isfinite(values).sum(axis=0)
    least, most = (
        _between(ordered, percent / 100 * np.maximum(known - 1, 0)) for percent in COMMON
    )
    return np.where(known > 1, np.maximum(least, 0.0) + np.minimum(most, 0.0), 0.0)


def _between(ordered: Array, place: Array) -> Array:
    """Values at fractional places of the first axis."""
    low = np.floor(place).astype(int)
    below, above = (
        np.take_along_axis(ordered, k[None], 0)[0] for k in (low, np.ceil(place).astype(int))
    )
    return below + (place - low) * (above - below)


def _without_repetitions(rec: Recording, error: Array, rate_hz: float) -> Array:
    """Errors less what other repetitions of the motion show at the same place.

    Incomplete repetitions count as far as they go. While the state of a joint's friction is
    unknown its errors tell nothing, neither of a contact nor of other repetitions.
    """
    away = np.abs(rec.q - rec.q[0]) > SETTLED * np.ptp(rec.q, axis=0)
    settled = np.maximum.accumulate(away, axis=0)
    period = find_period(rec.q, rate_hz)
    left = error
    if period is not None:
        length = round(period * rate_hz)
        whole = np.full((-(-len(error) // length) * length, error.shape[1]), np.nan)
        whole[: len(error)] = np.where(settled, error, np.nan)
        left = error - np.resize(_common(whole.reshape(-1, length, error.shape[1])), error.shape)
    return np.where(settled, left, 0.0)


ORDERS = (6.0, 400.0)
"""Waves a turn that are looked for."""
FINER = 21
"""Orders that are looked at beside the best."""
PROMINENT = 100.0
"""Power of a wave over the median of all others without it."""


def ripple(
    rec: Recording, error: Array, joint: int, least: float, touched: tuple[Contact, ...] = ()
) -> tuple[float, float] | None:
    """Waves a turn (or m) and amplitude [N.m or N] of a gear's ripple, if one stands out.

    Args:
        rec: The recording.
        error: (N, n) torques that the model leaves.
        joint: The joint.
        least: Amplitude from which it matters [N.m or N].
        touched: Contacts, which are left out.
    """
    step = float(rec.t[1] - rec.t[0])
    moving: Mask = np.abs(rec.dq[:, joint]) > 1e-3
    for contact in touched:
        moving &= (rec.t < contact.start_s) | (rec.t > contact.stop_s)
    q, left = rec.q[moving, joint], error[moving, joint]
    if len(q) < 200:
        return None
    stride = max(1, len(q) // 6000)
    q, left = q[::stride], left[::stride] - left[::stride].mean()
    reach = max(float(np.ptp(q)), 1e-6)
    # A wave that passes faster than the samples can show says nothing.
    top = 0.35 / step / max(float(np.percentile(np.abs(rec.dq[:, joint]), 90)), 1e-6) * 2 * np.pi
    spacing = 0.5 * 2 * np.pi / reach
    orders = np.arange(max(ORDERS[0], 30 / reach), min(ORDERS[1], top), spacing)
    if len(orders) < 30:
        return None
    best = int(np.argmax(wave_power(q, left, orders)))
    near = orders[best] + spacing * np.linspace(-1, 1, FINER)
    powers = wave_power(q, left, near)
    if 2 * np.sqrt(powers.max()) < least:
        return None
    order = float(near[np.argmax(powers)])
    wave = np.column_stack([np.cos(order * q), np.sin(order * q)])
    size: Array = np.asarray(np.linalg.lstsq(wave, left, rcond=None)[0], dtype=np.float64)
    # A motion that dwells in some places spreads a large wave over all orders: without it the
    # others tell what is usual. Where the model has taken a part of it, they do as they are.
    usual = min(float(np.median(wave_power(q, e, orders))) for e in (left, left - wave @ size))
    amplitude = float(np.linalg.norm(size))
    if amplitude**2 / 4 < PROMINENT * usual:
        return None
    return order, amplitude


def travels(q: Array) -> Mask:
    """(n) joints that move by more than a share `STILL` of what the joint does that moves most.

    Positions q (N, n) [rad or m]. Velocities of the others are mostly noise.
    """
    reach = q.std(axis=0)
    return reach >= STILL * reach.max()


def strokes(rec: Recording) -> float:
    """How often joints set out or turn round, over how many move at once; `BLOCKS` at most.

    Between two rests all joints follow one profile: what a model leaves in its rows is one error,
    however many they are. So many blocks of a recording are independent.
    """
    dq = rec.dq[:, travels(rec.q)]
    way = np.sign(dq) * (np.abs(dq) > residual.SLOW * np.percentile(np.abs(dq), 98, axis=0))
    starts = (np.diff(way, axis=0, prepend=0.0) != 0) & (way != 0)
    together = np.abs(way).sum() / max(float(way.any(axis=1).sum()), 1.0)
    return float(np.clip(starts.sum() / max(together, 1.0), 1.0, residual.BLOCKS))


SCALE, FILTER_S = 0.5, 0.1
"""Spread of a clock's scale, and of the time constants of the filters of velocities [s]."""
TOLD_APART = 3e-3
"""Singular value over the largest from which the motion tells scale and filter apart."""


def clock_scale(t: Array, q: Array, dq: Array) -> float:
    """Time of the stamps over time of the velocities: positions against integrated velocities.

    Controllers filter velocities. A clock scales all frequencies alike; a filter of second order
    leaves the slow ones, and adds the filtered velocity and its derivative to the positions.
    """
    steps = np.diff(t)
    a = np.zeros_like(q)
    a[1:] = np.cumsum((dq[1:] + dq[:-1]) / 2 * steps[:, None], axis=0)
    slope = np.gradient(dq, t, axis=0)
    rows = np.array([SCALE * q, FILTER_S * dq, FILTER_S**2 * slope, a - q])
    # How far joints went within a gap, velocities beside it do not tell.
    starts = np.flatnonzero(steps > GAP_STEPS * np.median(steps)) + 1
    for part in np.split(np.arange(len(t)), starts):
        rows[:, part] -= rows[:, part].mean(axis=1, keepdims=True)
    every = rows[:, :, travels(q)].transpose(2, 1, 0)
    found: list[Array] = [np.linalg.lstsq(x[:, :-1], x[:, -1], TOLD_APART)[0] for x in every]
    return 1 + SCALE * float(np.median(found, axis=0)[0])
