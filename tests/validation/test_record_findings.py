"""What a record says of its inputs: causes, not consequences; nothing where all is well."""

from __future__ import annotations

from pathlib import Path

import pytest
from pinocchio_arm import RATE, VISCOUS, Wrong, arm, recording

from dynid.core import Finding
from dynid.validation.record_faults import friction_drift
from dynid.workflow import Identification, IdentifySettings, identify

EARLY_OR_LATE_S = 0.35
"""A window is 0.3 s."""


def _identified(folder: Path, wrong: Wrong) -> Identification:
    settings = IdentifySettings(preset="paper", estimator="wls")
    return identify(recording(wrong), arm(folder), settings)


def _said_of_inputs(result: Identification) -> list[Finding]:
    kinds = (
        "clock_offset",
        "unit_suspect",
        "mounting",
        "drive_gain",
        "reversed",
        "contact",
        "exchanged",
    )
    return [n for n in result.warnings if n.kind in kinds]


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
    assert not any(finding.kind == "friction_drift" for finding in result.warnings)


@pytest.mark.parametrize("stop", [6.5, 7.6])
def test_a_long_push_bends_the_fit_and_is_found_all_the_same(tmp_path: Path, stop: float) -> None:
    result = _identified(tmp_path, Wrong(push=60.0, push_stop=stop))
    (text,) = [n.message for n in result.warnings if n.kind == "contact"]
    first, last = (float(x) for x in text.split(" at ")[1].split(" s ")[0].split(" to "))
    assert abs(first - 6.0) < EARLY_OR_LATE_S
    assert abs(last - stop) < EARLY_OR_LATE_S


@pytest.mark.parametrize("late", [-40, 25, 60])
def test_torques_of_another_clock_are_told_by_how_much(tmp_path: Path, late: int) -> None:
    (notice,) = _said_of_inputs(_identified(tmp_path, Wrong(late=late)))
    assert notice.value == pytest.approx(late / RATE, abs=0.005)


def test_exchanged_joints_are_named_and_no_gain_or_sign_is(tmp_path: Path) -> None:
    (notice,) = _said_of_inputs(_identified(tmp_path, Wrong(exchanged=True)))
    assert (notice.kind, notice.joints) == ("exchanged", (1, 2))


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
    (notice,) = [n for n in result.warnings if n.kind == "friction_drift"]
    assert ("warmer" if share > 0 else "colder") in notice.message


def test_a_gain_that_was_found_explains_its_gravity(tmp_path: Path) -> None:
    wrong = Wrong(scales=(1.0, 1.9, 1.0))
    found = [n for n in _identified(tmp_path, wrong).warnings if n.kind == "drive_gain"]
    assert [(n.joints, round(n.value or 0, 1)) for n in found] == [((1,), 1.9)]


def test_another_mounting_is_not_taken_for_another_order(tmp_path: Path) -> None:
    kinds = {n.kind for n in _identified(tmp_path, Wrong(tilt_deg=90.0)).warnings}
    assert not kinds & {"exchanged", "exchanged_torques"}


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
    (found,) = [n for n in result.warnings if n.kind == "payload"]
    assert found.value == pytest.approx(after - before, abs=max(4 * found.std, 0.02))
    assert "over_fitted" not in codes


def test_a_record_with_the_same_payload_says_nothing_of_it(tmp_path: Path) -> None:
    settings = IdentifySettings(preset="paper", estimator="wls")
    for other in (Wrong(seed=9), Wrong(seed=9, load_friction=0.1), Wrong(scales=(1.0, 1.2, 1.0))):
        result = identify(recording(Wrong()), arm(tmp_path), settings, validation=recording(other))
        assert not any(n.kind == "payload" for n in result.warnings)
