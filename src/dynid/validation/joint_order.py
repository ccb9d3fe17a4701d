"""Two joints whose columns were exchanged: the other order fits the torques far better."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

from dynid.core.arrays import Array
from dynid.core.notices import Notice
from dynid.identification.diagnostics import DO_NOT_USE
from dynid.identification.estimate import Estimate
from dynid.identification.problem import recorded_rows
from dynid.reduction.base import BaseParametrization, reduce_model
from dynid.regressor.model import InverseDynamicModel
from dynid.signals.samples import Samples

EXPLAINED = 0.7
"""Drop of the sum of log noises that an exchange has to bring."""
LEFT = 0.12
"""Share of the torque that the other order may leave: more, and something else is wrong."""
MOST_ROWS = 600
SWEEPS = 4


def exchanged_joints(estimate: Estimate, samples: Samples) -> tuple[int, int, bool] | None:
    """The two joints that look exchanged, and whether only their torques are.

    Args:
        estimate: The estimate.
        samples: The record it was identified from.

    Returns:
        None where no exchange explains the torques much better.
    """
    robot = estimate.model.robot
    kinds = robot.joint_types
    # The paper's terms: those that were chosen belong to the joints as they were told.
    base = reduce_model(InverseDynamicModel(robot=robot, frames=estimate.model.frames))
    own, _ = _log_noise(base, samples)
    best: tuple[float, int, int, bool] | None = None
    for i, j in combinations(range(samples.joints), 2):
        if kinds[i] != kinds[j]:
            continue
        order = list(range(samples.joints))
        order[i], order[j] = j, i
        for alone in (False, True):
            tau = samples.tau[:, order]
            other = (
                replace(samples, tau=tau)
                if alone
                else replace(
                    samples,
                    q=samples.q[:, order],
                    dq=samples.dq[:, order],
                    ddq=samples.ddq[:, order],
                    tau=tau,
                )
            )
            value, left = _log_noise(base, other)
            drop = own - value
            if left < LEFT and (best is None or drop > best[0]):
                best = (drop, i, j, alone)
    if best is None or best[0] < EXPLAINED:
        return None
    return best[1], best[2], best[3]


def _log_noise(base: BaseParametrization, samples: Samples) -> tuple[float, float]:
    """Sum over joints of the log of the noise that a weighted fit leaves, and its share."""
    used = samples.rows
    step = max(1, (used.stop - used.start) // MOST_ROWS)
    thin = replace(
        samples,
        t=samples.t[used][::step],
        q=samples.q[used][::step],
        dq=samples.dq[used][::step],
        ddq=samples.ddq[used][::step],
        tau=samples.tau[used][::step],
        torque_filter=None,
    )
    columns = list(base.independent)
    stack, torque = recorded_rows(base.model, thin, slice(0, thin.count), columns, None)
    scale = np.maximum(np.sqrt(np.square(stack).sum(axis=(1, 2))), 1e-12)
    stack = stack / scale[:, None, None]
    square = np.einsum("rjt,sjt->jrs", stack, stack, optimize=True)
    cross = np.einsum("rjt,jt->jr", stack, torque, optimize=True)
    energy = np.square(torque).sum(axis=1)
    noise: Array = np.maximum(energy, 1e-18)
    ridge = 1e-9 * np.eye(len(columns))
    for _ in range(SWEEPS):
        matrix = np.tensordot(1 / noise, square, axes=1)
        inverse = np.linalg.inv(matrix + ridge * float(np.trace(matrix)))
        values: Array = np.asarray(inverse, dtype=np.float64) @ ((1 / noise) @ cross)
        explained = np.einsum("r,jrs,s->j", values, square, values) - 2 * cross @ values
        noise = np.maximum(energy + explained, 1e-12 * energy + 1e-18)
    share = float(np.sqrt(noise.sum() / max(float(energy.sum()), 1e-18)))
    return float(np.log(noise / thin.count).sum()) / 2, share


def order_notice(i: int, j: int, alone: bool, names: tuple[str, ...]) -> Notice:
    """An exchange from `exchanged_joints` in words."""
    what = "torques of" if alone else "columns of"
    return Notice(
        "unit_suspect",
        f"the {what} {names[i]} and {names[j]} look exchanged: in the other order they fit the "
        f"model far better, and {DO_NOT_USE}: check the order of the joints (--columns or "
        "--joint-order)",
    )
