"""A push in the middle of a record is named; friction that turns over is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from known_arm import estimate as known
from known_arm import samples as known_samples
from pinocchio_arm import Wrong, arm, recording

from dynid.core import Finding
from dynid.validation import reproduce
from dynid.validation.prediction import validate_samples
from dynid.validation.record_faults import disturbed
from dynid.workflow import IdentifySettings, identify


def _found(folder: Path, wrong: Wrong) -> tuple[Finding, ...]:
    robot, record = arm(folder), recording(wrong)
    estimate = identify(record, robot, IdentifySettings(preset="paper", estimator="wls")).estimate
    return disturbed(reproduce(estimate, record), robot.joint_names)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_push_is_found_where_it_was(tmp_path: Path, seed: int) -> None:
    (notice,) = _found(tmp_path, Wrong(push=60.0, seed=seed))
    assert notice.kind == "contact"
    start, stop = (float(x) for x in notice.message.split(" at ")[1].split(" s ")[0].split(" to "))
    assert 5.5 <= start <= 6.1
    assert 6.3 <= stop <= 6.9


@pytest.mark.parametrize("load_friction", [0.0, 0.1])
def test_a_free_motion_is_left_alone(tmp_path: Path, load_friction: float) -> None:
    assert _found(tmp_path, Wrong(load_friction=load_friction)) == ()


def test_bursts_that_come_back_are_friction() -> None:
    error = np.random.default_rng(0).normal(size=(2000, 6))
    for first in range(0, 2000, 200):
        error[first : first + 40] *= 20
    assert disturbed(validate_samples(known(), known_samples(error)), ("j",) * 6) == ()


def test_one_joint_alone_is_no_contact() -> None:
    error = np.random.default_rng(0).normal(size=(2000, 6))
    error[900:930, 2] *= 40
    assert disturbed(validate_samples(known(), known_samples(error)), ("j",) * 6) == ()
    error[900:930, 3] *= 40
    (notice,) = disturbed(validate_samples(known(), known_samples(error)), tuple("abcdef"))
    assert "6.9 to 7.5 s" in notice.message or "7.2 to 7.5 s" in notice.message
