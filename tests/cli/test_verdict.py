"""The verdict follows from warnings, conditioning and the error on another motion."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from dynid.core import Finding
from dynid.workflow import verdict


def result(error: float | None, *codes: str, fit: float = 2.0) -> Any:
    """As much of an identification as the verdict looks at; `!` forbids the use."""
    validation = None
    if error is not None:
        validation = SimpleNamespace(moving=SimpleNamespace(relative_error_overall_percent=error))
    return cast(
        "Any",
        SimpleNamespace(
            validation=validation,
            training=SimpleNamespace(moving=SimpleNamespace(relative_error_overall_percent=fit)),
            warnings=tuple(
                Finding(code.rstrip("!"), "words", severity="error" if code.endswith("!") else "")
                for code in codes
            ),
        ),
    )


@pytest.mark.parametrize(
    ("error", "codes", "level"),
    [
        (3.0, (), "usable"),
        (3.0, ("non_white_residuals", "dropped_rows", "clock_jitter"), "usable"),
        # A mounting that was set straight is called ill_conditioned too, and harms nothing.
        (3.0, ("ill_conditioned",), "usable"),
        (3.0, ("over_fitted",), "care"),
        (3.0, ("not_physical",), "care"),
        (3.0, ("extrapolated",), "usable"),
        (None, (), "care"),
        (40.0, (), "care"),
        (float("nan"), (), "care"),
        (3.0, ("ill_conditioned!",), "care"),
        (40.0, ("ill_conditioned!",), "do_not_use"),
        (None, ("ill_conditioned!",), "do_not_use"),
        (3.0, ("low_excitation!",), "do_not_use"),
        (3.0, ("ill_conditioned!", "low_excitation!"), "do_not_use"),
    ],
)
def test_levels(error: float | None, codes: tuple[str, ...], level: str) -> None:
    judged = verdict(result(error, *codes))
    assert judged.level == level
    assert judged.reasons
    assert ("must not be used" in judged.headline) == (level == "do_not_use")
    assert "inf" not in judged.headline


def test_every_doubt_is_named() -> None:
    words = verdict(result(33.0, "extrapolated", "over_fitted")).headline
    assert "33.0 %" in words
    assert "over_fitted" in words


@pytest.mark.parametrize("fit", [85.0, float("nan")])
def test_a_model_that_misses_its_own_record_must_not_be_used(fit: float) -> None:
    judged = verdict(result(3.0, fit=fit))
    assert judged.level == "do_not_use"
    assert "unexplained" in judged.headline


def test_reversed_torques_are_named() -> None:
    judged = verdict(result(3.0, "reversed!"))
    assert judged.level == "do_not_use"
