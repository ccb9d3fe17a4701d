"""Excel workbooks (`.xlsx`): the only sheet of numbers, written as a table of text.

Such a file is XML in a zip archive, so Python's own library reads it.
"""

from __future__ import annotations

import re
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO
from xml.etree import ElementTree

from dynid.core import RecordError

_MARK = "xl/workbook.xml"
_STRINGS = "xl/sharedStrings.xml"
_SHEET = re.compile(r"xl/worksheets/[^/]+\.xml")
_FEWEST_ROWS = 3
_MOST_COLUMNS = 5000
_MOST_BYTES = 2 << 30
_MOST_ROWS = 1 << 20
_AGAIN = "Save the sheet as CSV."


def is_workbook(path: Path) -> bool:
    """Whether a zip archive is an Excel workbook, by its name or by what it holds."""
    if path.suffix.lower() in (".xlsx", ".xlsm"):
        return True
    try:
        with zipfile.ZipFile(path) as archive:
            return _MARK in archive.namelist()
    except (zipfile.BadZipFile, OSError, ValueError):
        return False


def write_sheet(path: Path, target: Path) -> None:
    """Write the sheet of numbers with tabs between cells, a line a row.

    Args:
        path: The workbook.
        target: The text file.

    Raises:
        RecordError: Damaged, too large, or none or several sheets of numbers.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            if sum(item.file_size for item in archive.infolist()) > _MOST_BYTES:
                raise RecordError("the workbook is too large", where=path.name)
            strings = _strings(archive)
            sheets = sorted(name for name in archive.namelist() if _SHEET.fullmatch(name))
            full = [name for name in sheets if _has_numbers(archive, name)]
            if len(full) != 1:
                raise RecordError(
                    f"the workbook has {len(full) or 'no'} sheets of numbers",
                    where=path.name,
                    value=_titles(archive),
                    next_step=_AGAIN,
                )
            with target.open("w", encoding="utf-8") as sink:
                for cells in _rows(archive, full[0]):
                    texts = [_text(kind, value, strings) for kind, value in cells]
                    sink.write("\t".join(texts) + "\n")
    # Damaged bytes show in the archive, in its compression, in the XML, or in its numbers.
    except (
        *(zipfile.BadZipFile, zipfile.LargeZipFile, ElementTree.ParseError, OSError, EOFError),
        *(zlib.error, ValueError, KeyError, IndexError, NotImplementedError, RuntimeError),
    ) as error:
        raise RecordError(
            "the workbook is damaged", where=path.name, value=str(error)[:200], next_step=_AGAIN
        ) from error


def _parsed(stream: IO[bytes]) -> Iterator[ElementTree.Element]:
    """Elements at their ends."""
    for _, element in ElementTree.iterparse(stream, events=("end",)):
        yield element


def _local(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2]


def _strings(archive: zipfile.ZipFile) -> list[str]:
    """The texts that cells refer to by number."""
    if _STRINGS not in archive.namelist():
        return []
    found: list[str] = []
    with archive.open(_STRINGS) as stream:
        for element in _parsed(stream):
            if _local(element) == "si":
                found.append(_inner(element))
                element.clear()
    return found


def _inner(element: ElementTree.Element) -> str:
    text = "".join(part.text or "" for part in element.iter() if _local(part) == "t")
    return " ".join(text.split())


def _rows(archive: zipfile.ZipFile, name: str) -> Iterator[list[tuple[str, str]]]:
    """Type and value of the cells of each row; rows that are left out are empty."""
    count = 0
    with archive.open(name) as stream:
        for element in _parsed(stream):
            if _local(element) != "row":
                continue
            number = int(element.get("r", count + 1))
            if not count < number <= _MOST_ROWS:
                raise ValueError(f"row {number} after row {count}")
            yield from ([] for _ in range(number - count - 1))
            count = number
            cells: list[tuple[str, str]] = []
            for cell in element:
                place = _column(cell.get("r", ""), len(cells))
                cells += [("", "")] * (place - len(cells))
                inline = cell.get("t") == "inlineStr"
                value = next((part.text or "" for part in cell if _local(part) == "v"), "")
                cells.append((cell.get("t", "n"), _inner(cell) if inline else value))
            yield cells
            element.clear()


def _column(reference: str, following: int) -> int:
    """The column of `C7`, from 0."""
    letters = re.match(r"[A-Z]{1,3}", reference)
    if letters is None:
        return following
    place = 0
    for letter in letters.group():
        place = 26 * place + ord(letter) - ord("A") + 1
    if not following < place <= _MOST_COLUMNS:
        raise ValueError(f"cell {reference} is out of order or too far right")
    return place - 1


def _has_numbers(archive: zipfile.ZipFile, name: str) -> bool:
    """Whether at least some rows are mostly numbers."""
    found = 0
    for cells in _rows(archive, name):
        numbers = sum(kind == "n" and bool(value) for kind, value in cells)
        found += numbers > 1 and 2 * numbers > sum(bool(value) for _, value in cells)
        if found >= _FEWEST_ROWS:
            return True
    return False


def _titles(archive: zipfile.ZipFile) -> list[str]:
    with archive.open(_MARK) as stream:
        return [item.get("name", "") for item in _parsed(stream) if _local(item) == "sheet"][:20]


def _text(kind: str, value: str, strings: list[str]) -> str:
    if kind == "s":
        return strings[int(value)]
    if kind == "e":
        # `#DIV/0!` is no value.
        return ""
    return " ".join(value.split())
