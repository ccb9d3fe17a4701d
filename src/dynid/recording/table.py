"""The raw table: what an importer found, before anything is repaired, and the clock among it.

Which columns are the time, and the best of them that runs.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import takewhile
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from dynid.core import Array, Finding, Mask, RecordError, UnclearRecordError, printable
from dynid.recording.cells import past_midnight
from dynid.recording.names import Name

Rows = NDArray[np.int64]

ESSENTIAL = ("q", "qd", "current", "effort")
"""Quantities whose missing cells cost the row; any other quantity is left out instead."""
TORQUE_SOURCES = ("current", "effort")
ANGLES = ("q", "qd", "qdd", "target_q", "target_qd", "target_qdd")
"""Quantities measured in rad, rad/s, rad/s^2 on revolute joints."""


def rows_with(cells: Mask) -> Mask:
    """(N) rows in which any of the (N, n) cells is true."""
    return np.asarray(cells.any(axis=1), dtype=np.bool_)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadOptions:
    """What a user says of a file that does not say everything itself; see `read_recording`."""

    format: str = "auto"
    columns: dict[str, str] | None = None
    """Quantity to what the user says holds it, see `parse_columns`; None to go by the names."""
    header: bool | None = None
    delimiter: str | None = None
    joints: tuple[str, ...] = ()
    """The robot's joint names, base to tip; empty if the robot is not known."""
    joint_order: tuple[str, ...] | None = None
    """Column numbers base to tip, or the robot's joint names in the file's order."""
    topic: str | None = None
    rate_hz: float | None = None
    """The clock of a recording without time stamps [Hz]."""
    degrees: bool = False
    """Whether positions, velocities and accelerations are in degrees."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RawTable:
    """Signals as they stood in a file; cells that could not be read are NaN."""

    source: str = ""
    """The file, for messages."""
    format: str = ""
    """The format it was read as; empty for that by which the reader was chosen."""
    rows: Rows
    """(N) line, message or sample number in the file, from 1."""
    index: Rows = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """(N) place of each row in the table as it was read, to know where rows have gone."""
    row_word: str = "line"
    """What `rows` counts: `line`, `message` or `sample`."""
    signals: Mapping[str, Array]
    """Quantity to (N, n) samples."""
    t: Array | None = None
    """(N) time stamps, or None where the file has no clock."""
    time_scale: float | None = None
    """Seconds per unit of `t`, or None where the file does not say."""
    t0: str = ""
    """The stamp at which `t` is zero; empty where `t` is the stamp itself."""
    clock: str = "recorded"
    """`recorded`, `header`, `receive` or `rate`."""
    labels: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])
    """Quantity to the names of its columns in the file."""
    columns: Mapping[str, list[int]] = field(default_factory=dict[str, list[int]])
    """Quantity to the numbers of its columns in the file, where it has such."""
    said: frozenset[str] = frozenset()
    """Quantities whose units the file itself names; they are in SI units already."""
    joint_names: tuple[str, ...] = ()
    """Joint names in column order, where the file gives them."""
    channels: Mapping[str, Array] = field(default_factory=dict[str, Array])
    """Other columns, name to (N)."""
    reported: Mask = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    """(N) rows whose loss `notices` reports already."""
    notices: tuple[Finding, ...] = ()
    """What was found so far."""
    notes: tuple[str, ...] = ()
    """Choices made in reading that are no problem, in words."""
    dropped: int = 0
    """Rows thrown away so far."""
    extra: Mapping[str, str] = field(default_factory=dict[str, str])
    """Facts for the record's metadata."""

    def __post_init__(self) -> None:
        if len(self.index) != len(self.rows):
            object.__setattr__(self, "index", np.arange(len(self.rows), dtype=np.int64))
        if len(self.reported) != len(self.rows):
            object.__setattr__(self, "reported", np.zeros(len(self.rows), dtype=np.bool_))

    @property
    def ticks(self) -> Array:
        """(N - 1) how many rows each step spans, those that were left out counted."""
        return np.diff(self.index).astype(np.float64)

    @property
    def stamps(self) -> Array:
        """(N) time stamps.

        Raises:
            RecordError: The table has none yet.
        """
        if self.t is None:
            raise RecordError("the recording has no time")
        return self.t

    @property
    def samples(self) -> int:
        """Number of rows N."""
        return len(self.rows)

    @property
    def joints(self) -> int:
        """Number of joints n, from the positions."""
        return self.signals["q"].shape[1] if "q" in self.signals else 0

    def label(self, quantity: str, joint: int) -> str:
        """The name of a column, as the file has it."""
        names = self.labels.get(quantity, ())
        if joint < len(names):
            return f"{quantity} of joint {joint + 1} ({printable(names[joint])})"
        return f"{quantity} of joint {joint + 1}"

    def row(self, index: int) -> str:
        """Where a row stands in the file: `line 12`."""
        return f"{self.row_word} {int(self.rows[index])}"

    def report(self, kind: str, text: str, joints: tuple[int, ...] = ()) -> Self:
        """The same table with one more notice."""
        return replace(self, notices=(*self.notices, Finding(kind, text, joints=joints)))

    def leave_out(self, bad: Mask, why: str, kind: str = "corrupt_rows", most: float = 1.0) -> Self:
        """The table without (N) bad rows, if there are any, and a notice that names the first.

        They are what `why` says: `rows ... and are left out`. Above the share `most` they stay.
        """
        if not bad.any():
            return self
        left, done = self.keep(~bad), "and are left out"
        if bad.mean() > most:
            left, done = self, "and are kept, too many to leave out"
        first = self.row(int(np.argmax(bad)))
        text = f"{int(bad.sum())} of {self.samples} rows {why} {done}; first: {first}"
        return left.report(kind, text)

    def note(self, text: str) -> Self:
        """The same table with one more note."""
        return replace(self, notes=(*self.notes, text))

    def with_signals(self, changes: Mapping[str, Array]) -> Self:
        """The same table with some signals replaced."""
        return replace(self, signals={**self.signals, **changes})

    def without(self, quantity: str) -> Self:
        """The same table without one quantity."""
        kept = {name: value for name, value in self.signals.items() if name != quantity}
        return replace(self, signals=kept)

    def keep(self, mask: Mask, *, counted: bool = True) -> Self:
        """Only the rows where `mask` (N) is true; the others may count as dropped rows."""
        if bool(mask.all()):
            return self
        return replace(
            self,
            rows=self.rows[mask],
            index=self.index[mask],
            t=None if self.t is None else self.t[mask],
            signals={name: value[mask] for name, value in self.signals.items()},
            channels={name: value[mask] for name, value in self.channels.items()},
            reported=self.reported[mask],
            dropped=self.dropped + (int((~mask).sum()) if counted else 0),
        )


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
    # One alone is of the run, as in `trial_1/t`, and not of a joint.
    alone = sum(name.quantity == "t" for name in parsed) == 1
    for k, name in enumerate(parsed):
        meaning = name.meaning
        half = halves.get(_stem(name)) if name.clock == "sec" else None
        of_joint = name.index is not None and not alone
        if half is None and (meaning is None or meaning[0] != "t" or of_joint):
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
        clock = Clock(
            columns=(k,) if half is None else (k, half),
            scale=1.0 if half is not None else name.time_scale,
            label=names[k],
        )
        found.append((order, clock))
    found.sort(key=lambda item: item[0])
    best = [clock for order, clock in found if order == found[0][0]]
    same = [clock for clock in best if clock.label == best[0].label]
    if len(same) > 1:
        raise UnclearRecordError(
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
    clocks: Sequence[Clock],
    column: Callable[[int], Array],
    moments: frozenset[int] = frozenset(),
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
