"""Figures of a designed motion: positions to accelerations, and the use of its limits."""

from __future__ import annotations

import numpy as np

from dynid.core import Array
from dynid.figures import (
    Axis,
    Figure,
    Level,
    Line,
    Mark,
    Panel,
    axis_around,
    joint_role,
    joint_unit,
)
from dynid.report.contents import JudgedMotion, ReportedDesign, joint_labels

SAMPLES = 1000
QUANTITIES = (("position", "rad"), ("velocity", "rad/s"), ("acceleration", "rad/s^2"))


def design_figures(item: ReportedDesign) -> tuple[Figure, ...]:
    """All figures of a design.

    Args:
        item: The design.
    """
    judged = () if item.judged is None else _arm_figures(item.judged, item.name)
    search = () if item.search is None else (_search_figure(item),)
    return (_motion_figure(item), *judged, *search)


def _motion_figure(item: ReportedDesign) -> Figure:
    """Positions, velocities and accelerations, and what they use of their limits."""
    names, slides = joint_labels(item.robot.joint_names), item.robot.prismatic
    motion = item.trajectory.evaluate(np.linspace(0.0, item.trajectory.duration, SAMPLES))
    middle = (item.bounds.upper + item.bounds.lower) / 2
    half = (item.bounds.upper - item.bounds.lower) / 2
    used = (
        np.abs(motion.q - middle) / half,
        np.abs(motion.dq) / item.bounds.velocity,
        np.abs(motion.ddq) / item.bounds.acceleration,
    )
    panels: list[Panel] = []
    for (what, unit), values, share in zip(
        QUANTITIES, (motion.q, motion.dq, motion.ddq), used, strict=True
    ):
        known = np.isfinite(share).all(axis=0)
        most = 100 * share[:, known].max(initial=0.0)
        largest = f", at most {most:.0f} % of its limit"
        panels.append(
            Panel(
                title=f"{what.capitalize()} [{joint_unit(unit, slides)}]"
                + (largest if known.any() else ""),
                y=axis_around(values, zero=True),
                marks=tuple(
                    Line(motion.t, values[:, j], joint_role(j), name)
                    for j, name in enumerate(names)
                ),
                height=110,
            )
        )
    return Figure(
        title="One period",
        x=Axis(low=0, high=item.trajectory.duration, label="time [s]"),
        panels=tuple(panels),
        link=f"period {item.name}",
    )


def _arm_figures(judged: JudgedMotion, name: str) -> tuple[Figure, ...]:
    """Shares of the limits of the whole arm, and distances beyond what must be kept."""
    panels: list[Panel] = []
    for title, values, kinds, level in (
        ("Share of the arm's limits [%]", 100 * judged.shares, judged.kinds, 100.0),
        ("Distance beyond the clearance [mm]", 1000 * judged.distances, judged.distance_kinds, 0.0),
    ):
        marks = _curves(judged.t, values, kinds)
        if marks:
            shown = values[:, np.isfinite(values).all(axis=0)]
            limit = Level(level, name="limit")
            axis = axis_around(shown, [level], zero=True)
            panels.append(Panel(title=title, y=axis, marks=(limit, *marks), height=110))
    axis = Axis(low=0, high=float(judged.t[-1]), label="time [s]")
    return tuple(
        Figure(title=panel.title, x=axis, panels=(Panel(y=panel.y, marks=panel.marks),), link=name)
        for panel in panels
    )


def _curves(t: Array, values: Array, kinds: tuple[str, ...]) -> tuple[Mark, ...]:
    return tuple(
        Line(t, values[:, k], joint_role(k), kind.replace("_", " "))
        for k, kind in enumerate(kinds)
        if np.isfinite(values[:, k]).all()
    )


def _search_figure(item: ReportedDesign) -> Figure:
    count, best = item.search or (np.zeros(1), np.ones(1))
    criterion = dict(item.facts).get("criterion", "criterion")
    return Figure(
        title=f"Search: best {criterion} so far",
        x=axis_around(count, label="objective evaluations", zero=True),
        panels=(
            Panel(
                y=axis_around(best, log=bool((best > 0).all())),
                marks=(Line(np.repeat(count, 2)[1:], np.repeat(best, 2)[:-1]),),
            ),
        ),
    )
