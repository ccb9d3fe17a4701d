"""Payloads of the simulated arm, and the nearest body against a conic solver."""

from __future__ import annotations

from dataclasses import replace

import clarabel
import numpy as np
import pinocchio as pin
import pytest
from scipy import sparse

from dynid.core import Array, InputError
from dynid.identification import Payload
from dynid.identification.payload import GAINS_OFF, NORMAL_95, nearest_body
from dynid.recording import ExperimentRecord
from dynid.robot import (
    RobotModel,
    from_pseudo_inertia,
    is_physical,
    load_robot,
    robot_from_chain,
    to_pseudo_inertia,
)
from dynid.simulation import cylinder, link_parameters, simulate, simulated_arm, with_payload
from dynid.trajectory import FourierSeries, random_excitation
from dynid.workflow import identify_gains_from_payload, identify_payload
from dynid.workflow.running import record_of

MASS, CENTRE = 0.02, 0.005
"""Asked: relative error of the mass, error of the centre [m]."""
SOLVERS_AGREE = 1e-5
"""What Clarabel reaches here; the conditions of optimality are the sharp check."""
KKT = 1e-7
ORTHOGONAL = 1e-8
"""Cosine between the gap and the body at the optimum, at which they are orthogonal."""
BASIS = to_pseudo_inertia(np.eye(10))
ROBOT = load_robot("ur5")
CASES = ((0.5, (0.0, 0.02, 0.04)), (2.0, (-0.05, 0.03, 0.08)), (5.0, (0.04, -0.02, 0.1)))


def motion(seed: int) -> FourierSeries:
    return random_excitation(ROBOT.limits, seed=seed, margin=0.6, acceleration=8.0)


def recorded(seed: int, payload: tuple[float, Array, Array] | None) -> ExperimentRecord:
    arm = simulated_arm(ROBOT)
    if payload is not None:
        arm = with_payload(arm, *payload)
    noise = seed if payload is None else seed + 1000
    return record_of(simulate(arm, motion(seed), seed=noise))


def body(mass: float, centre: tuple[float, ...]) -> tuple[float, Array, Array]:
    return mass, np.array(centre), cylinder(mass, 0.04, 0.1, 2)


@pytest.mark.parametrize(
    ("mass", "centre"),
    [CASES[0], *(pytest.param(*case, marks=pytest.mark.long) for case in CASES[1:])],
)
def test_payload_of_the_simulated_arm(mass: float, centre: tuple[float, ...]) -> None:
    truth = body(mass, centre)
    seed = round(10 * mass)
    found = identify_payload(recorded(seed, None), recorded(seed, truth), ROBOT)
    assert abs(found.mass / mass - 1) < MASS
    assert np.abs(found.centre - centre).max() < CENTRE
    # Four numbers: one outside 1.96 deviations is no surprise, one outside three is.
    assert abs(found.mass - mass) < 3 * found.mass_std
    assert (np.abs(found.centre - centre) < 3 * found.centre_std).all()
    spread = np.abs(found.free - link_parameters(*truth)) / found.std
    assert (spread < NORMAL_95).sum() >= 8
    assert is_physical(found.parameters)
    assert not found.warnings
    # Intervals that say something: not wider than what is asked.
    assert NORMAL_95 * found.mass_std < 3 * MASS * max(mass, 1.0)
    data = found.to_json()
    assert data["mass_interval"][0] < data["mass"] < data["mass_interval"][1]


def test_a_bias_that_both_runs_share_cancels() -> None:
    """A torque of the pose, as of a cable, three times what the payload weighs on the wrist."""
    truth = body(1.0, (0.01, 0.02, 0.05))
    runs = [recorded(4, None), recorded(4, truth)]
    plain = identify_payload(*runs, ROBOT)
    gain = ROBOT.drives.gain

    def biased(record: ExperimentRecord) -> ExperimentRecord:
        q = np.asarray(runs[0].signals["q"])
        torque = 6.0 * np.sin(2 * q + 0.3) + 4.0 * np.cos(3 * q)
        signals = dict(record.signals)
        signals["current"] = record.signals["current"] + torque / gain
        return ExperimentRecord(t=record.t, signals=signals)

    with_bias = identify_payload(biased(runs[0]), biased(runs[1]), ROBOT)
    assert abs(with_bias.mass - 1.0) < MASS
    assert np.abs(with_bias.centre - truth[1]).max() < CENTRE
    # In the loaded run alone the bias is not shared, and must show.
    alone = identify_payload(runs[0], biased(runs[1]), ROBOT)
    assert abs(alone.mass - 1.0) > 3 * abs(with_bias.mass - plain.mass)


def test_periods_of_one_motion_tell_no_more_where_they_are_many() -> None:
    """What a model gets wrong is the same in each period: copies of one add no information."""
    runs = [recorded(4, None), recorded(4, body(1.0, (0.01, 0.02, 0.05)))]

    def repeated(record: ExperimentRecord, times: int) -> ExperimentRecord:
        signals = {k: np.tile(v, (times, 1)) for k, v in record.signals.items()}
        t = np.arange(times * record.samples) / record.rate_hz
        return ExperimentRecord(t=t, signals=signals)

    few, many = (identify_payload(*(repeated(r, k) for r in runs), ROBOT) for k in (3, 9))
    ratio = many.std / few.std
    assert 0.75 < ratio.min() < ratio.max() < 1.1


def test_a_gain_that_is_off_moves_the_payload_within_its_deviations() -> None:
    runs = [recorded(4, None), recorded(4, body(2.0, (0.01, 0.02, 0.05)))]
    off = np.ones(6)
    off[1] += GAINS_OFF
    wrong = [
        ExperimentRecord(t=r.t, signals={**r.signals, "current": off * r.signals["current"]})
        for r in runs
    ]
    plain, moved = (identify_payload(*pair, ROBOT) for pair in (runs, wrong))
    away = np.abs(moved.free - plain.free) / plain.std
    assert 0.3 < away.max() < 1.1


def test_nothing_on_the_flange_is_told_from_nothing() -> None:
    empty = record_of(simulate(simulated_arm(ROBOT), motion(5), seed=77))
    found = identify_payload(recorded(5, None), empty, ROBOT)
    assert abs(found.free[0]) < 3 * found.mass_std
    assert "low_excitation" in [notice.code for notice in found.warnings]


def test_an_offset_of_currents_is_no_swap_of_runs() -> None:
    runs = [recorded(4, None), recorded(4, body(2.0, (0.01, 0.02, 0.05)))]
    off = runs[1].signals["current"] + [0.0, 5.0, 5.0, 2.0, 0.0, 0.0]
    signals = {**runs[1].signals, "current": off}
    wrong = identify_payload(runs[0], replace(runs[1], signals=signals), ROBOT)
    back = identify_payload(runs[1], runs[0], ROBOT)
    for found, words in ((wrong, "more than the payload"), (back, "swapped")):
        assert [(one.kind, words in one.text) for one in found.warnings] == [("not_physical", True)]


def scara(carried: pin.Inertia, seed: int) -> ExperimentRecord:
    """Parallel axes: no torque depends on a payload's height, nor on most of its tensor."""
    model = pin.Model()
    joints = (pin.JointModelRZ(), pin.JointModelRZ(), pin.JointModelPZ(), pin.JointModelRZ())
    bodies = [pin.Inertia(m, np.array([0.1, 0.0, 0.0]), 0.02 * np.eye(3)) for m in (7, 4, 2, 1)]
    bodies[-1] += carried
    for k, (joint, own) in enumerate(zip(joints, bodies, strict=True)):
        model.addJoint(k, joint, pin.SE3(np.eye(3), np.array(SCARA[k])), f"j{k}")
        model.appendBodyToJoint(k + 1, own, pin.SE3.Identity())
    t, data = np.arange(2400) / 200, model.createData()
    rates = np.array([1.0, 1.6, 1.3, 2.1])
    size = np.array([1.0, 1.2, 0.1, 1.5])
    q, dq, ddq = (
        size
        * (
            wave(np.outer(t, rates)) * rates**k
            - 0.4 * wave(2.7 * np.outer(t, rates)) * (2.7 * rates) ** k
        )
        for k, wave in enumerate((np.sin, np.cos, lambda x: -np.sin(x)))
    )
    tau = np.array([pin.rnea(model, data, *row) for row in zip(q, dq, ddq, strict=True)])
    tau += np.tanh(50 * dq) + dq
    tau += np.random.default_rng(seed).normal(size=tau.shape) * [0.3, 0.2, 0.3, 0.03]
    return ExperimentRecord(t=t, signals={"q": q, "qd": dq, "effort": tau})


SCARA = ((0.0, 0.0, 0.4), (0.35, 0.0, 0.0), (0.25, 0.0, 0.0), (0.0, 0.0, -0.1))


def scara_robot() -> RobotModel:
    placements = np.tile(np.eye(4), (4, 1, 1))
    placements[:, :3, 3] = SCARA
    axes, kinds = (
        np.tile([0.0, 0.0, 1.0], (4, 1)),
        ["revolute", "revolute", "prismatic", "revolute"],
    )
    return robot_from_chain(placements=placements, axes=axes, name="scara", joint_types=kinds)


def test_what_a_scara_shows_of_its_payload_is_told_from_what_it_does_not() -> None:
    robot = scara_robot()
    truth = pin.Inertia(1.0, np.array([0.03, -0.02, 0.05]), 0.002 * np.eye(3))
    found = identify_payload(scara(pin.Inertia.Zero(), 1), scara(truth, 2), robot)
    seen = [0, 1, 2, 6]
    expected = np.array([1.0, 0.03, -0.02, 0.002 + 0.03**2 + 0.02**2])
    assert (np.abs(found.free[seen] - expected) < 3 * found.std[seen]).all()
    assert found.std[seen].max() < 0.1
    assert found.std[3] > 10
    assert ["mz, Jxx" in notice.text for notice in found.warnings] == [True]


def test_a_weighed_payload_that_an_arm_shows_in_part_gives_gains() -> None:
    gains = np.array([11.0, 7.0, 30.0, 2.0])

    def currents(carried: pin.Inertia, seed: int) -> ExperimentRecord:
        signals = dict(scara(carried, seed).signals)
        signals["current"] = signals.pop("effort") / gains
        return ExperimentRecord(t=scara(carried, seed).t, signals=signals)

    carried = pin.Inertia(3.0, np.array([0.1, -0.05, 0.05]), 0.02 * np.eye(3))
    pair = currents(pin.Inertia.Zero(), 1), currents(carried, 2)
    found = identify_gains_from_payload(*pair, scara_robot(), mass=3.0)
    assert (np.abs(found.gain - gains) < 3 * found.std).all()
    assert (found.std < 0.1 * gains).all()
    unseen = [3, 4, 5, 7, 8, 9]
    assert np.flatnonzero(np.isnan(found.payload)).tolist() == unseen
    np.testing.assert_allclose(found.payload[1:3], [0.3, -0.15], atol=0.05)


def test_both_kinds_of_runs_are_needed() -> None:
    with pytest.raises(InputError, match="with and without"):
        identify_payload([], [], ROBOT)


def conic(free: Array, covariance: Array) -> Array:
    """The same problem by Clarabel, from its own formulation."""
    white = np.linalg.inv(np.linalg.cholesky(covariance))
    order = [(a, b) for b in range(4) for a in range(b + 1)]
    rows = np.array([[m[a, b] * (1 if a == b else np.sqrt(2)) for m in BASIS] for a, b in order])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix(np.triu(white.T @ white)),
        -white.T @ white @ free,
        sparse.csc_matrix(-rows),
        np.zeros(10),
        [clarabel.PSDTriangleConeT(4)],
        settings,
    )
    solution = solver.solve()
    assert str(solution.status) == "Solved"
    return np.array(solution.x)


@pytest.mark.parametrize("seed", range(8))
def test_the_nearest_body_is_the_conic_answer(seed: int) -> None:
    generator = np.random.default_rng(seed)
    root = generator.normal(size=(4, 4))
    truth = from_pseudo_inertia(root @ root.T)
    spread = generator.normal(size=(10, 10)) * 0.7
    covariance = spread @ spread.T + 0.5 * np.eye(10)
    free = truth + np.linalg.cholesky(covariance) @ generator.normal(size=10)
    found = nearest_body(free, covariance)
    assert np.linalg.eigvalsh(to_pseudo_inertia(found))[0] > -1e-9
    if is_physical(free, 0.0):
        np.testing.assert_array_equal(found, free)
        return
    # Optimal: the gradient as a functional of J is not negative, and zero along J.
    gradient = np.linalg.solve(covariance, found - free)
    pairing = np.array([[np.sum(a * b) for a in BASIS] for b in BASIS])
    functional = np.tensordot(np.linalg.solve(pairing, gradient), BASIS, axes=1)
    assert np.linalg.eigvalsh(functional)[0] > -KKT
    assert abs(np.sum(functional * to_pseudo_inertia(found))) < KKT
    expected = conic(free, covariance)
    np.testing.assert_allclose(found, expected, atol=SOLVERS_AGREE * np.abs(expected).max())


@pytest.mark.parametrize("seed", [5, 6])
def test_the_nearest_body_is_the_best_where_some_of_it_is_not_seen(seed: int) -> None:
    """As of an arm of parallel axes: deviations from 1e-3 to 1e2."""
    generator = np.random.default_rng(seed)
    root = generator.normal(size=(4, 4))
    truth = from_pseudo_inertia(root @ root.T)
    spread = 0.7 * np.logspace(-3, 2, 10)[:, None] * generator.normal(size=(10, 10))
    covariance = spread @ spread.T + 1e-6 * np.eye(10)
    free = truth + np.linalg.cholesky(covariance) @ generator.normal(size=10)
    assert not is_physical(free, 0.0)
    found = nearest_body(free, covariance)
    root = np.linalg.cholesky(covariance)
    gap, gain = (np.linalg.solve(root, x) for x in (found - free, found))
    # No multiple of the body is nearer, nor is any sum with another that can exist.
    assert abs(gap @ gain) < ORTHOGONAL * np.linalg.norm(gap) * np.linalg.norm(gain)
    others = generator.normal(size=(50, 4, 4))
    for other in from_pseudo_inertia(others @ others.swapaxes(1, 2)):
        assert gap @ np.linalg.solve(root, other) > -ORTHOGONAL * np.linalg.norm(gap)


@pytest.mark.parametrize("seed", range(10))
def test_the_nearest_body_to_next_to_nothing_on_a_scara_is_next_to_nothing(seed: int) -> None:
    """Of which parallel axes show m, mx, my and Jzz alone: the search has to stay exact."""
    generator = np.random.default_rng(seed)
    seen = [0, 1, 2, 6]
    std = np.full(10, 100.0)
    std[seen] = 0.01, 1e-3, 1e-3, 3e-4
    free = 1e-9 * generator.normal(size=10)
    free[0] = 0.003
    free[seen] += np.abs(std[seen] * generator.normal(size=4))
    free[6] *= -1
    found = nearest_body(free, np.diag(np.square(std)))
    assert np.linalg.eigvalsh(to_pseudo_inertia(found))[0] > -1e-9
    # Seen of a rod along the axis through the centre is its mass alone: that far at most.
    rod = np.linalg.norm(free[[1, 2, 6]] / std[[1, 2, 6]])
    assert np.linalg.norm((found - free)[seen] / std[seen]) < rod
    gap, gain = (found - free) / std, found / std
    assert abs(gap @ gain) < 1e-5 * np.linalg.norm(gap) * np.linalg.norm(gain)


def test_deviations_of_the_centre_are_those_of_draws() -> None:
    generator = np.random.default_rng(0)
    parameters = link_parameters(*body(2.0, (0.03, -0.02, 0.07)))
    root = generator.normal(size=(10, 10)) * 0.003
    payload = Payload(
        parameters=parameters,
        free=parameters,
        covariance=root @ root.T,
        noise=np.ones((2, 6)),
        samples=100,
    )
    draws = parameters + generator.normal(size=(20000, 10)) @ root.T
    np.testing.assert_allclose(
        payload.centre_std, (draws[:, 1:4] / draws[:, :1]).std(axis=0), rtol=0.05
    )
    np.testing.assert_allclose(payload.inertia, cylinder(2.0, 0.04, 0.1, 2), atol=1e-12)
