"""RTDE outputs as the plain numbers that the packets of 30001 to 30003 hold."""

from __future__ import annotations

from collections.abc import Sequence

from dynid.simulation.controller.machine import ControllerMachine


def scalar(machine: ControllerMachine, name: str) -> float:
    """The value of an output that is one number."""
    value = machine.output(name)
    if isinstance(value, Sequence):
        raise TypeError(f"{name} is a vector")
    return float(value)


def vector(machine: ControllerMachine, name: str) -> list[float]:
    """The values of an output that is a vector."""
    value = machine.output(name)
    if not isinstance(value, Sequence):
        raise TypeError(f"{name} is one number")
    return [float(number) for number in value]


def since(machine: ControllerMachine, cb: tuple[int, int], e_series: tuple[int, int]) -> bool:
    """Whether the software is as new as that of its series.

    Args:
        machine: The controller.
        cb: Major and minor number on the CB-Series.
        e_series: The same on the e-Series.
    """
    version = machine.core.version[:2]
    return version >= (cb if version[0] < 5 else e_series)
