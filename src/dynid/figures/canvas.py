"""Plotly with types: the few calls that the figures make."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any, Protocol


class Canvas(Protocol):
    """A Plotly figure."""

    def add_trace(self, trace: Any, row: int | None = None, col: int | None = None) -> Any:
        """Draw a series, in one of the plots."""
        ...

    def add_hline(self, y: float, **style: Any) -> Any:
        """A level."""
        ...

    def add_vline(self, x: float, **style: Any) -> Any:
        """An instant, or an index."""
        ...

    def update_layout(self, **changes: Any) -> Any:
        """Change what belongs to the whole figure."""
        ...

    def update_xaxes(self, **changes: Any) -> Any:
        """Change the x axes."""
        ...

    def update_yaxes(self, **changes: Any) -> Any:
        """Change the y axes."""
        ...

    def update_annotations(self, **changes: Any) -> Any:
        """Change the texts."""
        ...

    def to_plotly_json(self) -> dict[str, Any]:
        """The figure as plain objects."""
        ...

    def to_json(self) -> str:
        """The figure as JSON text."""
        ...

    def write_html(self, file: Any, **options: Any) -> None:
        """Write a page."""
        ...

    def write_image(self, file: Any, **options: Any) -> None:
        """Write SVG or PNG."""
        ...


def scatter(**values: Any) -> Any:
    """A line or points."""
    return _objects().Scatter(**values)


def bar(**values: Any) -> Any:
    """Bars."""
    return _objects().Bar(**values)


def copied(canvas: Canvas) -> Canvas:
    """Another figure that shows the same."""
    return _objects().Figure(canvas)


def stacked(rows: int, **options: Any) -> Canvas:
    """An empty figure of plots above each other."""
    made: Canvas = importlib.import_module("plotly.subplots").make_subplots(
        rows=rows, cols=1, **options
    )
    return made


def script() -> str:
    """The text of the library that draws in the browser."""
    source: str = importlib.import_module("plotly.offline").get_plotlyjs()
    return source


def plain(canvas: Canvas) -> Mapping[str, Any]:
    """Data and layout as JSON objects."""
    return canvas.to_plotly_json()


def _objects() -> Any:
    return importlib.import_module("plotly.graph_objects")
