"""Which columns are the time, and the best of them that runs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import Any

import numpy as np

from dynid.core import Array, RecordError
from dynid.recording.cells import past_midnight
from dynid.recording.names import Name


@dataclass(frozen=True, slots=True, kw_only=True)
class Clock:
    """One or two columns of time."""

    columns: tuple[int, ...]
    """The column, or those of whole seconds and of nanoseconds."""
    scale: float | None
    """Seconds per unit; None where the name does not say."""
    label: str
    """The name of its first column."""


def find_clocks(parsed: Sequence[Name], names: Sequence[str], scope: str) -> list[Clock]:
    """All columns of time, the best first.

    Stamps of a message's header go before times of arrival, and those of the positions' own
    message (`scope` is its path) before others.

    Raises:
        RecordError: Two columns of the same name.
    """
    found: list[tuple[tuple[int, ...], Clock]] = []
    halves = {_stem(name): k for k, name in enumerate(parsed) if name.clock == "nanosec"}
    for k, name in enumerate(parsed):
        meaning = name.meaning
        half = halves.get(_stem(name)) if name.clock == "sec" else None
        if half is None and (meaning is None or meaning[0] != "t" or name.index is not None):
            continue
        if name.clock == "nanosec" or (half is None and name.clock == "sec" and name.scope):
            continue
        header = half is not None or name.clock == "stamp"
        order = (
            0 if header else 1,
            -_shared(name.scope, scope),
            name.scope.count(".") + bool(name.scope),
            0 if meaning is None else meaning[1],
        )
        found.append(
            (
                order,
                Clock(
                    columns=(k,) if half is None else (k, half),
                    scale=1.0 if half is not None else name.time_scale,
                    label=names[k],
                ),
            )
        )
    found.sort(key=lambda item: item[0])
    same = [
        clock for order, clock in found if order == found[0][0] and clock.label == found[0][1].label
    ]
    if len(same) > 1:
        raise RecordError(
            "more than one time column",
            value=[clock.label for clock in same],
            next_step=f"Choose with --columns, for example t={same[0].columns[0]},q=...",
        )
    return [clock for _, clock in found]


def _stem(name: Name) -> tuple[str, str]:
    return name.scope, name.base.rpartition("_")[0].removesuffix("_nano")


def _shared(one: str, other: str) -> int:
    """How many parts two paths have in common from their start."""
    pairs = zip(one.split("."), other.split("."), strict=False)
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))


def stamps_of(
    clocks: Sequence[Clock], column: Callable[[int], Array], moments: frozenset[int]
) -> dict[str, Any]:
    """Time of a raw table by the best clock that runs, with notes: drivers leave headers empty.

    `moments` are columns that were dates, in seconds by now.
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
        facts = {"t": values, "time_scale": clock.scale, "notes": (note,) if note else ()}
        if len(clock.columns) == 2:
            finite = values[np.isfinite(values)]
            start = float(np.floor(finite[0])) if len(finite) else 0.0
            t = (values - start) + 1e-9 * column(clock.columns[1])
            facts |= {"t": t, "time_scale": 1.0, "t0": str(int(start))}
        elif clock.columns[0] in moments:
            facts |= {"t": past_midnight(values), "time_scale": 1.0}
        return facts
    return {"notes": ()}


def rises(values: Array) -> bool:
    """Whether numbers (N) go up nearly always, as a clock does."""
    steps = np.diff(values)
    return len(steps) > 0 and bool((steps > 0).mean() > 0.98)


def at_times(at: Array, t: Array, values: Array, farthest: float) -> Array:
    """Columns (N, k) on straight lines between rows with a clock of their own.

    Args:
        at: (N) the times wanted.
        t: (M) times of the rows, in any order; rows without one are passed over.
        values: (M, k) the columns.
        farthest: Median steps of the rows; over a wider gap, and beyond the ends, there is NaN.
    """
    there = np.isfinite(t)
    own, rows = np.unique(t[there], return_index=True)
    after = np.clip(np.searchsorted(own, at), 1, len(own) - 1)
    gap = own[after] - own[after - 1] > farthest * float(np.median(np.diff(own)))
    # A stamp that is there needs nothing between rows.
    gap &= (own[after] != at) & (own[after - 1] != at)
    out = np.empty((len(at), values.shape[1]))
    for k, column in enumerate(values[there][rows].T):
        out[:, k] = np.interp(at, own, column)
    out[gap | ~((at >= own[0]) & (at <= own[-1]))] = np.nan
    return out


def _runs(values: Array) -> bool:
    """Whether a column is there on most rows, is not zero, and changes."""
    finite = values[np.isfinite(values)]
    if len(finite) < 0.5 * len(values) or (finite <= 0).mean() > 0.5:
        return False
    # Whole seconds of a split stamp change rarely, but they do over a recording.
    return bool(np.ptp(finite) > 0)
