"""The page: sections rendered into one file that needs nothing else.

The sections of the default report, in order: copy and change.
"""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Sequence
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

from dynid.core import require, write_text
from dynid.report.contents import ReportContents, Section
from dynid.report.sections import (
    ComparisonSection,
    DesignSection,
    FrictionSection,
    NextSection,
    ParametersSection,
    PredictionSection,
    ReproduceSection,
    ResidualSection,
    VerdictSection,
)
from dynid.report.theme import layout, script


def default_sections() -> tuple[Section, ...]:
    """Verdict first, then the evidence, then how it was made."""
    return (
        VerdictSection(),
        NextSection(),
        ComparisonSection(),
        PredictionSection(),
        ParametersSection(),
        FrictionSection(),
        ResidualSection(),
        DesignSection(),
        ReproduceSection(),
    )


WIDTHS = "width=device-width, initial-scale=1"


def render(contents: ReportContents, sections: Sequence[Section] | None = None) -> str:
    """The report as HTML; text from files is escaped.

    Args:
        contents: What to show.
        sections: The chapters; None for the default recipe. Those without parts are left out.
    """
    chapters: list[dict[str, Any]] = []
    for section in default_sections() if sections is None else sections:
        parts = section.parts(contents)
        if parts:
            chapters.append({"anchor": section.anchor, "title": section.title, "parts": parts})
    jinja = require("jinja2", "all")
    environment = jinja.Environment(autoescape=True, undefined=jinja.StrictUndefined)
    environment.filters["embedded"] = _embedded
    template = environment.from_string(_asset("page.html"))
    page: str = template.render(
        title=contents.title,
        chapters=chapters,
        style=_asset("page.css"),
        behaviour=_asset("page.js"),
        library=_packed(script()),
        themes=_script_safe(_json({"light": layout(), "dark": layout(dark=True)})),
        version=version("dynid"),
        viewport=WIDTHS,
    )
    return page


def write_report(
    contents: ReportContents, path: str | Path, sections: Sequence[Section] | None = None
) -> Path:
    """Write the report in one piece: an interrupt leaves the old file or the new one.

    Args:
        contents: What to show.
        path: The page.
        sections: The chapters; None for the default recipe.

    Raises:
        InputError: A place where no such file can be.
        JobError: The disk does not take it.
    """
    target = Path(path)
    write_text(target, render(contents, sections))
    return target


def _asset(name: str) -> str:
    return files("dynid.report").joinpath("assets", name).read_text(encoding="utf-8")


def _packed(text: str) -> str:
    """Gzip in base64: the drawing library would be most of the page."""
    return base64.b64encode(gzip.compress(text.encode(), mtime=0)).decode("ascii")


def _embedded(canvas: Any) -> Any:
    return _script_safe(canvas.to_json())


def _json(value: Any) -> str:
    return json.dumps(value)


def _script_safe(text: str) -> Any:
    # Inside <script> only "</" and "<!--" end the text; JSON may write every "<" as an escape.
    safe = text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
    return require("markupsafe", "all").Markup(safe)
