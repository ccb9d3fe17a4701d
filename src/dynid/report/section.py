"""A section of the report, and what it may hold."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

from dynid.figures.canvas import Canvas
from dynid.report.contents import ReportContents


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Rows of text below a heading."""

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    folded: bool = False
    """Shown only on request: long tables."""

    @property
    def numeric(self) -> tuple[bool, ...]:
        """Which columns hold numbers alone, and stand right below each other."""
        cells = zip(*self.rows, strict=True) if any(self.columns) else ()
        found = tuple(any(column) and all(map(_is_number, column)) for column in cells)
        return found or (False,) * len(self.columns)


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A stretch of a section: words, then tables, then figures."""

    heading: str = ""
    words: tuple[str, ...] = ()
    """Paragraphs, plain text."""
    mark: str = ""
    """`usable`, `care` or `do_not_use`: the part is painted as a verdict."""
    tables: tuple[Table, ...] = field(default=())
    figures: tuple[Canvas, ...] = field(default=())


class Section(ABC):
    """One chapter; it computes nothing."""

    anchor: str
    """Its address in the page."""
    title: str

    @abstractmethod
    def parts(self, contents: ReportContents) -> tuple[Part, ...]:
        """What to show; nothing if it has nothing to say."""


def number(value: float | None, digits: int = 3) -> str:
    """A number for people; a dash where there is none."""
    if value is None or value != value:
        return "-"
    return f"{value:#.{digits}g}".rstrip(".") if value else "0"


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return cell in ("", "-")
    return True
