"""The general purpose registers and the digital and analog signals of a controller."""

from __future__ import annotations

from dynid.core import InputError

COUNT = 48
"""Integer and double registers in each direction."""
BITS = 128
"""Boolean registers in each direction."""
FLAGS = 32
"""Flags that programs set and read, nobody else."""
_INT_MIN, _INT_MAX = -(2**31), 2**31 - 1


class Registers:
    """Registers of one direction, as scripts and RTDE see them."""

    def __init__(self) -> None:
        self.integers: list[int] = [0] * COUNT
        self.doubles: list[float] = [0.0] * COUNT
        self.bits: list[bool] = [False] * BITS

    def write(self, kind: str, index: int, value: float) -> None:
        """Store a value.

        Args:
            kind: `int`, `double` or `bit`.
            index: Which register, from zero.
            value: Integers are cut to 32 bits.

        Raises:
            InputError: No such register.
        """
        _check(kind, index)
        if kind == "int":
            self.integers[index] = min(max(int(value), _INT_MIN), _INT_MAX)
        elif kind == "double":
            self.doubles[index] = float(value)
        else:
            self.bits[index] = bool(value)

    def read(self, kind: str, index: int) -> int | float | bool:
        """The value of a register.

        Args:
            kind: `int`, `double` or `bit`.
            index: Which register, from zero.

        Raises:
            InputError: No such register.
        """
        _check(kind, index)
        if kind == "int":
            return self.integers[index]
        return self.doubles[index] if kind == "double" else self.bits[index]

    def word(self, first: int) -> int:
        """Thirty-two boolean registers from `first` on, as one number."""
        return sum(1 << k for k in range(32) if self.bits[first + k])

    def set_word(self, first: int, value: int) -> None:
        """Thirty-two boolean registers from `first` on."""
        for k in range(32):
            self.bits[first + k] = bool(value >> k & 1)


class Signals:
    """Digital and analog signals; bits: 8 standard, 8 configurable, 2 of the tool."""

    def __init__(self) -> None:
        self.digital_in = 0
        self.digital_out = 0
        self.analog_in: list[float] = [0.0, 0.0]
        self.analog_out: list[float] = [0.0, 0.0]
        """Share of the range, 0 to 1."""
        self.analog_types = 0
        self.tool_voltage = 0
        self.flags = [False] * FLAGS
        """What programs remember between runs."""

    def set_digital_out(self, bit: int, on: bool) -> None:
        """Switch one of the 18 digital outputs.

        Raises:
            InputError: No such output.
        """
        if not 0 <= bit < 18:
            raise InputError("digital output", value=bit, limit=(0, 17))
        self.digital_out = self.digital_out | 1 << bit if on else self.digital_out & ~(1 << bit)

    def masked(self, mask: int, value: int, shift: int) -> None:
        """Set the outputs that a mask names.

        Args:
            mask: Which outputs change.
            value: Their new states.
            shift: Bit of the first output.
        """
        keep = self.digital_out & ~(mask << shift)
        self.digital_out = keep | (value & mask) << shift


def _check(kind: str, index: int) -> None:
    limit = BITS if kind == "bit" else COUNT
    if not 0 <= index < limit:
        raise InputError(f"{kind} register", value=index, limit=(0, limit - 1))
