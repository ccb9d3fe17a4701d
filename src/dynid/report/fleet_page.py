"""The page of a fleet: alarms, every joint's friction over time, its control; nothing to load."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from itertools import groupby
from pathlib import Path

import numpy as np

from dynid.core import Array, write_text
from dynid.figures import (
    Axis,
    Figure,
    Line,
    Mark,
    Panel,
    Points,
    Ranges,
    axis_around,
    fragment,
    script,
    style,
)
from dynid.identification import CONFIDENCE, JointState, Trend

DAY_S, PLOT_HEIGHT = 86400.0, 90.0
STYLE = """body{font:15px/1.5 var(--font);margin:0 auto;max-width:1120px;padding:16px;
background:var(--ground);color:var(--ink)}h1{font-size:1.5rem}p{max-width:80ch}
summary{cursor:pointer;padding:4px 0}summary .no{color:var(--no)}"""


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
    parts = [
        f"<h1>Fleet: {_alarms(joints)}</h1>",
        *(f"<p>{escape(fact)}</p>" for fact in facts),
        "<ul>" + "".join(f"<li>{escape(note)}</li>" for note in notes) + "</ul>",
    ]
    for robot, group in groupby(joints, key=lambda joint: joint.robot):
        own = list(group)
        found = any(joint.alarm for joint in own)
        parts.append(
            f"<details{' open' if found else ''}><summary><b>{escape(robot or 'no name')}</b>: "
            f'<span class="{"no" if found else "yes"}">{_alarms(own)}</span></summary>'
            f"{_plots(own)}</details>"
        )
    write_text(
        path,
        '<!doctype html><html lang="en"><meta charset="utf-8"><title>Fleet</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{style()}{STYLE}</style><body>{''.join(parts)}"
        f"<script>{script()}</script></body></html>\n",
    )


def _alarms(joints: Sequence[JointState]) -> str:
    count = sum(bool(joint.alarm) for joint in joints)
    return "1 alarm" if count == 1 else f"{count or 'no'} alarms"


def _plots(joints: Sequence[JointState]) -> str:
    """Friction at the left and its control at the right, joint by joint."""
    known = [joint for joint in joints if joint.friction is not None]
    if not known:
        return "<p>Too few recordings for trends.</p>"
    days = [one.time_s / DAY_S for joint in known for one in (joint.friction,) if one is not None]
    first = min(float(np.floor(d[0])) for d in days)
    last = max(float(d[-1]) for d in days)
    # Seconds since 1970 have no ticks that a reader knows.
    label = f"days since {np.datetime64(int(first), 'D')}"
    figure = Figure(
        title="Values at the reference temperature with 95 % intervals",
        x=Axis(low=-0.5, high=max(last - first, 1.0) + 0.5, label=label),
        panels=tuple(panel for joint in known for panel in _panels(joint, first)),
        columns=2,
        link=f"fleet-{joints[0].robot}",
    )
    return fragment(figure)


def _panels(joint: JointState, first_day: float) -> Iterator[Panel]:
    step, low, high = joint.change_percent
    told = f"{joint.name}: step {step:+.1f} % ({low:+.1f} to {high:+.1f}), p {joint.friction_p:.2g}"
    for trend, label, title, alarm in (
        (joint.friction, f"friction [{joint.unit}]", told, bool(joint.alarm)),
        (
            joint.control,
            "torque scale [1]",
            f"{joint.name}: torque of the inertias, p {joint.control_p:.2g}",
            joint.alarm == "torque_scale",
        ),
    ):
        if trend is None:
            yield Panel(marks=(), y=Axis(low=0.0, high=1.0), title=title, height=PLOT_HEIGHT)
            continue
        days, reach = trend.time_s / DAY_S - first_day, CONFIDENCE * trend.std
        low_end, high_end = trend.at_reference - reach, trend.at_reference + reach
        marks: tuple[Mark, ...] = (
            Ranges(days, low_end, high_end, "published"),
            Points(days, trend.at_reference, "measured", "a recording"),
            Line(*_level(trend, days, alarm), "no" if alarm else "predicted", "fitted level"),
        )
        yield Panel(
            marks=marks,
            y=axis_around(low_end, high_end, label=label),
            title=title,
            height=PLOT_HEIGHT,
        )


def _level(trend: Trend, days: Array, stepped: bool) -> tuple[Array, Array]:
    """The fitted level over days: a step where there is an alarm."""
    if not stepped:
        return days[[0, -1]], np.full(2, trend.level)
    after = trend.before + trend.change
    return (
        days[[0, trend.step_at, trend.step_at, -1]],
        np.array([trend.before, trend.before, after, after]),
    )
