"""Regions of the workspace, and which rows of a recording lie in which.

What predicts stretches of time inside one motion need not predict another motion: neighbours in
time lie in the same poses. Regions are clusters of poses (k-means on the sines and cosines of
the joints between the first and the last, whose angles change no gravity torque to speak of).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynid.core import Array, Indices, Mask, scipy_part

FINE, COARSE = 8, 4
"""Regions of the two partitions: what pays must pay on both."""
BLOCKS = 8
"""Stretches of time."""
POSES = 2000
"""Poses for the clusters, evenly spaced along the path: standing still adds none."""
ITERATIONS = 50
SLOWEST = 0.02
"""A joint moves when faster than this share of the 99th percentile of its own speed."""
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

    def features(self, q: Array) -> Array:
        """(N, d) of positions (N, n)."""
        return _features(q, self.joints, self.sliding, self.reach)

    def labels(self, q: Array, partition: int) -> Indices:
        """(N) region of each pose in a partition."""
        return _nearest(self.features(q), self.centres[partition])


def find_regions(positions: Sequence[Array], sliding: Sequence[bool]) -> Regions:
    """The regions of recordings, whatever their order.

    Args:
        positions: (N, n) positions of each recording.
        sliding: (n) joints that slide.
    """
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


def moving_rows(dq: Array, rate_hz: float) -> Mask:
    """(N, n) where joints move or reverse; where they stand, friction hides the torque.

    Args:
        dq: (N, n) velocities [rad/s or m/s].
        rate_hz: Rate of the samples.
    """
    speed = np.abs(dq)
    span = 2 * int(np.ceil(STANDING_S * rate_hz)) + 1
    fastest: Array = scipy_part("ndimage").maximum_filter1d(speed, span, axis=0)
    return np.asarray(fastest > SLOWEST * np.maximum(np.percentile(speed, 99, axis=0), 1e-9))


def stretches(rows: int) -> Indices:
    """(N) stretch of time of each row."""
    return np.arange(rows) * BLOCKS // max(rows, 1)


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
