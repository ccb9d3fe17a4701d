"""The motion without its noise, for estimators that need one."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from dynid.core.arrays import Array, Indices
from dynid.core.errors import InputError
from dynid.signals.derivatives import derivative
from dynid.signals.filters import low_pass, motion_bandwidth
from dynid.signals.samples import Samples

BANDWIDTH_FACTOR = 4.0
"""Cut-off of the smooth motion over the motion's own bandwidth: the motion passes whole."""
LOWEST_HZ = 1.0
SETTLED = 1.0
"""Periods of that cut-off at both ends that the filter spoils."""
GAP = 1.5
"""Steps in time longer than this many samples part two records."""


def smooth_motion(samples: Samples) -> tuple[Samples, Indices]:
    """The motion low-passed near its own bandwidth, far below the cut-off of the samples.

    Args:
        samples: The samples; several records are smoothed one by one.

    Returns:
        Samples with smooth q, dq, ddq, same torques; and the indices where the filter has
        settled, whole blocks of the samples.

    Raises:
        InputError: Too few samples remain.
    """
    rate, block = samples.rate_hz, samples.block
    q, dq, ddq = np.array(samples.q), np.array(samples.dq), np.array(samples.ddq)
    kept: list[Indices] = []
    for part in segments(samples.t, rate):
        cutoff = smooth_cutoff(samples.q[part], rate)
        q[part] = low_pass(samples.q[part], rate, cutoff)
        dq[part] = derivative(q[part], rate, "central", cutoff)
        ddq[part] = derivative(dq[part], rate, "central", cutoff)
        edge = int(np.ceil(SETTLED * rate / cutoff))
        inner: Indices = np.arange(part.start + edge, part.stop - edge, dtype=np.intp)
        kept.append(inner[: len(inner) // block * block])
    indices = np.concatenate(kept)
    if len(indices) < 16 * block:
        raise InputError(
            "the record is too short to smooth its motion",
            value=f"{samples.count} samples",
            next_step="Use --estimator wls, or a longer record.",
        )
    return replace(samples, q=q, dq=dq, ddq=ddq), indices


def smooth_cutoff(q: Array, rate_hz: float) -> float:
    """Cut-off [Hz] of the smooth motion."""
    return max(BANDWIDTH_FACTOR * motion_bandwidth(q, rate_hz), LOWEST_HZ)


def segments(t: Array, rate_hz: float) -> list[slice]:
    """Stretches without gaps."""
    cuts = np.flatnonzero(np.diff(t) > GAP / rate_hz) + 1
    edges = [0, *cuts.tolist(), len(t)]
    return [slice(a, b) for a, b in itertools.pairwise(edges)]


def picked(samples: Samples, indices: Indices) -> Samples:
    """The samples at some indices."""
    return replace(
        samples,
        t=samples.t[indices],
        q=samples.q[indices],
        dq=samples.dq[indices],
        ddq=samples.ddq[indices],
        tau=samples.tau[indices],
    )
