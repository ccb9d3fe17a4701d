"""The excitation trajectories."""

from __future__ import annotations

import numpy as np

from dynid.figures.canvas import Canvas
from dynid.figures.motion import convergence, distances, limit_usage, safety_usage, trajectory
from dynid.report.contents import ReportContents, ReportedDesign
from dynid.report.section import Part, Section, Table

SAMPLES = 600


class DesignSection(Section):
    """How the arm was moved, and how much of its limits that used."""

    anchor = "design"
    title = "The motion"

    def parts(self, contents: ReportContents) -> tuple[Part, ...]:
        """One part a trajectory."""
        return tuple(_part(item) for item in contents.designs)


def _part(item: ReportedDesign) -> Part:
    names = item.robot.joint_names
    motion = item.trajectory.evaluate(np.linspace(0.0, item.trajectory.duration, SAMPLES))
    criterion = dict(item.facts).get("criterion", "criterion")
    facts = (Table(columns=("", ""), rows=item.facts),) if item.facts else ()
    return Part(
        heading=item.name,
        words=(
            "The arm has to move so that every parameter leaves a trace in the torques: fast and "
            "slow, both ways, in many poses. Dashed lines are the limits.",
        ),
        tables=facts,
        figures=(
            trajectory(item.trajectory, names, item.robot.prismatic),
            limit_usage(motion, item.bounds, names),
            *_judged(item),
            *((convergence(*item.search, f"{criterion}, best so far"),) if item.search else ()),
        ),
    )


def _judged(item: ReportedDesign) -> tuple[Canvas, ...]:
    judged = item.judged
    if judged is None:
        return ()
    drawn = [safety_usage(judged.t, judged.shares, judged.kinds)]
    known = [
        k for k in range(len(judged.distance_kinds)) if np.isfinite(judged.distances[:, k]).all()
    ]
    if known:
        kinds = [judged.distance_kinds[k] for k in known]
        drawn.append(distances(judged.t, judged.distances[:, known], kinds, judged.clearance))
    return tuple(drawn)
