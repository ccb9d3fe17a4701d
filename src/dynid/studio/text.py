"""Text of the page. Whatever comes from a file or a robot is escaped here, in one place."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Mapping

from dynid.constraints import DISTANCES, RATIOS, Certificate, Worst
from dynid.studio.live import Near

LONGEST = 60
GOOD, WARN, BAD, INK = "#009E73", "#E69F00", "#D55E00", "inherit"
WORDS = {
    "position": "position", "velocity": "velocity", "acceleration": "acceleration",
    "torque": "torque", "tcp_speed": "tool speed", "elbow_speed": "elbow speed",
    "momentum": "momentum", "power": "power", "self_collision": "between bodies",
    "environment": "to the scene",
}  # fmt: skip
_NEAR = 0.9


def plain(text: object, longest: int = LONGEST) -> str:
    """Any text as one printable line that is not too long."""
    line = "".join(c if c.isprintable() else "?" for c in str(text))
    return line if len(line) <= longest else line[: longest - 1] + "\N{HORIZONTAL ELLIPSIS}"


def safe(text: object, longest: int = LONGEST) -> str:
    """Any text for HTML, as text."""
    return html.escape(plain(text, longest))


def line(text: str, colour: str = INK, *, bold: bool = False) -> str:
    """A line of HTML; `text` is escaped, its line breaks stay."""
    # Half characters, as file names may hold, cannot even be sent.
    text = "".join(c if c.isprintable() or c == "\n" else "?" for c in text)
    weight = "600" if bold else "400"
    return (
        f'<div style="padding:2px 12px;color:{colour};font-weight:{weight};font-size:0.8rem;'
        f'overflow-wrap:anywhere;white-space:pre-line">{html.escape(text)}</div>'
    )


def margins(worst: Mapping[str, Worst]) -> str:
    """A bar for every limit that is judged, and the least distances."""
    rows: list[str] = []
    for kind in RATIOS:
        item = worst.get(kind)
        if item is None or math.isnan(item.margin):
            continue
        used = 1.0 - item.margin
        rows.append(_bar(WORDS[kind], item.what, used, f"{100 * used:.0f} %"))
    for kind in DISTANCES:
        item = worst.get(kind)
        if item is None or math.isnan(item.margin):
            continue
        used = item.limit / item.margin if item.margin > item.limit > 0 else 1.0
        if item.room < 0:
            used = math.inf
        rows.append(_bar(WORDS[kind], item.what, used, f"{1000 * item.margin:.0f} mm"))
    if not rows:
        return line("no limit is judged")
    return (
        f'<div style="padding:0 12px;font-size:0.75rem" data-dynid="margins">{"".join(rows)}</div>'
    )


def nearest(found: Iterable[Near]) -> str:
    """The nearest bodies in words."""
    return "".join(
        line(
            f"nearest {WORDS[item.kind]}: {1000 * item.distance:.0f} mm, {plain(item.names)}"
            f" (at least {1000 * item.clearance:g} mm)",
            BAD if item.distance < item.clearance else INK,
        )
        for item in found
    )


def certificate(found: Certificate | None, *, stale: bool = False, error: str = "") -> str:
    """The verdict on a whole motion."""
    if error:
        return line(error, BAD, bold=True)
    if found is None:
        return line("not certified yet")
    head = found.headline if not found.feasible else "Every limit holds over the whole motion"
    colour = GOOD if found.feasible else WARN if found.holds else BAD
    if stale:
        head, colour = f"{head}, as the scene was before", WARN
    parts = [line(head, colour, bold=True)]
    parts.append(margins(found.worst))
    parts += [line(f"unjudged: {item.message}. {item.next_step}", WARN) for item in found.unjudged]
    parts += [line(note) for note in found.notes]
    return "".join(parts)


def _bar(name: str, what: str, used: float, value: str) -> str:
    colour = BAD if used > 1.0 else WARN if used > _NEAR else GOOD
    width = 100.0 * min(max(used, 0.0), 1.0)
    detail = f" <span style='opacity:0.7'>{safe(what, 44)}</span>" if what else ""
    return (
        f'<div style="display:flex;justify-content:space-between;gap:8px">'
        f"<span style='overflow-wrap:anywhere'>{html.escape(name)}{detail}</span>"
        f"<span style='white-space:nowrap'>{html.escape(value)}</span></div>"
        f'<div style="height:4px;background:rgba(127,127,127,0.25);margin-bottom:3px">'
        f'<div style="height:4px;width:{width:.1f}%;background:{colour}"></div></div>'
    )
