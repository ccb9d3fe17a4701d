import numpy as np
import pytest
from robots_for_simulation import HOME, build_ur5

from dynid.robot import RobotModel
from dynid.simulation import SimulatedArm, SimulatedRun, simulate, simulated_arm
from dynid.trajectory import FourierSeries, random_excitation


@pytest.fixture(scope="session")
def ur5() -> RobotModel:
    return build_ur5()


@pytest.fixture(scope="session")
def motion(ur5: RobotModel) -> FourierSeries:
    return random_excitation(ur5.limits, seed=4, margin=0.8, acceleration=5.5 * np.pi, offset=HOME)


@pytest.fixture(scope="session")
def arm(ur5: RobotModel) -> SimulatedArm:
    return simulated_arm(ur5)


@pytest.fixture(scope="session")
def run(arm: SimulatedArm, motion: FourierSeries) -> SimulatedRun:
    return simulate(arm, motion, seed=1)
