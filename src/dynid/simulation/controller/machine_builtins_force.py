"""Built-ins for force mode and for moving the arm by hand, which nobody does here."""

from __future__ import annotations

from typing import Any

from dynid.simulation.controller.machine_core import Core
from dynid.simulation.controller.motion_force import ForceMode
from dynid.simulation.controller.urscript.builtin import Builtin, Kind, builtin
from dynid.simulation.controller.urscript.errors import ScriptFault
from dynid.simulation.controller.urscript.pose_functions import numbers
from dynid.simulation.controller.urscript.values import Value, number

_WEIGHT = 50
_MOST_DAMPING, _MOST_GAIN = 1.0, 2.0
_TYPES = (1, 2, 3)
_ALL_FREE = (1, 1, 1, 1, 1, 1)


def _force_mode(
    core: Core,
    task_frame: Value,
    selection_vector: Value,
    wrench: Value,
    type: Value,
    limits: Value,
) -> None:
    kind = int(number(type))
    if kind not in _TYPES:
        raise ScriptFault("type of force mode", value=kind, limit=_TYPES)
    core.force = ForceMode(
        frame=numbers(task_frame, 6, "a pose"),
        compliant=[value != 0 for value in numbers(selection_vector, 6, "a selection")],
        wrench=numbers(wrench, 6, "a wrench"),
        kind=kind,
        limits=numbers(limits, 6, "limits"),
        gain=core.force_gain,
    )


def _end_force_mode(core: Core) -> None:
    core.force = None


def _set_damping(core: Core, damping: Value) -> None:
    _between("damping of force mode", damping, _MOST_DAMPING)


def _set_gain(core: Core, scaling: Value) -> None:
    core.force_gain = _between("gain of force mode", scaling, _MOST_GAIN)


def _between(what: str, value: Value, most: float) -> float:
    found = float(number(value))
    if not 0.0 <= found <= most:
        raise ScriptFault(what, value=found, limit=(0, most))
    return found


def _zero_sensor(core: Core) -> None:
    """The force at the tool is zero already."""


def _teach(core: Core) -> None:
    core.teaching = True


def _end_teach(core: Core) -> None:
    core.teaching = False


def _freedrive(core: Core, freeAxes: Value = _ALL_FREE, feature: Value = 0) -> None:
    core.teaching = True


def _freedrive_status(core: Core) -> int:
    """0: no joint is near its limit, as nobody pushes the arm there."""
    return 0


def _tool_contact(core: Core, direction: Value = 0) -> int:
    """0: the tool touches nothing."""
    return 0


_TABLE: dict[str, Any] = {
    "force_mode": _force_mode,
    "end_force_mode": _end_force_mode,
    "force_mode_set_damping": _set_damping,
    "force_mode_set_gain_scaling": _set_gain,
    "zero_ftsensor": _zero_sensor,
    "teach_mode": _teach,
    "end_teach_mode": _end_teach,
    "freedrive_mode": _freedrive,
    "end_freedrive_mode": _end_teach,
    "get_freedrive_status": _freedrive_status,
    "tool_contact": _tool_contact,
}
FORCE: list[Builtin] = [
    builtin(function, Kind.INSTANT, name=name, weight=_WEIGHT) for name, function in _TABLE.items()
]
"""Built-ins about the force at the tool."""
