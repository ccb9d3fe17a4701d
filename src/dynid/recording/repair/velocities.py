"""Velocities against the motion: they tell the clock, or are in another unit themselves."""

from __future__ import annotations

import numpy as np

from dynid.core import Array
from dynid.recording.table import Mask, RawTable

DEGREE = np.pi / 180
"""A degree [rad]."""
RPM = np.pi / 30
"""A revolution a minute [rad/s]."""


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


def check_velocities(table: RawTable, rate_hz: float | None) -> RawTable:
    """Compare velocities with the motion: the clock, units and order of the columns.

    Velocities in another unit than positions are left out: both cannot be right.
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
    wrong = _wrong_unit(slope, slopes[np.abs(np.nan_to_num(sure)) > 0.95])
    if wrong:
        return table.without("qd").report("unit_suspect", f"{wrong}; qd is left out")
    if abs(slope * DEGREE - 1) < 0.15:
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


def _wrong_unit(slope: float, sure: Array) -> str:
    """What velocities are where they cannot be the joints' in rad/s; empty where they can."""
    if abs(slope / DEGREE - 1) < 0.15:
        return "velocities are 57.3 times what positions in rad say: they are in deg/s"
    if abs(slope / RPM - 1) < 0.05:
        return "velocities are 9.55 times what positions in rad say: they are in rpm"
    if abs(slope + 1) < 0.15:
        return "velocities have the other sign than the motion of all joints"
    times = np.abs(1 / sure)
    if float(times.max()) > 1.5 * float(times.min()) and float(np.median(times)) > 3:
        return (
            f"velocities are {times.min():.4g} to {times.max():.4g} times what positions say, "
            "another factor for each joint: measured on the motors' side"
        )
    return ""


def _report_odd(table: RawTable, odd: Mask, why: str) -> RawTable:
    if not odd.any():
        return table
    names = ", ".join(str(k + 1) for k in np.flatnonzero(odd))
    return table.report(
        "unit_suspect", f"the velocities of joint {names} {why}: check the columns of q and qd"
    )
