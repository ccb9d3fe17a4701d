"""Which input of an identification does not fit its record: a gain, a sign, the mounting.

A wrong drive gain leaves the fit of its own joint perfect, but the same bodies load several
joints: their torques have to agree. Each suspicion has to explain what is left of the record, to
hold whichever stretch is left out, and to be large enough to matter.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.core.arrays import Array
from dynid.identification.conditioning import ILL_CONDITIONED
from dynid.identification.estimate import Estimate
from dynid.signals.samples import Samples
from dynid.validation.profile import (
    STRETCHES,
    Inputs,
    Objective,
    Profile,
    jackknife,
    minimum,
    profile_of,
)

EXPLAINED = 0.07
"""Drop of the sum of log noises that makes a gain or a tilt worth a look."""
EXPLAINED_BY_SIGN = 0.3
"""... and a sign: a stronger word."""
CERTAIN = 7.0
"""Distance from what was told, in standard deviations from leaving stretches out: few stretches,
many joints to choose from."""
LEAST_GAIN = 0.05
"""Gains are never known much better."""
LEAST_TILT_DEG = 0.5
WIDEST_LOG_GAIN = 0.8
"""Gains are looked for within a factor of 2.2."""
WIDEST_TILT = 0.5
"""A base stands elsewhere then, and `implausible_gravity` says so."""
AS_LIKELY = 0.75
"""Share of the best explanation from which another joint is named as well."""
MOST = 3
"""Wrong inputs that are looked for one after the other."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Suspicion:
    """One input that does not fit."""

    kind: str
    """`gain`, `sign` or `mounting`."""
    joint: int | None
    """Its joint; None for the mounting."""
    inputs: Inputs
    """What fits instead."""
    value: float
    """Factor on the torque, or the tilt [deg]."""
    std: float
    """Standard deviation of the value."""
    explained: float
    """Drop of the sum of log noises."""
    others: tuple[tuple[int, float], ...] = ()
    """(joint, factor) of gains that explain nearly as much."""


def suspects(estimate: Estimate, samples: Samples) -> tuple[Suspicion, ...]:
    """Look for wrong gains, signs and mountings in the record of an identification.

    Args:
        estimate: The estimate.
        samples: The samples that it was fitted to.

    Returns:
        The strongest first; nothing where the motion tells too little apart.
    """
    small = samples.count // samples.block < 4 * STRETCHES
    if small or estimate.motion_condition_number > ILL_CONDITIONED:
        return ()
    profile = profile_of(estimate.model, samples)
    now = Inputs(scales=np.ones(samples.joints))
    found: list[Suspicion] = []
    for _ in range(MOST):
        strongest = _strongest(profile, now)
        if strongest is None:
            break
        found.append(strongest)
        now = strongest.inputs
    return tuple(found)


def _strongest(profile: Profile, now: Inputs) -> Suspicion | None:
    sums = profile.without()
    left, weights = profile.log_noise(sums, now)
    left, weights = profile.log_noise(sums, now, weights)
    joints = len(now.scales)
    gains: list[tuple[float, int, Array]] = []
    signs: list[tuple[float, int]] = []
    for j in range(joints):
        objective = _gain_objective(profile, now, weights, j)
        step = minimum(objective, sums, np.zeros(1), WIDEST_LOG_GAIN)
        gains.append((left - objective(sums, step), j, step))
        signs.append((left - profile.log_noise(sums, _reversed(now, j), weights)[0], j))
    tilt = _tilt_objective(profile, now, weights)
    lean = minimum(tilt, sums, now.tilt, WIDEST_TILT)
    drop = left - tilt(sums, lean)
    candidates = [
        (max(signs)[0] if max(signs)[0] > EXPLAINED_BY_SIGN else 0.0, "sign"),
        (max(gains, key=lambda g: g[0])[0], "gain"),
        (drop, "mounting"),
    ]
    # What explains most comes first; a weaker one may still be certain where it is not.
    for explained, kind in sorted(candidates, reverse=True):
        if explained < EXPLAINED:
            return None
        if kind == "sign":
            found = _sign(profile, now, weights, left, max(signs)[1])
        elif kind == "gain":
            found = _gain(profile, now, weights, gains)
        else:
            found = _lean(profile, now, tilt, lean, explained)
        if found is not None:
            return found
    return None


def _sign(
    profile: Profile, now: Inputs, weights: Array, left: float, joint: int
) -> Suspicion | None:
    turned = _reversed(now, joint)
    drops: list[float] = []
    for k in range(STRETCHES):
        sums = profile.without(k)
        drops.append(
            profile.log_noise(sums, now, weights)[0] - profile.log_noise(sums, turned, weights)[0]
        )
    if min(drops) < EXPLAINED_BY_SIGN / 2:
        return None
    explained = left - profile.log_noise(profile.without(), turned, weights)[0]
    return Suspicion(
        kind="sign", joint=joint, inputs=turned, value=-1.0, std=0.0, explained=explained
    )


def _gain(
    profile: Profile, now: Inputs, weights: Array, gains: list[tuple[float, int, Array]]
) -> Suspicion | None:
    explained, joint, step = max(gains, key=lambda g: g[0])
    objective = _gain_objective(profile, now, weights, joint)
    spread = float(jackknife(profile, objective, step, WIDEST_LOG_GAIN)[0, 0]) ** 0.5
    size = float(step[0])
    if abs(size) < max(CERTAIN * spread, LEAST_GAIN) or abs(size) > 0.98 * WIDEST_LOG_GAIN:
        return None
    others = tuple(
        (j, float(np.exp(other[0])))
        for drop, j, other in sorted(gains, key=lambda g: -g[0])
        if j != joint and drop > AS_LIKELY * explained
    )
    scales = np.array(now.scales)
    scales[joint] *= np.exp(size)
    return Suspicion(
        kind="gain",
        joint=joint,
        inputs=replace(now, scales=scales),
        value=float(np.exp(size)),
        std=float(np.exp(size)) * spread,
        explained=explained,
        others=others,
    )


def _lean(
    profile: Profile, now: Inputs, objective: Objective, lean: Array, explained: float
) -> Suspicion | None:
    covariance = jackknife(profile, objective, lean, WIDEST_TILT)
    change = lean - now.tilt
    size = float(np.linalg.norm(change))
    direction = change / max(size, 1e-12)
    spread = float(np.sqrt(direction @ covariance @ direction))
    if (
        size < max(CERTAIN * spread, np.radians(LEAST_TILT_DEG))
        or np.abs(lean).max() > 0.98 * WIDEST_TILT
    ):
        return None
    return Suspicion(
        kind="mounting",
        joint=None,
        inputs=replace(now, tilt=lean),
        value=float(np.degrees(np.arctan(np.linalg.norm(lean)))),
        std=float(np.degrees(spread)),
        explained=explained,
    )


def _reversed(now: Inputs, joint: int) -> Inputs:
    scales = np.array(now.scales)
    scales[joint] *= -1
    return replace(now, scales=scales)


def _gain_objective(profile: Profile, now: Inputs, weights: Array, joint: int) -> Objective:
    def objective(sums: Array, step: Array) -> float:
        scales = np.array(now.scales)
        scales[joint] *= np.exp(step[0])
        return profile.log_noise(sums, replace(now, scales=scales), weights)[0]

    return objective


def _tilt_objective(profile: Profile, now: Inputs, weights: Array) -> Objective:
    def objective(sums: Array, tilt: Array) -> float:
        return profile.log_noise(sums, replace(now, tilt=tilt), weights)[0]

    return objective
