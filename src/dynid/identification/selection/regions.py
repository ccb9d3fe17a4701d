"""Regions of the workspace, and torque intervals that know where they are.

What predicts stretches of time inside one motion need not predict another motion: neighbours in
time lie in the same poses. Regions are clusters of poses (k-means on the sines and cosines of
the joints between the first and the last, whose angles change no gravity torque to speak of).
Intervals are wide where the recording has not been.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real
from statistics import NormalDist
from typing import Any

import numpy as np

from dynid.core import Array, Indices, InputError, Mask, Value, freeze, plain, scipy_part
from dynid.identification.bayesian import symbol_of
from dynid.identification.selection.unseen import Unseen
from dynid.robot import PARAMETERS

FINE, COARSE = 8, 4
"""Regions of the two partitions: what pays must pay on both."""
BLOCKS = 8
"""Stretches of time."""
POSES = 2000
"""Poses for the clusters, evenly spaced along the path: standing still adds none."""
ITERATIONS = 50
SLOWEST = 0.02
"""A joint moves when faster than this share of the 99th percentile of its own speed."""
MOST_ALONE = 0.8
"""Share of a joint's motion that is left out at once, at most."""
STANDING_S = 0.1
"""Joints that were slower for this long before and after stand still: others reverse [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Regions:
    """Clusters of poses.

    One partition into `FINE` and one into `COARSE` regions, or into fewer where there are
    fewer different poses.
    """

    joints: tuple[int, ...]
    """Which joints tell the regions apart."""
    sliding: Mask
    """(n) joints that slide."""
    reach: Array
    """(n) range of motion of each joint [rad or m]."""
    centres: tuple[Array, ...]
    """(k, d) centres of each partition."""

    def labels(self, q: Array, partition: int) -> Indices:
        """(N) region of each pose in a partition."""
        features = _features(q, self.joints, self.sliding, self.reach)
        return _nearest(features, self.centres[partition])


def find_regions(positions: Sequence[Array], sliding: Sequence[bool]) -> Regions:
    """The regions of recordings (N, n), whatever their order; some joints (n) slide."""
    n = positions[0].shape[1]
    joints = tuple(range(n)) if n < 4 else tuple(range(1, n - 1))
    slides = np.array(sliding, dtype=bool)
    reach = np.ptp(np.concatenate(positions), axis=0)
    paths = [_along(_features(q, joints, slides, reach), len(positions)) for q in positions]
    poses = np.concatenate(paths)
    # Sorted: the same clusters whatever the order of the recordings.
    poses = poses[np.lexsort(poses.T)]
    return Regions(
        joints=joints,
        sliding=slides,
        reach=reach,
        centres=tuple(_clusters(poses, count) for count in (FINE, COARSE)),
    )


def moving_rows(velocities: Sequence[Array], rate_hz: float) -> list[Mask]:
    """(N, n) of each recording where joints move or reverse; elsewhere friction hides the torque.

    By velocities (N, n) of all: a joint that stands still in one of them shows its noise alone.
    """
    speeds = [np.abs(dq) for dq in velocities]
    slowest = SLOWEST * np.maximum(np.percentile(np.concatenate(speeds), 99, axis=0), 1e-9)
    # Stamps give rates like 100.0000001.
    span = 2 * int(np.ceil(STANDING_S * rate_hz - 1e-6)) + 1
    fastest = scipy_part("ndimage").maximum_filter1d
    return [fastest(speed, span, axis=0) > slowest for speed in speeds]


def stretches(rows: int) -> Indices:
    """(N) stretch of time of each row."""
    return np.arange(rows) * BLOCKS // max(rows, 1)


def alone(parts: Indices, moves: Mask) -> tuple[int, ...]:
    """Parts that hold more of the motion of a joint than may be left out at once.

    Of several parts (N), with whether joints move (N, n).
    """
    total, found = np.maximum(moves.sum(axis=0), 1), np.unique(parts)
    shares = [(moves[parts == part].sum(axis=0) / total).max() for part in found]
    return tuple(int(p) for p, s in zip(found, shares, strict=True) if s > MOST_ALONE)


def divided(parts: Indices, moves: Mask, recordings: Indices) -> Indices:
    """(N) parts to leave out, halved where the rest would not show the friction of a joint.

    Where recordings move one joint each, what is left of them knows nothing of the others.

    Args:
        parts: (N) which part each row is in; one alone stays whole.
        moves: (N, n) whether joints move.
        recordings: (N) which recording each row is of: each is halved in time, whatever their
            order.
    """
    found, part, total = parts.copy(), 0, np.maximum(moves.sum(axis=0), 1)
    while parts.any() and part <= found.max():
        here = np.flatnonzero(found == part)
        own = moves[here]
        j = int(np.argmax(own.sum(axis=0) / total))
        later = np.zeros(len(here), dtype=bool)
        for which in np.unique(recordings[here]):
            rows = np.flatnonzero(recordings[here] == which)
            seen = own[rows, j].cumsum()
            later[rows] = seen > seen[-1] / 2
        halves = own[later, j].sum(), own[~later, j].sum()
        if sum(halves) > MOST_ALONE * total[j] and min(halves) > 0:
            found[here[later]] = found.max() + 1
        else:
            part += 1
    return found


def _features(q: Array, joints: tuple[int, ...], sliding: Mask, reach: Array) -> Array:
    parts: list[Array] = []
    for j in joints:
        if sliding[j]:
            parts.append(2.0 * q[:, j] / max(float(reach[j]), 1e-9))
        else:
            parts += [np.sin(q[:, j]), np.cos(q[:, j])]
    return np.stack(parts, axis=1)


def _along(features: Array, recordings: int) -> Array:
    """Poses evenly spaced along a path."""
    path = np.concatenate([[0.0], np.linalg.norm(np.diff(features, axis=0), axis=1).cumsum()])
    steps = np.floor(path / max(path[-1], 1e-12) * POSES / recordings)
    return features[np.unique(steps, return_index=True)[1]]


def _clusters(poses: Array, count: int) -> Array:
    """(k, d) centres of k-means, started from poses as far from each other as possible."""
    away = np.square(poses - poses.mean(axis=0)).sum(axis=1)
    chosen: list[Array] = []
    for _ in range(count):
        # What lies within a millionth of a turn of a centre is the same pose.
        if away.max() < 1e-12:
            break
        chosen.append(poses[int(np.argmax(away))])
        own = np.square(poses - chosen[-1]).sum(axis=1)
        away = own if len(chosen) == 1 else np.minimum(away, own)
    centres = np.array(chosen) if chosen else poses[:1]
    for _ in range(ITERATIONS):
        nearest = _nearest(poses, centres)
        moved = np.array(
            [poses[nearest == k].mean(axis=0) for k in range(len(centres)) if (nearest == k).any()]
        )
        if moved.shape == centres.shape and np.allclose(moved, centres, atol=1e-9):
            break
        centres = moved
    return centres


def _nearest(features: Array, centres: Array) -> Indices:
    squares = np.square(centres).sum(axis=1) - 2.0 * features @ centres.T
    return np.argmin(squares, axis=1)


LEVELS = (0.5, 0.68, 0.8, 0.9, 0.95, 0.99)
"""Levels whose quantiles are kept; others lie on straight lines between."""
FRICTION_CHANGE, GAIN_CHANGE = 0.1, 0.05
"""Standard deviation of friction and of drive gains between days: gains regressed from two
recordings of one UR5 differ by 1 to 20 %."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TorqueInterval(Value):
    """Torque intervals that grow where the recording has not been.

    s^2 = sigma^2 + c^2 h with the leverage h = |root' x|^2 of a state's columns x. The half width
    is a quantile of |error| / s on the regions left out (split conformal prediction), of rows in
    motion and at rest apart; at rest never less than stiction may hold, and of the leverage never
    a smaller one than that of normal errors: sigma may be that of the other rows. What friction and
    drive gains of another day may change, and the noise of single samples, are added in square.
    """

    root: Array
    """(r, k) root of the uncertainty of the base parameters: their information, what is unsure
    of the published inertias, and what near-equal models differ by."""
    sigma: Array
    """(n) RMS error on stretches of time left out [N.m or N]."""
    scale: Array
    """(n) c."""
    slowest: Array
    """(n) speed from which a joint moves [rad/s or m/s]."""
    quantiles: Array
    """(2, n, L) of |error| / s at `LEVELS`, at rest and in motion."""
    averaged: Array
    """(n) deviation of the noise that single samples have beyond the fitted means over blocks and
    periods [N.m or N]."""

    def __post_init__(self) -> None:
        n = len(self.sigma)
        freeze(self, root=(None, None), sigma=(n,), scale=(n,), slowest=(n,), averaged=(n,))
        freeze(self, quantiles=(2, n, len(LEVELS)))

    def half_width(
        self,
        names: Sequence[str],
        values: Array,
        columns: Array,
        motion: tuple[Array, Array],
        unseen: Unseen,
        level: float,
    ) -> Array:
        """(n, N) half widths [N.m or N] of the intervals of states.

        Args:
            names: (r) of the base parameters.
            values: (r) base parameters.
            columns: (r, n, N) base columns of the states.
            motion: (n, N) their velocities and accelerations, in SI units.
            unseen: What the recording could not show.
            level: Share of measured torques that shall lie within, 0.5 to 0.99.

        Raises:
            InputError: A level outside `LEVELS`.
        """
        if not (isinstance(level, Real) and LEVELS[0] <= level <= LEVELS[-1]):
            raise InputError(
                "level of an interval", value=level, limit=f"{LEVELS[0]} to {LEVELS[-1]}"
            )
        dq, ddq = motion
        inertial = {"Im", "Imm", *PARAMETERS}
        rubs = [k for k, name in enumerate(names) if symbol_of(name) not in inertial]
        friction = np.tensordot(values[rubs], columns[rubs], axes=1)
        torque = np.tensordot(values, columns, axes=1)
        stiction = np.zeros(torque.shape)
        for k in rubs:
            if symbol_of(names[k]) == "Fc":
                j = int(names[k][2:]) - 1
                # Where the Coulomb column is not saturated, friction holds what it is given.
                stiction[j] = abs(values[k]) * np.sqrt(np.maximum(1.0 - columns[k, j] ** 2, 0.0))
        rest, moved = np.array(
            [[np.interp(level, LEVELS, row) for row in part] for part in self.quantiles],
            dtype=np.float64,
        )
        # As arithmetic: the type of `where` is not known to checkers.
        factor = rest[:, None] + (np.abs(dq) > self.slowest[:, None]) * (moved - rest)[:, None]
        normal = NormalDist().inv_cdf((1.0 + level) / 2.0)
        # A share of sigma that errs less in motion than at rest says nothing of the parameters.
        unsure = np.maximum(factor, normal) * self.scale[:, None]
        unsure = np.square(unsure) * leverage(self.root, columns)
        # Friction at rest is anywhere between its bounds.
        half = np.sqrt(np.square(factor * self.sigma[:, None]) + unsure)
        half = np.maximum(half, level * stiction)
        change = np.hypot(FRICTION_CHANGE * friction, GAIN_CHANGE * torque)
        hidden = unseen.deviation(dq, ddq, friction, self.sigma)
        beside = np.sqrt(change**2 + hidden**2 + self.averaged[:, None] ** 2)
        return np.hypot(half, normal * beside)

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return plain(self) | {"levels": list(LEVELS)}


def leverage(root: Array, columns: Array) -> Array:
    """(n, N) |root' x|^2 for columns (r, n, N)."""
    return np.square(np.tensordot(root, columns, axes=(0, 0))).sum(axis=0)
