"""The page of a fleet: alarms, every joint's friction over time, its control; nothing to load."""

from __future__ import annotations

import html
from collections.abc import Sequence
from datetime import UTC, datetime
from itertools import groupby
from pathlib import Path

import numpy as np

from dynid.core import Array, write_text
from dynid.identification import JointState, Trend

WIDTH, HEIGHT, LEFT, FOOT = 340, 120, 44, 18
"""Of a plot [px], with room for numbers at the left and days below."""
CONFIDENCE = 1.96
STYLE = """:root{color-scheme:light dark}body{font:15px/1.5 system-ui,sans-serif;margin:0 auto;
max-width:1120px;padding:16px}h1{font-size:1.5rem}h2{font-size:1.15rem;margin:28px 0 6px}
.row{display:flex;flex-wrap:wrap;gap:8px 20px}figure{margin:0}figcaption{font-size:.85rem}
.alarm figcaption{font-weight:700;color:#b3261e}svg text{font:10px system-ui,sans-serif;
fill:currentColor}.axis{stroke:currentColor;opacity:.35}.point{fill:#0072B2}.bar{stroke:#0072B2;
opacity:.45}.fit{stroke:#D55E00;fill:none;stroke-width:1.6}p{max-width:80ch}
summary{cursor:pointer}"""


def write_fleet_page(
    path: Path,
    *,
    joints: Sequence[JointState],
    notes: Sequence[str],
    facts: Sequence[str],
) -> None:
    """Write the page in one piece.

    Args:
        path: The page.
        joints: Of all robots, robot by robot.
        notes: Alarms and what is missing, in words.
        facts: What was done and how alarms are raised, in words.

    Raises:
        InputError: A place where no such file can be.
        JobError: The disk does not take it.
    """
    alarms = sum(bool(joint.alarm) for joint in joints)
    parts = [
        f"<h1>Fleet: {alarms} alarm{'' if alarms == 1 else 's'}</h1>",
        *(f"<p>{html.escape(fact)}</p>" for fact in facts),
        "<ul>" + "".join(f"<li>{html.escape(note)}</li>" for note in notes) + "</ul>",
    ]
    for robot, group in groupby(joints, key=lambda joint: joint.robot):
        own = list(group)
        found = [joint for joint in own if joint.alarm]
        plots = "".join(_figure(joint) for joint in own)
        title = html.escape(robot or "robot without a name")
        state = f"{len(found)} alarm{'' if len(found) == 1 else 's'}" if found else "no alarm"
        parts.append(
            f"<details{' open' if found else ''}><summary><b>{title}</b>: {state}</summary>"
            f'<div class="row">{plots}</div></details>'
        )
    write_text(
        path,
        '<!doctype html><html lang="en"><meta charset="utf-8"><title>Fleet</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{STYLE}</style><body>{''.join(parts)}</body></html>\n",
    )


def _figure(joint: JointState) -> str:
    """Friction and control of one joint, with what was found."""
    name = html.escape(joint.name)
    if joint.friction is None:
        return f"<figure><figcaption>{name}: too few recordings for a trend</figcaption></figure>"
    step, low, high = joint.change_percent
    told = f"{name}: step {step:+.1f} % ({low:+.1f} to {high:+.1f}), p {joint.friction_p:.2g}"
    plots = _plot(joint.friction, f"friction [{joint.unit}]", joint.alarm != "")
    if joint.control is not None:
        told += f"; torque scale p {joint.control_p:.2g}"
        plots += _plot(joint.control, "torque scale", joint.alarm == "torque_scale")
    kind = ' class="alarm"' if joint.alarm else ""
    return f"<figure{kind}><figcaption>{told}</figcaption>{plots}</figure>"


def _plot(one: Trend, what: str, stepped: bool) -> str:
    """Values at the reference temperature with 95 % intervals over days, and the fitted level."""
    reach = CONFIDENCE * one.std
    low, high = float((one.at_reference - reach).min()), float((one.at_reference + reach).max())
    first, last = float(one.time_s[0]), float(one.time_s[-1])

    def x(time_s: Array | float) -> Array:
        return LEFT + (WIDTH - LEFT - 6) * (np.asarray(time_s) - first) / max(last - first, 1e-9)

    def y(value: Array | float) -> Array:
        return 6 + (HEIGHT - FOOT - 12) * (high - np.asarray(value)) / max(high - low, 1e-12)

    bars = "".join(
        f"M{a:.1f} {b:.1f}V{c:.1f}"
        for a, b, c in zip(
            x(one.time_s), y(one.at_reference - reach), y(one.at_reference + reach), strict=True
        )
    )
    points = "".join(
        f'<circle class="point" cx="{a:.1f}" cy="{b:.1f}" r="2"/>'
        for a, b in zip(x(one.time_s), y(one.at_reference), strict=True)
    )
    left, right, change = float(x(first)), float(x(last)), float(x(one.time_s[one.step_at]))
    if stepped:
        before, after = float(y(one.before)), float(y(one.before + one.change))
        fit = f"M{left:.1f} {before:.1f}H{change:.1f}V{after:.1f}H{right:.1f}"
    else:
        fit = f"M{left:.1f} {float(y(one.level)):.1f}H{right:.1f}"
    foot = HEIGHT - FOOT
    days = [datetime.fromtimestamp(t, UTC).date().isoformat() for t in (first, last)]
    return (
        f'<svg width="{WIDTH}" height="{HEIGHT}" role="img" aria-label="{what} over time">'
        f'<path class="axis" d="M{LEFT} 4V{foot}H{WIDTH}" fill="none"/>'
        f'<path class="bar" d="{bars}"/>{points}<path class="fit" d="{fit}"/>'
        f'<text x="2" y="12">{high:.3g}</text><text x="2" y="{foot}">{low:.3g}</text>'
        f'<text x="{LEFT + 4}" y="12">{what}</text>'
        f'<text x="{LEFT}" y="{HEIGHT - 4}">{days[0]}</text>'
        f'<text x="{WIDTH - 6}" y="{HEIGHT - 4}" text-anchor="end">{days[1]}</text></svg>'
    )
