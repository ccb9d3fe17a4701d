"""Repair: the unit of time, and what the clock is worth."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal

import numpy as np

from dynid.core.arrays import Array
from dynid.recording.table import Mask, RawTable

_DAY = 86400.0
_UNITS = {1.0: "s", 1e-3: "ms", 1e-6: "us", 1e-9: "ns", _DAY: "days"}
_DAY_COUNTS = ((3e4, 6e4), (7e5, 8e5))
"""Days since 1900, as spreadsheets count, and since year 0, as MATLAB does."""
_FASTEST = 2e-5
"""Shortest step that a robot's recorder may have [s]."""
_DEGREE = np.pi / 180


def velocity_slopes(t: Array, q: Array, qd: Array) -> tuple[Array, Array]:
    """How far joints move for each unit that their velocities say, and how surely.

    Args:
        t: (N) time.
        q: (N, n) positions.
        qd: (N, n) velocities.

    Returns:
        (n) slope of the displacement over the integrated velocity, and (n) their
        correlation; NaN for joints that hardly move.
    """
    joints = q.shape[1]
    slopes, correlations = np.full(joints, np.nan), np.full(joints, np.nan)
    window = min(max(4, len(t) // 20), 25) if len(t) < 4000 else min(len(t) // 150, 100)
    if len(t) < 4 * window:
        return slopes, correlations
    area = np.concatenate(
        [
            np.zeros((1, joints)),
            np.cumsum(0.5 * (qd[1:] + qd[:-1]) * np.diff(t)[:, None], axis=0),
        ]
    )
    stride = max(1, window // 2)
    said = (area[window:] - area[:-window])[::stride]
    moved = (q[window:] - q[:-window])[::stride]
    span = (t[window:] - t[:-window])[::stride]
    # Over a gap the integral of the velocity means nothing.
    close = span < 1.5 * np.median(span)
    said, moved = said[close], moved[close]
    for joint in range(joints):
        a, b = said[:, joint], moved[:, joint]
        energy, motion = float(a @ a), float(b @ b)
        if np.abs(b).max(initial=0.0) < 5e-3:
            continue
        if energy <= 0:
            slopes[joint] = correlations[joint] = 0.0
            continue
        slopes[joint] = float(a @ b) / energy
        correlations[joint] = float(a @ b) / np.sqrt(energy * motion)
    return slopes, correlations


def common_slope(slopes: Array, correlations: Array) -> float | None:
    """The slope that the well correlated joints agree on, or None."""
    sure: Mask = np.isfinite(slopes) & (np.abs(np.nan_to_num(correlations)) > 0.95)
    return float(np.median(slopes[sure])) if sure.any() else None


def settle_unit(table: RawTable) -> RawTable:
    """Bring the stamps to seconds from the first sample.

    The unit is what the file says, else what makes positions and velocities agree, else
    what makes the sampling rate one of a robot (10 Hz to 10 kHz).
    """
    if table.t is None:
        return table
    first = float(table.t[0])
    t = table.t - first
    scale = table.time_scale
    guessed = scale is None
    if scale is None:
        scale = _scale(t, table)
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
                for factor in (1.0, _DEGREE, 1 / _DEGREE):
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


def check_velocities(table: RawTable, rate_hz: float | None) -> RawTable:
    """Compare velocities with the motion: the clock, units and order of the columns.

    A velocity in deg/s beside positions in rad is left out: both cannot be right.
    """
    if table.t is None:
        return table
    nominal = 1.0 / float(np.median(np.diff(table.t)))
    if rate_hz is not None and table.clock != "rate" and abs(rate_hz / nominal - 1) > 0.03:
        table = table.report(
            "clock_mismatch",
            f"the time stamps say {nominal:.5g} Hz, not the {rate_hz:.5g} Hz given; the stamps "
            "are kept",
        )
    if "qd" not in table.signals:
        return table
    slopes, sure = velocity_slopes(table.stamps, table.signals["q"], table.signals["qd"])
    slope = common_slope(slopes, sure)
    if slope is None:
        odd = np.isfinite(sure) & (np.abs(np.nan_to_num(sure)) < 0.5)
        table = _report_odd(table, odd, "do not follow the motion")
        if odd.any() and bool((odd | ~np.isfinite(sure)).all()):
            return table.without("qd").note("qd is left out: it is no velocity of these joints")
        return table
    if abs(slope / _DEGREE - 1) < 0.15:
        return table.without("qd").report(
            "unit_suspect",
            "velocities are 57.3 times what positions in rad say: they are in deg/s; qd is left "
            "out",
        )
    if abs(slope * _DEGREE - 1) < 0.15:
        return table.report(
            "unit_suspect",
            "positions move 57.3 times as far as velocities in rad/s say: positions in degrees?",
        )
    table = _report_odd(table, slopes * np.sign(slope) < -0.5 * abs(slope), "have the other sign")
    low = np.isfinite(sure) & (np.abs(np.nan_to_num(sure)) < 0.5)
    table = _report_odd(table, low, "do not follow the motion")
    if abs(slope - 1) > 0.03:
        table = table.report(
            "clock_mismatch",
            f"positions move {slope:.4g} times as far as velocities and clock say: the clock "
            f"gives {nominal:.5g} Hz, the velocities {nominal / abs(slope):.4g} Hz",
        )
    return table


def _report_odd(table: RawTable, odd: Mask, why: str) -> RawTable:
    if not odd.any():
        return table
    names = ", ".join(str(k + 1) for k in np.flatnonzero(odd))
    return table.report(
        "unit_suspect", f"the velocities of joint {names} {why}: check the columns of q and qd"
    )
