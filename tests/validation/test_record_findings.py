"""What a record says of its inputs: causes, not consequences; nothing where all is well."""

from __future__ import annotations

from pathlib import Path

import pytest
from pinocchio_arm import RATE, VISCOUS, Wrong, arm, recording

from dynid.core import Notice
from dynid.validation import CARRIED, DISTURBED
from dynid.validation.record_faults import DRIFTS, friction_drift
from dynid.workflow import Identification, IdentifySettings, identify

EARLY_OR_LATE_S = 0.35
"""A window is 0.3 s."""


def _identified(folder: Path, wrong: Wrong) -> Identification:
    settings = IdentifySettings(preset="paper", estimator="wls")
    return identify(recording(wrong), arm(folder), settings)


def _said_of_inputs(result: Identification) -> list[Notice]:
    codes = ("clock_mismatch", "unit_suspect", "corrupt_rows")
    return [n for n in result.warnings if n.code in codes]


@pytest.mark.parametrize(
    "wrong",
    [
        Wrong(),
        Wrong(seed=1, load_friction=0.05),
        Wrong(seed=2, late=2),
        Wrong(seed=3, seconds=40.0),
        Wrong(seed=4, seconds=40.0, load_friction=0.05),
    ],
)
def test_good_records_say_nothing(tmp_path: Path, wrong: Wrong) -> None:
    result = _identified(tmp_path, wrong)
    assert _said_of_inputs(result) == []
    assert not any(DRIFTS in notice.message for notice in result.warnings)


@pytest.mark.parametrize("stop", [6.5, 7.6])
def test_a_long_push_bends_the_fit_and_is_found_all_the_same(tmp_path: Path, stop: float) -> None:
    result = _identified(tmp_path, Wrong(push=60.0, push_stop=stop))
    (text,) = [n.message for n in result.warnings if DISTURBED in n.message]
    first, last = (float(x) for x in text.split(" at ")[1].split(" s ")[0].split(" to "))
    assert abs(first - 6.0) < EARLY_OR_LATE_S
    assert abs(last - stop) < EARLY_OR_LATE_S


@pytest.mark.parametrize("late", [-40, 25, 60])
def test_torques_of_another_clock_are_told_by_how_much(tmp_path: Path, late: int) -> None:
    (notice,) = _said_of_inputs(_identified(tmp_path, Wrong(late=late)))
    assert notice.code == "clock_mismatch"
    assert f"{abs(late) / RATE:.2f} s {'later' if late > 0 else 'earlier'}" in notice.message


def test_exchanged_joints_are_named_and_no_gain_or_sign_is(tmp_path: Path) -> None:
    (notice,) = _said_of_inputs(_identified(tmp_path, Wrong(exchanged=True)))
    assert notice.code == "unit_suspect"
    assert "j2 and j3 look exchanged" in notice.message


@pytest.mark.parametrize("share", [0.3, -0.3])
def test_friction_that_drifts_is_said_with_its_size(tmp_path: Path, share: float) -> None:
    result = _identified(tmp_path, Wrong(warming=share, seconds=40.0))
    drift = friction_drift(result.estimate, result.training)
    usual = [float((x[abs(x) > 0.02] ** 2).mean() ** 0.5) for x in result.training.dq.T]
    for j, speed in enumerate(usual):
        viscous = VISCOUS[j] * speed
        mean = viscous * (1 - share / 2) + (3.0, 4.0, 1.0)[j]
        # The speed of moving rows is not uniform: the line is that of the friction near `usual`.
        assert drift.change[j] == pytest.approx(-share * viscous / mean, rel=0.35)
    (notice,) = [n for n in result.warnings if DRIFTS in n.message]
    assert notice.code == "non_white_residuals"
    assert ("warmer" if share > 0 else "colder") in notice.message


def test_a_gain_that_was_found_explains_its_gravity(tmp_path: Path) -> None:
    wrong = Wrong(scales=(1.0, 1.9, 1.0))
    messages = [n.message for n in _identified(tmp_path, wrong).warnings]
    assert any("the torques of j2 are 1.8" in text for text in messages)
    assert not any("known masses" in text for text in messages)


def test_another_mounting_is_not_taken_for_another_order(tmp_path: Path) -> None:
    messages = [n.message for n in _identified(tmp_path, Wrong(tilt_deg=90.0)).warnings]
    assert not any("exchanged" in text for text in messages)


@pytest.mark.parametrize(("before", "after"), [(0.0, 0.5), (0.0, 2.0), (1.0, 0.0)])
def test_another_payload_is_weighed_in_the_validation_record(
    tmp_path: Path, before: float, after: float
) -> None:
    result = identify(
        recording(Wrong(carried=before)),
        arm(tmp_path),
        IdentifySettings(preset="paper", estimator="wls"),
        validation=recording(Wrong(carried=after, seed=9)),
    )
    codes = [n.code for n in result.warnings]
    (text,) = [n.message for n in result.warnings if CARRIED in n.message]
    mass = float(text.split("carries ")[1].split(" +-")[0])
    spread = float(text.split("+- ")[1].split(" kg")[0])
    assert mass == pytest.approx(abs(after - before), abs=max(4 * spread, 0.02))
    assert ("more" if after > before else "less") in text
    assert "over_fitted" not in codes


def test_a_record_with_the_same_payload_says_nothing_of_it(tmp_path: Path) -> None:
    settings = IdentifySettings(preset="paper", estimator="wls")
    for other in (Wrong(seed=9), Wrong(seed=9, load_friction=0.1), Wrong(scales=(1.0, 1.2, 1.0))):
        result = identify(recording(Wrong()), arm(tmp_path), settings, validation=recording(other))
        assert not any(CARRIED in n.message for n in result.warnings)
