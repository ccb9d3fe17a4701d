"""Rows whose cells hold lists, `"[0.1, 0.2]"`, and rows that name their joints."""

from __future__ import annotations

import re
from collections.abc import Sequence

from dynid.recording.text.cells import is_missing, is_number, split

_ARRAY = re.compile(r"array\(\s*(?:['\"][a-z]['\"]\s*,\s*)?(\[[^\]]*\])[^()]*\)")
_LIST = re.compile(r"(?<![\w\])])[\[(]([^\[\]()]*)[\])](?![\w\[(])")
_WORD = re.compile(r"[A-Za-z_][\w/\-]*")
_NAMES = frozenset({"name", "names", "joint_name", "joint_names"})


def has_lists(line: str) -> bool:
    """Whether some cell of a row is a list of numbers or of words."""
    return any(
        len(items) > 1 and (all(map(is_number, items)) or all(map(_WORD.fullmatch, items)))
        for match in _LIST.finditer(_ARRAY.sub(r"\1", line))
        for items in [_items(match.group(1))]
    )


def flatten(line: str, delimiter: str) -> str:
    """A row with the items of its lists as cells of their own, and without quotes."""
    return _LIST.sub(
        lambda match: delimiter.join(_items(match.group(1))), _ARRAY.sub(r"\1", line)
    ).replace('"', "")


def widths(line: str, delimiter: str) -> list[int]:
    """How many numbers or words each cell of a row holds.

    Args:
        line: The row as it stands in the file.
        delimiter: What separates the cells.
    """
    counts: list[int] = []

    def mark(match: re.Match[str]) -> str:
        counts.append(len(_items(match.group(1))))
        return "\x00"

    cells = split(_LIST.sub(mark, _ARRAY.sub(r"\1", line)), delimiter)
    sizes = iter(counts)
    return [next(sizes) if "\x00" in cell else 1 for cell in cells]


def spread(names: Sequence[str], sizes: Sequence[int]) -> tuple[str, ...] | None:
    """Header names for flattened rows: `q` of six items becomes `q[0]` to `q[5]`.

    Args:
        names: The header's names, one a cell.
        sizes: Items of each cell.

    Returns:
        The names, or None where the header has another number of cells.
    """
    if len(names) != len(sizes):
        return None
    out: list[str] = []
    for name, size in zip(names, sizes, strict=True):
        out += [name] if size == 1 else [f"{name}[{k}]" for k in range(size)]
    return tuple(out)


def echoed_names(cells: Sequence[str]) -> tuple[str, ...] | None:
    """The header that `ros2 topic echo --csv` leaves out before JointState messages.

    A row holds the stamp (s and ns), the frame, n joint names, and n numbers of each of
    position, velocity and effort, as far as they were sent.

    Args:
        cells: A row.

    Returns:
        The names, or None where the row is no such message.
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


def joints_named(names: Sequence[str] | None, cells: Sequence[str]) -> tuple[int, ...]:
    """The columns that hold joint names, base first as the messages have them.

    Args:
        names: Header names.
        cells: A row of the table.
    """
    if names is None or len(cells) != len(names):
        return ()
    found: list[tuple[int, int]] = []
    for k, name in enumerate(names):
        word = re.split(r"[/.]", name.strip().strip("\"'").lower())[-1]
        match = re.fullmatch(r"([a-z_]+?)_?\[?(\d{1,2})\]?", word)
        if match and match.group(1) in _NAMES and not is_number(cells[k]):
            found.append((int(match.group(2)), k))
    return tuple(column for _, column in sorted(found))


def _items(inside: str) -> list[str]:
    separator = "," if "," in inside else ";" if ";" in inside else None
    return [item.strip().strip("\"'") for item in inside.strip().split(separator)]
