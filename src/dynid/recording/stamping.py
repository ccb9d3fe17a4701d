"""The time of a table: the best of its clocks that really runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dynid.core import Array
from dynid.recording.clocks import Clock
from dynid.recording.text.stamps import past_midnight


@dataclass(frozen=True, slots=True, kw_only=True)
class Stamps:
    """Time stamps of a table."""

    t: Array | None
    """(N) stamps from `t0` on, or None where there are none."""
    scale: float | None
    """Seconds per unit; None where it is not known."""
    t0: str = ""
    """The stamp at which `t` is zero; empty where `t` is the stamp itself."""
    note: str = ""
    """A choice made, in words."""


def stamps_of(
    clocks: Sequence[Clock], column: Callable[[int], Array], moments: frozenset[int] = frozenset()
) -> Stamps:
    """The stamps of the best clock that runs: drivers leave headers empty.

    Args:
        clocks: Columns of time, the best first.
        column: Gives the (N) numbers of a column.
        moments: Columns that were dates, in seconds by now.
    """
    passed: list[str] = []
    for clock in clocks:
        values = column(clock.columns[0])
        if clock is not clocks[-1] and not _runs(values):
            passed.append(clock.label)
            continue
        note = f"time is read from {clock.label!r}" if len(clocks) > 1 else ""
        if passed:
            note += f"; empty or at rest: {', '.join(map(repr, passed))}"
        if len(clock.columns) == 2:
            finite = values[np.isfinite(values)]
            start = float(np.floor(finite[0])) if len(finite) else 0.0
            t = (values - start) + 1e-9 * column(clock.columns[1])
            return Stamps(t=t, scale=1.0, t0=str(int(start)), note=note)
        if clock.columns[0] in moments:
            return Stamps(t=past_midnight(values), scale=1.0, note=note)
        return Stamps(t=values, scale=clock.scale, note=note)
    return Stamps(t=None, scale=None)


def _runs(values: Array) -> bool:
    """Whether a column is there on most rows, is not zero, and changes."""
    finite = values[np.isfinite(values)]
    if len(finite) < 0.5 * len(values) or (finite <= 0).mean() > 0.5:
        return False
    # Whole seconds of a split stamp change rarely, but they do over a recording.
    return bool(np.ptp(finite) > 0)
