"""A design as the report shows it: judged over time, with the search that found it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dynid.constraints.usage import DISTANCES
from dynid.core.arrays import Array
from dynid.report.contents import JudgedMotion, ReportedDesign
from dynid.workflow.design_files import StoredDesign, read_design

SAMPLES = 200
KINDS = ("torque", "tcp_speed", "elbow_speed", "momentum", "power")
FACTS = {
    "criterion": "criterion",
    "method": "method",
    "condition_number": "condition number",
    "feasible": "feasible",
    "evaluations": "motions looked at",
    "wall_s": "time of the search [s]",
    "seed": "seed",
}


def reported_design(path: Path) -> ReportedDesign:
    """Read a design or a trajectory and judge it at instants.

    Args:
        path: The file.

    Raises:
        InputError: Not a design, or its robot cannot be read.
    """
    found = read_design(path)
    stored, facts = found.stored, found.facts
    return ReportedDesign(
        name=path.name,
        trajectory=stored.trajectory,
        robot=found.robot,
        bounds=stored.limits,
        facts=(
            ("duration", f"{stored.trajectory.duration:g} s"),
            *((words, _text(facts[name])) for name, words in FACTS.items() if name in facts),
        ),
        search=_search(facts.get("history")),
        judged=_judged(found),
    )


def _text(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _search(history: object) -> tuple[Array, Array] | None:
    if not isinstance(history, list):
        return None
    rows: list[tuple[float, float]] = []
    for entry in history:  # pyright: ignore[reportUnknownVariableType]
        if isinstance(entry, dict):
            value, count = entry.get("value"), entry.get("evaluations")  # pyright: ignore
            if isinstance(value, int | float) and isinstance(count, int | float):
                rows.append((float(count), float(value)))
    if len(rows) < 2:
        return None
    table = np.array(rows)
    return table[:, 0], np.minimum.accumulate(table[:, 1])


def _judged(found: StoredDesign) -> JudgedMotion | None:
    if found.limits is None:
        return None
    judge = found.limits.constraints(found.robot)
    t = _instants(found)
    count = len(t)
    motion = found.stored.trajectory.evaluate(t)
    shares = np.empty((count, len(KINDS)))
    gaps = np.empty((count, len(DISTANCES)))
    for k in range(count):
        usage = judge.usage(motion.q[k : k + 1], motion.dq[k : k + 1], motion.ddq[k : k + 1])
        shares[k] = [usage.ratio(kind) for kind in KINDS]
        gaps[k] = [usage.distance(kind) for kind in DISTANCES]
    if not np.isfinite(shares).any() and not np.isfinite(gaps).any():
        return None
    # Beyond what each kind must keep, so that one line at zero is the limit of both.
    kept = np.array([judge.settings.self_clearance, judge.settings.clearance])
    names = zip(DISTANCES, kept, strict=True)
    return JudgedMotion(
        t=t,
        kinds=KINDS,
        shares=shares,
        distance_kinds=tuple(
            f"{kind.replace('_', ' ')}, beyond {1000 * own:g} mm to keep" for kind, own in names
        ),
        distances=gaps - kept,
        clearance=0.0,
    )


def _instants(found: StoredDesign) -> Array:
    """When to judge: evenly, and where the certificate of the design is tightest."""
    duration = found.stored.trajectory.duration
    times = [np.linspace(0.0, duration, SAMPLES)]
    worst = found.facts.get("worst")
    for entry in worst.values() if isinstance(worst, dict) else ():  # pyright: ignore
        when = entry.get("t") if isinstance(entry, dict) else None  # pyright: ignore
        if isinstance(when, int | float) and 0.0 <= when <= duration:
            times.append(np.array([float(when)]))
    return np.unique(np.concatenate(times))
