"""The scoreboard of verdicts: false alarms, faults named, on arms that share no code with dynid."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dynid.bench.verdict_cases import DISCRETE, FAULTS, SIZES, Case, Recorded, recorded
from dynid.core import Array, DynidError, Finding, Progress, silent

GOOD = 5.0
"""[%] true error on another motion up to which a clean recording gave a good model."""
NAMED = 2
"""Explanations that a result may name: those of equal torque count as one answer."""
NEAR_S = 0.5
"""A contact is found where one is named this near to it."""
SAME = {
    "gain": ("drive_gain",),
    "gains": ("gain_all",),
    "joint_delay": ("delay",),
    "clock": ("clock_scale",),
    "tilt": ("mounting",),
    "length": ("link_length",),
    "quarter_turn": ("encoder_zero",),
    "exchanged_torques": ("exchanged_torques", "exchanged"),
}
"""Fault to the kinds of finding that name it, where they are called otherwise."""
COLUMNS = ("fault", "size", "cases", "named", "found", "usable")
ANYWHERE = frozenset(
    {"gains", "delay", "clock", "tilt", "payload", "friction_drift", "contact", *DISCRETE[4:]}
) - {"saturated"}
"""Faults of no single joint."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """What an identification said of a case."""

    findings: tuple[Finding, ...]
    level: str
    t: ArrayLike
    """(N) times of the validation motion [s]."""
    predicted: ArrayLike
    """(N, n) torques predicted then [N.m or N]."""


Judge = Callable[[Recorded], Judged]
"""Identifies a case's recording, validates it, and says what was found."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One case and its outcome."""

    case: Case
    level: str
    kinds: tuple[str, ...]
    """Findings above information, strongest first."""
    named: bool
    """The planted fault is among the first `NAMED` findings, at its joint or time."""
    error_percent: float
    """True error on the validation motion."""
    cpu_s: float


def run_verdicts(
    judge: Judge, chosen: Iterable[Case], progress: Progress = silent
) -> tuple[Row, ...]:
    """Judge cases one after the other.

    Args:
        judge: What is tested.
        chosen: The cases.
        progress: Told which case is under way.
    """
    every = list(chosen)
    rows: list[Row] = []
    for k, case in enumerate(every):
        progress(case.label, k / len(every))
        made = recorded(case)
        start = process_time()
        try:
            judged = judge(made)
        except DynidError:
            rows.append(
                Row(case=case, level="refused", kinds=(), named=False, error_percent=np.nan,
                    cpu_s=process_time() - start)
            )  # fmt: skip
            continue
        told = [f for f in judged.findings if f.severity != "info" or f.kind == case.fault]
        rows.append(
            Row(
                case=case,
                level=judged.level,
                kinds=tuple(f.kind for f in told),
                named=_named(case, made, told),
                error_percent=_error_percent(made, judged),
                cpu_s=process_time() - start,
            )
        )
    return tuple(rows)


def _named(case: Case, made: Recorded, told: Sequence[Finding]) -> bool:
    if case.fault is None:
        return not told
    kinds = SAME.get(case.fault, (case.fault,))
    faults = [f for f in told if f.kind not in ("at_rest", "low_excitation", "ill_conditioned")]
    for finding in faults[:NAMED]:
        if finding.kind not in kinds:
            continue
        if case.fault == "contact":
            near = [abs((finding.value or 0.0) - t) < NEAR_S for t in made.times_s]
            if any(near):
                return True
        elif case.fault in ANYWHERE or made.joint in finding.joints:
            return True
    return False


def _error_percent(made: Recorded, judged: Judged) -> float:
    """Error against the true torques, at the times that were predicted."""
    t = made.validation.t
    times, torque = np.asarray(judged.t), np.asarray(judged.predicted)
    columns: list[Array] = [made.clean[:, j] for j in range(made.clean.shape[1])]
    true: Array = np.column_stack([np.interp(times, t - t[0], column) for column in columns])
    return float(100 * np.sqrt(np.square(torque - true).sum() / np.square(true).sum()))


def summarise(rows: Sequence[Row]) -> dict[str, Any]:
    """False alarms by kind, and the share of each fault and size that is named."""
    clean = [r for r in rows if r.case.fault is None]
    good = [r for r in clean if r.error_percent <= GOOD]
    doubted = [r for r in good if r.level != "usable"]
    planted: list[dict[str, Any]] = []
    for fault in (*FAULTS, *DISCRETE):
        for size in SIZES:
            cells = [r for r in rows if r.case.fault == fault and r.case.size == size]
            if cells:
                planted.append(
                    {
                        "fault": fault,
                        "size": size,
                        "cases": len(cells),
                        "named": sum(r.named for r in cells),
                        "found": sum(bool(r.kinds) for r in cells),
                        "usable": sum(r.level == "usable" for r in cells),
                    }
                )
    return {
        "clean": len(clean),
        "good": len(good),
        "doubted": len(doubted),
        "false_alarms": dict(Counter(kind for r in clean for kind in set(r.kinds)).most_common()),
        "faults": planted,
        "cpu_s_median": float(np.median([r.cpu_s for r in rows])) if rows else 0.0,
    }


def rates(told: dict[str, Any]) -> dict[str, float]:
    """Right cause by size, in per cent."""
    out: dict[str, float] = {}
    for size in SIZES:
        cells = [row for row in told["faults"] if row["size"] == size]
        count = sum(row["cases"] for row in cells)
        if count:
            out[size] = 100 * sum(row["named"] for row in cells) / count
    return out


def markdown(told: dict[str, Any], title: str) -> str:
    """A summary as a section of a page."""
    lines = [
        f"## {title}",
        "",
        f"{told['clean']} clean recordings; of {told['good']} the true error is below {GOOD:g} %,",
        f"and {told['doubted']} of these are not called usable.",
        f"Median CPU of a case {told['cpu_s_median']:.1f} s.",
        "",
        "False alarms: "
        + (", ".join(f"{kind} {count}" for kind, count in told["false_alarms"].items()) or "none")
        + ".",
        "",
        "Right cause: " + ", ".join(f"{k} {v:.0f} %" for k, v in rates(told).items()) + ".",
        "",
        "| fault | size | cases | named | anything found | still called usable |",
        "|---|---|---|---|---|---|",
    ]
    lines += ["| " + " | ".join(str(row[key]) for key in COLUMNS) + " |" for row in told["faults"]]
    return "\n".join([*lines, ""])
