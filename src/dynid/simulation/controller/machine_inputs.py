"""The RTDE inputs of the simulated controller, by name."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from dynid.core import InputError
from dynid.simulation.controller.machine_core import Core
from dynid.simulation.controller.machine_registers import BITS, COUNT

InputValue = bool | int | float | Sequence[float]
_MASKED = (
    ("standard_digital_output", 0),
    ("configurable_digital_output", 8),
    ("tool_digital_output", 16),
)


class Inputs:
    """Takes inputs as they come and applies them at the start of a cycle.

    Args:
        core: The controller.
    """

    def __init__(self, core: Core) -> None:
        self._core = core
        self._waiting: dict[str, float] = {}
        self._writers: dict[str, Callable[[InputValue], None]] = {}
        inputs = core.inputs
        for k in range(COUNT):
            self._writers[f"input_int_register_{k}"] = _to(inputs.write, "int", k)
            self._writers[f"input_double_register_{k}"] = _to(inputs.write, "double", k)
        for k in range(64, BITS):
            self._writers[f"input_bit_register_{k}"] = _to(inputs.write, "bit", k)
        for first, name in ((0, "0_to_31"), (32, "32_to_63")):
            self._writers[f"input_bit_registers{name}"] = _word(inputs.set_word, first)
        held = [f"{name}{part}" for name, _ in _MASKED for part in ("", "_mask")]
        held += ["speed_slider_mask", "speed_slider_fraction"]
        held += [f"standard_analog_output_{part}" for part in ("mask", "type", "0", "1")]
        for name in held:
            self._writers[name] = self._holder(name)
        self._writers["external_force_torque"] = self._wrench

    def write(self, name: str, value: InputValue) -> None:
        """Take an input.

        Raises:
            InputError: No such input.
        """
        writer = self._writers.get(name)
        if writer is None:
            raise InputError("unknown RTDE input", value=name)
        writer(value)
        self._core.feed(name)

    def apply(self) -> None:
        """Let masked inputs act: outputs and the speed slider change where the mask says so."""
        if not self._waiting:
            return
        waiting, core, signals = self._waiting, self._core, self._core.signals
        fraction = waiting.get("speed_slider_fraction", math.nan)
        if waiting.get("speed_slider_mask") and math.isfinite(fraction):
            core.speed_fraction = min(max(fraction, 0.0), 1.0)
        for name, shift in _MASKED:
            mask = int(waiting.get(f"{name}_mask", 0))
            if mask:
                signals.masked(mask, int(waiting.get(name, 0)), shift)
        mask = int(waiting.get("standard_analog_output_mask", 0))
        for k in range(2):
            share = waiting.get(f"standard_analog_output_{k}", 0.0)
            if mask >> k & 1 and math.isfinite(share):
                signals.analog_out[k] = min(max(share, 0.0), 1.0)
        if mask:
            kinds = int(waiting.get("standard_analog_output_type", 0)) & mask
            signals.analog_types = signals.analog_types & ~(mask << 2) | kinds << 2
        waiting.clear()

    def _holder(self, name: str) -> Callable[[InputValue], None]:
        def hold(value: InputValue) -> None:
            self._waiting[name] = _number(value)

        return hold

    def _wrench(self, value: InputValue) -> None:
        if not isinstance(value, Sequence) or len(value) != 6:
            raise InputError("external_force_torque has six numbers", value=value)
        self._core.external_wrench = list(value)


def _number(value: InputValue) -> float:
    if isinstance(value, Sequence):
        raise InputError("this RTDE input is one number", value=value)
    return value


def _to(
    write: Callable[[str, int, float], None], kind: str, index: int
) -> Callable[[InputValue], None]:
    return lambda value: write(kind, index, _number(value))


def _word(set_word: Callable[[int, int], None], first: int) -> Callable[[InputValue], None]:
    return lambda value: set_word(first, int(_number(value)))
