"""The last line of a text table: whether its last number is whole."""

from __future__ import annotations

import math

import numpy as np

from dynid.recording.text.cells import decimals, is_missing, number, split
from dynid.recording.text.dialect import Dialect
from dynid.recording.text.stamps import stamp


def moment(cell: str, decimal: str = ".") -> float:
    """The number of a cell that may hold a date; NaN where the value is missing.

    Args:
        cell: The cell.
        decimal: Decimal sign of numbers.

    Raises:
        ValueError: The cell is neither.
    """
    try:
        return stamp(cell)
    except ValueError:
        return number(cell, decimal)


def is_cut(line: str, before: list[str], dialect: Dialect) -> bool:
    """Whether the last number of a file without a last line end looks cut off.

    A whole number is as long as those above it; one that has nine decimals lost at most
    the tenth, and the plausible range catches a lost exponent.

    Args:
        line: The last line.
        before: Lines above it.
        dialect: How the table is written.
    """
    last = split(line, dialect.delimiter)[-1]
    above = [split(x, dialect.delimiter)[-1] for x in before[-60:]]
    if is_missing(last):
        return not all(map(is_missing, above))
    try:
        value = moment(last, dialect.decimal)
        others = np.array([moment(x, dialect.decimal) for x in above], dtype=np.float64)
    except ValueError:
        return True
    others = others[np.isfinite(others)]
    if len(others) < 3 or not math.isfinite(value):
        return False
    spread = float(others.max() - others.min())
    plausible = others.min() - spread <= value <= others.max() + spread
    usual = float(np.median([decimals(x) for x in above]))
    return not plausible or decimals(last) < min(usual - 1, 9)
