"""Text files as blocks of lines, with bounded memory whatever the bytes are."""

from __future__ import annotations

import codecs
from collections.abc import Iterator
from pathlib import Path

from dynid.core import RecordError
from dynid.recording.opening import unreadable

MAX_LINE = 1 << 20
"""Longest line that is read [characters]; a longer one counts as unreadable."""
UNREADABLE = "\ufffd"
"""What stands in the place of a line that is too long."""
_BLOCK = 1 << 20
_MOST_SNIFFED = 4 << 20
_TEXT = bytes([*range(9, 14), *range(32, 127)])
_LETTERS = frozenset("°²³µ·äöüÄÖÜßéèàçñ±".encode("cp1252"))
SNIFFED = 1 << 16
"""Bytes from the start of a file that tell its encoding."""


def encoding_of(head: bytes) -> str:
    """The encoding of a text.

    A byte order mark says it; zeros beside plain letters do; else it is UTF-8, or the
    Windows code page where the bytes are no UTF-8 (a degree sign in a header).

    Args:
        head: The first bytes of the file.
    """
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    wide = _wide(head)
    if wide:
        return wide
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        # A few wrong bytes in a long table are damage; in a header they are letters.
        if b"\x00" not in head and _LETTERS.issuperset(head.translate(None, _TEXT)):
            return "cp1252"
    return "utf-8-sig"


def looks_like_text(head: bytes) -> bool:
    """Whether the first bytes of a file can be a table in text form."""
    if head.startswith((b"\xff\xfe", b"\xfe\xff")) or _wide(head):
        return True
    return len(head.translate(None, _TEXT)) <= 0.1 * len(head)


def _wide(head: bytes) -> str:
    """The sort of UTF-16 without a byte order mark, or nothing."""
    even, odd = head[0:4096:2], head[1:4096:2]
    if len(odd) < 8:
        return ""
    for zeros, letters, name in ((odd, even, "utf-16-le"), (even, odd, "utf-16-be")):
        if zeros.count(0) >= 0.95 * len(zeros) and (
            len(letters.translate(None, _TEXT)) <= 0.05 * len(letters)
        ):
            return name
    return ""


def line_blocks(path: Path, encoding: str) -> Iterator[tuple[list[str], bool]]:
    """Lines of a file, some thousands at a time.

    Yields:
        Lines without their ends, and whether the last of them was closed by a line end
        (false for the last line of a file that stops in mid-line only).

    Raises:
        RecordError: The file cannot be read.
    """
    try:
        with path.open(encoding=encoding, errors="replace") as stream:
            pending, too_long = "", False
            while block := stream.read(_BLOCK):
                lines = block.split("\n")
                lines[0] = pending + lines[0]
                if too_long and len(lines) > 1:
                    lines[0], too_long = UNREADABLE, False
                pending = lines.pop()
                if len(pending) > MAX_LINE or too_long:
                    pending, too_long = "", True
                yield [x if len(x) <= MAX_LINE else UNREADABLE for x in lines], True
            if pending or too_long:
                yield [UNREADABLE if too_long else pending], False
    except UnicodeError as error:
        raise RecordError(
            "the text encoding is damaged",
            where=path.name,
            next_step="Save the file as UTF-8.",
        ) from error
    except OSError as error:
        raise unreadable(path, error) from error


def first_lines(path: Path, encoding: str, count: int) -> list[str]:
    """At most `count` lines from the start of a file.

    Raises:
        RecordError: The file cannot be read, or its first line is too long for a table.
    """
    lines: list[str] = []
    size = 0
    for block, _ in line_blocks(path, encoding):
        lines.extend(block)
        size += _BLOCK
        if len(lines) >= count or (lines and size > _MOST_SNIFFED):
            break
        if lines[:1] == [UNREADABLE]:
            break
        if not lines and path.stat().st_size > 4 * MAX_LINE:
            break
    if not lines or lines[0] == UNREADABLE:
        raise RecordError(
            "line 1 is too long for a table",
            where=path.name,
            limit=f"{MAX_LINE} characters",
            next_step="Check that the file is a recording in text form.",
        )
    return lines[:count]
