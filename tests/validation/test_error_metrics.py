import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.validation import Metrics, deciding_errors, errors_by_kind, metrics

FORMULA = 1e-12
KEYS = [
    "samples",
    "normalized_error",
    "rmse",
    "nrmse",
    "relative_error_percent",
    "relative_error_overall_percent",
    "r2",
]


def _torques(seed: int, samples: int = 400, joints: int = 3) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    scale = np.array([50.0, 10.0, 1.0])[:joints]
    measured = 5 + scale * random.normal(size=(samples, joints))
    return measured, measured + 0.1 * scale * random.normal(size=(samples, joints))


def test_every_metric_is_its_formula() -> None:
    measured, predicted = _torques(1)
    found = metrics(measured, predicted)
    error = measured - predicted
    assert found.samples == 400
    # The paper: (1/N) sqrt(e'e), e of length 3 N.
    assert found.normalized_error == pytest.approx(
        math.sqrt(float((error.ravel() ** 2).sum())) / 400, rel=FORMULA
    )
    for j in range(3):
        tau, e = measured[:, j], error[:, j]
        size = math.sqrt(float(np.mean(e**2)))
        assert found.rmse[j] == pytest.approx(size, rel=FORMULA)
        assert found.nrmse[j] == pytest.approx(size / (tau.max() - tau.min()), rel=FORMULA)
        assert found.relative_error_percent[j] == pytest.approx(
            100 * np.linalg.norm(e) / np.linalg.norm(tau), rel=FORMULA
        )
        assert found.r2[j] == pytest.approx(
            1 - (e**2).sum() / ((tau - tau.mean()) ** 2).sum(), rel=FORMULA
        )
    assert found.relative_error_overall_percent == pytest.approx(
        100 * np.linalg.norm(error) / np.linalg.norm(measured), rel=FORMULA
    )


def test_newtons_and_newton_metres_do_not_add() -> None:
    """A heavy slide hides nothing of light turning joints, nor the other way round."""
    measured, predicted = _torques(3)
    moves = np.abs(measured) > 5
    found = errors_by_kind(measured, predicted, moves, (True, False, False))
    assert list(found) == ["turning", "sliding"]
    for j, kind in (([1, 2], "turning"), ([0], "sliding")):
        whole, moving = found[kind]
        assert whole.to_json() == metrics(measured[:, j], predicted[:, j]).to_json()
        assert moving.to_json() == metrics(measured[:, j], predicted[:, j], moves[:, j]).to_json()
    worst = max(whole.relative_error_overall_percent for whole, _ in found.values())
    both = metrics(measured, predicted, prismatic=(True, False, False))
    assert both.relative_error_overall_percent == worst
    for alike in (True, False):
        (whole, moving) = errors_by_kind(measured, predicted, moves, [alike] * 3)["all"]
        assert whole.to_json() == metrics(measured, predicted).to_json()
        assert moving.to_json() == metrics(measured, predicted, moves).to_json()


@pytest.mark.parametrize("repeats", [4, 9])
def test_the_papers_error_falls_with_the_root_of_the_samples(repeats: int) -> None:
    measured, predicted = _torques(2)
    once = metrics(measured, predicted)
    often = metrics(np.tile(measured, (repeats, 1)), np.tile(predicted, (repeats, 1)))
    assert often.normalized_error == pytest.approx(
        once.normalized_error / math.sqrt(repeats), rel=FORMULA
    )
    np.testing.assert_allclose(often.rmse, once.rmse, rtol=FORMULA, atol=0)


@given(seed=st.integers(0, 2**31), share=st.floats(0.02, 0.98))
@settings(derandomize=True)
def test_a_split_counts_every_joint_sample_once(seed: int, share: float) -> None:
    measured, predicted = _torques(seed, samples=60)
    mask = np.random.default_rng(seed).uniform(size=measured.shape) < share
    both, yes, no = (metrics(measured, predicted, m) for m in (None, mask, ~mask))
    counts = mask.sum(axis=0)
    for j in range(3):
        squares = sum(
            n * part.rmse[j] ** 2 for n, part in ((counts[j], yes), (60 - counts[j], no)) if n
        )
        assert squares == pytest.approx(60 * both.rmse[j] ** 2, rel=1e-9)
    assert abs(yes.samples + no.samples - 60) <= 1
    # e_N of a split is over joint samples by joints.
    parts = [
        (part.normalized_error * m.sum() / 3) ** 2
        for part, m in ((yes, mask), (no, ~mask))
        if m.any()
    ]
    assert sum(parts) == pytest.approx((both.normalized_error * 60) ** 2, rel=1e-9)


def test_a_joint_that_never_counts_is_null_and_the_others_are_not() -> None:
    measured, predicted = _torques(3)
    mask = np.ones(measured.shape, dtype=bool)
    mask[:, 1] = False
    found = metrics(measured, predicted, mask)
    data = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert list(data) == KEYS
    for key in ("rmse", "nrmse", "relative_error_percent", "r2"):
        assert [value is None for value in data[key]] == [False, True, False]
    assert data["samples"] == round(2 * 400 / 3)
    assert data["normalized_error"] > 0


def test_nothing_to_measure_is_null_everywhere() -> None:
    measured, predicted = _torques(4)
    data = metrics(measured, predicted, np.zeros(measured.shape, dtype=bool)).to_json()
    assert data["samples"] == 0
    assert data["normalized_error"] is None
    assert data["relative_error_overall_percent"] is None
    assert data["rmse"] == [None] * 3
    json.dumps(data, allow_nan=False)


@pytest.mark.parametrize("level", [0.0, 0.1, 1 / 3, -7e5])
def test_a_constant_torque_has_no_range_to_compare_with(level: float) -> None:
    measured = np.full((300, 1), level)
    found = metrics(measured, measured + 0.5).to_json()
    assert found["rmse"] == [pytest.approx(0.5)]
    assert found["nrmse"] == [None]
    assert found["r2"] == [None]
    relative = pytest.approx(50 / abs(level)) if level else None
    assert found["relative_error_percent"] == [relative]
    assert found["relative_error_overall_percent"] == relative


def test_a_perfect_prediction_is_perfect() -> None:
    measured, _ = _torques(5)
    found = metrics(measured, measured)
    assert (found.normalized_error, found.relative_error_overall_percent) == (0.0, 0.0)
    np.testing.assert_array_equal(found.r2, 1.0)


def test_predicting_the_mean_explains_nothing() -> None:
    measured, _ = _torques(6)
    found = metrics(measured, np.broadcast_to(measured.mean(axis=0), measured.shape))
    np.testing.assert_allclose(found.r2, 0.0, rtol=0, atol=FORMULA)


def test_numbers_are_plain_for_json() -> None:
    data = metrics(*_torques(7)).to_json()
    assert isinstance(data["samples"], int)
    assert all(type(x) is float for key in KEYS[2:5] for x in data[key])
    assert isinstance(metrics(*_torques(7)), Metrics)


def test_a_model_error_that_noise_hides_is_bounded() -> None:
    """Noise as large as the torque, and a slow error of 10 % of it: never told to be 0."""
    t = np.linspace(0.0, 10.0, 1250)
    torque = 100 * np.sin(np.outer(t, [1.0, 1.7]))
    slow = 10 * np.cos(np.outer(t, [1.3, 0.9]))
    true = 100 * float(np.linalg.norm(slow) / np.linalg.norm(torque))
    moves = np.ones(torque.shape, dtype=bool)
    held = 0
    for seed in range(40):
        random = np.random.default_rng(seed)
        measured = torque + slow + 70 * random.normal(size=torque.shape)
        found = deciding_errors(measured, torque, moves, [False, False])
        told = math.sqrt(max(found.moving**2 - found.noise**2, 0.0))
        held += true < math.hypot(told, found.resolution)
        # 1.645 standard deviations of a mean of 2500 products of two errors.
        assert found.resolution == pytest.approx(
            found.noise * math.sqrt(1.645 / math.sqrt(2500)), rel=0.1
        )
    assert held >= 36
