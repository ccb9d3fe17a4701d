"""The raw table: what an importer found, before anything is repaired."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dynid.core import Array, Finding, RecordError, printable

Mask = NDArray[np.bool_]
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

    def report(self, kind: str, text: str, joints: tuple[int, ...] = ()) -> RawTable:
        """The same table with one more notice."""
        return replace(self, notices=(*self.notices, Finding(kind, text, joints=joints)))

    def leave_out(self, bad: Mask, why: str, kind: str = "corrupt_rows") -> RawTable:
        """The table without (N) bad rows, if there are any, and a notice that names the first.

        They are what `why` says: `rows ... and are left out`.
        """
        if not bad.any():
            return self
        first = self.row(int(np.argmax(bad)))
        text = f"{int(bad.sum())} of {self.samples} rows {why} and are left out; first: {first}"
        return self.keep(~bad).report(kind, text)

    def note(self, text: str) -> RawTable:
        """The same table with one more note."""
        return replace(self, notes=(*self.notes, text))

    def with_signals(self, changes: Mapping[str, Array]) -> RawTable:
        """The same table with some signals replaced."""
        return replace(self, signals={**self.signals, **changes})

    def without(self, quantity: str) -> RawTable:
        """The same table without one quantity."""
        return replace(
            self, signals={name: v for name, v in self.signals.items() if name != quantity}
        )

    def keep(self, mask: Mask, *, counted: bool = True) -> RawTable:
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
