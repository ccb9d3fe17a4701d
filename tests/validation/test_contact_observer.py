from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dynid
from dynid.core import Array, InputError
from dynid.identification import Estimate
from dynid.simulation import SimulatedPlant, simulated_arm
from dynid.validation import ContactThresholds, MomentumObserver, contact_thresholds

pytestmark = pytest.mark.usefixtures("undiagnosed")

RATE = 125.0
CONTACT = 15.0
WITHIN_S = 0.05
SETTLED = 20
"""Cycles after which the observer has forgotten its start."""
FIRST = 500
"""Cycle at which the contact begins."""


@pytest.fixture(scope="module")
def estimate() -> Estimate:
    robot = dynid.load_robot("ur5")
    motion = dynid.random_excitation(robot.limits, seed=1)
    record = dynid.simulate_recording(robot, motion, seed=1, periods=2, thermal="warm")
    return dynid.identify([record], robot, dynid.IdentifySettings(preset="paper")).estimate


def touched(seed: int, joint: int | None, cycles: int = 750) -> tuple[Array, Array, Array, Array]:
    """The simulated arm in motion, from `FIRST` on with a torque on one joint."""
    robot = dynid.load_robot("ur5")
    arm = simulated_arm(robot)
    plant = SimulatedPlant(arm, rate_hz=RATE, thermal="warm")
    motion = dynid.random_excitation(robot.limits, seed=seed).evaluate(np.arange(cycles) / RATE)
    plant.reset(motion.q[0])
    states = []
    for k, setpoint in enumerate(motion.q):
        if joint is not None and k == FIRST:
            plant._joint[1, joint] = CONTACT
        states.append(plant.tick(setpoint))
    random = np.random.default_rng(seed)
    q, dq, torque = (np.array([getattr(s, name) for s in states]) for name in ("q", "dq", "torque"))
    dq = arm.truth.sensors.read("velocity", dq, random)
    current = arm.truth.sensors.read("current", torque / arm.truth.gain, random)
    return motion.t, q, dq, current * arm.truth.gain


@pytest.fixture(scope="module", params=[6, pytest.param(12, marks=pytest.mark.long)])
def thresholds(request: pytest.FixtureRequest, estimate: Estimate) -> ContactThresholds:
    observer = MomentumObserver(estimate=estimate)
    free = [touched(seed, None, 1250) for seed in range(100, 100 + request.param)]
    return contact_thresholds(
        [observer.residuals(*run)[SETTLED:] for run in free],
        [run[2][SETTLED:] for run in free],
        noise=estimate.noise,
    )


@pytest.mark.parametrize("joint", [0, 1, 2, 3, 5])
def test_a_contact_is_found_in_time_and_nothing_before(
    estimate: Estimate, thresholds: ContactThresholds, joint: int
) -> None:
    t, q, dq, torque = touched(20 + joint, joint, cycles=600)
    residual = MomentumObserver(estimate=estimate).residuals(t, q, dq, torque)
    alarm = thresholds.contacts(residual, dq)
    assert not alarm[SETTLED:FIRST].any()
    found = np.flatnonzero(alarm[FIRST:].any(axis=1))
    assert len(found)
    assert (found[0] + 1) / RATE <= WITHIN_S


@pytest.mark.long
@pytest.mark.parametrize("thresholds", [12], indirect=True)
def test_ten_minutes_of_free_motion_raise_no_alarm(
    estimate: Estimate, thresholds: ContactThresholds
) -> None:
    observer = MomentumObserver(estimate=estimate)
    for seed in range(20_000, 20_060):
        t, q, dq, torque = touched(seed, None, 1250)
        alarm = thresholds.contacts(observer.residuals(t, q, dq, torque), dq)
        assert not alarm[SETTLED:].any(), seed


def test_the_residual_is_the_external_torque(estimate: Estimate) -> None:
    t, q, dq, torque = touched(5, 1)
    residual = MomentumObserver(estimate=estimate).residuals(t, q, dq, torque)
    after = residual[FIRST + 50 :, 1].mean() - residual[FIRST - 200 : FIRST, 1].mean()
    assert after == pytest.approx(CONTACT, abs=3.0)


def test_velocities_that_were_not_recorded_are_differences(estimate: Estimate) -> None:
    t, q, dq, torque = touched(3, None, cycles=100)
    observer, signals = MomentumObserver(estimate=estimate), {"q": q, "effort": torque}
    residual, found = observer.of_record(dynid.ExperimentRecord(t=t, signals=signals))
    np.testing.assert_allclose(found[1:-1], (q[2:] - q[:-2]) * RATE / 2, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(residual, observer.residuals(t, q, found, torque))
    _, own = observer.of_record(dynid.ExperimentRecord(t=t, signals={**signals, "qd": dq}))
    np.testing.assert_array_equal(own, dq)


@given(st.integers(0, 1000))
@settings(max_examples=10)
def test_momentum_is_pinocchios(estimate: Estimate, seed: int) -> None:
    """p = M dq and C' dq, by pinocchio's Coriolis matrix of the same links."""
    model, robot = estimate.model, estimate.model.robot
    frames = robot.parameter_frames[model.frames]
    known = pin.Model()
    parent, matrices = 0, []
    for k in range(6):
        joint = pin.JointModelRevoluteUnaligned(robot.axes[k])
        parent = known.addJoint(parent, joint, pin.SE3(robot.placements[k]), f"j{k}")
        matrices.append((parent, pin.SE3(frames[k])))
    random = np.random.default_rng(seed)
    q, dq = random.uniform(-3, 3, (2, 1, 6))
    # Bodies of random mass, in an estimate of their own.
    bodies = [
        pin.Inertia(
            random.uniform(0.5, 5),
            random.uniform(-0.2, 0.2, 3),
            np.diag(random.uniform(0.1, 0.2, 3)),
        )
        for _ in range(6)
    ]
    standard = np.zeros(len(model.columns))
    for k, (body, (where, frame)) in enumerate(zip(bodies, matrices, strict=True)):
        known.appendBodyToJoint(where, body, frame)
        ten = body.toDynamicParameters()
        standard[10 * k : 10 * k + 10] = ten[[0, 1, 2, 3, 4, 6, 9, 8, 7, 5]]
    base = dynid.reduce_model(model)
    own, slope = MomentumObserver(
        estimate=replace(
            estimate,
            values=base.from_standard(standard),
            independent=base.independent,
            expressions=base.expressions,
            covariance=np.eye(base.rank),
            naive_std=np.ones(base.rank),
            essential=(),
            standard=None,
        )
    ).momentum(q, dq)
    data = known.createData()
    mass = pin.crba(known, data, q[0])
    mass = np.triu(mass) + np.triu(mass, 1).T
    coriolis = pin.computeCoriolisMatrix(known, data, q[0], dq[0])
    np.testing.assert_allclose(own[0], mass @ dq[0], rtol=0, atol=1e-10)
    np.testing.assert_allclose(slope[0], coriolis.T @ dq[0], rtol=0, atol=1e-10)


def test_thresholds_learn_from_each_speed_apart() -> None:
    random = np.random.default_rng(0)
    residual = random.normal(size=(4000, 2))
    speed = np.ones((4000, 2))
    speed[:2000, 0] = 0.0
    residual[:2000, 0] *= 10.0
    found = contact_thresholds([residual], [speed], quantile=0.99, margin=2.0)
    assert found.samples == 4000
    slow, fast = (2 * np.quantile(np.abs(part[:, 0]), 0.99) for part in np.split(residual, 2))
    assert found.limits[0, 0] == pytest.approx(slow, rel=0.01)
    assert found.limits[-1, 0] == pytest.approx(fast, rel=0.01)
    assert (np.diff(found.limits, axis=0) <= 0).all()
    floor = contact_thresholds([residual], [speed], noise=[30.0, 0.1], quantile=0.99, margin=2.0)
    assert floor.limits[-1, 0] == 90.0
    np.testing.assert_array_equal(floor.limits[:, 1], found.limits[:, 1])
    # Joint 2 never stood: its thresholds are those of all its samples.
    assert len(set(found.limits[:, 1])) == 1
    seen = found.contacts(np.array([[15.0, 0.0], [15.0, 15.0]]), np.array([[0.0, 1], [-0.6, 1]]))
    # Joint 1 has rested a moment ago: the residual may still hold what stiction did.
    np.testing.assert_array_equal(seen, [[False, False], [False, True]])
    assert found.contacts(np.array([[15.0, 0.0]]), np.array([[-0.6, 1.0]]))[0, 0]


@pytest.mark.parametrize(("rate_hz", "bandwidth"), [(125.0, 50.0), (1000.0, 50.0), (500.0, 20.0)])
def test_friction_of_a_reversal_raises_no_threshold_of_fast_joints(
    rate_hz: float, bandwidth: float
) -> None:
    """At 500 Hz those of a UR5 were four times those at 125 Hz."""
    since = np.arange(4 * rate_hz)[:, None] % (rate_hz // 2) / rate_hz
    speed, residual = np.array([1.0 * (since > 0), np.exp(-bandwidth * since)], dtype=np.float64)
    found = contact_thresholds([residual], [speed], rate_hz=rate_hz, bandwidth=bandwidth)
    assert found.limits[0, 0] > 1.8
    assert found.limits[-1, 0] < 2 * np.exp(-2.5)
    assert not found.contacts(residual, speed).any()


def test_stored_thresholds_are_those_that_were_learned() -> None:
    free = contact_thresholds([np.ones((200, 6))], [np.ones((200, 6))])
    limits = np.array(free.limits)
    speeds: Any = free.speeds.tolist()
    again = ContactThresholds(speeds=speeds, limits=limits, samples=200)
    limits[:] = np.inf
    assert again == free
    assert again.contacts([[3.0] * 6], [[1.0] * 6]).all()
    with pytest.raises(InputError, match="limits has the wrong shape"):
        ContactThresholds(speeds=free.speeds[1:], limits=free.limits, samples=200)


def test_refuses_nonsense(estimate: Estimate) -> None:
    for bandwidth in (0.0, -1.0, float("nan")):
        with pytest.raises(InputError, match="bandwidth"):
            MomentumObserver(estimate=estimate, bandwidth=bandwidth)
    observer, zero = MomentumObserver(estimate=estimate), np.zeros((3, 6))
    with pytest.raises(InputError, match="increase"):
        observer.residuals([0.0, 0.1, 0.1], zero, zero, zero)
    with pytest.raises(InputError, match="wrong shape"):
        observer.residuals([0.0, 0.1, 0.2], zero, zero, zero[:2])
    with pytest.raises(InputError, match="not finite"):
        observer.residuals([0.0, 0.1, 0.2], zero, zero, np.full((3, 6), np.nan))
    with pytest.raises(InputError, match="samples of free motion"):
        contact_thresholds([zero], [zero])
    with pytest.raises(InputError, match="quantile"):
        contact_thresholds([zero], [zero], quantile=1.0)
    with pytest.raises(InputError, match="rate"):
        contact_thresholds([zero], [zero], rate_hz=0.0)
    free = contact_thresholds([np.ones((200, 6))], [np.ones((200, 6))])
    assert free.contacts([[3.0] * 6], [[1.0] * 6]).all()
    for wrong in ([1.0] * 6, np.zeros((2, 6))):
        with pytest.raises(InputError, match="dq has the wrong shape"):
            free.contacts(np.zeros((1, 6)), wrong)
    assert free.contacts(np.zeros((0, 6)), np.zeros((0, 6))).shape == (0, 6)
    for noise in ([1.0, 2.0], np.ones((3, 6))):
        with pytest.raises(InputError, match="noise has the wrong shape"):
            contact_thresholds([np.ones((200, 6))], [np.ones((200, 6))], noise=noise)
    # A threshold that is no number would never be crossed.
    gone = np.full((40, 6), np.nan)
    for residuals, velocities, message in (
        ([gone], [np.zeros((40, 6))], "residuals is not finite"),
        ([], [], "of the same samples"),
        ([np.zeros((90, 6)), np.zeros((90, 5))],) * 2 + ("same samples and joints",),
        ([np.zeros((40, 6))], [np.zeros((40, 5))], "of the same samples"),
        ([None], [None], "residuals"),
    ):
        with pytest.raises(InputError, match=message):
            contact_thresholds(residuals, velocities)
