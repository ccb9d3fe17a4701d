"""Held to hand formulas, to drawn estimates whose difference is known, and to refusals."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from known_arm import RATE, estimate, samples, samples_without_torque
from scipy import stats

from dynid.core import Finding, InputError
from dynid.identification import Estimate, write_estimate
from dynid.reduction import reduce_model
from dynid.regressor import (
    TERMS,
    Gear,
    InverseDynamicModel,
    LoadFriction,
    TorqueRipple,
    parse_terms,
)
from dynid.robot import RobotModel, load_robot, with_mount
from dynid.signals import Samples
from dynid.validation import ParameterComparison, compare, refit_friction
from dynid.validation.comparison import FALSE_ALARM, GROUPS

SIZES = {"inertial": 36, "coulomb": 6, "viscous": 6, "motor": 4}
"""The composition of the UR5's 52 base parameters (paper 2.1)."""


def group(comparison: ParameterComparison, name: str):
    return next(item for item in comparison.groups if item.name == name)


def moved(by: dict[str, float], std: float = 1.0) -> Estimate:
    """The known estimate with some parameters moved."""
    base = estimate()
    values = base.values.copy()
    for name, step in by.items():
        values[base.names.index(name)] += step
    return replace(base, values=values, covariance=std**2 * np.eye(len(values)))


def test_newtons_of_a_slide_are_no_prior_of_the_other_joints() -> None:
    """At rest nothing is seen: each deviation is what the parameter may change by."""
    base = estimate()
    slides = replace(base.model.robot, joint_types=("prismatic", *["revolute"] * 5))
    friction = [k for k, name in enumerate(base.names) if name.startswith("Fc")]
    values = base.values.copy()
    values[friction] = [400.0, 3.0, 0.01, 2.0, 1.0, 1.0]
    rest = np.zeros((200, 6))
    samples = Samples(
        t=np.arange(200) / 100.0, q=rest, dq=rest, ddq=rest, tau=rest, rate_hz=100.0, cutoff_hz=5.0
    )
    for robot, least in ((slides, 0.3), (base.model.robot, 40.0)):
        known = replace(base, values=values, model=replace(base.model, robot=robot))
        std = refit_friction(known, samples).std[friction]
        assert std[2] == pytest.approx(max(least, known.std[friction[2]]), rel=1e-6)


def test_refitted_friction_is_that_of_least_squares() -> None:
    """Of two columns a joint, with one independent value in 0.2 s, where it may be anything."""
    base, draw = replace(estimate(), covariance=1e6 * np.eye(52)), np.random.default_rng(4)
    dq = samples_without_torque(np.arange(2000) / RATE).dq
    change = np.array([[1.5, -0.8, 0.5, 2.0, -1.0, 0.7], [0.6, 0.9, -0.7, 0.3, 1.2, -0.4]])
    known = samples(change[0] * np.sign(dq) + change[1] * dq + 0.3 * draw.normal(size=dq.shape))
    left = known.tau - base.predict(known.q, known.dq, known.ddq)
    moves = np.abs(dq) > 0.02 * np.abs(dq).max(axis=0)
    found, squares, rest = np.zeros((2, 6)), np.zeros((2, 6)), 0.0
    for j in range(6):
        rows = moves[:, j]
        columns = np.column_stack([np.sign(dq[rows, j]), dq[rows, j]])
        found[:, j], residual = np.linalg.lstsq(columns, left[rows, j])[:2]
        squares[:, j] = np.diag(np.linalg.inv(columns.T @ columns))
        rest += float(residual[0])
    std = np.sqrt(squares * rest / (moves.sum() / (0.2 * RATE) - 12))
    adapted = refit_friction(base, known)
    for kind, values, deviations in zip(("Fc", "Fv"), found, std, strict=True):
        places = [base.names.index(f"{kind}{j + 1}") for j in range(6)]
        step = adapted.values[places] - base.values[places]
        np.testing.assert_allclose(step, values, rtol=1e-5)
        np.testing.assert_allclose(adapted.std[places], deviations, rtol=1e-5)


def test_z_and_change_follow_their_formulas() -> None:
    a, b = moved({}, std=3.0), moved({"Fv2": 10.0}, std=4.0)
    result = compare(a, b)
    at = result.names.index("Fv2")
    assert result.z[at] == pytest.approx(10.0 / 5.0, rel=1e-12)
    assert result.change_percent[at] == pytest.approx(1000.0 / abs(a.values[at]), rel=1e-12)
    assert np.count_nonzero(result.z) == 1


def test_the_deviations_are_those_that_allow_for_correlation() -> None:
    naive = replace(moved({}), naive_std=np.full(52, 1e-6))
    assert compare(naive, moved({"Fv1": 1.0})).z.max() == pytest.approx(1 / np.sqrt(2))


def test_groups_are_the_papers() -> None:
    result = compare(estimate(), estimate())
    assert tuple(item.name for item in result.groups) == GROUPS
    assert {item.name: len(item.members) for item in result.groups} == SIZES
    assert not any(item.moved for item in result.groups)
    every = other_model(friction=parse_terms(",".join(TERMS)))
    assert len(group(compare(every, every), "inertial").members) == SIZES["inertial"]


@pytest.mark.parametrize(("parameter", "name"), [("Fv3", "viscous"), ("Fc1", "coulomb")])
def test_only_the_group_that_moved_is_named(parameter: str, name: str) -> None:
    result = compare(estimate(), moved({parameter: 10.0}))
    assert [item.name for item in result.groups if item.moved] == [name]
    largest = group(result, name).largest
    assert largest is not None
    assert result.names[largest] == parameter


def test_the_limit_keeps_false_alarms_at_their_chance() -> None:
    random, trials = np.random.default_rng(0), 2000
    base = estimate()
    alarms = 0
    members = [k for item in compare(base, base).groups[:1] for k in item.members]
    limit = group(compare(base, base), "inertial").limit_z
    for _ in range(trials):
        alarms += bool((np.abs(random.standard_normal(len(members))) > limit).any())
    spread = 4 * np.sqrt(FALSE_ALARM * (1 - FALSE_ALARM) / trials)
    assert abs(alarms / trials - FALSE_ALARM) < spread
    chance = 2 * stats.norm.sf(limit)
    assert 1 - (1 - chance) ** len(members) == pytest.approx(FALSE_ALARM, rel=1e-9)


def test_the_median_change_leaves_out_what_nobody_knows() -> None:
    base = estimate()
    values, covariance = np.ones(52), 0.01 * np.eye(52)
    at = base.names.index("Fv1")
    covariance[at, at] = 4.0
    a = replace(base, values=values, covariance=covariance)
    warmer = values.copy()
    viscous = [base.names.index(f"Fv{j}") for j in range(1, 7)]
    warmer[viscous] *= 0.75
    warmer[at] = 50.0
    result = compare(a, replace(a, values=warmer))
    assert group(result, "viscous").median_change_percent == pytest.approx(-25.0)


def test_other_motions_are_told_and_repetitions_are_not() -> None:
    base = estimate()
    span = np.ptp(np.stack([base.motion.lower, base.motion.upper]), axis=0)
    again = replace(base.motion, upper=base.motion.upper + 0.05 * span)
    assert compare(base, replace(base, motion=again)).warnings == ()
    # Where a joint stands, its range is noise.
    stands = base.motion.upper - 1e-4 * (np.arange(6) == 4)
    one, two = (
        replace(base, motion=replace(base.motion, lower=np.where(np.arange(6) == 4, at, low)))
        for at, low in ((stands, base.motion.lower), (stands - 0.003, base.motion.lower))
    )
    assert compare(one, two).warnings == ()
    other = replace(base.motion, lower=base.motion.lower + 0.5 * span * (np.arange(6) == 2))
    (told,) = compare(base, replace(base, motion=other)).warnings
    assert (told.kind, told.severity, told.joints) == ("other_motion", "warning", (2,))


def test_one_recording_and_other_shapes_are_told() -> None:
    base = estimate()
    made = replace(base.provenance, inputs={"run.parquet": "0123"})
    first = replace(base, provenance=made, settings=replace(base.settings, stop_s=6.0))
    second = replace(first, settings=replace(base.settings, start_s=6.0, stop_s=None))
    assert compare(first, second).warnings == ()
    (told,) = compare(first, replace(second, settings=base.settings)).warnings
    assert told.kind == "same_record"
    # Neither friction of several days, of one fit, nor other seconds are other settings.
    assert "settings" not in told.text
    (told,) = compare(first, replace(first, values=base.values + 1.0)).warnings
    assert "settings" not in told.text
    asked = replace(made, settings={**made.settings, "cutoff_hz": 5.0})
    (told,) = compare(first, replace(first, provenance=asked)).warnings
    assert "settings" in told.text
    rows = {"record": "4567", "start_s": 0.0, "stop_s": 6.0}
    again = replace(made, settings={**made.settings, "refit": rows})
    (told,) = compare(first, replace(first, provenance=again)).warnings
    assert (told.kind, "refitted" in told.text) == ("same_record", True)
    for same in (
        replace(base.model.friction, width=tuple([base.model.friction.width] * 6)),
        replace(base.model.friction, stribeck_velocity=0.3),
        replace(base.model.friction, presliding=(0.0,) * 6),
    ):
        assert compare(base, replace(base, model=replace(base.model, friction=same))).warnings == ()
    wide = replace(base.model.friction, width=0.05)
    (told,) = compare(base, replace(base, model=replace(base.model, friction=wide))).warnings
    assert told.kind == "other_shape"
    # The velocity of the peak shapes models that have one.
    for terms in ("fc,fv,im", "fc,fv,im,fs"):
        friction = parse_terms(terms)
        one, other = (
            other_model(friction=replace(friction, stribeck_velocity=v)) for v in (0.1, 0.2)
        )
        told = [finding.kind for finding in compare(one, other).warnings]
        assert told == ["other_shape"] * ("fs" in terms)


def coupled(name: str) -> RobotModel:
    """The arm with a motor that turns two joints."""
    robot = load_robot(name)
    turns = np.diag([100.0] * 6)
    turns[5, 4] = 100.0
    return replace(robot, drives=replace(robot.drives, coupling=turns))


def other_model(**changes: object) -> Estimate:
    base = estimate()
    values = {"robot": base.model.robot, "frames": "dh", "friction": base.model.friction}
    model = InverseDynamicModel(**{**values, **changes})  # pyright: ignore[reportArgumentType]
    found = reduce_model(model)
    return replace(
        base,
        model=model,
        independent=found.independent,
        expressions=found.expressions,
        values=np.ones(found.rank),
        covariance=np.eye(found.rank),
        naive_std=np.ones(found.rank),
    )


def test_a_group_without_parameters_has_not_moved() -> None:
    base = other_model(friction=parse_terms("fc,fv"))
    motor = group(compare(base, base), "motor")
    assert (motor.members, motor.largest, motor.moved) == ((), None, False)
    assert np.isnan(motor.limit_z)


@pytest.mark.parametrize("symbol", ["Fl", "Fw"])
def test_friction_by_load_and_ripple_are_of_the_gear(symbol: str) -> None:
    parameters = tuple(np.linspace(1.0, 2.0, 60).tolist())
    load = LoadFriction(joints=(1, 2), parameters=parameters)
    gear = Gear(joint=0, waves=(100.0,), speed=1.0, powers=1)
    ripple = TorqueRipple(joint=0, gears=(gear,), coefficients=(1.0, 0.5))
    friction = replace(estimate().model.friction, load=load, ripples=(ripple,))
    base = other_model(friction=friction)
    at = [k for k, name in enumerate(base.names) if name.startswith(symbol)]
    moved = np.ones(len(base.names))
    moved[at] = 50.0
    result = compare(base, replace(base, values=moved))
    assert at
    assert [found.name for found in result.groups if found.moved] == ["coulomb"]


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"robot": load_robot("ur10")}, "robots"),
        ({"robot": coupled("ur5")}, "robots"),
        ({"robot": replace(load_robot("ur5"), axes=-load_robot("ur5").axes)}, "robots"),
        ({"robot": with_mount(load_robot("ur5"), "wall")}, "mountings"),
        ({"frames": "mdh"}, "frames"),
        ({"friction": parse_terms("fc,fv:2")}, "terms"),
    ],
)
def test_strangers_are_refused_in_one_message(changes: dict[str, object], word: str) -> None:
    with pytest.raises(InputError, match=rf"differ in .*{word}") as caught:
        compare(estimate(), other_model(**changes))
    assert caught.value.exit_code == 2
    assert "\n" not in str(caught.value)


def test_estimates_of_chosen_terms_are_told_the_terms_to_compare_with() -> None:
    with pytest.raises(InputError, match=r"terms fc,fv,fo:1\+3,im"):
        compare(
            other_model(friction=parse_terms("fc,fv:2,fo:3")),
            other_model(friction=parse_terms("fc,fv,im,fo:1")),
        )


def test_other_base_sets_are_refused() -> None:
    base = estimate()
    shorter = replace(
        base,
        independent=base.independent[:-1],
        expressions=base.expressions[:-1],
        values=base.values[:-1],
        covariance=np.eye(51),
        naive_std=np.ones(51),
    )
    with pytest.raises(InputError, match="base sets"):
        compare(base, shorter)


def test_warnings_of_either_estimate_are_passed_on() -> None:
    told = (Finding("ill_conditioned", "really", severity="error"), Finding("ripple", "one"))
    result = compare(estimate(), replace(estimate(), warnings=told))
    found = [(notice.kind, notice.severity) for notice in result.warnings]
    assert found == [("ill_conditioned", "error"), ("ripple", "info")]
    assert "second" in result.warnings[0].message


def test_files_give_the_same_and_the_keys_are_the_contract(tmp_path: Path) -> None:
    paths = [tmp_path / "a.json", tmp_path / "b.json"]
    pair = (moved({}), moved({"Fv4": 20.0}))
    for path, one in zip(paths, pair, strict=True):
        write_estimate(one, path)
    data = compare(*paths).to_json()
    assert data["parameters"] == compare(*pair).to_json()["parameters"]
    assert set(data["groups"]) == set(GROUPS)
    assert {"name", "a", "b", "change_percent", "z"} <= set(data["parameters"][0])
    assert json.dumps(data)
