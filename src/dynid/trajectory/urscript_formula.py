"""Formulas in URScript: numbers, poses, series and polynomials."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from dynid.core.arrays import Array
from dynid.trajectory.pieces import Piece

_TERMS = 4
"""Harmonics in one statement, which keeps lines short."""
_LATE = 1e-9
"""Share of a cycle by which rounding may place the start of a piece too late."""


def decimal(value: float) -> str:
    """The number that reads back exactly, without an exponent and with a decimal point."""
    return np.format_float_positional(float(value), unique=True, trim="0")


def pose_list(pose: Array) -> str:
    """Joint positions (n) as a list."""
    return f"[{', '.join(decimal(value) for value in pose)}]"


def variables(parts: Sequence[Piece]) -> list[str]:
    """The names that `formula_lines` sets, all numbers."""
    joints = len(parts[0].polynomial)
    orders = range(1, max(part.harmonics for part in parts) + 1)
    return [
        "t",
        "s",
        *(f"{name}{order}" for name in "sc" for order in orders),
        *(f"q{joint}" for joint in range(1, joints + 1)),
    ]


def formula_lines(parts: Sequence[Piece], rate_hz: float) -> list[str]:
    """Statements that set t, s and q1 to qn from `sample`, the number within the period.

    Args:
        parts: The formulas of one period.
        rate_hz: Samples a second of the motion's own time.
    """
    lines = [f"t = sample/{decimal(rate_hz)}"]
    if len(parts) == 1:
        return [*lines, *_piece(parts[0], 0.0)]
    starts = np.concatenate([[0.0], np.cumsum([part.duration for part in parts])])
    for number, part in enumerate(parts):
        # Chosen by the whole number of the sample: no rounding decides it on the controller.
        until = math.ceil(starts[number + 1] * rate_hz - _LATE)
        if number == 0:
            lines.append(f"if sample < {until}:")
        elif number < len(parts) - 1:
            lines.append(f"elif sample < {until}:")
        else:
            lines.append("else:")
        lines += [f"  {line}" for line in _piece(part, float(starts[number]))]
    return [*lines, "end"]


def _piece(part: Piece, start: float) -> Iterable[str]:
    if part.polynomial.shape[1] > 1:
        shift = f"(t - {decimal(start)})" if start else "t"
        yield f"s = {shift}/{decimal(part.duration)}"
    if part.harmonics:
        base = 2.0 * math.pi / part.duration
        shift = f"(t - {decimal(start)})" if start else "t"
        for order in range(1, part.harmonics + 1):
            yield f"s{order} = sin({decimal(order * base)}*{shift})"
            yield f"c{order} = cos({decimal(order * base)}*{shift})"
    for joint, row in enumerate(part.polynomial, start=1):
        yield f"q{joint} = {_horner(row)}"
        terms = [
            f"{_signed(a)}*s{order} {_signed(-b)}*c{order}"
            for order, (a, b) in enumerate(
                zip(part.a[joint - 1], part.b[joint - 1], strict=True), start=1
            )
        ]
        for first in range(0, len(terms), _TERMS):
            yield f"q{joint} = q{joint} {' '.join(terms[first : first + _TERMS])}"


def _horner(coefficients: Array) -> str:
    """Ascending coefficients of s, the highest one innermost."""
    text = decimal(coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        text = f"({text})*s {_signed(coefficient)}"
    return text


def _signed(value: float) -> str:
    """`+ 0.5` or `- 0.5`."""
    return f"{'-' if value < 0 else '+'} {decimal(abs(value))}"
