"""Built-ins for registers, signals, messages and watchdogs."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from typing import Any

from dynid.simulation.controller.machine_core import Core, Watchdog
from dynid.simulation.controller.machine_messages import MessageKind
from dynid.simulation.controller.machine_registers import FLAGS, Registers
from dynid.simulation.controller.urscript.builtin import Builtin, Kind, builtin
from dynid.simulation.controller.urscript.errors import ScriptFault
from dynid.simulation.controller.urscript.values import Value, number, shown, truth

_MESSAGE_WEIGHT = 100
_ACTIONS = ("ignore", "pause", "stop")


def _index(address: Value) -> int:
    if address.__class__ is not int:
        raise ScriptFault("an address must be a whole number", value=shown(address))
    return address


def _reader(kind: str, bank: Callable[[Core], Registers]) -> Any:
    def read(core: Core, address: Value) -> Value:
        return bank(core).read(kind, _index(address))

    return read


def _writer(kind: str) -> Any:
    def write(core: Core, address: Value, value: Value) -> None:
        stored = truth(value) if kind == "bit" else number(value)
        if kind == "int" and not math.isfinite(stored):
            raise ScriptFault("an integer register takes whole numbers", value=stored)
        core.outputs.write(kind, _index(address), stored)

    return write


def _textmsg(core: Core, s1: Value, s2: Value = "") -> None:
    core.say(shown(s1) + shown(s2))


def _popup(
    core: Core,
    s: Value,
    title: Value = "Popup",
    warning: Value = False,
    error: Value = False,
    blocking: Value = False,
) -> Generator[None, None, None]:
    level = 1 if truth(error) else 2 if truth(warning) else 3
    waits = truth(blocking)
    core.say(shown(s), "program", level, MessageKind.POPUP, title=shown(title), blocking=waits)
    if waits:
        core.blocking_popup = True
        while core.blocking_popup:
            yield


def _rtde_set_watchdog(
    core: Core, variable_name: Value, min_frequency: Value, action: Value = "pause"
) -> None:
    name, wanted = shown(variable_name), shown(action).lower()
    if not name.startswith(("input_", "speed_slider", "standard_", "configurable_", "tool_")):
        raise ScriptFault("a watchdog needs an RTDE input", value=name)
    if wanted not in _ACTIONS:
        raise ScriptFault("action of a watchdog", value=wanted, limit=_ACTIONS)
    rate = number(min_frequency)
    if not 0.0 <= rate <= core.rate_hz:
        raise ScriptFault("frequency of a watchdog", value=rate, limit=(0, core.rate_hz))
    period = 1.0 / rate if rate > 0.0 else math.inf
    core.watchdogs[name] = Watchdog(name, period, wanted, core.now)


def _digital_out(shift: int, count: int) -> Any:
    def set_out(core: Core, n: Value, b: Value) -> None:
        bit = _index(n)
        if not 0 <= bit < count:
            raise ScriptFault("digital output", value=bit, limit=(0, count - 1))
        core.signals.set_digital_out(shift + bit, truth(b))

    return set_out


def _digital(shift: int, count: int, inputs: bool) -> Any:
    def get(core: Core, n: Value) -> bool:
        bit = _index(n)
        if not 0 <= bit < count:
            raise ScriptFault("digital signal", value=bit, limit=(0, count - 1))
        bits = core.signals.digital_in if inputs else core.signals.digital_out
        return bool(bits >> (shift + bit) & 1)

    return get


def _pair(n: Value) -> int:
    if _index(n) not in (0, 1):
        raise ScriptFault("analog signal", value=n, limit=(0, 1))
    return n


def _get_analog_in(core: Core, n: Value) -> float:
    return core.signals.analog_in[_pair(n)]


def _get_analog_out(core: Core, n: Value) -> float:
    return core.signals.analog_out[_pair(n)]


def _set_analog_out(core: Core, n: Value, f: Value) -> None:
    core.signals.analog_out[_pair(n)] = min(max(float(number(f)), 0.0), 1.0)


def _flag(n: Value) -> int:
    if not 0 <= _index(n) < FLAGS:
        raise ScriptFault("flag", value=n, limit=(0, FLAGS - 1))
    return n


def _get_flag(core: Core, n: Value) -> bool:
    return core.signals.flags[_flag(n)]


def _set_flag(core: Core, n: Value, b: Value) -> None:
    core.signals.flags[_flag(n)] = truth(b)


def _get_tool_analog_in(core: Core, n: Value) -> float:
    _pair(n)
    return 0.0


def _set_tool_voltage(core: Core, voltage: Value) -> None:
    core.signals.tool_voltage = int(number(voltage))


_KINDS = {"integer": "int", "float": "double", "boolean": "bit"}
_INSTANT: dict[str, Any] = {
    "rtde_set_watchdog": _rtde_set_watchdog,
    "get_standard_analog_in": _get_analog_in,
    "get_analog_in": _get_analog_in,
    "get_standard_analog_out": _get_analog_out,
    "get_analog_out": _get_analog_out,
    "set_standard_analog_out": _set_analog_out,
    "set_analog_out": _set_analog_out,
    "set_tool_voltage": _set_tool_voltage,
    "get_tool_analog_in": _get_tool_analog_in,
    "get_flag": _get_flag,
    "set_flag": _set_flag,
}
for _word, _kind in _KINDS.items():
    _INSTANT[f"read_input_{_word}_register"] = _reader(_kind, lambda core: core.inputs)
    _INSTANT[f"read_output_{_word}_register"] = _reader(_kind, lambda core: core.outputs)
    _INSTANT[f"write_output_{_word}_register"] = _writer(_kind)
for _group, _shift, _count in (
    ("", 0, 18),
    ("standard_", 0, 8),
    ("configurable_", 8, 8),
    ("tool_", 16, 2),
):
    _INSTANT[f"set_{_group}digital_out"] = _digital_out(_shift, _count)
    _INSTANT[f"get_{_group}digital_out"] = _digital(_shift, _count, inputs=False)
    _INSTANT[f"get_{_group}digital_in"] = _digital(_shift, _count, inputs=True)

IO: list[Builtin] = [
    *(builtin(function, Kind.INSTANT, name=name) for name, function in _INSTANT.items()),
    builtin(_textmsg, Kind.INSTANT, name="textmsg", weight=_MESSAGE_WEIGHT),
    builtin(_popup, Kind.BLOCKING, name="popup", weight=_MESSAGE_WEIGHT),
]
"""Built-ins that read and write what RTDE shows."""
