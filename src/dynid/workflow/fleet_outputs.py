"""What `dynid fleet` writes: the table of estimates, and the state for dashboards."""

from __future__ import annotations

import csv
import importlib
import io
import os
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core import cannot_write, write_text
from dynid.identification import JointState

STATE, METRICS = "state.csv", "state.prom"
ALARMS = ("", "friction_drift", "torque_scale")
"""Their places are the numbers of the metric."""
STRINGS = ("robot", "model", "recording", "name")
NUMBERS = (
    "value",
    "std",
    "temperature_degC",
    "at_reference",
    "at_reference_std",
    "reference_degC",
)
"""Columns of the table, with `time`, `joint` (from 1; 0 for none) between."""


def iso_time(time_s: float) -> str | None:
    """Seconds since 1970 as an ISO time in UTC; None where unknown."""
    if not np.isfinite(time_s):
        return None
    return datetime.fromtimestamp(time_s, UTC).isoformat(timespec="seconds")


def joint_row(joint: JointState) -> dict[str, Any]:
    """The state of a joint: a row of the CSV, an object of the JSON."""
    step, low, high = joint.change_percent
    one, control = joint.friction, joint.control
    nan = float("nan")
    percent = 100 / max(abs(one.level), 1e-12) if one else nan
    changed = iso_time(float(one.time_s[one.step_at])) if one and joint.alarm else None
    return {
        "robot": joint.robot,
        "joint": joint.joint + 1,
        "name": joint.name,
        "unit": joint.unit,
        "reference_speed": joint.reference_speed,
        "reference_degC": one.reference_degC if one else nan,
        "friction": joint.now,
        "friction_std": joint.now_std,
        "change_percent": step,
        "change_low_percent": low,
        "change_high_percent": high,
        "changed_at": changed,
        "slope_percent_per_year": percent * one.slope_per_year if one else nan,
        "slope_std_percent": percent * one.slope_std if one else nan,
        "per_kelvin_percent": percent * one.per_kelvin if one else nan,
        "torque_scale": (control.before + control.change if control else nan),
        "torque_scale_change_percent": 100 * control.change if control else nan,
        "p_friction": joint.friction_p,
        "p_torque_scale": joint.control_p,
        "alarm": joint.alarm or None,
    }


def write_table(target: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write the estimates as Parquet; the file appears whole or not at all.

    Args:
        target: The file.
        rows: One a quantity and recording; those without a recording are shared.

    Raises:
        InputError: A place where no such file can be.
        JobError: The disk does not take it.
    """
    arrow, parquet = (importlib.import_module(name) for name in ("pyarrow", "pyarrow.parquet"))
    nan = float("nan")
    times = [row.get("time", nan) for row in rows]
    table = arrow.table(
        {
            **{name: arrow.array([row.get(name) for row in rows]) for name in STRINGS[:3]},
            "time": arrow.array(
                [None if np.isnan(t) else round(1000 * t) for t in times],
                arrow.timestamp("ms", "UTC"),
            ),
            "joint": arrow.array([row["joint"] for row in rows], arrow.int32()),
            "name": arrow.array([row["name"] for row in rows]),
            **{name: arrow.array([float(row.get(name, nan)) for row in rows]) for name in NUMBERS},
        }
    )
    draft = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        try:
            parquet.write_table(table, draft, compression="zstd")
            draft.replace(target)
        finally:
            draft.unlink(missing_ok=True)
    except OSError as error:
        raise cannot_write(target, error) from error


def write_state(folder: Path, *, joints: Sequence[JointState], recordings: int) -> None:
    """Write the state of each joint as CSV, and for Prometheus.

    Args:
        folder: Where to.
        joints: Of all robots.
        recordings: How many there are.

    Raises:
        InputError: A place where no such file can be.
        JobError: The disk does not take it.
    """
    state = [joint_row(joint) for joint in joints]
    text = io.StringIO()
    writer = csv.DictWriter(text, list(state[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(state)
    write_text(folder / STATE, text.getvalue())
    write_text(folder / METRICS, _metrics(joints, recordings))


def _metrics(joints: Sequence[JointState], recordings: int) -> str:
    """The state in the text format of Prometheus."""
    rows = [(joint, joint_row(joint)) for joint in joints]
    lines: list[str] = []
    for name, help_text, key in (
        ("friction", "Friction level at the reference speed and temperature, SI units", "friction"),
        ("friction_change_percent", "Step of the friction level", "change_percent"),
        ("torque_scale", "Measured over predicted torque of the inertias", "torque_scale"),
        ("alarm", "1 for a drift of friction, 2 for one of the torque scale", "alarm"),
    ):
        lines += [f"# HELP dynid_{name} {help_text}", f"# TYPE dynid_{name} gauge"]
        for joint, row in rows:
            value = ALARMS.index(joint.alarm) if key == "alarm" else row[key]
            label = joint.robot.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
            if np.isfinite(value):
                lines.append(f'dynid_{name}{{robot="{label}",joint="{joint.joint + 1}"}} {value:g}')
    lines += ["# TYPE dynid_recordings gauge", f"dynid_recordings {recordings}"]
    return "\n".join(lines) + "\n"
