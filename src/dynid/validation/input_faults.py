"""Which input of an identification does not fit its record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, cast

import numpy as np

from dynid.core import Array
from dynid.identification import ILL_CONDITIONED, Estimate, block_mean, chunk_size, motion_state
from dynid.reduction import reduce_model
from dynid.regressor import FrictionTerms, InverseDynamicModel
from dynid.signals import Samples

STRETCHES = 8
"""Contiguous parts of a record that are left out in turn."""
MOST_ROWS = 2500
"""Rows a joint; longer records are averaged, torques and columns alike."""
_GENERAL_TILT = 0.2
_RIDGE = 1e-8
_SWEEPS = 3
_FIRST_STEP = 0.05

Objective = Callable[[Array, Array], float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Inputs:
    """What a record is told about its robot, and what might be wrong with it."""

    scales: Array
    """(n) factor by which each joint's torque was recorded too large; negative: reversed."""
    tilt: Array = field(default_factory=lambda: np.zeros(2))
    """(2) gravity along the two axes across the mounting's, as a share of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """Products of one record's columns and torques, by stretch."""

    products: Array
    """(STRETCHES, n, 3r + 1, 3r + 1): columns, the same for gravity along each axis, torque."""
    rank: int
    """r, base parameters of the robot in any gravity."""
    rows: int
    """Rows a joint."""
    axes: Array
    """(2, 3) unit vectors across the mounting's gravity, base frame."""

    def without(self, stretch: int | None = None) -> Array:
        """(n, 3r + 1, 3r + 1) sums over all stretches, or all but one."""
        total = self.products.sum(axis=0)
        return total if stretch is None else total - self.products[stretch]

    def log_noise(
        self, sums: Array, inputs: Inputs, weights: Array | None = None
    ) -> tuple[float, Array]:
        """Sum over joints of the log of the noise that the best parameters leave.

        Args:
            sums: From `without`.
            inputs: The hypothesis.
            weights: (n) weight of each joint to start from [1/(N.m)].

        Returns:
            The sum [log N.m], and (n) the weights found.
        """
        matrix, vector, energy = self._systems(sums, inputs)
        if weights is None:
            weights = 1.0 / np.sqrt(np.maximum(energy / self.rows, 1e-18))
        square = energy
        for _ in range(_SWEEPS):
            values = _solution(np.square(weights), matrix, vector)
            explained = np.einsum("i,jik,k->j", values, matrix, values) - 2 * vector @ values
            square = np.maximum((energy + explained) / self.rows, 1e-12 * energy / self.rows)
            weights = 1.0 / np.sqrt(np.maximum(square, 1e-18))
        return -float(np.log(weights).sum()), weights

    def _systems(self, sums: Array, inputs: Inputs) -> tuple[Array, Array, Array]:
        r = self.rank
        matrix, vector = sums[:, :r, :r], sums[:, :r, -1]
        if inputs.tilt.any():
            # Block by block: the columns are those without tilt and two shares of gravity's.
            share = np.append(1.0, inputs.tilt)
            blocks = sums[:, :-1, :-1].reshape(-1, 3, r, 3, r)
            matrix = np.zeros((len(sums), r, r))
            for a in range(3):
                for b in range(3):
                    matrix += share[a] * share[b] * blocks[:, a, :, b]
            vector = np.tensordot(sums[:, :-1, -1].reshape(-1, 3, r), share, axes=(1, 0))
        scales = inputs.scales
        return np.square(scales)[:, None, None] * matrix, scales[:, None] * vector, sums[:, -1, -1]


def _solution(weights: Array, matrix: Array, vector: Array) -> Array:
    total = np.tensordot(weights, matrix, axes=1)
    diagonal = np.diag(total)
    # Parameters that only a tilted base shows have no columns without one.
    seen = diagonal > 1e-14 * diagonal.max()
    scale = np.where(seen, 1.0 / np.sqrt(np.where(seen, diagonal, 1.0)), 0.0)
    system = total * np.outer(scale, scale) + np.diag(np.where(seen, _RIDGE, 1.0))
    solved = np.linalg.solve(system, (weights @ vector) * scale)
    return np.asarray(solved * scale, dtype=np.float64)


def profile_of(model: InverseDynamicModel, samples: Samples) -> Profile:
    """Sum the products of a record.

    Args:
        model: The model that was identified.
        samples: The samples that it was identified from.
    """
    robot = model.robot
    size, axes = float(np.linalg.norm(robot.gravity)), across(robot.gravity)
    # Tilted at random, the base set holds all that any gravity shows.
    turned = replace(robot, gravity=robot.gravity + _GENERAL_TILT * size * (axes[0] + axes[1] / 2))
    columns = reduce_model(replace(model, robot=turned)).independent
    # Gravity's share of the columns: no friction, nothing moves.
    still = [
        InverseDynamicModel(
            robot=replace(robot, gravity=size * axis),
            frames=model.frames,
            friction=FrictionTerms(terms=(("fv", None),)),
        )
        for axis in axes
    ]
    state = motion_state(model, samples)
    block = max(samples.block, -(-samples.count // MOST_ROWS))
    used = samples.rows
    rows = (used.stop - used.start) // block
    width = 3 * len(columns) + 1
    products = np.zeros((STRETCHES, robot.joints, width, width))
    cuts = [used.start + k * rows // STRETCHES * block for k in range(STRETCHES + 1)]
    step = max(1, chunk_size(samples) // block) * block
    for k, (start, stop) in enumerate(pairwise(cuts)):
        for first in range(start, stop, step):
            part = slice(first, min(first + step, stop))
            values = _columns(model, still, columns, samples, part, state)
            values = block_mean(values, block)
            for j in range(robot.joints):
                products[k, j] += values[:, j] @ values[:, j].T
    return Profile(products=products, rank=len(columns), rows=rows, axes=axes)


def _columns(
    model: InverseDynamicModel,
    still: list[InverseDynamicModel],
    columns: tuple[int, ...],
    samples: Samples,
    part: slice,
    state: Array | None,
) -> Array:
    """(3r + 1, n, T) columns, those of gravity along both axes, torque."""
    wide, inner = samples.surroundings(part)
    q = samples.q[wide]
    rest = np.zeros_like(q)
    chosen = list(columns)
    inertial = [c for c in chosen if c < 10 * model.robot.joints]
    now = None if state is None else state[:, wide]
    stacks = [model.stack(q, samples.dq[wide], samples.ddq[wide], state=now)[chosen]]
    for other in still:
        gravity = np.zeros_like(stacks[0])
        gravity[: len(inertial)] = other.stack(q, rest, rest)[inertial]
        stacks.append(gravity)
    stacks.append(model.known_torque(q).T[None])
    values = samples.as_recorded(np.concatenate(stacks), wide)[..., inner]
    values[-1] += samples.tau[part].T
    return values


def across(gravity: Array) -> Array:
    """(2, 3) unit vectors at right angles to gravity and to each other, as `Profile.axes`."""
    down = gravity / np.linalg.norm(gravity)
    near = np.eye(3)[int(np.argmin(np.abs(down)))]
    first = np.cross(down, near)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(down, first)], dtype=np.float64)


def minimum(objective: Objective, sums: Array, start: Array, widest: float) -> Array:
    """(m) where an objective of m inputs is smallest, within +-widest of zero.

    Args:
        objective: Takes sums of products and (m) inputs.
        sums: From `Profile.without`.
        start: (m) where to start.
        widest: Bound on each input.
    """
    from scipy.optimize import (  # pyright: ignore[reportMissingTypeStubs]
        minimize,  # pyright: ignore[reportUnknownVariableType]
    )

    size = len(start)

    def value(x: Array) -> float:
        return objective(sums, x)

    found = cast("Any", minimize)(
        value,
        start,
        method="Nelder-Mead",
        bounds=[(-widest, widest)] * size,
        options={
            "xatol": 2e-4,
            "fatol": 1e-6,
            "maxiter": 60,
            "initial_simplex": np.vstack([start, start + _FIRST_STEP * np.eye(size)]),
        },
    )
    return np.asarray(found.x, dtype=np.float64)


def jackknife(profile: Profile, objective: Objective, best: Array, widest: float) -> Array:
    """(m, m) covariance of a minimum, from leaving out one stretch after the other."""
    minima = np.array(
        [minimum(objective, profile.without(k), best, widest) for k in range(STRETCHES)]
    )
    away = minima - minima.mean(axis=0)
    return np.asarray((STRETCHES - 1) / STRETCHES * away.T @ away, dtype=np.float64)


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
