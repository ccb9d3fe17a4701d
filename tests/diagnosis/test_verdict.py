"""The verdict by purpose follows from the error to expect, the faults and the motion."""

from __future__ import annotations

from typing import Any

import pytest

from dynid.core import Finding
from dynid.diagnosis import Verdict, judge


def judged(error: float | None, *kinds: str, **changed: Any) -> Verdict:
    """A verdict on an error [%] and findings; `!` makes one an error."""
    findings = [
        Finding(kind.rstrip("!"), "words", severity="error" if kind.endswith("!") else "")
        for kind in kinds
    ]
    asked: dict[str, Any] = {
        "expected_percent": error,
        "noise_percent": 1.0,
        "confirmed": error is not None,
        "uncertain_share": 0.1,
    }
    return judge(findings, **(asked | changed))


@pytest.mark.parametrize(
    ("error", "kinds", "level"),
    [
        (3.0, (), "usable"),
        (3.0, ("non_white_residuals", "dropped_rows", "clock_jitter", "ripple"), "usable"),
        # A mounting that was set straight is called ill_conditioned too, and harms nothing.
        (3.0, ("ill_conditioned",), "usable"),
        (3.0, ("other_motion",), "usable"),
        (None, (), "care"),
        (30.0, (), "care"),
        (50.0, (), "do_not_use"),
        (3.0, ("delay",), "care"),
        (3.0, ("contact",), "care"),
        (3.0, ("reversed",), "do_not_use"),
        (2.0, ("low_excitation!",), "usable"),
        (8.0, ("low_excitation!",), "care"),
        (20.0, ("ill_conditioned!",), "do_not_use"),
        (None, ("ill_conditioned!",), "do_not_use"),
    ],
)
def test_levels(error: float | None, kinds: tuple[str, ...], level: str) -> None:
    found = judged(error, *kinds)
    assert found.level == level
    assert found.reasons
    assert ("must not be used" in found.headline) == (level == "do_not_use")


def test_noise_that_no_model_predicts_is_not_held_against_it() -> None:
    assert judged(20.0, noise_percent=19.0).prediction.answer == "yes"
    assert judged(20.0, noise_percent=1.0).prediction.answer == "limits"


def test_intervals_that_do_not_hold_limit_a_prediction() -> None:
    found = judged(3.0, covered=("joint_4", 0.37)).prediction
    assert (found.answer, found.value, found.limit) == ("limits", pytest.approx(37.0), 50.0)
    assert "joint_4" in found.reason
    assert judged(3.0, covered=("joint_4", 0.66)).level == "usable"
    assert judged(50.0, covered=("joint_4", 0.37)).level == "do_not_use"


def test_the_error_with_rests_stands_beside_that_in_motion() -> None:
    """Readers who compute their own take all rows."""
    both = judged(1.44, whole_percent=1.64).headline
    assert both.index("1.4 %") < both.index("1.6 %")
    assert judged(1.44, whole_percent=1.41).headline == judged(1.44).headline


def test_each_purpose_has_its_own_answer() -> None:
    poor = judged(2.0, "ill_conditioned!")
    assert (poor.prediction.answer, poor.parameters.answer) == ("yes", "no")
    heavy = judged(2.0, "indefinite_mass")
    assert (heavy.prediction.answer, heavy.simulation.answer) == ("yes", "no")
    vague = judged(2.0, uncertain_share=0.9)
    assert (vague.parameters.answer, vague.parameters.value) == ("limits", 90.0)
    idle = judged(2.0, pays=False)
    assert (idle.prediction.answer, idle.parameters.answer) == ("yes", "limits")
    assert idle.parameters.reason in idle.headline
    pushing = judged(2.0, "negative_friction")
    assert pushing.prediction.answer == "yes"
    assert (pushing.parameters.answer, pushing.simulation.answer) == ("limits", "limits")
    stuck = judged(2.0, obstacle="not physical: link 5 cannot exist")
    assert (stuck.prediction.answer, stuck.simulation.answer) == ("yes", "no")
    assert "link 5" in stuck.headline


@pytest.mark.parametrize("kind", ["delay", "reversed", "low_excitation!", "negative_friction"])
def test_a_reason_is_given_once(kind: str) -> None:
    """Other purposes with the same reason are named beside it."""
    assert judged(30.0, kind, obstacle="words").headline.count("words") == 1


def test_the_json_has_the_number_that_decides() -> None:
    data = judged(30.0).to_json()
    assert data["level"] == "care"
    assert data["prediction"]["value"] == pytest.approx(30.0, rel=1e-2)
    assert set(data["prediction"]) == {"answer", "reason", "value", "unit", "limit"}


@pytest.mark.parametrize(("hidden", "level"), [(9.0, "usable"), (11.0, "care")])
def test_what_noise_may_hide_decides_like_an_error(hidden: float, level: str) -> None:
    found = judged(50.0, noise_percent=50.0, resolution_percent=hidden)
    assert (found.level, found.prediction.value) == (level, hidden)
    # A model error that stands out of the noise is told as it is.
    plain = judged(50.0, noise_percent=48.0, resolution_percent=hidden)
    assert plain.prediction.value == pytest.approx(14.0)
