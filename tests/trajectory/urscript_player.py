"""Runs a generated URScript program in Python: what it does to the robot, call by call.

The programs use no more than assignments, if, while and calls, and are indented as Python would
have it; only `local` and `end` are foreign. Anything else in a program is a syntax error here.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field

import numpy as np

from dynid.core import Array

_ALLOWED = re.compile(
    r"def \w+\(\):|end|(local )?\w+ = [^=]+|while \w+ < \d+:|(el)?if \w+ (<|>=) \d+:|else:"
    r"|(write_output_integer_register|rtde_set_watchdog|movej|servoj|stopj|sleep)\(.*\)"
)
_OPERATORS = re.compile(r"\*\*|//|%|\be[+-]?\d|\d[eE]")


@dataclass
class Played:
    """What a program asked of the controller."""

    targets: list[list[float]] = field(default_factory=list)
    """Every `servoj` target."""
    registers: list[tuple[int, int]] = field(default_factory=list)
    """Every register written, and its value."""
    at_servo: list[dict[int, int]] = field(default_factory=list)
    """The registers as they stood at every `servoj`."""
    calls: list[tuple[str, tuple[object, ...], dict[str, object]]] = field(default_factory=list)
    """Every other call."""

    def motion(self, index_register: int = 24) -> tuple[Array, Array]:
        """The indices (N) and targets (N, 6) of the motion, without the hold at the end."""
        total = max(row[index_register] for row in self.at_servo)
        rows = [k for k, row in enumerate(self.at_servo) if row[index_register] < total]
        return (
            np.array([self.at_servo[k][index_register] for k in rows]),
            np.array([self.targets[k] for k in rows]),
        )


def play(text: str) -> Played:
    """Run a program to its end."""
    kept: list[str] = []
    depth = 0
    for line in text.splitlines():
        words = line.strip()
        if words.startswith("#"):
            continue
        assert _ALLOWED.fullmatch(words), words
        assert not _OPERATORS.search(words), words
        depth += bool(re.match(r"(def|while|if) ", words)) - (words == "end")
        if words != "end":
            kept.append(line.replace("local ", ""))
    assert depth == 0
    played, current = Played(), dict[int, int]()

    def write(register: int, value: int) -> None:
        assert isinstance(value, int)
        played.registers.append((register, value))
        current[register] = value

    def servoj(target: list[float], a: float, v: float, **how: float) -> None:
        played.targets.append(list(target))
        played.at_servo.append(dict(current))
        played.calls.append(("servoj", (a, v), dict(how)))

    def other(name: str):  # type: ignore[no-untyped-def]
        def call(*positional: object, **named: object) -> None:
            played.calls.append((name, positional, named))

        return call

    scope: dict[str, object] = {
        "write_output_integer_register": write,
        "servoj": servoj,
        "sin": math.sin,
        "cos": math.cos,
        "__builtins__": {},
    }
    for name in ("movej", "stopj", "sleep", "rtde_set_watchdog"):
        scope[name] = other(name)
    name = re.match(r"def (\w+)", text)
    assert name
    exec("\n".join(kept), scope)
    scope[name[1]]()  # type: ignore[operator]
    return played
