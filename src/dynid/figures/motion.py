"""A trajectory and how it uses its limits (the paper's Figure 2)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynid.core.arrays import Array
from dynid.figures.canvas import Canvas
from dynid.figures.theme import LIMIT, colour, figure, joint_unit, label, line, log_axis
from dynid.trajectory.bounds import MotionBounds
from dynid.trajectory.motion import JointMotion
from dynid.trajectory.trajectory import Trajectory

SAMPLES = 1000


def trajectory(
    motion: Trajectory, names: Sequence[str], prismatic: Sequence[bool] = (False,)
) -> Canvas:
    """Positions, velocities and accelerations over one period.

    Args:
        motion: The trajectory.
        names: (n) joint names.
        prismatic: (n) which joints slide.
    """
    samples = motion.evaluate(np.linspace(0.0, motion.duration, SAMPLES))
    drawn = figure(
        3,
        title="Trajectory over one period",
        x="time [s]",
        y=[
            f"{what} [{joint_unit(unit, prismatic)}]"
            for what, unit in (
                ("position", "rad"),
                ("velocity", "rad/s"),
                ("acceleration", "rad/s\N{SUPERSCRIPT TWO}"),
            )
        ],
        height=640,
    )
    for row, part in enumerate((samples.q, samples.dq, samples.ddq), start=1):
        for j, name in enumerate(names):
            drawn.add_trace(
                line(samples.t, part[:, j], label(name), color=colour(j), legend=row == 1),
                row=row,
                col=1,
            )
    return drawn


def limit_usage(samples: JointMotion, bounds: MotionBounds, names: Sequence[str]) -> Canvas:
    """How much of each limit is used over time: 100 % is the limit.

    Args:
        samples: The motion.
        bounds: Its limits, NaN or infinite where unknown: these are not drawn.
        names: (n) joint names.
    """
    middle, half = (bounds.upper + bounds.lower) / 2, (bounds.upper - bounds.lower) / 2
    shares = (
        np.abs(samples.q - middle) / half,
        np.abs(samples.dq) / bounds.velocity,
        np.abs(samples.ddq) / bounds.acceleration,
    )
    drawn = figure(
        3,
        title="Use of the limits",
        x="time [s]",
        y=("position [%]", "velocity [%]", "acceleration [%]"),
        height=640,
    )
    for row, share in enumerate(shares, start=1):
        for j, name in enumerate(names):
            if np.isfinite(share[:, j]).all():
                drawn.add_trace(
                    line(
                        samples.t,
                        100 * share[:, j],
                        label(name),
                        color=colour(j),
                        legend=row == 1,
                    ),
                    row=row,
                    col=1,
                )
        drawn.add_hline(100, line={"color": LIMIT, "dash": "dash"}, row=row, col=1)
    return drawn


def safety_usage(t: Array, shares: Array, kinds: Sequence[str]) -> Canvas:
    """How much of each limit of the whole arm is used over time: 100 % is the limit.

    Args:
        t: (N) time [s].
        shares: (N, k) value over limit; NaN where a kind is not judged.
        kinds: (k) such as `torque` or `tcp_speed`.
    """
    drawn = figure(title="Use of the arm's limits", x="time [s]", y="share of the limit [%]")
    for k, kind in enumerate(kinds):
        if np.isfinite(shares[:, k]).all():
            drawn.add_trace(
                line(t, 100 * shares[:, k], label(kind.replace("_", " ")), color=colour(k))
            )
    drawn.add_hline(100, line={"color": LIMIT, "dash": "dash"})
    return drawn


def distances(t: Array, gaps: Array, pairs: Sequence[str], clearance: float) -> Canvas:
    """Distances between bodies over time.

    Args:
        t: (N) time [s].
        gaps: (N, k) distances [m], negative where bodies overlap.
        pairs: (k) names of the pairs.
        clearance: The smallest distance allowed [m].
    """
    drawn = figure(title="Distances between bodies", x="time [s]", y="distance [mm]")
    nearest = np.argsort(gaps.min(axis=0))[:8]
    for k, pair in enumerate(nearest):
        drawn.add_trace(line(t, 1000 * gaps[:, pair], label(pairs[int(pair)]), color=colour(k)))
    drawn.add_hline(1000 * clearance, line={"color": LIMIT, "dash": "dash"})
    return drawn


def convergence(evaluations: Array, best: Array, criterion: str) -> Canvas:
    """The best criterion so far over the evaluations of a design.

    Args:
        evaluations: (k) number of evaluations.
        best: (k) best value of the criterion so far.
        criterion: Its name.
    """
    drawn = figure(title="Search for the design", x="evaluations", y=label(criterion))
    drawn.add_trace(line(evaluations, best, label(criterion), color=colour(0), shape="hv"))
    if len(best) and (best > 0).all():
        drawn.update_yaxes(**log_axis(best))
    return drawn
