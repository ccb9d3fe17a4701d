"""Condition numbers: the paper's, and one that depends on the motion alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynid.core.arrays import Array
from dynid.core.linalg import upper_triangle
from dynid.identification.accumulate import joint_factors
from dynid.identification.problem import IdentificationProblem
from dynid.reduction.base import BaseParametrization, reduce_model
from dynid.regressor.model import InverseDynamicModel
from dynid.robot.model import RobotModel
from dynid.signals.filters import motion_bandwidth
from dynid.signals.process import samples_from
from dynid.signals.resample import UniformSignals
from dynid.signals.samples import ProcessingSettings

ILL_CONDITIONED = 50.0
"""Of `motion_condition_number`: excitation trajectories of real arms reach 10 to 30."""
LARGEST = 1e16
"""Beyond rounding all condition numbers are alike, and JSON knows no infinity."""
BANDWIDTH_FACTOR = 2.0
LOWEST_HZ = 0.5


def observation_root(problem: IdentificationProblem) -> Array:
    """(r, r) upper triangular R with R'R = W'W, rows unweighted."""
    rank = problem.base.rank
    return upper_triangle(joint_factors(problem)[:, :, :rank].reshape(-1, rank))


def condition_number(root: Array) -> float:
    """Of W as it stands, which depends on units and frames: the paper's."""
    return min(float(np.linalg.cond(root)), LARGEST)


def scaled_condition_number(root: Array, mapping: Array) -> float:
    """Of all standard columns with unit norm, on what motion can show of them.

    Unlike the paper's it depends neither on units nor on which columns were chosen as base
    parameters: a poor choice (the Panda in DH frames) costs a factor of a thousand there.

    Args:
        root: (r, r) from `observation_root`.
        mapping: (r, p) base parameters of standard parameters, from `base_mapping`.

    Returns:
        Largest over r-th singular value; `LARGEST` if that is zero.
    """
    columns = root @ mapping
    norms = np.linalg.norm(columns, axis=0)
    seen = norms > 1e-12 * norms.max(initial=1e-300)
    values = np.linalg.svd(columns[:, seen] / norms[seen], compute_uv=False)
    weakest = values[len(root) - 1] if len(values) >= len(root) else 0.0
    return float(values[0] / weakest) if weakest > 1e-15 * values[0] else LARGEST


def base_mapping(base: BaseParametrization) -> Array:
    """(r, p) B with p_B = B p."""
    mapping = np.zeros((base.rank, len(base.model.columns)))
    mapping[np.arange(base.rank), list(base.independent)] = 1.0
    mapping[:, list(base.dependent)] = base.regrouping
    return mapping


def motion_condition_number(
    robot: RobotModel, frames: str, signals: UniformSignals, settings: ProcessingSettings
) -> float:
    """Scaled condition number of the motion alone, for the paper's parameters.

    Differentiated noise fills the columns of a poor record and makes it look well conditioned.
    Here the motion is smoothed down to twice its own bandwidth first, which leaves a good
    record as it is.

    Args:
        robot: The robot.
        frames: Parameter frames.
        signals: The record on a uniform grid.
        settings: How it is processed; cut-off, delays and velocity source do not matter.
    """
    base = reduce_model(InverseDynamicModel(robot=robot, frames=frames))
    cutoff = max(BANDWIDTH_FACTOR * motion_bandwidth(signals.q, signals.rate_hz), LOWEST_HZ)
    smooth = replace(
        settings,
        cutoff_hz=cutoff,
        velocity="position",
        delays_s=None,
        decimate=True,
        torque_filter=None,
    )
    problem = IdentificationProblem(base=base, samples=samples_from(signals, smooth))
    return scaled_condition_number(observation_root(problem), base_mapping(base))
