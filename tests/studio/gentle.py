"""A short, gentle motion of the UR5 in a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dynid.core import provenance
from dynid.robot import load_robot
from dynid.trajectory import write_trajectory
from rest_motions import rest_series

PERIOD, CYCLES = 2.0, 250
MIDDLE = np.array([0.1, -1.4, 0.3, -2.1, 0.2, 0.1])


def write_motion(path: Path, period: float = PERIOD, size: float = 0.05) -> Path:
    free = size * np.random.default_rng(0).normal(size=(6, 4))
    limits = load_robot("ur5").limits
    series = rest_series(period, MIDDLE, free)
    write_trajectory(series, path, robot="ur5", limits=limits, provenance=provenance(seed=0))
    return path
