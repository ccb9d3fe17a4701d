"""Torque ripple of gears, found by the waves that a fit leaves over their joints' positions."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise, product

import numpy as np

from dynid.core import Array
from dynid.identification import least_squares, problem
from dynid.reduction import reduce_model
from dynid.regressor import Gear, InverseDynamicModel, TorqueRipple
from dynid.signals import NYQUIST_SHARE, Samples

FEWEST_WAVES, MOST_WAVES = 40.0, 5000.0
"""Slower waves look like gravity and friction: gears of arms turn their motors 30 to 160 times, and
motors cog some 50 times a turn."""
GAIN = 0.01
"""A gear must lower the logarithm of a joint's held-out RMS by this much."""
FAMILIES = ((1.0,), (0.5, 1.0), (1.0, 2.0), (0.5, 1.0, 2.0))
"""Waves over the strongest: once a turn of the motor, twice, four times."""
POWERS = (1, 2, 3, 4, 5)
"""Numbers of powers of the speed that are tried."""
CLEAR_PEAK = 30.0
"""Power of a wave over the median beside it from which it is a gear's: noise and stiction, the
strongest of a thousand waves, reach 10 to 20; gears of a Franka 40 to 260."""
WEAK_PEAK = 10.0
"""The same for a joint with the wave of another joint's clear peak: a gear of the same size."""
NEIGHBOURS = 0.25
"""How far beside a wave, as a share of it, others are its neighbours."""
FEWEST_NEIGHBOURS = 8
ALIKE = 1.03
"""Ratio of waves that belong to gears of one size."""
SPEED_SHARE = 99.0
"""Percentile of the speeds that counts as the highest."""
ROUNDS = 4
"""Searches, each in what those before leave."""
STRETCHES = 64
FEWEST_SAMPLES = 16 * STRETCHES
"""In motion."""
FOLDS = 8
"""Every eighth stretch is left out in turn: each lasts many waves, and all speeds stay seen."""
RIDGE = 1e-3
"""On the coefficients, over the trace of their products: powers of the speed are alike."""


def find_gears(
    q: Array, dq: Array, residual: Array, rate_hz: float, prismatic: Sequence[bool]
) -> list[Gear]:
    """The gears whose waves a residual contains; see `find_ripples`."""
    turning = [j for j in range(len(q)) if not prismatic[j]]
    found = {j: _peak(q[j], dq[j], residual[j], rate_hz) for j in turning}
    peaks = {j: peak for j, peak in found.items() if peak is not None}
    gears: list[Gear] = []
    for group in alike({j: wave for j, (wave, _) in peaks.items()}):
        powers = [peaks[j][1] for j in group]
        # Beside a clear peak, weaker ones of the same wave are gears of the same size.
        if max(powers) < CLEAR_PEAK:
            continue
        group = [j for j, power in zip(group, powers, strict=True) if power > WEAK_PEAK]
        parts = {j: (q[j], dq[j], residual[j]) for j in group}
        wave = _common_wave(parts, [peaks[j][0] for j in group])
        shaped = (_gear(j, q[j], dq[j], residual[j], rate_hz, wave) for j in group)
        gears += [gear for gear in shaped if gear is not None]
    return gears


def alike(waves: Mapping[int, float]) -> list[list[int]]:
    """Joints whose waves are the same within `ALIKE`: gears of one size."""
    groups: list[list[int]] = []
    for joint, wave in sorted(waves.items(), key=lambda item: item[1]):
        if groups and wave < waves[groups[-1][-1]] * ALIKE:
            groups[-1].append(joint)
        else:
            groups.append([joint])
    return groups


def _common_wave(
    signals: Mapping[int, tuple[Array, Array, Array]], waves: Sequence[float]
) -> float:
    """The wave that suits the joints of a group together: one joint's reach may not tell."""
    resolution = min(np.pi / 4 / float(np.ptp(q)) for q, _, _ in signals.values())
    grid = np.arange(min(waves) - 4 * resolution, max(waves) + 4.5 * resolution, resolution)

    def score(wave: float) -> float:
        total = 0.0
        for j, (q, dq, residual) in signals.items():
            speed = float(np.percentile(np.abs(dq), SPEED_SHARE))
            gear = Gear(joint=j, waves=(wave / 2, wave), speed=speed, powers=3)
            total += np.log(held_out([gear.columns(q, dq)], residual)[0])
        return total

    return min((float(wave) for wave in grid), key=score)


def _peak(q: Array, dq: Array, residual: Array, rate_hz: float) -> tuple[float, float] | None:
    """The strongest wave of one joint's residual, and its power over its neighbours' median."""
    grid = _waves(q, dq, rate_hz)
    if len(grid) < 2:
        return None
    power = wave_power(q, residual, grid)
    best = int(np.argmax(power))
    away = np.abs(grid - grid[best])
    beside = power[(away < NEIGHBOURS * grid[best]) & (away > 4 * np.pi / float(np.ptp(q)))]
    if len(beside) < FEWEST_NEIGHBOURS or np.median(beside) <= 0:
        return None
    return float(grid[best]), float(power[best] / np.median(beside))


def _waves(q: Array, dq: Array, rate_hz: float) -> Array:
    """Waves a turn that a recording can show, four to each that it can tell apart."""
    reach, speed = float(np.ptp(q)), float(np.percentile(np.abs(dq), SPEED_SHARE))
    if reach * FEWEST_WAVES < 4 * np.pi or speed <= 0:
        return np.zeros(0)
    highest = min(NYQUIST_SHARE * np.pi * rate_hz / speed, MOST_WAVES)
    return np.arange(FEWEST_WAVES, highest, np.pi / 2 / reach)


def _gear(
    joint: int, q: Array, dq: Array, residual: Array, rate_hz: float, wave: float
) -> Gear | None:
    """The gear of one joint, or None where its own torque shows no ripple that predicts."""
    highest = float(_waves(q, dq, rate_hz)[-1])
    speed = float(np.percentile(np.abs(dq), SPEED_SHARE))

    def score(gear: Gear) -> float:
        return held_out([gear.columns(q, dq)], residual)[0]

    shapes = [
        Gear(joint=joint, waves=waves, speed=speed, powers=powers)
        for family, powers in product(FAMILIES, POWERS)
        if (waves := tuple(wave * k for k in family if FEWEST_WAVES <= wave * k <= highest))
    ]
    best = min(shapes, key=score)
    gain = np.log(float(np.square(residual).mean()) / score(best)) / 2
    return best if gain > GAIN else None


def wave_power(q: Array, residual: Array, waves: Array) -> Array:
    """(k) power of evenly spaced waves a turn (k) in a residual (N) at positions (N)."""
    # exp(i (a + b) q) = exp(i a q) exp(i b q): few exponentials serve all waves.
    width = int(np.sqrt(len(waves))) + 1
    near = np.exp(1j * np.outer((waves[1] - waves[0]) * np.arange(width), q))
    far = residual * np.exp(1j * np.outer(waves[::width], q))
    found = (far @ near.T).ravel()[: len(waves)] / len(q)
    return np.square(np.abs(found))


def held_out(parts: Sequence[Array], residual: Array, together: int = 1) -> tuple[float, Array]:
    """Mean square error on stretches left out, and the coefficients of all.

    Of columns (k, N) of each gear that shall explain a residual (N); so many stretches in a row are
    left out `together`.
    """
    rows = np.vstack([*parts, residual])
    cuts = [k * len(residual) // STRETCHES for k in range(STRETCHES + 1)]
    products = [rows[:, a:b] @ rows[:, a:b].T for a, b in pairwise(cuts)]
    folds: list[Array] = [
        np.sum([p for i, p in enumerate(products) if i // together % FOLDS == k], axis=0)
        for k in range(FOLDS)
    ]
    total: Array = np.sum(products, axis=0)
    ridge = RIDGE * max(float(np.trace(total[:-1, :-1])), 1e-300) * np.eye(len(total) - 1)
    error = 0.0
    for fold in folds:
        rest = total - fold
        found = np.linalg.solve(rest[:-1, :-1] + ridge, rest[:-1, -1])
        error += float(fold[-1, -1] - 2 * found @ fold[:-1, -1] + found @ fold[:-1, :-1] @ found)
    values = np.linalg.solve(total[:-1, :-1] + ridge, total[:-1, -1])
    return error / len(residual), np.asarray(values, dtype=np.float64)


MOST_SAMPLES = 40_000
"""Of a longer record, every so manieth."""
SAMPLES_OF_A_WAVE = 4.0
"""At least, of means over blocks: of fewer the size of a ripple cannot be told."""
MATTERS = 1e-3
"""Ripple below this share of a joint's torque is not worth a column."""
MOVING = 0.02
"""Slower joints count as resting [rad/s]."""
ONE_PART = STRETCHES // FOLDS
"""Stretches that make one of eight parts of the record."""


def with_ripple(
    model: InverseDynamicModel, samples: Samples, estimator: least_squares.Estimator
) -> InverseDynamicModel:
    """The model with the torque ripple that lowers errors on blocks of samples left out.

    The model has none yet; it is fitted to the samples by the estimator.
    """
    if samples.torque_filter is not None:
        # What smoothed the torque has taken the ripple away.
        return model
    base = reduce_model(model)
    plain = problem.IdentificationProblem(base=base, samples=samples)
    fit = estimator.checked_fit(plain)
    predicted = model.inverse_dynamics(
        samples.q, samples.dq, samples.ddq, base.to_standard(fit.values), plain.state
    )
    residual = samples.tau + model.known_torque(samples.q) - predicted
    step = -(-samples.count // MOST_SAMPLES)
    q, dq, left = (np.array(x.T[:, ::step]) for x in (samples.q, samples.dq, residual))
    least = MATTERS * np.sqrt(np.square(samples.tau).mean(axis=0))
    found = find_ripples(q, dq, left, samples.rate_hz, model.robot.prismatic)
    ripples = tuple(one for one in found if one.torque(q, dq).std() > least[one.joint])
    return replace(model, friction=replace(model.friction, ripples=ripples))


def resolve_ripple(model: InverseDynamicModel, samples: Samples) -> Samples:
    """Samples with blocks so short that their means keep the waves of a model's ripple."""
    gears = [gear for ripple in model.friction.ripples for gear in ripple.gears]
    fastest = max((max(gear.waves) * gear.speed / (2 * np.pi) for gear in gears), default=0.0)
    if fastest == 0.0:
        return samples
    block = int(samples.rate_hz / (SAMPLES_OF_A_WAVE * fastest))
    return replace(samples, block=max(1, min(samples.block, block)))


def find_ripples(
    q: Array, dq: Array, residual: Array, rate_hz: float, prismatic: Sequence[bool]
) -> tuple[TorqueRipple, ...]:
    """Ripples that lower the errors on blocks left out.

    In a residual (n, N) [N.m] at positions and velocities (n, N) [rad, rad/s]; waves faster than
    the recording's rate shows are not seen, and joints that slide have no turns.
    """
    # At rest there is stiction, and a wave that stands still.
    moving = (np.abs(dq) > MOVING).any(axis=0)
    if np.count_nonzero(moving) < FEWEST_SAMPLES:
        return ()
    q, dq, residual = (x[:, moving] for x in (q, dq, residual))
    columns: dict[Gear, Array] = {}
    ripples: list[TorqueRipple] = []
    left = residual
    for _ in range(ROUNDS):
        # A strong wave hides others of the same joint.
        gears = find_gears(q, dq, left, rate_hz, prismatic)
        if not gears:
            break
        columns |= {gear: gear.columns(q[gear.joint], dq[gear.joint]) for gear in gears}
        found = [_ripple(j, residual[j], columns) for j in range(len(q))]
        ripples = [ripple for ripple in found if ripple is not None]
        left = residual.copy()
        for ripple in ripples:
            left[ripple.joint] -= ripple.torque(q, dq)
    return tuple(ripples)


def _ripple(joint: int, residual: Array, columns: dict[Gear, Array]) -> TorqueRipple | None:
    """Gears added to one joint's ripple as long as each lowers the error on blocks left out."""
    chosen: list[Gear] = []
    best = before = float(np.square(residual).mean())
    while len(chosen) < len(columns):
        error, gear = min(
            (
                (held_out([columns[g] for g in (*chosen, gear)], residual)[0], gear)
                for gear in columns
                if gear not in chosen
            ),
            key=lambda scored: scored[0],
        )
        if np.log(best / error) / 2 < GAIN:
            break
        chosen.append(gear)
        # Errors that last look like ripple beside themselves, but not in another part.
        lasting = held_out([columns[g] for g in chosen], residual, ONE_PART)[0]
        if lasting > before:
            chosen.pop()
            break
        best, before = error, lasting
    if not chosen:
        return None
    values = held_out([columns[gear] for gear in chosen], residual)[1]
    return TorqueRipple(joint=joint, gears=tuple(chosen), coefficients=tuple(values.tolist()))
