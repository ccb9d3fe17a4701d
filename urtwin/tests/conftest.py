"""Controllers for the tests: in this process without sockets, and as processes with them.

A process that nobody asks anything still computes its cycles, a tenth of a core: none outlives its
module.
"""

import pytest

from dynid.robot import load_robot
from dynid.simulation import simulated_arm
from urtwin import ControllerMachine, controller_process


@pytest.fixture(scope="session")
def arm():
    """The built-in simulated UR5."""
    return simulated_arm(load_robot("ur5"))


@pytest.fixture(scope="session")
def e_arm():
    """The built-in simulated UR5e."""
    return simulated_arm(load_robot("ur5e"))


@pytest.fixture
def machine(arm):
    return ControllerMachine(arm, version=(3, 15, 8, 106339))


@pytest.fixture
def e_machine(e_arm):
    return ControllerMachine(e_arm, rate_hz=500.0, version=(5, 12, 0, 1101319))


@pytest.fixture(scope="module")
def real():
    """A UR5 in real time, 125 Hz."""
    with controller_process("ur5") as controller:
        yield controller


@pytest.fixture(scope="module")
def real_e():
    """A UR5e in real time, 500 Hz."""
    with controller_process("ur5e") as controller:
        yield controller


@pytest.fixture(scope="module")
def fast():
    """A UR5 in virtual time."""
    with controller_process("ur5", virtual_time=True) as controller:
        yield controller
