"""Exact derivatives of torques and of the regressor by the motion, batched over samples.

Reverse mode: a weighted sum is differentiated by all positions, velocities and accelerations in
one pass, whatever the weights. Coulomb steps of the paper's width have slopes that say little;
`InverseDynamicModel.with_coulomb_width` gives a model with wider ones.
"""

from __future__ import annotations

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.regressor.adjoint_regressor import regressor_pullback
from dynid.regressor.adjoint_torque import torque_pullback
from dynid.regressor.inertial import every_row
from dynid.regressor.inertial_kernel import LANES
from dynid.regressor.model import InverseDynamicModel
from dynid.regressor.trigonometry import turns

Gradient = tuple[Array, Array, Array]
"""Derivatives by q, dq and ddq, each (N, n)."""


def torque_adjoint(
    model: InverseDynamicModel,
    q: Array,
    dq: Array,
    ddq: Array,
    parameters: Array,
    multipliers: Array,
) -> Gradient:
    """The gradient of sum(multipliers * inverse_dynamics(q, dq, ddq, parameters)).

    Args:
        model: The inverse dynamic model.
        q: (N, n) positions [rad or m].
        dq: (N, n) velocities.
        ddq: (N, n) accelerations.
        parameters: (p) standard parameters.
        multipliers: (N, n) weight of each torque.

    Returns:
        Derivatives by q, dq and ddq, each (N, n).

    Raises:
        InputError: Shapes that do not fit the model or each other, columns without a derivative.
    """
    n = model.robot.joints
    samples = len(q)
    _check("parameters", parameters, (len(model.columns),))
    _check("multipliers", multipliers, (samples, n))
    state = _state(model, q, dq, ddq)
    weights = np.zeros((n, state.shape[2]))
    weights[:, :samples] = multipliers.T
    out = np.zeros(state.shape)
    constants = model.constants
    torque_pullback(
        constants.geometry,
        constants.screws,
        constants.gravity,
        np.array(parameters[: 10 * n], dtype=np.float64).reshape(n, 10),
        turns(state[0]),
        state,
        weights,
        out,
    )
    # One term of the weighted sum for each column: its parameter times the multipliers.
    pull_blocks(model, state, parameters[10 * n :, None, None] * weights, out)
    return _by_sample(out, samples)


def regressor_adjoint(
    model: InverseDynamicModel, q: Array, dq: Array, ddq: Array, weights: Array
) -> Gradient:
    """The gradient of sum(weights * stack(q, dq, ddq)).

    Args:
        model: The inverse dynamic model.
        q: (N, n) positions [rad or m].
        dq: (N, n) velocities.
        ddq: (N, n) accelerations.
        weights: (p, n, N) weight of each entry: column, joint row, sample.

    Returns:
        Derivatives by q, dq and ddq, each (N, n).

    Raises:
        InputError: Shapes that do not fit the model or each other, columns without a derivative.
    """
    n = model.robot.joints
    samples = len(q)
    _check("weights", weights, (len(model.columns), n, samples))
    state = _state(model, q, dq, ddq)
    rows = np.zeros((10 * n, n, state.shape[2]))
    rows[:, :, :samples] = weights[: 10 * n]
    out = np.zeros(state.shape)
    constants = model.constants
    regressor_pullback(
        constants.geometry,
        constants.screws,
        constants.gravity,
        turns(state[0]),
        state,
        rows.reshape(10 * n * n, -1),
        every_row(n),
        out,
    )
    beside = np.zeros((len(weights) - 10 * n, n, state.shape[2]))
    beside[:, :, :samples] = weights[10 * n :]
    pull_blocks(model, state, beside, out)
    return _by_sample(out, samples)


def check_differentiable(model: InverseDynamicModel) -> None:
    """Check that every column beside the inertial ones belongs to a block.

    Raises:
        InputError: Columns that no block differentiates, as friction that grows with the load
            and torque ripple.
    """
    n = 10 * model.robot.joints
    known = n + sum(len(block.columns(model.robot)) for block in model.blocks)
    if known != len(model.columns):
        raise InputError(
            "columns without a derivative",
            value=model.names[known:],
            next_step="Use a model without load-dependent friction and torque ripple.",
        )


def _state(model: InverseDynamicModel, q: Array, dq: Array, ddq: Array) -> Array:
    """(3, n, N) q, dq, ddq, at rest where samples are missing to fill the lanes."""
    check_differentiable(model)
    n, samples = model.robot.joints, len(q)
    for name, array in (("q", q), ("dq", dq), ("ddq", ddq)):
        _check(name, array, (samples, n))
    state = np.zeros((3, n, max(samples, LANES)))
    for part, array in zip(state, (q, dq, ddq), strict=True):
        part[:, :samples] = array.T
    return state


def pull_blocks(model: InverseDynamicModel, state: Array, weights: Array, out: Array) -> None:
    """Add what the columns beside the inertial ones give; weights (p - 10 n, n, N)."""
    first = 0
    for block in model.blocks:
        count = len(block.columns(model.robot))
        part = weights[first : first + count]
        block.pull(model.robot, state[1], state[2], part, out[1], out[2])
        first += count


def _by_sample(out: Array, samples: int) -> Gradient:
    q_bar, dq_bar, ddq_bar = (np.array(part[:, :samples].T, order="C") for part in out)
    return q_bar, dq_bar, ddq_bar


def _check(name: str, array: Array, shape: tuple[int, ...]) -> None:
    # The compiled kernels trust their shapes: they would read beyond shorter arrays.
    if array.shape != shape:
        raise InputError(f"{name} does not fit", value=array.shape, limit=shape)
