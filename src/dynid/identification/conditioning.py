"""Condition numbers: the paper's, and one that neither units nor noise flatter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynid.core.arrays import Array
from dynid.core.linalg import upper_triangle
from dynid.identification.accumulate import joint_factors
from dynid.identification.problem import IdentificationProblem
from dynid.recording.record import ExperimentRecord
from dynid.signals.filters import motion_bandwidth
from dynid.signals.process import process, uniform_signals
from dynid.signals.samples import ProcessingSettings

BANDWIDTH_FACTOR = 2.0
LOWEST_HZ = 0.5


def observation_root(problem: IdentificationProblem) -> Array:
    """(r, r) upper triangular R with R'R = W'W, rows unweighted."""
    rank = problem.base.rank
    return upper_triangle(joint_factors(problem)[:, :, :rank].reshape(-1, rank))


def condition_number(root: Array) -> float:
    """Of W as it stands, which depends on units and frames: the paper's."""
    return float(np.linalg.cond(root))


def scaled_condition_number(root: Array) -> float:
    """Of W with columns of unit norm; infinite if a column is zero."""
    norms = np.linalg.norm(root, axis=0)
    return float(np.linalg.cond(root / norms)) if norms.min() > 0 else float("inf")


def smooth_condition_number(
    problem: IdentificationProblem, record: ExperimentRecord, settings: ProcessingSettings
) -> float:
    """Scaled condition number of the motion alone.

    Differentiated noise fills the columns of a poor record and makes it look well conditioned.
    Here the motion is smoothed down to twice its own bandwidth first, which leaves a good
    record as it is.
    """
    robot = problem.base.model.robot
    signals = uniform_signals(record, robot, settings)
    cutoff = max(BANDWIDTH_FACTOR * motion_bandwidth(signals.q, signals.rate_hz), LOWEST_HZ)
    smooth = replace(settings, cutoff_hz=cutoff, velocity="position", delays_s=None, decimate=True)
    samples = process(record, robot, smooth)
    return scaled_condition_number(observation_root(replace(problem, samples=samples)))
