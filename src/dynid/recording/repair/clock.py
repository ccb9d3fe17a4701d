"""Repair: the unit of time, and what the clock is worth."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal

import numpy as np

from dynid.core import Array, RecordError
from dynid.recording.families import by_rows
from dynid.recording.repair.velocities import DEGREE, RPM, common_slope, velocity_slopes
from dynid.recording.table import RawTable

_DAY = 86400.0
_UNITS = {1.0: "s", 1e-3: "ms", 1e-6: "us", 1e-9: "ns", _DAY: "days"}
_DAY_COUNTS = ((3e4, 6e4), (7e5, 8e5))
"""Days since 1900, as spreadsheets count, and since year 0, as MATLAB does."""
_FASTEST = 2e-5
"""Shortest step that a robot's recorder may have [s]."""


def settle_unit(table: RawTable) -> RawTable:
    """Bring the stamps to seconds from the first sample.

    The unit is what the file says, else what makes positions and velocities agree, else
    what makes the sampling rate one of a robot (10 Hz to 10 kHz).

    Raises:
        RecordError: The time counts rows.
    """
    if table.t is None:
        return table
    first = float(table.t[0])
    t = table.t - first
    scale = table.time_scale
    guessed = scale is None
    if scale is None:
        scale = _scale(t, table)
        _refuse_row_counts(t * scale, t, table)
    # Rows before the first may have gone, so its stamp counts from where t was zero.
    stamp = f"{Decimal(table.t0) + Decimal(repr(first)):f}" if table.t0 else repr(first * scale)
    table = replace(table, t=t * scale, time_scale=1.0, t0=stamp)
    if guessed and scale != 1.0:
        rate = 1.0 / (float(np.median(np.diff(t))) * scale)
        table = table.report(
            "unit_suspect",
            f"time stamps are in {_UNITS[scale]} by their size ({rate:.4g} Hz); converted to s",
        )
    step = float(np.median(np.diff(table.stamps)))
    if step < _FASTEST:
        table = table.report(
            "unit_suspect",
            f"the time stamps say {1 / step:.4g} Hz, which is no robot's rate: another unit?",
        )
    return table


def _scale(t: Array, table: RawTable) -> float:
    step = float(np.median(np.diff(t)))
    q = table.signals["q"]
    if "qd" in table.signals:
        slope = common_slope(*velocity_slopes(t, q, table.signals["qd"]))
        if slope is not None and slope > 0:
            # Degrees on one side only show as a factor of 57.3 on top of the unit.
            for scale in _UNITS:
                for factor in (1.0, DEGREE, 1 / DEGREE):
                    if abs(slope / (scale * factor) - 1) < 0.25:
                        return scale
    first = 0.0 if table.t is None else float(table.t[0])
    if step < _FASTEST and any(low < first < high for low, high in _DAY_COUNTS):
        return _DAY
    if step < 0.5:
        return 1.0
    scale = 1e-3 if step < 100 else 1e-6 if step < 1e5 else 1e-9
    # A slow log of a moving robot has large steps of position as well.
    speed = float(np.quantile(np.abs(np.diff(q, axis=0)), 0.99)) / (step * scale)
    return 1.0 if speed > 50 else scale


def _refuse_row_counts(seconds: Array, t: Array, table: RawTable) -> None:
    """Refuse a time of 0, 1, 2, ... that contradicts the velocities: it counts rows.

    Raises:
        RecordError: It does; the message names the rate that velocities tell.
    """
    if "qd" not in table.signals or float((np.diff(t) == 1).mean()) < 0.9:
        return
    slope = common_slope(*velocity_slopes(seconds, table.signals["q"], table.signals["qd"]))
    others = (1.0, DEGREE, 1 / DEGREE, RPM)
    if slope is None or slope <= 0 or any(abs(slope / other - 1) < 0.25 for other in others):
        return
    rate = 1 / float(np.median(np.diff(seconds))) / slope
    raise RecordError(
        "the time goes up by 1 a row and fits the velocities in no unit: it counts rows",
        where=table.source,
        value=f"velocities tell {rate:.4g} Hz",
        next_step=by_rows(table.columns),
    )


def report_clock(table: RawTable) -> RawTable:
    """Report gaps and jitter of the stamps."""
    if table.t is None or table.samples < 4 or table.clock == "rate":
        return table
    steps = np.diff(table.t)
    # Where rows were left out the step is wide by our own doing, and reported as such.
    ours = np.zeros(len(steps), dtype=np.bool_)
    if table.index is not None:
        ours = np.diff(table.index) > 1
    nominal = float(np.median(steps))
    steps = np.where(ours, nominal, steps)
    # A late stamp is followed, or was preceded, by a short step; a gap is not.
    padded = np.pad(steps, 1, constant_values=nominal)
    lonely = np.minimum(steps + padded[2:], steps + padded[:-2]) > 2.5 * nominal
    gaps = (steps > 1.5 * nominal) & lonely
    missing = int(np.sum(np.round(steps[gaps] / nominal) - 1))
    jitter = 100 * float(np.quantile(np.abs(steps - nominal), 0.99)) / nominal
    parts: list[str] = []
    if jitter > 5:
        parts.append(
            f"steps between {1e3 * steps.min():.4g} and {1e3 * steps.max():.4g} ms, "
            f"{jitter:.0f} % off the nominal"
        )
    if missing > 0:
        largest = int(np.argmax(np.where(gaps, steps, 0.0)))
        parts.append(
            f"{int(gaps.sum())} gaps, about {missing} samples missing, the largest "
            f"{1e3 * steps[largest]:.4g} ms before {table.row(largest + 1)}"
        )
    if not parts:
        return table
    return table.report("clock_jitter", f"nominal {1 / nominal:.5g} Hz; {'; '.join(parts)}")
