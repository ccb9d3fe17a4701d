"""How a text table is written: encoding, lines, lists in cells, delimiter, header."""

import codecs
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from dynid.core import RecordError, UnclearRecordError
from dynid.recording.cells import count, is_missing, is_name, is_number, is_stamp, is_unit, split
from dynid.recording.content import first_bytes
from dynid.recording.names import NAMES_OF_JOINTS, parse_name

MAX_LINE = 1 << 20
"""Longest line that is read [characters]; a longer one counts as unreadable."""
UNREADABLE = "\ufffd"
"""What stands in the place of a line that is too long."""
_BLOCK = 1 << 20
_MOST_SNIFFED = 4 << 20
_TEXT = bytes([*range(9, 14), *range(32, 127)])
_LETTERS = frozenset("°²³µ·äöüÄÖÜßéèàçñ±\u00a0\u2019".encode("cp1252"))
SNIFFED = 1 << 16
"""Bytes from the start of a file that tell its encoding."""


def _encoding_of(head: bytes) -> str:
    """The encoding of a text, by the first bytes of its file.

    A byte order mark says it; else it is UTF-8, or the Windows code page where the bytes are no
    UTF-8 (a degree sign in a header).
    """
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        # A few wrong bytes in a long table are damage; in a header they are letters.
        if b"\x00" not in head and _LETTERS.issuperset(head.translate(None, _TEXT)):
            return "cp1252"
    return "utf-8-sig"


def looks_like_text(head: bytes) -> bool:
    """Whether the first bytes of a file can be a table in text form."""
    marked = head.startswith((b"\xff\xfe", b"\xfe\xff"))
    # The minus of Swedish and Norwegian programs.
    head = head.replace("\u2212".encode(), b"-")
    return marked or len(head.translate(None, _TEXT)) <= 0.1 * len(head)


def line_blocks(path: Path, encoding: str) -> Iterator[tuple[list[str], bool]]:
    """Lines of a file, some thousands at a time.

    Yields:
        Lines without their ends, and whether the last of them was closed by a line end
        (false for the last line of a file that stops in mid-line only).

    Raises:
        RecordError: The encoding is damaged.
    """
    try:
        with path.open(encoding=encoding, errors="replace") as stream:
            while lines := stream.readlines(_BLOCK):
                short = (x.rstrip("\n") if len(x) <= MAX_LINE else UNREADABLE for x in lines)
                yield list(short), lines[-1].endswith("\n")
    except UnicodeError as error:
        raise RecordError(
            "the text encoding is damaged", where=path.name, next_step="Save the file as UTF-8."
        ) from error


def _first_lines(path: Path, encoding: str, count: int) -> list[str]:
    """At most `count` lines from the start of a file; RecordError where the first is too long."""
    lines: list[str] = []
    size = 0
    for block, _ in line_blocks(path, encoding):
        lines.extend(block)
        size += sum(map(len, block))
        if len(lines) >= count or size > _MOST_SNIFFED or lines[0] == UNREADABLE:
            break
    if not lines or lines[0] == UNREADABLE:
        raise RecordError(
            "line 1 is too long for a table",
            where=path.name,
            limit=f"{MAX_LINE} characters",
            next_step="Check that the file is a recording in text form.",
        )
    return lines[:count]


_ARRAY = re.compile(r"array\(\s*(?:['\"][a-z]['\"]\s*,\s*)?(\[[^\]]*\])[^()]*\)")
_LIST = re.compile(r"(?<![\w\])])[\[(]([^\[\]()]*)[\])](?![\w\[(])")
_WORD = re.compile(r"[A-Za-z_][\w/\-]*")


def _has_lists(line: str) -> bool:
    """Whether some cell of a row is a list of numbers or of words."""
    return any(
        len(items) > 1 and (all(map(is_number, items)) or all(map(_WORD.fullmatch, items)))
        for match in _LIST.finditer(_ARRAY.sub(r"\1", line))
        for items in [_items(match.group(1))]
    )


def _flatten(line: str, delimiter: str) -> str:
    """A row with the items of its lists as cells of their own, and without quotes."""
    return _LIST.sub(
        lambda match: delimiter.join(_items(match.group(1))), _ARRAY.sub(r"\1", line)
    ).replace('"', "")


_QUOTED = re.compile(r'"((?:[^"]|"")*)"')
_COMMA_IN_QUOTES = re.compile(r'(?:^|,)"[^"]*,[^"]*"(?:,|$)')


def _unquoted(line: str) -> str:
    """A row between commas, with tabs between its cells and without quotes."""
    return re.sub(f"{_QUOTED.pattern}|,", lambda m: "\t" if m[0] == "," else m[1], line)


def _widths(line: str, delimiter: str) -> list[int]:
    """How many numbers or words each cell of a row, as it stands in the file, holds."""
    marked = _LIST.sub(lambda match: f"\0{len(_items(match.group(1)))}", _ARRAY.sub(r"\1", line))
    counts = (re.search(r"\0(\d+)", cell) for cell in split(marked, delimiter))
    return [int(found.group(1)) if found else 1 for found in counts]


def _spread(names: Sequence[str], sizes: Sequence[int]) -> tuple[str, ...] | None:
    """Header names for flattened rows: `q` of six items becomes `q[0]` to `q[5]`.

    None where the header has another number of cells than there are sizes.
    """
    if len(names) != len(sizes):
        return None
    out: list[str] = []
    for name, size in zip(names, sizes, strict=True):
        out += [name] if size == 1 else [f"{name}[{k}]" for k in range(size)]
    return tuple(out)


def _echoed_names(cells: Sequence[str]) -> tuple[str, ...] | None:
    """The header that `ros2 topic echo --csv` leaves out before JointState messages.

    A row holds the stamp (s and ns), the frame, n joint names, and n numbers of each of
    position, velocity and effort, as far as they were sent. None where it is no such message.
    """
    words = [k for k, cell in enumerate(cells) if not is_number(cell) and not is_missing(cell)]
    first = 3 if words[:1] == [2] or (len(cells) > 2 and is_missing(cells[2])) else 2
    joints = [k for k in words if k >= first]
    n = len(joints)
    rest = len(cells) - first - n
    if n == 0 or joints != list(range(first, first + n)) or rest % n or not n <= rest <= 3 * n:
        return None
    if not all(is_number(cell) for cell in cells[:2]):
        return None
    names = ["header.stamp.sec", "header.stamp.nanosec", "header.frame_id"][:first]
    fields = ("name", "position", "velocity", "effort")
    for field in fields if rest == 3 * n else fields[: 1 + rest // n]:
        names += [f"{field}[{k}]" for k in range(n)]
    return tuple(names)


def _joints_named(names: Sequence[str] | None, cells: Sequence[str]) -> tuple[int, ...]:
    """The columns of a row that hold joint names, base first as the messages have them."""
    if names is None or len(cells) != len(names):
        return ()
    found: list[tuple[int, int]] = []
    for k, name in enumerate(names):
        word = re.split(r"[/.]", name.strip().strip("\"'").lower())[-1]
        match = re.fullmatch(r"([a-z_]+?)_?\[?(\d{1,2})\]?", word)
        if match and match.group(1) in NAMES_OF_JOINTS and not is_number(cells[k]):
            found.append((int(match.group(2)), k))
    return tuple(column for _, column in sorted(found))


def _items(inside: str) -> list[str]:
    separator = "," if "," in inside else ";" if ";" in inside else None
    return [item.strip().strip("\"'") for item in inside.strip().split(separator)]


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
    stamps: frozenset[int]
    """Columns that hold dates or times of day."""
    lists: bool
    """Whether cells hold lists, each item of which counts as a column."""
    joint_names: tuple[str, ...]
    """Joint names that stand in the rows themselves, if any."""
    joint_cells: str
    """Those names as they stand in a row, from the first to the last."""
    quoted: bool
    """Whether commas stand within cells, which are in quotes."""

    def row(self, line: str) -> str:
        """A row as it is split at the delimiter: without commas in quotes, a cell an item."""
        if self.quoted:
            return _unquoted(line)
        if self.lists:
            return _flatten(line, self.delimiter)
        if self.delimiter == "," and '"' in line:
            # Thousands, in a table whose first rows have none.
            return _QUOTED.sub(lambda match: match[1].replace(",", ""), line)
        return line


def _delimiter_of(given: str | None) -> str | None:
    """The delimiter that a user names: a character, or `tab`, `space`, `comma`."""
    if given is None:
        return None
    delimiter = _WORDS.get(given.strip().lower(), given) if given != "\t" else given
    if len(delimiter) != 1 or delimiter.isalnum() or delimiter in "\n\r.+-\"'":
        words = "a character, or comma, semicolon, tab, space"
        raise RecordError("the delimiter must be one character", value=given, limit=words)
    return delimiter


def sniff(path: Path, *, header: bool | None, delimiter: str | None) -> Dialect:
    """Find out how a text table is written, from its first lines, as far as it is not given.

    Raises:
        RecordError: There are no rows of numbers, or far too many columns.
    """
    encoding = _encoding_of(first_bytes(path, SNIFFED))
    written = _first_lines(path, encoding, _SAMPLE)
    given = _delimiter_of(delimiter)
    # A title or a header may have brackets as well: most lines must have lists.
    lists = 2 * sum(map(_has_lists, written[:_SCORED])) > min(len(written), _SCORED)
    lines = written
    if lists:
        # Between cells of which some are lists semicolon and tab are sure ones.
        signs = (given or next((sign for sign in ";\t" if sign in line), ",") for line in written)
        lines = [_flatten(line, sign) for line, sign in zip(written, signs, strict=True)]
    quoted = not lists and given in (None, ",") and any(map(_COMMA_IN_QUOTES.search, written))
    if quoted:
        given, written = "\t", [_unquoted(line) for line in written]
        lines = written
    best, sign, width = _best(lines[:_SCORED], DELIMITERS if given is None else (given,))
    if width == 0:
        step = "Check the file, or name its --delimiter."
        raise UnclearRecordError("there are no rows of numbers", where=path.name, next_step=step)
    if width > MAX_COLUMNS:
        raise RecordError("too many columns", where=path.name, value=width, limit=MAX_COLUMNS)
    first = _first_row(lines, best, sign, header, width)
    names = None
    if header is not False:
        sizes = _widths(written[first], best) if lists else []
        names = _names(written[:first], best, width, sizes, forced=bool(header))
    misfit = 0
    if names is not None and len(names) != width:
        misfit = len(names)
        names = None
    rows = [split(line, best) for line in lines[first:]]
    whole = [cells for cells in rows if len(cells) == width]
    if names is None and header is None and misfit == 0 and whole:
        names = _echoed_names(whole[0])
    stamps = frozenset(k for k in range(width) if any(is_stamp(cells[k]) for cells in whole[:5]))
    numeric = frozenset(k for k in range(width) if any(is_number(row[k], sign) for row in whole))
    named = _joints_named(names, whole[0] if whole else ())
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
        stamps=stamps,
        lists=lists,
        joint_names=tuple(whole[0][k].strip() for k in named),
        quoted=quoted,
        joint_cells=best.join(whole[0][named[0] : named[-1] + 1]) if named else "",
    )


def _best(lines: list[str], delimiters: tuple[str, ...]) -> tuple[str, str, int]:
    """Delimiter, decimal sign and width under which the lines hold most numbers."""
    best, sign, width, score = ",", ".", 0, 0
    for delimiter in delimiters:
        cells = [split(line, delimiter) for line in lines]
        for decimal in (".",) if delimiter == "," else (".", ","):
            # The most common width of rows of numbers, and how many numbers those rows hold.
            widths: Counter[int] = Counter()
            for row in cells:
                numbers, present = count(row, decimal)
                if _is_data(numbers, present):
                    widths[len(row)] += numbers
            found, points = widths.most_common(1)[0] if widths else (0, 0)
            if points > score:
                best, sign, width, score = delimiter, decimal, found, points
    return best, sign, width


def _is_data(numbers: int, present: int) -> bool:
    return numbers > 0 and 2 * numbers >= present


def _first_row(
    lines: list[str], delimiter: str, decimal: str, header: bool | None, width: int
) -> int:
    start = 0
    if header:
        start = 1 + next((k for k, x in enumerate(lines) if x.strip()), 0)
    rows = [cells for cells in (split(x, delimiter) for x in lines) if len(cells) == width]
    numbered = 2 * sum(is_name(row[0]) for row in rows) <= len(rows)
    first, few = start, False
    for k, line in enumerate(lines[start:], start):
        if not line.strip() or line.lstrip().startswith(COMMENT):
            continue
        cells = split(line, delimiter)
        numbers, present = count(cells, decimal)
        words = sum(map(is_name, cells))
        # `Sampling rate,125` above a wide table is no row of it, nor is `X0,0,0` of one of numbers.
        titled = numbered and is_name(cells[0])
        titled |= len(cells) != width and words > 0
        data, first = _is_data(numbers, present), first if few else k
        if header is False or (data and not titled):
            return first
        # Under the header a word may stand beside the numbers of a row.
        few = data and len(cells) == width and 3 * words < width
        # A damaged first row is a row, not a header: a header is made of names, or of units.
        named = titled or numbers == 0 or 2 * words >= present
        if header is None and not (named or _are_units(cells)):
            return first
    return start


def _are_units(cells: list[str]) -> bool:
    """Whether a line holds only units, which may stand in brackets or quotes."""
    return all(map(is_unit, filter(None, (cell.strip("\"'[]() ") for cell in cells))))


def _grouped(groups: list[str], cells: list[str]) -> list[str]:
    """Names under a line of groups, each above the first of its columns, as paths."""
    group, found = "", list[str]()
    for above, cell in zip(groups, cells, strict=True):
        group = above or (group if cell else "")
        inner, outer = (cell, group) if parse_name(cell).meaning else (group, cell)
        unit = cell.strip("[]()") if group and is_unit(cell.strip("[]()")) else ""
        found.append(f"{group} [{unit}]" if unit else "/".join(filter(None, (outer, inner))))
    return found


def _names(
    above: list[str], delimiter: str, width: int, sizes: list[int], *, forced: bool
) -> tuple[str, ...] | None:
    """The header above the first row, with the units of a line under it in brackets.

    The header is the nearest line of names that is no line of units.
    """
    misfit: tuple[str, ...] | None = None
    units = [""] * width
    plain = [x.strip().lstrip("#%/ ") if x.lstrip().startswith(COMMENT) else x for x in above]
    table = [[cell.strip().strip("\"'").strip() for cell in split(x, delimiter)] for x in plain]
    steps = {x for row in table if row[0].startswith("SampleTime") for x in row[1::2]}
    for cells in table:
        if len(cells) == width > 1 and {*cells[::2]} == {"Name"} and len(steps) < 2:
            # TwinCAT Scope: a pair of time and value a signal, at the same times.
            cells[::2] = ["Time [ms]", *[""] * (width // 2 - 1)]
            return tuple(cells)
    for k, cells in reversed(list(enumerate(table))):
        if _are_units(cells):
            units = [cell.strip("[]()- ") for cell in cells] if len(cells) == width else units
            continue
        if len(cells) == width - 1 and delimiter != " ":
            # Rows that end in a delimiter have one empty cell more than the header.
            cells.append("")
        if cells[width:] == ["Comment"]:
            cells.pop()  # LabVIEW has no cell of it in rows without a comment.
        wide = _spread(cells, sizes) if sizes else None
        if wide is not None and len(wide) == width:
            cells = list(wide)
        elif len(cells) != width or not (forced or 2 * sum(map(is_name, cells)) >= width - 1):
            if misfit is None and not above[k].lstrip().startswith(COMMENT) and len(cells) > 1:
                misfit = tuple(cells)
            continue
        # A line of groups may end with the last one's first column.
        groups = table[k - 1] if k > 0 else []
        if 1 < len(groups) <= width and len({*cells}) < sum(map(bool, cells)):
            cells = _grouped([*groups, *[""] * (width - len(groups))], cells)
        pairs = zip(cells, units, strict=True)
        return tuple(f"{name} [{unit}]" if unit else name for name, unit in pairs)
    return misfit
