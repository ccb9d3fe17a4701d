import json
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from known_robot import COULOMB, VISCOUS, identified, oracle, recording, ur5

from dynid import identify
from dynid.core import Array, InputError
from dynid.identification.fitting import smallest_mass_eigenvalue
from dynid.identification.problem import base_mapping, motion_condition_number
from dynid.recording import ExperimentRecord
from dynid.reduction import reduce_model
from dynid.regressor import InverseDynamicModel, parse_terms
from dynid.signals import ProcessingSettings, process, uniform_signals
from dynid.workflow import Identification, IdentifySettings, verdict
from dynid.workflow.identify import fit_records

pytestmark = pytest.mark.usefixtures("undiagnosed")


def codes(result: Identification) -> set[str]:
    return {notice.code for notice in result.warnings}


def test_a_good_record_raises_no_alarm() -> None:
    assert not codes(identified()) & {
        "ill_conditioned",
        "low_excitation",
        "over_fitted",
        "not_physical",
    }


def test_the_condition_number_of_a_motion_is_a_pencil_s_of_pinocchio_in_all_frames() -> None:
    """The largest ratio of torques elsewhere to recorded ones; the same random motions."""
    record, model, motion_hz = recording(0), oracle()[0], 0.6
    signals = [uniform_signals(record, ur5(), ProcessingSettings())]
    ours = [
        motion_condition_number(reduce_model(model), signals, ProcessingSettings())
        for model in (InverseDynamicModel(robot=ur5(), frames=f) for f in ("dh", "urdf"))
    ]
    assert ours[0] == pytest.approx(ours[1], rel=1e-6)
    samples = process(record, ur5(), ProcessingSettings(cutoff_hz=2 * motion_hz))
    draw, shape = np.random.default_rng(0), (1000, 6)
    q = draw.uniform(ur5().limits.lower, ur5().limits.upper, shape)
    speed, acceleration = (
        draw.normal(size=shape) * np.sqrt(np.square(x).mean(axis=0))
        for x in (samples.dq, samples.ddq)
    )
    data = model.createData()
    motions = [
        (samples.q, samples.dq, samples.ddq),
        (q, speed, acceleration),
    ]
    grams: list[Array] = []
    for motion in motions:
        columns = [
            np.hstack(
                [
                    pin.computeJointTorqueRegressor(model, data, q, dq, ddq),
                    np.diag(np.tanh(dq / 0.001)),
                    np.diag(dq),
                    np.diag(ddq),
                ]
            )
            for q, dq, ddq in zip(*motion, strict=True)
        ]
        scaled = np.array(columns) / np.sqrt(np.square(samples.tau).mean(axis=0))[:, None]
        grams.append(np.einsum("tji,tjk->ik", scaled, scaled) / len(columns))
    size = np.sqrt(np.maximum(np.diag(sum(grams)), 1e-12))
    values, vectors = np.linalg.eigh(sum(grams) / np.outer(size, size))
    whiten = (vectors[:, -52:] / np.sqrt(values[-52:])) / size[:, None]
    weakest = np.linalg.eigvalsh(whiten.T @ grams[0] @ whiten)[0]
    assert ours[0] == pytest.approx(np.sqrt(1 / weakest - 1), rel=1e-6)


@pytest.mark.long
def test_a_joint_that_stands_is_low_excitation() -> None:
    record = recording(0)
    q = record.signals["q"].copy()
    q[:, 3] = 0.5 + 1e-4 * np.sin(np.arange(len(q)) / 40)
    still = ExperimentRecord(t=record.t, signals={"q": q, "effort": record.signals["effort"]})
    result = identify([still], ur5(), IdentifySettings())
    assert {"low_excitation"} <= codes(result)
    message = next(n.message for n in result.warnings if n.code == "low_excitation")
    assert "wrist_1_joint" in message


def test_the_smallest_mass_eigenvalue_is_pinocchio_s() -> None:
    record, (model, truth) = recording(0), oracle()
    few = {name: values[::8] for name, values in record.signals.items()}
    thin = ExperimentRecord(t=record.t[::8], signals=few)
    estimate = identify([thin], ur5(), IdentifySettings(preset="paper")).estimate
    mapping = base_mapping(reduce_model(estimate.model))
    samples = process(thin, ur5(), ProcessingSettings())
    size, std = smallest_mass_eigenvalue(replace(estimate, values=mapping @ truth), samples)
    data = model.createData()
    theirs = [np.linalg.eigvalsh(pin.crba(model, data, q))[0] for q in samples.q]
    assert size == pytest.approx(min(theirs), rel=1e-6)
    assert 0.0 < std < size


def test_a_model_of_another_robot_is_over_fitted() -> None:
    record, other = recording(0), recording(1)
    heavier = ExperimentRecord(
        t=other.t, signals={"q": other.signals["q"], "effort": 1.4 * other.signals["effort"]}
    )
    result = identify([record], ur5(), IdentifySettings(preset="paper"), validation=heavier)
    assert "over_fitted" in codes(result)


def test_correlated_residuals_are_said() -> None:
    result = identify([recording(0, correlation=0.9)], ur5(), IdentifySettings(preset="paper"))
    assert "non_white_residuals" in codes(result)


def test_given_terms_and_cutoff_are_kept() -> None:
    terms = parse_terms("fc,fv,im,fo:2")
    given = IdentifySettings(terms=terms, cutoff_hz=12.5)
    result = fit_records([recording(0)], ur5(), given).estimate
    assert result.model.friction.terms == terms.terms
    assert result.settings.cutoff_hz == 12.5


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"preset": "worst"}, "preset"),
        ({"estimator": "kalman"}, "ols, wls, irls"),
        ({"weighting": "loud"}, "weighting"),
    ],
)
def test_unknown_words_are_refused(settings: dict[str, str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        IdentifySettings(**settings)


def test_no_record_is_refused() -> None:
    with pytest.raises(InputError, match="at least one record"):
        identify([], ur5())


@pytest.mark.parametrize("value", [0.0, 0.25])
def test_a_torque_that_never_changes_is_refused_by_its_joint(value: float) -> None:
    record = recording(0)
    effort = record.signals["effort"].copy()
    effort[:, 2] = value
    dead = ExperimentRecord(t=record.t, signals={"q": record.signals["q"], "effort": effort})
    with pytest.raises(InputError, match="same on every row; got elbow_joint"):
        identify([dead], ur5())


def test_an_arm_that_stands_still_is_refused() -> None:
    record = recording(0)
    still = np.tile(record.signals["q"][0], (record.samples, 1))
    motionless = ExperimentRecord(
        t=record.t, signals={"q": still, "effort": record.signals["effort"]}
    )
    with pytest.raises(InputError, match="too much alike"):
        identify([motionless], ur5())


@pytest.mark.long
def test_a_joint_that_stands_still_takes_nothing_from_the_others() -> None:
    record = recording(3, seconds=20.0, period=20.0)
    q = record.signals["q"].copy()
    q[:, 4:] = q[0, 4:]
    model, _ = oracle()
    data = model.createData()
    still = ExperimentRecord(t=record.t, signals={"q": q, "effort": record.signals["effort"]})
    samples = process(still, ur5(), ProcessingSettings(cutoff_hz=10.0))
    rigid = np.array(
        [
            pin.rnea(model, data, *state)
            for state in zip(samples.q, samples.dq, samples.ddq, strict=True)
        ]
    )
    torque = rigid + COULOMB * np.tanh(samples.dq / 0.02) + VISCOUS * samples.dq
    noise = 0.1 * np.random.default_rng(0).normal(size=torque.shape)
    again = ExperimentRecord(t=samples.t, signals={"q": samples.q, "effort": torque + noise})
    result = identify(again, ur5(), IdentifySettings(preset="best"))
    estimate = result.estimate
    assert np.isfinite(estimate.std).all()
    json.dumps(result.to_json(), allow_nan=False)
    value = dict(zip(estimate.names, estimate.values, strict=True))
    assert [value[f"Fv{j}"] for j in (1, 2, 3)] == pytest.approx(VISCOUS[:3], rel=0.1)
    judged = verdict(result)
    assert (judged.prediction.answer, judged.parameters.answer) == ("limits", "no")
    assert "only for motions like these" in judged.prediction.reason
    assert "expected to predict torques of such motions" in judged.prediction.reason
    assert "other motions" not in judged.prediction.reason
