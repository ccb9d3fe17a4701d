"""A short, gentle motion near the pose in which a simulated controller starts."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from dynid.core import provenance
from dynid.drivers import Execution
from dynid.experiment.plan import watch_limits
from dynid.robot import RobotModel, load_robot
from dynid.trajectory import FourierFamily, FourierSeries, write_trajectory

PERIOD, RATE = 2.0, 125.0
CYCLES = 250
MIDDLE = np.array([0.1, -1.4, 0.3, -2.1, 0.2, 0.1])


@cache
def ur5() -> RobotModel:
    return load_robot("ur5")


def gentle(period: float = PERIOD, size: float = 0.05, seed: int = 0) -> FourierSeries:
    free = size * np.random.default_rng(seed).normal(size=(6, 4))
    return FourierFamily(duration=period, order=3).member(MIDDLE, free)


def gentle_execution(
    periods: int = 1, settle: int = 0, trajectory: FourierSeries | None = None
) -> Execution:
    return Execution(
        trajectory=trajectory or gentle(),
        periods=periods,
        settle=settle,
        limits=watch_limits(ur5()),
    )


def write_gentle(path: Path, trajectory: FourierSeries | None = None) -> Path:
    write_trajectory(
        trajectory or gentle(),
        path,
        robot="ur5",
        limits=ur5().limits,
        provenance=provenance(seed=0),
    )
    return path


class ListRecorder:
    """Keeps what it is told."""

    def __init__(self) -> None:
        self.t: list[float] = []
        self.signals: list[dict[str, object]] = []
        self.channels: list[dict[str, float]] = []
        self.problems: list[object] = []

    def append(self, t, signals, channels=None) -> None:
        self.t.append(t)
        self.signals.append(dict(signals))
        self.channels.append(dict(channels or {}))

    def report(self, problem) -> None:
        self.problems.append(problem)

    def array(self, name: str):
        return np.array([row[name] for row in self.signals])

    def channel(self, name: str):
        return np.array([row[name] for row in self.channels])
