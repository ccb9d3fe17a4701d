"""Lines on the script ports that are no URScript: what pendants and drivers tell the controller.

UR's own client library switches the robot on with them (Universal_Robots_Client_Library,
src/primary/primary_client.cpp): software 10 has no dashboard server.
"""

from __future__ import annotations

import re
from collections.abc import Callable

from dynid.simulation.controller.machine import ControllerMachine

_SPEED = re.compile(r"set speed (\d+(?:\.\d*)?|\.\d+)")
_LONGEST = 60


def _unlock(machine: ControllerMachine) -> None:
    machine.unlock_protective_stop()


def _nothing(machine: ControllerMachine) -> None:
    """The simulated arm is the real one here."""


_COMMANDS: dict[str, Callable[[ControllerMachine], object]] = {
    "power on": ControllerMachine.power_on,
    "power off": ControllerMachine.power_off,
    "set robotmode run": ControllerMachine.brake_release,
    "set unlock protective stop": _unlock,
    "stop program": ControllerMachine.stop,
    "pause program": ControllerMachine.pause,
    "resume program": ControllerMachine.play,
    "run program": ControllerMachine.play,
    "set real": _nothing,
    "set sim": _nothing,
}


def obey(text: str, machine: ControllerMachine) -> bool:
    """Do what a line says, if it is such a command.

    Args:
        text: What came on a script port.
        machine: The controller.

    Returns:
        Whether it was one; else it is a program.
    """
    if len(text) > _LONGEST:
        return False
    line = " ".join(text.split()).lower()
    command = _COMMANDS.get(line)
    if command is not None:
        command(machine)
        return True
    speed = _SPEED.fullmatch(line)
    if speed is None:
        return False
    machine.set_input("speed_slider_mask", 1)
    machine.set_input("speed_slider_fraction", float(speed.group(1)))
    return True
