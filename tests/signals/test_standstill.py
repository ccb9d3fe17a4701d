"""When an arm stands still."""

from __future__ import annotations

import numpy as np
import pytest

from dynid.signals import UniformSignals, rest_share

RATE = 100.0


def record(q: np.ndarray) -> UniformSignals:
    count = len(q)
    return UniformSignals(
        t=np.arange(count) / RATE,
        rate_hz=RATE,
        q=q,
        qd=None,
        torque=np.zeros_like(q),
        valid=np.ones(count),
    )


def test_the_share_is_that_of_the_time_in_which_no_joint_moves() -> None:
    t = np.arange(1000) / RATE
    stops = np.clip(t, 2.0, 8.0)
    goes_on = np.sin(t)
    assert rest_share(record(np.column_stack([stops, stops]))) == pytest.approx(0.4, abs=0.01)
    # One joint is slow only where its speed turns round.
    assert rest_share(record(np.column_stack([stops, goes_on]))) < 0.02
    assert rest_share(record(np.zeros((1000, 2)))) == 1.0
    assert rest_share(record(np.zeros((3, 2)))) == 1.0


def test_the_last_digit_of_an_encoder_is_no_motion() -> None:
    digit = np.random.default_rng(0).integers(0, 2, (1000, 2)) * 4e-4
    # From sample to sample the digit alone would be 0.04 rad/s.
    assert rest_share(record(digit)) == 1.0
