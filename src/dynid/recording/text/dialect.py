"""How a text table is written: delimiter, decimal sign, header, width."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from dynid.core import RecordError
from dynid.recording.text.cells import count, is_name, is_number, split
from dynid.recording.text.lines import SNIFFED, encoding_of, first_lines
from dynid.recording.text.lists import (
    echoed_names,
    flatten,
    has_lists,
    joints_named,
    spread,
    widths,
)
from dynid.recording.text.stamps import is_stamp
from dynid.recording.units import is_unit

DELIMITERS = (",", ";", "\t", "|", " ")
MAX_COLUMNS = 5000
COMMENT = ("#", "%", "//")
_WORDS = {"comma": ",", "semicolon": ";", "tab": "\t", "\\t": "\t", "space": " ", "blank": " "}
_SAMPLE = 300
_SCORED = 80


@dataclass(frozen=True, slots=True, kw_only=True)
class Dialect:
    """How one text table is written."""

    path: Path
    encoding: str
    delimiter: str
    """One character; a blank stands for any run of blanks."""
    decimal: str
    """`.` or `,`."""
    width: int
    """Cells in a row."""
    first_row: int
    """Index of the first line of numbers, from 0."""
    names: tuple[str, ...] | None
    """Header names, as many as `width`, or None."""
    header_cells: int
    """Cells of a header that does not fit the rows; 0 where it fits or is absent."""
    numeric: frozenset[int]
    """Columns that hold numbers in the first rows."""
    units: tuple[str, ...]
    """Units from a line of their own under the header, one a column, or none."""
    stamps: frozenset[int]
    """Columns that hold dates or times of day."""
    lists: bool
    """Whether cells hold lists, each item of which counts as a column."""
    joint_names: tuple[str, ...]
    """Joint names that stand in the rows themselves, if any."""
    joint_cells: str
    """Those names as they stand in a row, from the first to the last."""


def delimiter_of(given: str | None) -> str | None:
    """The delimiter that a user names: a character, or `tab`, `space`, `comma`.

    Raises:
        RecordError: Not one character.
    """
    if given is None:
        return None
    delimiter = _WORDS.get(given.strip().lower(), given) if given != "\t" else given
    if len(delimiter) != 1 or delimiter.isalnum() or delimiter in "\n\r.+-\"'":
        raise RecordError(
            "the delimiter must be one character",
            value=given,
            limit="a character, or comma, semicolon, tab, space",
        )
    return delimiter


def sniff(path: Path, *, header: bool | None, delimiter: str | None) -> Dialect:
    """Find out how a text table is written, from its first lines.

    Args:
        path: The file.
        header: Whether it has a header line; None to find out.
        delimiter: Its delimiter; None to find out.

    Raises:
        RecordError: There are no rows of numbers, or far too many columns.
    """
    with path.open("rb") as stream:
        encoding = encoding_of(stream.read(SNIFFED))
    written = first_lines(path, encoding, _SAMPLE)
    given = delimiter_of(delimiter)
    # A title or a header may have brackets as well: most lines must have lists.
    lists = 2 * sum(map(has_lists, written[:_SCORED])) > min(len(written), _SCORED)
    lines = [flatten(line, given or _between_lists(line)) for line in written] if lists else written
    best, sign, width = _best(lines[:_SCORED], DELIMITERS if given is None else (given,))
    if width == 0:
        raise RecordError(
            "there are no rows of numbers",
            where=path.name,
            next_step="Check the file, or name its --delimiter.",
        )
    if width > MAX_COLUMNS:
        raise RecordError("too many columns", where=path.name, value=width, limit=MAX_COLUMNS)
    first = _first_row(lines, best, sign, header, width)
    names = None
    units: tuple[str, ...] = ()
    if header is not False:
        sizes = widths(written[first], best) if lists else []
        names, units = _names(written[:first], best, width, sizes, forced=bool(header))
    misfit = 0
    if names is not None and len(names) != width:
        misfit = len(names)
        names = None
    rows = [split(line, best) for line in lines[first:]]
    whole = [cells for cells in rows if len(cells) == width]
    if names is None and header is None and misfit == 0 and whole:
        names = echoed_names(whole[0])
    stamps = frozenset(k for k in range(width) if any(is_stamp(cells[k]) for cells in whole[:5]))
    numeric = frozenset(
        k for k in range(width) if any(is_number(cells[k], sign) for cells in whole)
    )
    named = joints_named(names, whole[0] if whole else ())
    return Dialect(
        path=path,
        encoding=encoding,
        delimiter=best,
        decimal=sign,
        width=width,
        first_row=first,
        names=names,
        header_cells=misfit,
        numeric=numeric,
        units=units,
        stamps=stamps,
        lists=lists,
        joint_names=tuple(whole[0][k].strip() for k in named),
        joint_cells=best.join(whole[0][named[0] : named[-1] + 1]) if named else "",
    )


def _best(lines: list[str], delimiters: tuple[str, ...]) -> tuple[str, str, int]:
    """Delimiter, decimal sign and width under which the lines hold most numbers."""
    best, sign, width, score = ",", ".", 0, 0
    for delimiter in delimiters:
        for decimal in (".",) if delimiter == "," else (".", ","):
            found, points = _score(lines, delimiter, decimal)
            if points > score:
                best, sign, width, score = delimiter, decimal, found, points
            if found > 1 and points >= 0.95 * found * len(lines):
                return best, sign, width
    return best, sign, width


def _score(lines: list[str], delimiter: str, decimal: str) -> tuple[int, int]:
    """The most common width of rows of numbers, and how many numbers those rows hold."""
    widths: Counter[int] = Counter()
    for line in lines:
        cells = split(line, delimiter)
        numbers, present = count(cells, decimal)
        if _is_data(numbers, present):
            widths[len(cells)] += numbers
    return widths.most_common(1)[0] if widths else (0, 0)


def _is_data(numbers: int, present: int) -> bool:
    return numbers > 0 and 2 * numbers >= present


def _first_row(
    lines: list[str], delimiter: str, decimal: str, header: bool | None, width: int
) -> int:
    start = 0
    if header:
        start = 1 + next((k for k, x in enumerate(lines) if x.strip()), 0)
    for k, line in enumerate(lines[start:], start):
        if not line.strip() or line.lstrip().startswith(COMMENT):
            continue
        cells = split(line, delimiter)
        # `Sampling rate,125` above a wide table is no row of it.
        titled = len(cells) != width and any(map(is_name, cells))
        if header is False or (_is_data(*count(cells, decimal)) and not titled):
            return k
        # A damaged first row is a row, not a header: a header is made of names.
        if header is None and 2 * sum(map(is_name, cells)) < len(cells):
            return k
    return start


def _between_lists(line: str) -> str:
    """The delimiter between cells of which some are lists: semicolon and tab are sure ones."""
    return next((sign for sign in (";", "\t") if sign in line), ",")


def _names(
    above: list[str], delimiter: str, width: int, sizes: list[int], *, forced: bool
) -> tuple[tuple[str, ...] | None, tuple[str, ...]]:
    """The header above the first row, and the units of a line under it.

    The header is the nearest line of names that is no line of units.
    """
    misfit: tuple[str, ...] | None = None
    units: tuple[str, ...] = ()
    for line in reversed(above):
        text = line.strip().lstrip("#%/ ") if line.lstrip().startswith(COMMENT) else line
        cells = [cell.strip().strip("\"'").strip() for cell in split(text, delimiter)]
        if not any(cells):
            continue
        if all(map(is_unit, filter(None, (cell.strip("[]()") for cell in cells)))):
            fits = len(cells) == width
            units = tuple(cell.strip("[]()") for cell in cells) if fits else units
            continue
        if len(cells) == width - 1 and delimiter != " ":
            # Rows that end in a delimiter have one empty cell more than the header.
            cells.append("")
        wide = spread(cells, sizes) if sizes else None
        if wide is not None and len(wide) == width:
            return wide, units
        if len(cells) == width and (forced or 2 * sum(map(is_name, cells)) >= len(cells) - 1):
            return tuple(cells), units
        if misfit is None and not line.lstrip().startswith(COMMENT) and len(cells) > 1:
            misfit = tuple(cells)
    return misfit, units
