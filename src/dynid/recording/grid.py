"""Numbers of a text table: fast where the file is sound, cell by cell where it is not."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from dynid.core import Array, Finding, Mask, RecordError, printable
from dynid.recording.cells import decimals, is_missing, number, split, stamp
from dynid.recording.dialect import COMMENT, Dialect, line_blocks
from dynid.recording.table import Rows


def _moment(cell: str, decimal: str = ".") -> float:
    """The number of a cell that may hold a date; see `number`."""
    try:
        return stamp(cell)
    except ValueError:
        return number(cell, decimal)


def _is_cut(line: str, before: list[str], dialect: Dialect) -> bool:
    """Whether the last number of a file without a last line end looks cut off.

    A whole number is as long as those above it; one that has nine decimals lost at most
    the tenth, and the plausible range catches a lost exponent.
    """
    last = split(line, dialect.delimiter)[-1]
    above = [split(x, dialect.delimiter)[-1] for x in before[-_RECENT:]]
    if is_missing(last):
        return not all(map(is_missing, above))
    try:
        value = _moment(last, dialect.decimal)
        others = np.array([_moment(x, dialect.decimal) for x in above], dtype=np.float64)
    except ValueError:
        return True
    others = others[np.isfinite(others)]
    if len(others) < 3 or not np.isfinite(value):
        return False
    spread = float(others.max() - others.min())
    plausible = others.min() - spread <= value <= others.max() + spread
    usual = float(np.median([decimals(x) for x in above]))
    return not plausible or decimals(last) < min(usual - 1, 9)


_RECENT = 60
"""Lines that a last line is compared with."""
_CHUNK = 512
_PIECE = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """Columns of a text table; a line that cannot be read is a row of NaN in its place."""

    values: Array
    """(N, k) the wanted columns."""
    rows: Rows
    """(N) line numbers, from 1."""
    reported: Mask
    """(N) rows that `notices` accounts for."""
    notices: tuple[Finding, ...]
    broken: int = 0
    """Lines whose number of cells is wrong."""


def _are_pieces(run: list[int], width: int) -> bool:
    """Whether lines that are too short are rows with line ends in them, and not rows cut short."""
    if len(run) > 2 and len(set(run)) == 1:
        return False
    left = 0
    for count in run:
        left += count
        # A line end within a number makes one cell more.
        left = 0 if left in (width, width + 1) else left
        if left > width:
            return False
    return left == 0


@dataclass(slots=True)
class _Draft:
    """The rows that were read so far."""

    dialect: Dialect
    wanted: list[int]
    soft: frozenset[int]
    blocks: list[Array] = field(default_factory=list[Array])
    rows: list[int] = field(default_factory=list[int])
    bad: list[int] = field(default_factory=list[int])
    broken: int = 0
    first: str = ""
    """What is wrong with the first bad row."""
    run: list[int] = field(default_factory=list[int])
    """Cells of the broken lines on end."""
    recent: deque[str] = field(default_factory=lambda: deque[str](maxlen=_RECENT))

    def take(self, chunk: list[tuple[int, str]]) -> None:
        """Read numbered lines."""
        width, delimiter = self.dialect.width, self.dialect.delimiter
        counts = (
            [len(line.split()) for _, line in chunk]
            if delimiter == " "
            else [line.count(delimiter) + 1 for _, line in chunk]
        )
        if width + 1 in counts:
            # Some lines of a file may end with a delimiter where others do not.
            both = zip(counts, chunk, strict=True)
            more = [count == width + 1 and x.endswith(delimiter) for count, (_, x) in both]
            chunk = [(k, x[:-1] if m else x) for m, (k, x) in zip(more, chunk, strict=True)]
            counts = [count - m for m, count in zip(more, counts, strict=True)]
        if not self.run and all(count == width for count in counts):
            values = self._fast([line for _, line in chunk])
            if values is not None:
                self.blocks.append(values)
                self.rows.extend(n for n, _ in chunk)
                self.recent.extend(line for _, line in chunk[-_RECENT:])
                return
        if len(chunk) > _PIECE:
            # Halve it, so that one bad cell does not make all its neighbours slow.
            half = len(chunk) // 2
            self.take(chunk[:half])
            self.take(chunk[half:])
            return
        for (line_number, line), count in zip(chunk, counts, strict=True):
            if count == width:
                self.close_run()
                self._slow(line_number, line)
                self.recent.append(line)
                continue
            self.broken += 1
            self.run.append(count)
            self.first = self.first or f"line {line_number} has {count} cells, not {width}"
            if len(self.run) == 1:
                self._lose(line_number)

    def close_run(self) -> None:
        """Give a run of broken lines as many rows as it must have been: counted time holds."""
        run, self.run, width = self.run, [], self.dialect.width
        if not run:
            return
        if len(run) > 1 and max(run) < width and not _are_pieces(run, width):
            true_rows = len(run)
        else:
            # Two rows in one line have 2 width - 1 cells if the line end became part of a number.
            true_rows = round((sum(run) + (len(run) == 1)) / width)
        for _ in range(min(true_rows, _CHUNK) - 1):
            self._lose(self.rows[-1])

    def _lose(self, line_number: int) -> None:
        """Add a row without numbers."""
        self.bad.append(len(self.rows))
        self.rows.append(line_number)
        self.blocks.append(np.full((1, len(self.wanted)), np.nan))

    def _fast(self, lines: list[str]) -> Array | None:
        if self.dialect.decimal == ",":
            lines = [line.replace(",", ".") for line in lines]
        try:
            values = np.loadtxt(
                lines,
                delimiter=None if self.dialect.delimiter == " " else self.dialect.delimiter,
                usecols=self.wanted,
                converters=dict.fromkeys(self.dialect.stamps & {*self.wanted}, _moment) or None,
                ndmin=2,
                comments=None,
                dtype=np.float64,
            )
        except (ValueError, OverflowError):
            return None
        return values if values.shape == (len(lines), len(self.wanted)) else None

    def _slow(self, line_number: int, line: str) -> None:
        cells = split(line, self.dialect.delimiter)
        values = np.full((1, len(self.wanted)), np.nan)
        faulty = False
        for k, column in enumerate(self.wanted):
            try:
                read = _moment if column in self.dialect.stamps else number
                values[0, k] = read(cells[column], self.dialect.decimal)
            except ValueError:
                if column in self.soft:
                    continue
                faulty = True
                name = printable(self.dialect.names[column]) if self.dialect.names else str(column)
                cell = printable(cells[column].strip(), 40)
                self.first = self.first or f"line {line_number}, column {name}: {cell!r}"
        if faulty:
            self.bad.append(len(self.rows))
        self.blocks.append(values)
        self.rows.append(line_number)


def read_grid(dialect: Dialect, wanted: list[int], soft: frozenset[int] = frozenset()) -> Grid:
    """Read the wanted columns of a text table, in this order.

    Unreadable cells of `soft` columns are only missing, not a fault of the row.

    Raises:
        RecordError: The file cannot be read, or holds no row.
    """
    draft = _Draft(dialect, wanted, soft)
    name, notices = dialect.path.name, list[Finding]()
    line_number = strangers = 0
    chunk: list[tuple[int, str]] = []
    closed = True
    for lines, ended in line_blocks(dialect.path, dialect.encoding):
        closed = ended
        for line in lines:
            line_number += 1
            if line_number <= dialect.first_row or not line.strip():
                continue
            if line.lstrip().startswith(COMMENT):
                continue
            row = dialect.row(line)
            named = dialect.joint_cells in row
            if not named and len(split(row, dialect.delimiter)) == dialect.width:
                # It has other joint names than the first, or in another order.
                strangers += 1
                continue
            chunk.append((line_number, row))
        # The last line is looked at before it is read.
        while len(chunk) > _CHUNK:
            draft.take(chunk[:_CHUNK])
            del chunk[:_CHUNK]
    if chunk:
        number_, line = chunk[-1]
        cells = len(split(line, dialect.delimiter))
        before = [*draft.recent, *(text for _, text in chunk[:-1])]
        if cells < dialect.width or (
            not closed and dialect.width - 1 in wanted and _is_cut(line, before, dialect)
        ):
            chunk.pop()
            text = f"the last line (line {number_}) of {name} stops in the middle; it is left out"
            notices.append(Finding("truncated_file", text))
    if chunk:
        draft.take(chunk)
    draft.close_run()
    if not draft.rows:
        raise RecordError("there are no rows of numbers", where=name)
    if draft.bad:
        text = f"{len(draft.bad)} of {len(draft.rows)} rows of {name} cannot be read"
        notices.insert(0, Finding("corrupt_rows", f"{text}; first: {draft.first}"))
    if strangers:
        text = f"{strangers} rows of {name} name other joints than its first row"
        notices.append(Finding("dropped_rows", text))
    reported = np.zeros(len(draft.rows), dtype=np.bool_)
    reported[draft.bad] = True
    return Grid(
        values=np.concatenate(draft.blocks),
        rows=np.array(draft.rows, dtype=np.int64),
        reported=reported,
        notices=tuple(notices),
        broken=draft.broken,
    )
