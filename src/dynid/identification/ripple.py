"""Torque ripple of gears, found in what a fit leaves over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynid.core.arrays import Array
from dynid.identification.gear_waves import FOLDS, GAIN, STRETCHES, find_gears, held_out
from dynid.identification.least_squares import WeightedLeastSquares
from dynid.identification.problem import IdentificationProblem
from dynid.reduction.base import reduce_model
from dynid.regressor.model import InverseDynamicModel
from dynid.regressor.ripple import Gear, TorqueRipple
from dynid.signals.samples import Samples

MOST_SAMPLES = 40_000
"""Of a longer record, every so manieth."""
MATTERS = 1e-3
"""Ripple below this share of a joint's torque is not worth a column."""
MOVING = 0.02
"""Slower joints count as resting [rad/s]."""
ONE_PART = STRETCHES // FOLDS
"""Stretches that make one of eight parts of the record."""


def with_ripple(
    model: InverseDynamicModel, samples: Samples, prior_gain: float | None
) -> InverseDynamicModel:
    """The model with the torque ripple that samples show, where leaving blocks out bears it out.

    Args:
        model: A model without ripple.
        samples: The samples that it will be fitted to.
        prior_gain: See `WeightedLeastSquares`.
    """
    if samples.torque_filter is not None:
        # What smoothed the torque has taken the ripple away.
        return model
    base = reduce_model(model)
    problem = IdentificationProblem(base=base, samples=samples)
    fit = WeightedLeastSquares(prior_gain=prior_gain).fit(problem)
    parameters = np.zeros(len(model.columns))
    parameters[list(base.independent)] = fit.values
    motion = (samples.q, samples.dq, samples.ddq)
    predicted = model.inverse_dynamics(*motion, parameters, problem.state)
    residual = samples.tau + model.known_torque(samples.q) - predicted
    step = -(-samples.count // MOST_SAMPLES)
    q, dq, left = (np.array(x.T[:, ::step]) for x in (samples.q, samples.dq, residual))
    least = MATTERS * np.sqrt(np.square(samples.tau).mean(axis=0))
    ripples = tuple(
        ripple
        for ripple in find_ripples(q, dq, left, samples.rate_hz, model.robot.prismatic)
        if ripple.torque(q, dq).std() > least[ripple.joint]
    )
    return InverseDynamicModel(
        robot=model.robot, frames=model.frames, friction=replace(model.friction, ripples=ripples)
    )


def find_ripples(
    q: Array, dq: Array, residual: Array, rate_hz: float, prismatic: Sequence[bool]
) -> tuple[TorqueRipple, ...]:
    """Ripples that lower the errors on blocks left out.

    Args:
        q: (n, N) positions [rad].
        dq: (n, N) velocities [rad/s].
        residual: (n, N) what a fit left over [N.m].
        rate_hz: Rate of the recording: faster waves are not seen.
        prismatic: (n) joints that slide have no turns.
    """
    # At rest there is stiction, and a wave that stands still.
    moving = (np.abs(dq) > MOVING).any(axis=0)
    if np.count_nonzero(moving) < STRETCHES**2:
        return ()
    q, dq, residual = (x[:, moving] for x in (q, dq, residual))
    gears = find_gears(q, dq, residual, rate_hz, prismatic)
    columns = {gear: gear.columns(q[gear.joint], dq[gear.joint]) for gear in gears}
    found = [_ripple(j, residual[j], columns) for j in range(len(q))]
    return tuple(ripple for ripple in found if ripple is not None)


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
