"""Intervals over poses, of a narrow motion of an arm of MuJoCo whose inertias nobody published."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import dynid
from dynid.bench import arm, plant
from dynid.validation import uncertainty_over_poses

HELD = 0.85
"""Of 90 % intervals, 300 poses: three standard deviations below."""


@pytest.mark.usefixtures("undiagnosed_once")
def test_intervals_grow_where_the_recording_has_not_been_and_hold_there() -> None:
    told, draw = arm("ur5"), np.random.default_rng(0)
    real = plant(told, 4)
    t = np.arange(1500) / 125.0
    # Some tenths of a radian about one pose.
    size = 0.1 * draw.normal(size=(5, 6)) / np.arange(1, 6)[:, None]
    rate = 2 * np.pi * np.arange(1, 6)[:, None] / 10.0
    angle = t[:, None, None] * rate + draw.uniform(0, 6, (5, 6))
    middle = np.array([0.0, -1.0, 1.0, -0.5, 0.4, 0.2])
    q = middle + (size * np.sin(angle)).sum(axis=1)
    dq = (size * rate * np.cos(angle)).sum(axis=1)
    torque = real.torque(q, dq, -(size * rate**2 * np.sin(angle)).sum(axis=1))
    torque += real.coulomb * np.tanh(dq / 0.01) + real.viscous * dq
    torque += real.torque_noise * draw.normal(size=torque.shape)
    record = dynid.ExperimentRecord(t=t, signals={"q": q, "effort": torque})
    robot = replace(told, inertias=np.full_like(told.inertias, np.nan))
    found = dynid.identify(record, robot).estimate
    over = uncertainty_over_poses(found)
    for j in (1, 2, 3):
        own = over[j].position
        seen = (own > found.motion.lower[j]) & (own < found.motion.upper[j])
        assert over[j].anywhere.max() > 1.3 * over[j].near[seen].min()
        assert over[j].anywhere.mean() > over[j].near.mean()
    motion = found.motion
    for j, k in ((1, 0), (2, 20), (4, 40)):
        others = draw.uniform(motion.lower, motion.upper, (1000, 6))
        others[:, j] = over[j].position[k]
        half = found.predict(others, others * 0 + motion.speed / 2, others * 0, interval=0.9)
        known = np.quantile(half.half_width[:, j], 0.9)
        assert over[j].near[k] == pytest.approx(known, rel=0.1)
    many = draw.uniform(-3, 3, (300, 6))
    slow = np.full_like(many, 0.1)
    true = real.torque(many, slow, 0 * many) + real.coulomb + real.viscous * slow
    told_torque = found.predict(many, slow, 0 * many, interval=0.9)
    within = np.abs(true - told_torque.torque) < told_torque.half_width
    assert (within.mean(axis=0) > HELD).all()
