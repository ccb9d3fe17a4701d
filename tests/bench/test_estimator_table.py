"""The table of estimators: its figures of merit by hand, and what must come out of it."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

import dynid.bench
from dynid.bench import compare_estimators, summary, to_json
from dynid.bench.estimators import (
    KnownArm,
    Trial,
    known_arm,
    parameter_distance,
    relative_error,
    tracking_error,
)
from dynid.cli.app import main
from dynid.core import InputError
from dynid.identification import WeightedLeastSquares


@pytest.fixture(scope="module")
def arm() -> KnownArm:
    return known_arm(0)


def test_figures_of_merit_by_hand() -> None:
    assert parameter_distance(np.array([1.0, 2.0]), np.array([1.0, 2.0])) == 0.0
    assert parameter_distance(np.array([1.0, 0.0]), np.array([-1.0, 0.0])) == pytest.approx(1.0)
    assert parameter_distance(np.array([3.0]), np.array([1.0])) == pytest.approx(1.0)
    truth = np.array([[3.0, 4.0], [0.0, 2.0]])
    assert relative_error(truth + np.array([[0.0, 0.5], [0.2, 0.0]]), truth) == pytest.approx(10.0)


def test_the_arm_obeys_the_model_that_is_fitted(arm: KnownArm) -> None:
    # MuJoCo made these torques: the regressor explains them with the true parameters, but for
    # the torque that is held between two control cycles.
    truth = arm.run.truth
    predicted = arm.model.inverse_dynamics(truth.q, truth.dq, truth.ddq, arm.parameters)
    assert relative_error(predicted, truth.torque) < 2.0


def test_noise_is_what_was_asked(arm: KnownArm) -> None:
    low, high = (
        WeightedLeastSquares().fit(arm.problem(noise, 5.0, 0)).noise for noise in (1.0, 4.0)
    )
    np.testing.assert_allclose(high / low, 4.0, rtol=0.15, atol=0)


def test_the_truth_tracks_and_a_wrong_model_does_not(arm: KnownArm) -> None:
    right = tracking_error(arm, arm.parameters)
    assert right < 0.05
    assert tracking_error(arm, 0.7 * arm.parameters) > 10 * right
    assert tracking_error(arm, -arm.parameters) == float("inf")


@pytest.mark.long
def test_instruments_and_output_error_win_where_the_filter_is_bad() -> None:
    trials = compare_estimators(("ols", "iv", "didim"), (0,))
    table = {(r["estimator"], r["scenario"]): r for r in summary(trials)}
    assert len(table) == 9
    for figure in ("d_tau_percent", "d_q_percent"):
        ols = table["ols", "badly filtered"][figure]
        assert table["iv", "badly filtered"][figure] < ols / 3
        assert table["didim", "badly filtered"][figure] < ols / 3
    assert table["ols", "well filtered"]["d_tau_percent"] < 3.0


def test_unknown_words_are_refused() -> None:
    for words, seeds in ((("olss",), (0,)), ((), (0,)), (("ols",), ())):
        with pytest.raises(InputError):
            compare_estimators(words, seeds)


def test_the_command(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    made: dict[tuple[str, ...], tuple[Trial, ...]] = {}

    def once(words: tuple[str, ...], *rest: Any, **options: Any) -> tuple[Trial, ...]:
        if words not in made:
            made[words] = compare_estimators(words, *rest, **options)
        return made[words]

    monkeypatch.setattr(dynid.bench, "compare_estimators", once)
    assert main(["bench", "estimators", "--only", "wls,wls", "--seeds", "1", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert {row["estimator"] for row in data["table"]} == {"wls"}
    assert len(data["trials"]) == 3
    assert set(data) == set(to_json(()))
    assert main(["bench", "estimators", "--only", "nope"]) == 2
    assert main(["bench", "estimators", "--only", "wls,wls", "--seeds", "1"]) == 0
    assert "badly filtered" in capsys.readouterr().out


def test_failures_are_counted_and_not_averaged() -> None:
    def trial(seed: int, size: float, failure: str = "") -> Trial:
        return Trial(
            estimator="ml",
            scenario="noise x4",
            seed=seed,
            d_beta=size,
            d_tau_percent=10 * size,
            d_q_percent=100 * size,
            seconds=size / 10,
            failure=failure,
        )

    (row,) = summary([trial(0, 1.0), trial(1, 3.0), trial(2, 99.0, "it diverged")])
    assert (row["estimator"], row["scenario"]) == ("ml", "noise x4")
    assert (row["seeds"], row["failures"]) == (3, 1)
    figures = [row[name] for name in ("d_beta", "d_tau_percent", "d_q_percent", "seconds")]
    assert figures == pytest.approx([2.0, 20.0, 200.0, 0.2])
    (lost,) = summary([trial(0, 1.0, "it diverged")])
    assert lost["failures"] == 1
    assert np.isnan(lost["d_beta"])
