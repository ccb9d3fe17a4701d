"""The certificate of a motion: every limit and every distance, between samples too.

Positions, velocities and accelerations of a Fourier series are bounded as trigonometric
polynomials, those of the other kinds by their formulas' higher derivatives (`extremes`);
distances, speeds and momentum by how fast they can change (branch and bound).

Torque and power are looked at in 1 kHz samples with twice their curvature as an allowance:
dense, not proven; `proven` says which kinds are.
"""

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from dynid import trajectory as motions
from dynid.constraints import collision, limits
from dynid.constraints.motion import MotionConstraints
from dynid.core import Array, InputError, plain

_RATE_HZ = 1000.0
_FEWEST_LEAVES, _MOST_LEAVES = 2000, 60_000
_MOST_OF_ALL = 20 * _MOST_LEAVES
"""Of all parts together: some 1 GB of memory. Beyond that long parts have fewer."""
_WAVE, _SPAN = 64, 32
"""Fewest samples of a harmonic, and of a polynomial."""
_STEPS, _WAVE_STEPS = 256, 128
"""Intervals of a polynomial, and of a harmonic, whose derivatives are bounded."""
_DOUBT = 2.0
"""Jerk between samples over the largest jerk seen across one sample."""
_BESIDE = 1e-7
"""How far from a jump of the acceleration samples lie, over the time of the leg."""
BEYOND = 0.01
"""The same at most, over the time to the next of the `_MOST_LEAVES` samples of a leg."""


def dense_times(trajectory: motions.Trajectory) -> list[Array]:
    """Times from 0 to the end at 1 kHz, and closer where a part is short or waves are.

    One array for each part in which the acceleration does not jump; what is known of both sides of
    a jump is nearly at it. Of a repetition the first period, which is all of it.

    Raises:
        InputError: More parts than can be judged in the memory that a check may take.
    """
    leaves = list(_leaves(trajectory, 0.0))
    fewest = sum(_fewest(leaf) for _, leaf in leaves)
    if fewest > _MOST_OF_ALL:
        raise InputError(
            "the motion has too many parts to be judged",
            value=len(leaves),
            limit=f"{_MOST_OF_ALL} samples, of which they need {fewest}",
            next_step="Check it in several files.",
        )
    most = _MOST_LEAVES
    while sum(counts := [_samples(leaf, most) for _, leaf in leaves]) > _MOST_OF_ALL + fewest:
        most //= 2
    more = max(1.0, _FEWEST_LEAVES / sum(counts))
    parts: list[Array] = []
    for (start, leaf), count in zip(leaves, counts, strict=True):
        ends, beside = np.array([0.0, leaf.duration]), 0.0
        if isinstance(leaf, motions.PointToPoint):
            ends = np.cumsum([0.0, *(time for time, _ in leaf.polynomials())])
            beside = _BESIDE * leaf.duration
        edges: list[float] = (start + ends).tolist()
        for first, last in pairwise(edges):
            share = (last - first) / leaf.duration
            steps = int(np.ceil(more * count * share))
            parts.append(np.linspace(first + beside, last - beside, steps + 1))
    return parts


def _fewest(leaf: motions.Trajectory) -> int:
    match leaf:
        case motions.FourierSeries() | motions.FourierQuintic():
            return _WAVE * leaf.harmonics
        case motions.BSpline():
            return _SPAN * (leaf.control.shape[1] - leaf.degree)
        case _:
            return _SPAN


def _samples(leaf: motions.Trajectory, most: int) -> int:
    return max(_fewest(leaf), int(np.clip(np.ceil(leaf.duration * _RATE_HZ), 1, most)))


def _leaves(
    trajectory: motions.Trajectory, start: float
) -> Iterator[tuple[float, motions.Trajectory]]:
    """The motions that a motion is put together from, and when they begin."""
    if isinstance(trajectory, motions.MotionSequence):
        for part, begin in zip(trajectory.parts, trajectory.starts, strict=True):
            yield from _leaves(part, start + float(begin))
    elif isinstance(trajectory, motions.Repetition):
        yield from _leaves(trajectory.part, start)
    else:
        yield start, trajectory


def extremes(trajectory: motions.Trajectory) -> motions.Extremes:
    """The bounds of any trajectory; proven for every kind of this package."""
    found = [_of_leaf(leaf) for _, leaf in _leaves(trajectory, 0.0)]
    return motions.Extremes(
        lower=np.min([item.lower for item in found], axis=0),
        upper=np.max([item.upper for item in found], axis=0),
        velocity=np.max([item.velocity for item in found], axis=0),
        acceleration=np.max([item.acceleration for item in found], axis=0),
        proven=all(item.proven for item in found),
    )


def _of_leaf(trajectory: motions.Trajectory) -> motions.Extremes:
    if type(trajectory) is motions.FourierSeries:
        return motions.peaks(trajectory)
    try:
        parts = motions.pieces(trajectory)
    except InputError:
        return _from_samples(trajectory)
    bounds = np.array([_of_piece(piece) for piece in parts])
    lower, upper = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    most = np.maximum(np.abs(lower), np.abs(upper))
    return motions.Extremes(lower=lower[0], upper=upper[0], velocity=most[1], acceleration=most[2])


def _of_piece(piece: motions.Piece) -> Array:
    """(2, 3, n) what q, dq and ddq of a formula are not below and not above.

    Between samples h apart a function leaves the larger of both by at most h^2 / 8 of its second
    derivative, and that one its own samples by h^2 / 8 of the fourth, which is at most the sum of
    its coefficients' sizes.
    """
    count = max(_STEPS, _WAVE_STEPS * piece.harmonics)
    s: Array = np.linspace(0.0, 1.0, count + 1)
    eighth = 1.0 / (8.0 * count**2)
    values: list[Array] = []
    steepest: list[Array] = []
    slope = piece
    for _ in range(7):
        values.append(slope.values(s))
        waves = np.abs(slope.a) + np.abs(slope.b)
        steepest.append(np.abs(slope.polynomial).sum(axis=1) + waves.sum(axis=1))
        slope = slope.slope()
    bounds = np.empty((2, 3, len(piece.polynomial)))
    for order in range(3):
        value, bend = values[order], np.abs(values[order + 2])
        room = eighth * (np.maximum(bend[:-1], bend[1:]) + eighth * steepest[order + 4])
        bounds[0, order] = (np.minimum(value[:-1], value[1:]) - room).min(axis=0)
        bounds[1, order] = (np.maximum(value[:-1], value[1:]) + room).max(axis=0)
        bounds[:, order] /= piece.duration**order
    return bounds


def _from_samples(trajectory: motions.Trajectory) -> motions.Extremes:
    """Of samples, with the jerk between them taken as twice what neighbouring ones show.

    Differences count as well: by the mean value theorem no motion is slower than its way, whatever
    its class says of derivatives.
    """
    times = np.concatenate(dense_times(trajectory))
    motion = trajectory.evaluate(times)
    step = trajectory.duration / (len(times) - 1)
    jerk = _DOUBT * np.abs(np.diff(motion.ddq, axis=0)).max(axis=0) / step
    velocity, most = (
        np.maximum(np.abs(slope).max(axis=0), np.abs(np.diff(value, axis=0)).max(axis=0) / step)
        for value, slope in ((motion.q, motion.dq), (motion.dq, motion.ddq))
    )
    acceleration = most + jerk * step / 2
    # Between samples a smooth curve leaves its chord by at most h^2 / 8 of its curvature.
    bow = acceleration * step**2 / 8
    return motions.Extremes(
        lower=motion.q.min(axis=0) - bow,
        upper=motion.q.max(axis=0) + bow,
        velocity=velocity + jerk * step**2 / 8,
        acceleration=acceleration,
        proven=False,
    )


Judge = Callable[[Array, float], tuple[Array, Array]]
"""Takes middles (N) [s] and half a width [s]; gives values (N) there, and what the quantity is
nowhere below within half a width (N)."""

_CHUNK = 8192
_NARROWEST = 1e-6
"""Intervals are not halved below this half width [s]."""
_SEARCH_MOST = 2_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Least:
    """The least value over all time."""

    bound: float
    """Nothing is lower than this; where the limit is broken, the least value seen."""
    value: float
    """The least value seen."""
    t: float
    """Where it was seen [s]."""


def least_value(
    judge: Judge, duration: float, *, first: int, threshold: float, tolerance: float
) -> Least:
    """The least value over 0 to `duration`, with `first` intervals to begin with.

    The bound may lie `tolerance` below the least value seen, and more where that is far above
    `threshold`, the limit in question.
    """
    half = duration / first / 2
    middles: Array = (2.0 * np.arange(first, dtype=np.float64) + 1.0) * half
    best, place, bound = np.inf, 0.0, np.inf
    spent = 0
    while True:
        lows = np.empty(len(middles))
        for start in range(0, len(middles), _CHUNK):
            part = slice(start, start + _CHUNK)
            values, lows[part] = judge(middles[part], half)
            k = int(np.argmin(values))
            if values[k] < best:
                best, place = float(values[k]), float(middles[start + k])
        spent += len(middles)
        slack = tolerance + 0.1 * max(best - threshold, 0.0)
        open_ = lows < best - slack
        bound = min(bound, float(lows[~open_].min(initial=np.inf)))
        if not open_.any():
            break
        if best < threshold:
            # Broken is broken: nothing is left to prove.
            return Least(bound=best, value=best, t=place)
        if half < _NARROWEST or spent > _SEARCH_MOST:
            bound = min(bound, float(lows[open_].min()))
            break
        half /= 2
        middles = np.concatenate([middles[open_] - half, middles[open_] + half])
    return Least(bound=min(bound, best), value=best, t=place)


ROUNDING = 1e-9
"""A limit that is met exactly may be missed by rounding."""
_DISTANCE_WITHIN = 1e-4
_RATIO_WITHIN = 2e-3
_INTERVALS_HZ = 50.0
_FEWEST, _MOST = 64, 30_000
"""Intervals with which a search begins: those of ten minutes; what is open then is halved."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificate:
    """The verdict on one motion."""

    worst: dict[str, limits.Worst]
    """Kind to its guaranteed margin, and where it is smallest."""
    proven: tuple[str, ...]
    """Kinds whose margin is proven: at all times, and for distances with shapes that are known to
    hold the links. The others are dense samples with an allowance, or leave something out, which
    the notes say."""
    notes: tuple[str, ...]
    """What was assumed."""
    unjudged: tuple[limits.Unjudged, ...] = ()
    """What was asked for and could not be judged."""

    @property
    def assumed(self) -> tuple[str, ...]:
        """The notes that are not among the causes of something unjudged."""
        told = {cause for item in self.unjudged for cause in item.causes}
        return tuple(note for note in self.notes if note not in told)

    @property
    def holds(self) -> bool:
        """Whether no limit that is judged is broken and no clearance missed, at any time."""
        return not self.broken

    @property
    def verdict(self) -> str:
        """`violated`, `unjudged` where something asked for could not be judged, or `certified`."""
        if not self.holds:
            return "violated"
        return "unjudged" if self.unjudged else "certified"

    @property
    def feasible(self) -> bool:
        """Whether everything asked for was judged and holds."""
        return self.verdict == "certified"

    @property
    def headline(self) -> str:
        """The verdict in words."""
        match self.verdict:
            case "violated":
                return f"NOT feasible: {', '.join(self.broken)}"
            case "unjudged":
                kinds = dict.fromkeys(item.kind for item in self.unjudged)
                return f"NOT certified: {', '.join(kinds)} unjudged"
            case _:
                return "certified, feasible"

    def allows(self, accepted: Collection[str]) -> bool:
        """Whether it holds, and only kinds that are accepted are unjudged."""
        return self.holds and all(item.kind in accepted for item in self.unjudged)

    @property
    def margins(self) -> dict[str, float | None]:
        """Kind to margin: share of the limit left, or distance [m]; None where not judged."""
        return {
            f"{kind}_m" if kind in limits.DISTANCES else kind: plain(item.margin)
            for kind, item in self.worst.items()
        }

    @property
    def broken(self) -> tuple[str, ...]:
        """The kinds that are broken, worst first."""
        found = {kind: item.room for kind, item in self.worst.items()}
        return tuple(sorted((k for k in found if found[k] < -ROUNDING), key=lambda k: found[k]))

    def to_json(self) -> dict[str, Any]:
        """The form that `dynid check --json` prints."""
        return {
            "certificate": self.verdict,
            "feasible": self.feasible,
            "unjudged": [item.to_json() for item in self.unjudged],
            "margins": self.margins,
            "worst": {
                kind: item.to_json()
                for kind, item in self.worst.items()
                if math.isfinite(item.margin)
            },
            "proven": list(self.proven),
            "notes": list(self.notes),
        }


def certify(trajectory: motions.Trajectory, constraints: MotionConstraints) -> Certificate:
    """Judge a motion from its start to its end.

    Raises:
        InputError: A motion of another number of joints, or of no duration.
    """
    motions.require_positive("the motion's duration", trajectory.duration)
    while isinstance(trajectory, motions.Repetition):
        trajectory = trajectory.part
    parts = dense_times(trajectory)
    times = np.concatenate(parts)
    motion = trajectory.evaluate(times)
    if motion.q.shape[1] != constraints.robot.joints:
        raise InputError(
            "joints of the motion", value=motion.q.shape[1], limit=constraints.robot.joints
        )
    worst = constraints.usage(motion.q, motion.dq, motion.ddq, times)
    ends = extremes(trajectory)
    _between_samples(worst, constraints, ends)
    _add_allowance(worst, constraints, motion, [len(part) for part in parts])
    proven = ["position", "velocity", "acceleration"] if ends.proven else []
    first = min(max(_FEWEST, math.ceil(trajectory.duration * _INTERVALS_HZ)), _MOST)
    between = _Between(trajectory, ends)
    least = partial(least_value, duration=trajectory.duration, first=first, threshold=0.0)
    for kind, (points, limit) in constraints.points.items():
        found = least(partial(between.left, points, limit), tolerance=_RATIO_WITHIN)
        item, value = worst[kind], limit * (1.0 - found.value)
        # Shares are sought of what the limit is less its margin.
        seen, sure = (limits.left_over(1.0 - x, item.required) for x in (found.value, found.bound))
        worst[kind] = _settled(item, found.t, value, seen, sure)
        proven += [kind] if ends.proven else []
    around = constraints.surroundings
    if around is not None:
        for kind, pairs in around.pairs.items():
            apart = partial(between.apart, around.bodies, pairs)
            found = least(apart, tolerance=_DISTANCE_WITHIN)
            item = worst[kind]
            if found.value < item.room:
                at = trajectory.evaluate(np.array([found.t])).q
                pair = int(around.bodies.nearest(at, pairs).pair[0])
                required = float(pairs.required[pair])
                item = replace(
                    item,
                    what=pairs.names[pair],
                    margin=item.room + required,
                    limit=required,
                    required=required,
                )
            # What is sought is the distance less what is required.
            seen, sure = found.value + item.required, found.bound + item.required
            worst[kind] = _settled(item, found.t, seen, seen, sure)
            proven += [kind] if ends.proven and not around.lacking[kind] else []
    return Certificate(
        worst=worst,
        proven=tuple(kind for kind in proven if math.isfinite(worst[kind].margin)),
        notes=constraints.notes,
        unjudged=constraints.unjudged,
    )


def _settled(
    before: limits.Worst, t: float, value: float, seen: float, sure: float
) -> limits.Worst:
    """The worst of samples and of a search, which saw a margin and is sure of another."""
    if seen < before.margin:
        before = replace(before, t=t, value=value)
    return replace(before, margin=min(sure, before.margin))


def _between_samples(
    worst: dict[str, limits.Worst], constraints: MotionConstraints, ends: motions.Extremes
) -> None:
    bounds = constraints.settings.bounds
    sides = np.stack([ends.lower, ends.upper])
    both = np.stack([ends.velocity, ends.velocity]), np.stack([ends.acceleration] * 2)
    for kind, ratio in zip(
        ("position", "velocity", "acceleration"),
        limits.bound_ratios(bounds, sides, *both),
        strict=True,
    ):
        item = worst[kind]
        if math.isfinite(item.margin):
            least = limits.left_over(float(ratio.max()), item.required)
            worst[kind] = replace(item, margin=min(item.margin, least))


def _add_allowance(
    worst: dict[str, limits.Worst],
    constraints: MotionConstraints,
    motion: motions.JointMotion,
    counts: Sequence[int],
) -> None:
    """Torque and power between samples: their curvature, twice.

    Parts of so many samples meet where the acceleration may jump: curvature is that within a part,
    and its first and last samples lie up to `BEYOND` of a step from the jump.
    """
    judge = constraints.torque
    if judge is None:
        return
    torque, power = judge.largest(motion.q, motion.dq, motion.ddq)
    edges = np.cumsum(counts)
    firsts = edges - np.array(counts)
    for kind, values, limit in (("torque", torque, judge.limits), ("power", power, judge.power)):
        item = worst[kind]
        if math.isfinite(item.margin):
            bow = np.zeros(values.shape)
            bow[1:-1] = np.abs(values[2:] - 2 * values[1:-1] + values[:-2]) / 4
            for edge, inner in ((edges - 1, edges - 2), (firsts, firsts + 1)):
                bow[edge] = bow[inner] + BEYOND * np.abs(values[edge] - values[inner])
            least = limits.left_over(float(np.nanmax((values + bow) / limit)), item.required)
            worst[kind] = replace(item, margin=min(item.margin, least))


@dataclass(frozen=True, slots=True)
class _Between:
    """What cannot be missed within `half` [s] either side of times t (N) of a motion."""

    trajectory: motions.Trajectory
    ends: motions.Extremes

    def _fastest(self, motion: motions.JointMotion, half: float) -> Array:
        """(N, n) speeds that the joints do not exceed there."""
        return np.minimum(np.abs(motion.dq) + half * self.ends.acceleration, self.ends.velocity)

    def left(
        self, points: limits.MovingPoints, limit: float, t: Array, half: float
    ) -> tuple[Array, Array]:
        """Share of a speed limit that is left, and what it cannot fall below.

        A point's acceleration is at most sum_k r_k |ddq_k| + sum_jk r_max(j,k) |dq_j dq_k|, since a
        joint's column turns with the joints before it and is turned by those after it.
        """
        motion = self.trajectory.evaluate(t)
        speed = self._fastest(motion, half)
        # r_max(j,k) summed over pairs: joint k with all before it, twice, and with itself.
        before = np.cumsum(speed, axis=1) - speed
        push = speed * (2 * before + speed) + self.ends.acceleration
        left = 1.0 - points.norms(motion.q, motion.dq) / limit
        return left, left - half * (push @ points.reach(self.ends.travel)) / limit

    def apart(
        self, bodies: collision.CollisionBodies, pairs: collision.JudgedPairs, t: Array, half: float
    ) -> tuple[Array, Array]:
        """The least room, and what it cannot fall below: no body moves faster than its reach."""
        motion = self.trajectory.evaluate(t)
        way = half * self._fastest(motion, half)
        found = bodies.nearest(motion.q, pairs, travel=self.ends.travel, way=way)
        return found.room, found.bound
