"""Which columns are the time: stamps of headers, in one column or two, or any other clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dynid.core import RecordError
from dynid.recording.naming import Name


@dataclass(frozen=True, slots=True, kw_only=True)
class Clock:
    """One or two columns of time."""

    columns: tuple[int, ...]
    """The column, or those of whole seconds and of nanoseconds."""
    scale: float | None
    """Seconds per unit; None where the name does not say."""
    label: str
    """The name of its first column."""


def find_clocks(
    parsed: Sequence[Name], names: Sequence[str], scope: str, where: str
) -> list[Clock]:
    """All columns of time, the best first.

    Stamps of a message's header go before times of arrival, and those of the positions' own
    message before others.

    Args:
        parsed: Column names taken apart.
        names: The same as they stand in the file.
        scope: The path of the positions' columns.
        where: The file, for messages.

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
            where=where,
            value=[clock.label for clock in same],
            next_step=f"Say which with --columns, for example t={same[0].columns[0]},q=...",
        )
    return [clock for _, clock in found]


def _stem(name: Name) -> tuple[str, str]:
    return name.scope, name.base.rpartition("_")[0].removesuffix("_nano")


def _shared(one: str, other: str) -> int:
    """How many parts two paths have in common from their start."""
    count = 0
    for a, b in zip(filter(None, one.split(".")), filter(None, other.split(".")), strict=False):
        if a != b:
            break
        count += 1
    return count
