"""The noise of a program is that program's: neither earlier waiting nor the clock is in it."""

from __future__ import annotations

import pytest

from dynid.robot import load_robot
from dynid.simulation import simulated_arm
from urtwin import ControllerMachine

PROGRAM = "def wait():\n  while True:\n    sync()\n  end\nend\n"
CYCLES = 5


def speeds(seed: int, waited: int, programs: int = 1) -> list[list[float]]:
    """Measured speeds of the standing arm in the first cycles of the last program."""
    machine = ControllerMachine(simulated_arm(load_robot("ur5")), seed=seed)
    for _ in range(waited):
        machine.tick()
    for _ in range(programs):
        machine.run_script(PROGRAM)
    found = []
    for _ in range(CYCLES):
        machine.tick()
        found.append(machine.output("actual_qd"))
    return found


def test_waiting_before_a_program_does_not_change_its_noise() -> None:
    at_once, later = speeds(seed=4, waited=0), speeds(seed=4, waited=7)
    for first, second in zip(at_once, later, strict=True):
        assert second == pytest.approx(first, abs=1e-6)


def test_seeds_and_programs_differ() -> None:
    reference = speeds(seed=4, waited=0)
    assert speeds(seed=5, waited=0) != reference
    assert speeds(seed=4, waited=0, programs=2) != reference
