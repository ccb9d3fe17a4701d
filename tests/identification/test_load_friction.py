"""Friction that grows with the load: its column, its file, and whether the data find it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from known_robot import NOISE, identified, oracle, recording, ur5

from dynid import identify
from dynid.core import InputError
from dynid.identification import (
    PRIOR_GAIN,
    IdentificationProblem,
    WeightedLeastSquares,
    read_estimate,
    without_negative,
    write_estimate,
)
from dynid.recording import ExperimentRecord
from dynid.reduction import reduce_model
from dynid.regressor import FrictionTerms, InverseDynamicModel, LoadFriction, terms_from_json
from dynid.signals import ProcessingSettings, process
from dynid.trajectory import random_excitation
from dynid.workflow import Identification

pytestmark = pytest.mark.usefixtures("undiagnosed")

SHARE = 0.08
"""Of the load of joint 2 [-]."""
WIDTH = 0.02


def loaded_record(seed: int) -> ExperimentRecord:
    """The known UR5, whose joint 2 rubs harder the more it carries."""
    plain = recording(seed, width=WIDTH)
    series = random_excitation(ur5().limits, seed=seed, period_s=10.0, acceleration=5.5 * np.pi)
    motion = series.evaluate(plain.t)
    model, _ = oracle()
    data = model.createData()
    rigid = np.array(
        [pin.rnea(model, data, *x) for x in zip(motion.q, motion.dq, motion.ddq, strict=True)]
    )
    rigid -= np.asarray(model.armature) * motion.ddq
    extra = SHARE * np.abs(rigid) * np.tanh(motion.dq / WIDTH) * [0, 1, 0, 0, 0, 0]
    return ExperimentRecord(
        t=plain.t, signals={"q": plain.signals["q"], "effort": plain.signals["effort"] + extra}
    )


@pytest.fixture(scope="module")
def found() -> Identification:
    return identify(loaded_record(0), ur5(), validation=loaded_record(1))


def test_the_column_is_the_formula() -> None:
    robot = ur5()
    _, truth = oracle()
    load = LoadFriction(joints=(1, 2), parameters=tuple(truth[:60].tolist()))
    friction = FrictionTerms(width=WIDTH, load=load)
    model = InverseDynamicModel(robot=robot, friction=friction)
    assert model.names[-2:] == ("Fl2", "Fl3")
    generator = np.random.default_rng(0)
    q, dq, ddq = generator.normal(size=(3, 40, 6))
    stack = model.stack(q, dq, ddq)
    pinocchio, _ = oracle()
    data = pinocchio.createData()
    rigid = np.array([pin.rnea(pinocchio, data, *x) for x in zip(q, dq, ddq, strict=True)])
    rigid -= np.asarray(pinocchio.armature) * ddq
    for k, j in ((-2, 1), (-1, 2)):
        expected = np.abs(rigid[:, j]) * np.tanh(dq[:, j] / WIDTH)
        np.testing.assert_allclose(stack[k, j], expected, rtol=0, atol=1e-9)
        assert not np.delete(stack[k], j, axis=0).any()
    assert terms_from_json(friction.to_json()) == friction


def test_loads_of_other_robots_are_refused() -> None:
    load = LoadFriction(joints=(6,), parameters=(0.0,) * 70)
    with pytest.raises(InputError, match="another robot"):
        InverseDynamicModel(robot=ur5(), friction=FrictionTerms(load=load))
    for joints in ((), (1, 1), (-1,)):
        with pytest.raises(InputError, match="each once"):
            LoadFriction(joints=joints, parameters=(0.0,) * 60)


def test_the_data_choose_it_where_it_is(found: Identification) -> None:
    estimate = found.estimate
    load = estimate.model.friction.load
    assert load is not None
    assert 1 in load.joints
    k = estimate.names.index("Fl2")
    assert estimate.values[k] == pytest.approx(SHARE, abs=4 * estimate.std[k])
    assert found.validation is not None
    noise = NOISE
    assert (found.validation.metrics.rmse < 1.15 * noise).all()


def test_friction_that_the_fit_makes_negative_is_left_out() -> None:
    """A joint that friction drives, and load friction where there is none."""
    plain, (_, truth) = recording(0, width=WIDTH), oracle()
    series = random_excitation(ur5().limits, seed=0, period_s=10.0, acceleration=5.5 * np.pi)
    driving = 12.0 * np.tanh(series.evaluate(plain.t).dq / WIDTH) * [0, 0, 1, 0, 0, 0]
    signals = plain.signals | {"effort": plain.signals["effort"] - driving}
    samples = process(replace(plain, signals=signals), ur5(), ProcessingSettings())
    load = LoadFriction(joints=(0, 1, 2, 3, 4, 5), parameters=tuple(truth[:60].tolist()))
    model = InverseDynamicModel(robot=ur5(), friction=FrictionTerms(width=WIDTH, load=load))
    estimator = WeightedLeastSquares(prior_gain=PRIOR_GAIN)

    def negative(model: InverseDynamicModel) -> list[str]:
        base = reduce_model(model)
        values = estimator.fit(IdentificationProblem(base=base, samples=samples)).values
        pairs = zip(base.names, values, strict=True)
        return [name for name, value in pairs if name[0] == "F" and value < 0]

    assert "Fc3" in negative(model)
    found = without_negative(model, samples, estimator)
    assert not negative(found)
    assert set(model.names) - set(found.names) >= {"Fc3"}
    assert {"Fc1", "Fv1", "Im3"} <= set(found.names)


def test_it_survives_the_file(found: Identification, tmp_path: Path) -> None:
    path = tmp_path / "loaded.json"
    write_estimate(found.estimate, path)
    back = read_estimate(path)
    assert back.model.friction == found.estimate.model.friction
    q, dq, ddq = np.random.default_rng(1).normal(size=(3, 5, 6))
    np.testing.assert_array_equal(back.predict(q, dq, ddq), found.estimate.predict(q, dq, ddq))


@pytest.mark.long
def test_a_robot_without_it_gets_none() -> None:
    assert identified().estimate.model.friction.load is None
