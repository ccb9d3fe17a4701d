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
    return f"{value:.{digits}g}"
