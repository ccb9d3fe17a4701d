"""The certificate of a motion: every limit and every distance, between samples too.

Positions, velocities and accelerations of a Fourier series are bounded as trigonometric
polynomials, those of the other kinds by their formulas' higher derivatives (`extremes`);
distances, speeds and momentum by how fast they can change (branch and bound).
Torque and power are looked at in 1 kHz samples with twice their curvature as an allowance:
dense, not proven; `proven` says which kinds are.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from dynid.constraints import limits
from dynid.constraints.collision import CollisionBodies, JudgedPairs
from dynid.constraints.extremes import BEYOND, Extremes, dense_times, extremes, least_value
from dynid.constraints.motion import MotionConstraints
from dynid.core import Array, InputError, plain
from dynid.trajectory import JointMotion, Repetition, Trajectory, require_positive

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


def certify(trajectory: Trajectory, constraints: MotionConstraints) -> Certificate:
    """Judge a motion from its start to its end.

    Raises:
        InputError: A motion of another number of joints, or of no duration.
    """
    require_positive("the motion's duration", trajectory.duration)
    while isinstance(trajectory, Repetition):
        trajectory = trajectory.part
    parts = dense_times(trajectory)
    times = np.concatenate(parts)
    motion = trajectory.evaluate(times)
    if motion.q.shape[1] != constraints.robot.joints:
        raise InputError(
            "joints of the motion", value=motion.q.shape[1], limit=constraints.robot.joints
        )
    worst = dict(constraints.usage(motion.q, motion.dq, motion.ddq, times).worst)
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
    worst: dict[str, limits.Worst], constraints: MotionConstraints, ends: Extremes
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
    motion: JointMotion,
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

    trajectory: Trajectory
    ends: Extremes

    def _fastest(self, motion: JointMotion, half: float) -> Array:
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
        self, bodies: CollisionBodies, pairs: JudgedPairs, t: Array, half: float
    ) -> tuple[Array, Array]:
        """The least room, and what it cannot fall below: no body moves faster than its reach."""
        motion = self.trajectory.evaluate(t)
        way = half * self._fastest(motion, half)
        found = bodies.nearest(motion.q, pairs, travel=self.ends.travel, way=way)
        return found.room, found.bound
