"""Numbers of a text table: fast where the file is sound, cell by cell where it is not."""

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from dynid.core import Array, Finding, RecordError
from dynid.recording.cells import decimals, is_missing, number, split, stamp
from dynid.recording.dialect import COMMENT, Dialect, flatten, line_blocks
from dynid.recording.table import Mask, Rows, plain


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
    broken: int
    """Lines whose number of cells is wrong."""


@dataclass(slots=True)
class _Draft:
    blocks: list[Array] = field(default_factory=list[Array])
    rows: list[int] = field(default_factory=list[int])
    bad: list[int] = field(default_factory=list[int])
    broken: int = 0
    first: str = ""
    run_lines: int = 0
    run_cells: int = 0
    recent: deque[str] = field(default_factory=lambda: deque[str](maxlen=60))

    def blame(self, text: str) -> None:
        if not self.first:
            self.first = text


def read_grid(dialect: Dialect, wanted: list[int], soft: frozenset[int] = frozenset()) -> Grid:
    """Read columns of a text table.

    Args:
        dialect: How the table is written.
        wanted: Columns to read, in this order.
        soft: Columns whose unreadable cells are only missing, not a fault of the row.

    Raises:
        RecordError: The file cannot be read, or holds no row.
    """
    draft = _Draft()
    notices: list[Finding] = []
    line_number = strangers = 0
    chunk: list[tuple[int, str]] = []
    closed = True
    for lines, closed in line_blocks(dialect.path, dialect.encoding):
        for line in lines:
            line_number += 1
            if line_number <= dialect.first_row or not line.strip():
                continue
            if line.lstrip().startswith(COMMENT):
                continue
            row = flatten(line, dialect.delimiter) if dialect.lists else line
            if dialect.joint_cells and _names_others(row, dialect):
                strangers += 1
                continue
            chunk.append((line_number, row))
        if not closed:
            break
        while len(chunk) > _CHUNK:
            _take(draft, chunk[:_CHUNK], dialect, wanted, soft)
            del chunk[:_CHUNK]
    if chunk:
        number_, line = chunk[-1]
        cells = len(split(line, dialect.delimiter))
        before = [*draft.recent, *(text for _, text in chunk[:-1])]
        if cells < dialect.width or (
            not closed and dialect.width - 1 in wanted and is_cut(line, before, dialect)
        ):
            chunk.pop()
            notices.append(
                Finding(
                    "truncated_file",
                    f"the last line (line {number_}) of {dialect.path.name} stops in the middle; "
                    "it is left out",
                )
            )
    while chunk:
        _take(draft, chunk[:_CHUNK], dialect, wanted, soft)
        del chunk[:_CHUNK]
    _close_run(draft, dialect.width, len(wanted))
    if not draft.rows:
        raise RecordError("there are no rows of numbers", where=dialect.path.name)
    if draft.bad:
        notices.insert(
            0,
            Finding(
                "corrupt_rows",
                f"{len(draft.bad)} of {len(draft.rows)} rows of {dialect.path.name} cannot be "
                f"read; first: {draft.first}",
            ),
        )
    if strangers:
        notices.append(
            Finding(
                "dropped_rows",
                f"{strangers} rows of {dialect.path.name} name other joints than its first row",
            )
        )
    reported = np.zeros(len(draft.rows), dtype=np.bool_)
    reported[draft.bad] = True
    return Grid(
        values=np.concatenate(draft.blocks),
        rows=np.array(draft.rows, dtype=np.int64),
        reported=reported,
        notices=tuple(notices),
        broken=draft.broken,
    )


def _take(
    draft: _Draft,
    chunk: list[tuple[int, str]],
    dialect: Dialect,
    wanted: list[int],
    soft: frozenset[int],
) -> None:
    width, delimiter = dialect.width, dialect.delimiter
    counts = (
        [len(line.split()) for _, line in chunk]
        if delimiter == " "
        else [line.count(delimiter) + 1 for _, line in chunk]
    )
    if draft.run_lines == 0 and all(count == width for count in counts):
        values = _fast(chunk, dialect, wanted)
        if values is not None:
            draft.blocks.append(values)
            draft.rows.extend(n for n, _ in chunk)
            draft.recent.extend(line for _, line in chunk[-60:])
            return
    if len(chunk) > _PIECE:
        # Halve it, so that one bad cell does not make all its neighbours slow.
        half = len(chunk) // 2
        _take(draft, chunk[:half], dialect, wanted, soft)
        _take(draft, chunk[half:], dialect, wanted, soft)
        return
    for (line_number, line), count in zip(chunk, counts, strict=True):
        if count != width:
            draft.broken += 1
            draft.run_lines += 1
            draft.run_cells += count
            draft.blame(f"line {line_number} has {count} cells, not {width}")
            if draft.run_lines == 1:
                draft.rows.append(line_number)
                draft.bad.append(len(draft.rows) - 1)
                draft.blocks.append(np.full((1, len(wanted)), np.nan))
            continue
        _close_run(draft, width, len(wanted))
        _slow(draft, line_number, line, dialect, wanted, soft)
        draft.recent.append(line)


def _close_run(draft: _Draft, width: int, columns: int) -> None:
    """Give a run of broken lines as many rows as it must have been, so that counted time holds."""
    lines, cells = draft.run_lines, draft.run_cells
    draft.run_lines = draft.run_cells = 0
    if lines == 0:
        return
    # Two rows in one line have 2 width - 1 cells if the line end became part of a number.
    true_rows = round((cells + 1) / width) if lines == 1 else round(cells / width)
    for _ in range(min(true_rows, _CHUNK) - 1):
        draft.rows.append(draft.rows[-1])
        draft.bad.append(len(draft.rows) - 1)
        draft.blocks.append(np.full((1, columns), np.nan))


def _fast(chunk: list[tuple[int, str]], dialect: Dialect, wanted: list[int]) -> Array | None:
    lines = [line for _, line in chunk]
    if dialect.decimal == ",":
        lines = [line.replace(",", ".") for line in lines]
    try:
        values = np.loadtxt(
            lines,
            delimiter=None if dialect.delimiter == " " else dialect.delimiter,
            usecols=wanted,
            converters=dict.fromkeys(dialect.stamps & set(wanted), moment) or None,
            ndmin=2,
            comments=None,
            dtype=np.float64,
        )
    except (ValueError, OverflowError):
        return None
    return values if values.shape == (len(lines), len(wanted)) else None


def _slow(
    draft: _Draft,
    line_number: int,
    line: str,
    dialect: Dialect,
    wanted: list[int],
    soft: frozenset[int],
) -> None:
    cells = split(line, dialect.delimiter)
    values = np.full((1, len(wanted)), np.nan)
    faulty = False
    for k, column in enumerate(wanted):
        try:
            read = moment if column in dialect.stamps else number
            values[0, k] = read(cells[column], dialect.decimal)
        except ValueError:
            if column in soft:
                continue
            faulty = True
            name = plain(dialect.names[column]) if dialect.names else str(column)
            cell = plain(cells[column].strip(), 40)
            draft.blame(f"line {line_number}, column {name}: {cell!r}")
    draft.blocks.append(values)
    draft.rows.append(line_number)
    if faulty:
        draft.bad.append(len(draft.rows) - 1)


def _names_others(row: str, dialect: Dialect) -> bool:
    """Whether a whole row has other joint names than the first, or in another order."""
    return dialect.joint_cells not in row and (len(split(row, dialect.delimiter)) == dialect.width)
