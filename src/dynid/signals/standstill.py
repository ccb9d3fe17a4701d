"""When an arm stands still."""

from __future__ import annotations

import numpy as np

from dynid.signals.resample import UniformSignals

RESTING = 0.02
"""Slower joints count as resting [rad/s or m/s]."""
SPAN_S = 0.05
"""Over which speeds are looked at [s]."""


def rest_share(signals: UniformSignals) -> float:
    """Share of a record in which no joint moves."""
    span = max(1, round(SPAN_S * signals.rate_hz))
    speed = np.abs(signals.q[span:] - signals.q[:-span]) * (signals.rate_hz / span)
    return float((speed < RESTING).all(axis=1).mean()) if len(speed) else 1.0
