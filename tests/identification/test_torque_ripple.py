"""Torque ripple of gears: its column, its file, and whether the data find it."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from known_robot import NOISE, recording, ur5

from dynid import identify
from dynid.core import InputError
from dynid.identification import read_estimate, write_estimate
from dynid.identification.ripple import alike, find_ripples
from dynid.recording import ExperimentRecord
from dynid.regressor import (
    FrictionTerms,
    Gear,
    InverseDynamicModel,
    TorqueRipple,
    check_differentiable,
    terms_from_json,
)
from dynid.workflow import Identification

pytestmark = pytest.mark.usefixtures("undiagnosed")

RATE = 500.0
QUIET = 0.2
"""Share of the usual torque noise."""
GEAR = Gear(joint=1, waves=(100.0, 200.0), speed=1.5, powers=2)
RIPPLE = TorqueRipple(joint=2, gears=(GEAR,), coefficients=(1, -2, 3, -4, 5, -6, 7, -8))


def shaken(seed: int) -> ExperimentRecord:
    """The known UR5 with gears whose motors turn a hundred times as often as the joints."""
    plain = recording(seed, rate=RATE, noise=QUIET, width=0.02)
    q = plain.signals["q"]
    effort = plain.signals["effort"].copy()
    effort[:, 0] += 0.8 * np.sin(200 * q[:, 0] + 0.4)
    # A gear shakes its neighbour's sensor too.
    effort[:, 1] += 1.0 * np.cos(200 * q[:, 1]) + 0.6 * np.cos(200 * q[:, 0])
    return ExperimentRecord(t=plain.t, signals={**plain.signals, "effort": effort})


@pytest.fixture(scope="module")
def found() -> Identification:
    return identify(shaken(0), ur5(), validation=shaken(1))


def test_the_column_is_the_formula() -> None:
    generator = np.random.default_rng(0)
    q, dq, ddq = generator.normal(size=(3, 40, 6))
    model = InverseDynamicModel(robot=ur5(), friction=FrictionTerms(ripples=(RIPPLE,)))
    assert model.names[-1] == "Fw3"
    column = model.stack(q, dq, ddq)[-1]
    speed = np.clip(dq[:, 1] / 1.5, -1, 1)
    expected = (1 + 3 * speed) * np.cos(100 * q[:, 1]) + (-2 - 4 * speed) * np.sin(100 * q[:, 1])
    expected += (5 + 7 * speed) * np.cos(200 * q[:, 1]) + (-6 - 8 * speed) * np.sin(200 * q[:, 1])
    np.testing.assert_allclose(column[2], expected, rtol=0, atol=1e-12)
    assert not np.delete(column, 2, axis=0).any()
    with pytest.raises(InputError, match="torque ripple"):
        check_differentiable(model)


def test_terms_with_ripple_survive_json() -> None:
    friction = FrictionTerms(ripples=(RIPPLE,))
    assert terms_from_json(friction.to_json()) == friction


@pytest.mark.parametrize(
    "wrong",
    [
        {"coefficients": (1.0,)},
        {"coefficients": (float("nan"),) * 8},
        {"gears": ()},
        {"joint": -1},
    ],
)
def test_ripples_that_cannot_be_are_refused(wrong: dict[str, object]) -> None:
    given = {"joint": 2, "gears": (GEAR,), "coefficients": (1.0,) * 8, **wrong}
    with pytest.raises(InputError, match="torque ripple"):
        TorqueRipple(**given)  # pyright: ignore[reportArgumentType]


def test_gears_and_joints_that_cannot_be_are_refused() -> None:
    for waves, speed, powers in (((), 1.0, 1), ((0.0,), 1.0, 1), ((9.0,), 0.0, 1), ((9.0,), 1, 0)):
        with pytest.raises(InputError, match="gear"):
            Gear(joint=0, waves=waves, speed=speed, powers=powers)
    with pytest.raises(InputError, match="each once"):
        FrictionTerms(ripples=(RIPPLE, RIPPLE))
    far = TorqueRipple(joint=6, gears=(GEAR,), coefficients=RIPPLE.coefficients)
    with pytest.raises(InputError, match="does not have"):
        InverseDynamicModel(robot=ur5(), friction=FrictionTerms(ripples=(far,)))


def test_it_is_found_where_it_is_and_nowhere_else(found: Identification) -> None:
    ripples = {r.joint: r for r in found.estimate.model.friction.ripples}
    assert set(ripples) == {0, 1}
    assert [gear.joint for gear in ripples[0].gears] == [0]
    assert {gear.joint for gear in ripples[1].gears} == {0, 1}
    for ripple in ripples.values():
        for gear in ripple.gears:
            assert min(abs(wave - 200) for wave in gear.waves) < 0.5
    assert any("ripple of joint 1" in word for word in found.estimate.choices)


def test_it_predicts_another_motion(found: Identification) -> None:
    assert found.validation is not None
    assert (found.validation.metrics.rmse < 1.3 * QUIET * NOISE).all()


def test_two_waves_of_one_motor_are_found() -> None:
    """Means over 4 ms leave little of them: their size was -2 +- 2.3 and 6 +- 2 on a TX40."""
    plain = recording(0, rate=2000.0, noise=QUIET, width=0.02)
    effort, q = plain.signals["effort"].copy(), plain.signals["q"][:, 0]
    effort[:, 0] += 0.8 * np.sin(1536 * q) + 0.5 * np.cos(1632 * q)
    record = ExperimentRecord(t=plain.t, signals={**plain.signals, "effort": effort})
    estimate = identify(record, ur5()).estimate
    (ripple,) = estimate.model.friction.ripples
    assert sorted(round(gear.waves[-1]) for gear in ripple.gears) == [1536, 1632]
    size = estimate.names.index("Fw1")
    assert estimate.values[size] == pytest.approx(1.0, abs=0.02)
    assert estimate.std[size] < 0.008


@pytest.mark.long
@pytest.mark.parametrize("correlation", [0.0, 0.95])
def test_no_ripple_is_made_of_noise(correlation: float) -> None:
    record = recording(4, rate=RATE, width=0.02, correlation=correlation)
    assert identify(record, ur5()).estimate.model.friction.ripples == ()


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in (1, 2, 3))]
)
def test_no_ripple_is_made_of_stiction_at_stops(seed: int) -> None:
    generator = np.random.default_rng(seed)
    stops = generator.uniform(-2, 2, size=(2, 25))
    share = np.clip(np.linspace(0, 2, 2000), 0, 1)
    way = 10 * share**3 - 15 * share**4 + 6 * share**5
    q = np.concatenate([a[:, None] + (b - a)[:, None] * way for a, b in pairwise(stops.T)], axis=1)
    dq = np.gradient(q, 1 / RATE, axis=1)
    at_rest = np.repeat(generator.normal(size=(2, 24)), 2000, axis=1) * (np.abs(dq) < 1e-3)
    residual = at_rest + 0.2 * generator.normal(size=q.shape)
    assert find_ripples(q, dq, residual, RATE, (False, False)) == ()
    shaken = residual + 0.3 * np.sin(160 * q)
    assert {ripple.joint for ripple in find_ripples(q, dq, shaken, RATE, (False, False))} == {0, 1}


def test_twenty_seconds_at_the_rate_of_a_ur_show_a_ripple() -> None:
    """No model of such a recording had one: the verdict said yes with errors of 11 %."""
    t = np.arange(2500) / 125.0
    q = np.stack([np.sin(0.9 * t + 1) + 0.4 * np.sin(2.3 * t), 0.9 * np.cos(1.7 * t)])
    dq = np.gradient(q, 1 / 125.0, axis=1)
    residual = 0.2 * np.random.default_rng(0).normal(size=q.shape)
    assert find_ripples(q, dq, residual, 125.0, (False, False)) == ()
    residual[1] += 0.3 * np.sin(80 * q[1])
    assert [r.joint for r in find_ripples(q, dq, residual, 125.0, (False, False))] == [1]


@pytest.mark.long
def test_no_ripple_is_made_of_what_filters_leave() -> None:
    result = identify(recording(0, noise=0.0, width=0.02), ur5())
    assert result.estimate.model.friction.ripples == ()


def test_it_survives_the_file(found: Identification, tmp_path: Path) -> None:
    write_estimate(found.estimate, tmp_path / "model.json")
    read = read_estimate(tmp_path / "model.json")
    assert read.model.friction == found.estimate.model.friction
    generator = np.random.default_rng(0)
    state = generator.normal(size=(3, 20, 6))
    np.testing.assert_array_equal(read.predict(*state), found.estimate.predict(*state))


def test_joints_of_one_size_share_a_gear() -> None:
    peaks = {0: 240.6, 1: 239.0, 2: 244.0, 3: 160.0, 4: 161.0}
    assert alike(peaks) == [[3, 4], [1, 0, 2]]
