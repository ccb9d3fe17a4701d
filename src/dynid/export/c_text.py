"""Numbers, tables and comments of the generated C header."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from dynid.core.arrays import Array


def number(value: float) -> str:
    """A double constant that reads back exactly."""
    text = repr(float(value))
    return text if any(mark in text for mark in ".e") else f"{text}.0"


def vector(name: str, values: Sequence[float] | Array) -> str:
    """A constant array; `name` with its length, as C writes it."""
    return f"static const double {name} = {{{', '.join(number(x) for x in values)}}};"


def table(name: str, values: Array) -> str:
    """A constant table (n, k) with a row a joint."""
    rows = ",\n".join(f"    {{{', '.join(number(x) for x in row)}}}" for row in np.asarray(values))
    return f"static const double {name}[$_JOINTS][{values.shape[1]}] = {{\n{rows}}};"


def weighted_sum(share: Array, name: str) -> str:
    """The sum of share[k] name[k]."""
    return " + ".join(f"{number(x)} * {name}[{k}]" for k, x in enumerate(share) if x)


def spread(share: Array, name: str) -> Iterator[str]:
    """Lines that add share[k] times a scalar to torque[k]."""
    for k, x in enumerate(share):
        if x:
            yield f"        torque[{k}] += {number(x)} * {name};"


def safe(text: str) -> str:
    """Text that cannot end a comment or be taken for one of our marks."""
    clean = "".join(c if c.isascii() and c.isprintable() and c not in "@$\\" else "?" for c in text)
    return clean.replace("*/", "* /").replace("/*", "/ *")
