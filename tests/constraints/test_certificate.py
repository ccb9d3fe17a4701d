"""The certificate against motions looked at far more finely than it looks itself."""

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
import pytest
from chains_for_constraints import random_arm
from numpy.typing import ArrayLike

from dynid.constraints import (
    RATIOS,
    ConstraintSettings,
    MotionConstraints,
    certify,
    paper_constraints,
    safe_constraints,
    scene_from_json,
)
from dynid.core import InputError, JsonFields, MotionBounds
from dynid.robot import (
    Body,
    JointLimits,
    RobotModel,
    from_body,
    load_robot,
    robot_from_chain,
)
from dynid.trajectory import (
    FourierSeries,
    JointMotion,
    MotionSequence,
    PointToPoint,
    Quintic,
    Trajectory,
    random_excitation,
    usable_bounds,
)

FINE_HZ = 5000
FLOOR = scene_from_json(JsonFields({"shapes": [{"type": "floor", "height": -1.2}]}))
PROVEN = {
    "position",
    "velocity",
    "acceleration",
    "tcp_speed",
    "elbow_speed",
    "momentum",
    "self_collision",
    "environment",
}


def small(robot: RobotModel, seed: int, share: float, period: float = 4.0) -> FourierSeries:
    return random_excitation(
        robot.limits, seed=seed, margin=share, period_s=period, offset=np.zeros(robot.joints)
    )


def judge_of(robot: RobotModel) -> MotionConstraints:
    bounds = usable_bounds(robot.limits)
    return MotionConstraints(robot, ConstraintSettings(bounds=bounds, scene=FLOOR))


@pytest.mark.parametrize(("joints", "slides", "seed"), [(2, False, 0), (4, True, 1), (7, True, 2)])
def test_margins_are_never_above_and_hardly_below_the_truth(
    joints: int, slides: bool, seed: int
) -> None:
    robot = random_arm(joints, seed, slides=slides)
    judge = judge_of(robot)
    series = small(robot, seed, 0.3)
    certificate = certify(series, judge)
    motion = series.sample(FINE_HZ)
    truth = judge.usage(motion.q, motion.dq, motion.ddq)
    assert set(certificate.proven) <= PROVEN
    assert {"position", "tcp_speed", "momentum"} <= set(certificate.proven)
    for kind, item in truth.items():
        ours = certificate.worst[kind].margin
        assert np.isnan(ours) == np.isnan(item.margin)
        if not np.isnan(ours):
            # Of a broken limit nothing is proven but that it is broken.
            assert ours <= item.margin + (1e-12 if item.room >= 0 else 1e-5), kind
            loose = 0.005 + 0.11 * abs(item.margin)
            assert ours >= item.margin - loose, kind


def test_a_torque_that_grows_up_to_a_jump_of_the_acceleration_is_all_of_it() -> None:
    # That of a slide is a straight line while it accelerates.
    frame, one = np.eye(4)[None], np.ones(1)
    slide = replace(
        robot_from_chain(placements=frame, axes=np.eye(3)[:1], joint_types=["prismatic"]),
        inertias=from_body(2.0, np.zeros(3), 0.01 * np.eye(3))[None],
        limits=JointLimits(
            lower=-2 * one, upper=2 * one, velocity=2 * one, acceleration=5 * one, torque=40 * one
        ),
    )
    judge = safe_constraints(slide, collision=False)
    leg = PointToPoint(start=np.zeros(1), goal=np.ones(1), travel_time=1.5)
    at = leg.evaluate(np.array([1 / 3 - 2e-9]) * leg.duration)
    truth = judge.usage(at.q, at.dq, at.ddq)["torque"].margin
    assert certify(leg, judge).worst["torque"].margin <= truth


def test_torque_and_power_beside_jumps_of_the_acceleration_are_those_of_the_motion() -> None:
    # An allowance for the jump itself made every motion through points at the limit infeasible.
    judge = safe_constraints(load_robot("ur5"), collision=False)
    q = np.array([0.3, -1.2, 1.5, -0.5, 1.0, 0.2])
    legs = [
        PointToPoint(start=q, goal=q + 0.6, travel_time=0.8),
        PointToPoint(start=q + 0.6, goal=q - 0.3, travel_time=0.9),
    ]
    found = certify(MotionSequence(parts=tuple(legs)), judge)
    # Of each leg on its own, away from its ends, where the arm counts as resting.
    jumps = np.add.outer([1 / 3, 2 / 3], [-2e-9, 2e-9]).ravel()
    shares = np.sort(np.concatenate([np.linspace(2e-9, 1 - 2e-9, 9 * FINE_HZ), jumps]))
    seen = [leg.evaluate(shares * leg.duration) for leg in legs]
    for kind in ("torque", "power"):
        truth = min(judge.usage(m.q, m.dq, m.ddq)[kind].margin for m in seen)
        assert truth - 2e-3 <= found.worst[kind].margin <= truth, kind


def test_speed_and_momentum_are_those_of_pinocchio() -> None:
    robot = random_arm(5, 3)
    judge = judge_of(robot)
    model = pin.Model()
    parent = 0
    for k in range(5):
        kind = (
            pin.JointModelPrismaticUnaligned
            if robot.prismatic[k]
            else (pin.JointModelRevoluteUnaligned)
        )
        parent = model.addJoint(parent, kind(robot.axes[k]), pin.SE3(robot.placements[k]), f"j{k}")
        mass = float(robot.inertias[k, 0])
        body = pin.Inertia(mass, robot.inertias[k, 1:4] / mass, np.eye(3))
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    data = model.createData()
    tool = model.addFrame(pin.Frame("tool", 5, 0, pin.SE3(robot.flange), pin.FrameType.OP_FRAME))
    data = model.createData()
    for q, dq in np.random.default_rng(0).uniform(-2, 2, (10, 2, 5)):
        pin.forwardKinematics(model, data, q, dq)
        speed = pin.getFrameVelocity(model, data, tool, pin.LOCAL_WORLD_ALIGNED).linear
        momentum = pin.computeCentroidalMomentum(model, data, q, dq).linear
        for kind, theirs in (("tcp_speed", speed), ("momentum", momentum)):
            points, _ = judge.points[kind]
            ours = points.norms(q[None], dq[None])[0]
            assert ours == pytest.approx(np.linalg.norm(theirs), rel=1e-12)


def test_torque_and_power_of_the_prior_are_those_of_pinocchio() -> None:
    robot = random_arm(4, 4, slides=False)
    judge = judge_of(robot).torque
    assert judge is not None
    model = pin.Model()
    parent = 0
    for k in range(4):
        joint = pin.JointModelRevoluteUnaligned(robot.axes[k])
        parent = model.addJoint(parent, joint, pin.SE3(robot.placements[k]), f"j{k}")
        six = robot.inertias[k]
        mass = float(six[0])
        com = six[1:4] / mass
        about = np.array(
            [[six[4], six[9], six[8]], [six[9], six[5], six[7]], [six[8], six[7], six[6]]]
        ) - mass * (com @ com * np.eye(3) - np.outer(com, com))
        model.appendBodyToJoint(parent, pin.Inertia(mass, com, about), pin.SE3.Identity())
    model.gravity.linear = np.array(robot.gravity)
    data = model.createData()
    limit = robot.limits.torque
    for q, dq, ddq in np.random.default_rng(0).uniform(-2, 2, (10, 3, 4)):
        rigid = pin.rnea(model, data, q, dq, ddq)
        prior = rigid + limit * (0.08 * dq + 0.01 * ddq)
        worst = 1.15 * np.abs(prior) + 0.06 * limit
        torque, power = judge.largest(q[None], dq[None], ddq[None])
        np.testing.assert_allclose(torque[0], worst, rtol=1e-9)
        assert power[0] == pytest.approx(float(worst @ np.abs(dq)), rel=1e-9)


@dataclass(frozen=True, slots=True)
class Spike(Trajectory):
    """A joint that swings out and back within a few milliseconds, between coarse samples."""

    at: float
    width: float
    height: float

    @property
    def duration(self) -> float:
        return 2.0

    @property
    def joints(self) -> int:
        return 2

    def evaluate(self, t: ArrayLike) -> JointMotion:
        times = np.asarray(t, dtype=np.float64)
        x = (times - self.at) / self.width
        bump = np.where(np.abs(x) < 1, (1 - x**2) ** 4, 0.0)
        slope = np.where(np.abs(x) < 1, -8 * x * (1 - x**2) ** 3, 0.0) / self.width
        bend = np.where(np.abs(x) < 1, -8 * (1 - x**2) ** 2 * (1 - 7 * x**2), 0.0) / self.width**2
        q, dq, ddq = (np.outer(part, [self.height, 0.0]) for part in (bump, slope, bend))
        return JointMotion(t=times, q=q, dq=dq, ddq=ddq)


def test_a_short_collision_between_samples_is_found() -> None:
    robot = random_arm(2, 0, slides=False)
    arm = replace(
        robot,
        placements=np.array([np.eye(4), np.eye(4)]),
        axes=np.array([[0.0, 0, 1], [0.0, 0, 1]]),
        bodies=(
            Body(name="post", link=0, points=[[0.0, 0.5, 0], [0.0, 0.6, 0]], radius=0.05),
            Body(name="tip", link=2, points=[[0.4, 0.0, 0], [0.5, 0.0, 0]], radius=0.05),
        ),
    )
    wide = MotionBounds(
        lower=np.full(2, -9.0), upper=np.full(2, 9.0), velocity=np.full(2, 1e4),
        acceleration=np.full(2, 1e9),
    )  # fmt: skip
    off = dict.fromkeys(("torque", "power", "tcp_speed", "elbow_speed", "momentum"), False)
    judge = MotionConstraints(arm, ConstraintSettings(bounds=wide, **off))
    assert certify(Spike(1.0003, 0.02, 1.0), judge).holds
    hit = certify(Spike(1.0003, 0.02, 1.5), judge)
    assert hit.broken == ("self_collision",)
    assert hit.worst["self_collision"].t == pytest.approx(1.0003, abs=0.01)


@pytest.mark.parametrize("kind", ["velocity", "acceleration", "position", "torque", "tcp_speed"])
def test_one_broken_limit_is_named(kind: str) -> None:
    robot = replace(load_robot("ur5"), bodies=())
    home = np.array([0.0, -1.2, 0.9, -1.2, -1.5, 0.0])
    series = random_excitation(robot.limits, seed=2, margin=0.3, offset=home)
    judge = safe_constraints(robot, margin=0.0)
    before = certify(series, judge)
    assert before.holds
    assert before.broken == ()
    safety, limits = robot.safety, robot.limits
    shrink = (1 - before.worst[kind].margin) * 0.995
    if kind == "tcp_speed":
        slower = 0.9999 * before.worst[kind].value
        changed = replace(robot, safety=replace(safety, tcp_speed=slower))
    elif kind == "position":
        changed = replace(
            robot,
            limits=replace(limits, lower=limits.lower * shrink, upper=limits.upper * shrink),
        )
    else:
        changed = replace(robot, limits=replace(limits, **{kind: getattr(limits, kind) * shrink}))
    after = certify(series, safe_constraints(changed, margin=0.0))
    if kind == "torque":  # the anchors of friction shrink with the limits
        assert after.worst[kind].margin < before.worst[kind].margin
    else:
        assert after.broken == (kind,)
        assert not after.feasible
        assert after.to_json()["margins"][kind] < 0


def test_an_infinite_torque_limit_is_unknown_and_tells_nothing_of_friction() -> None:
    robot = random_arm(3, 5, slides=False)
    robot = replace(robot, bodies=(), safety=replace(robot.safety, power=500.0))
    certificates = []
    for limit in (np.inf, np.nan):
        limits = replace(robot.limits, torque=[50.0, limit, 50.0])
        judge = safe_constraints(replace(robot, limits=limits), collision=False)
        certificates.append(certify(small(robot, 1, 0.1), judge))
    assert certificates[0].margins == certificates[1].margins
    assert certificates[0].unjudged == certificates[1].unjudged
    assert [item.kind for item in certificates[0].unjudged] == ["torque"]


@pytest.mark.parametrize("free", [0.0, 0.25])
def test_limits_and_values_are_those_of_the_robot_whatever_is_kept_free(free: float) -> None:
    robot = random_arm(4, 5)
    judge = safe_constraints(robot, collision=False, margin=free)
    q, dq, ddq = (0.3 * np.random.default_rng(0).standard_normal((20, 4)) for _ in range(3))
    worst = judge.usage(q, dq, ddq, t=0.1 * np.arange(20))
    names, limits, safety = list(robot.joint_names), robot.limits, robot.safety
    for kind, values in (("velocity", dq), ("acceleration", ddq)):
        item = worst[kind]
        j, k = names.index(item.what), round(10 * item.t)
        assert item.limit == pytest.approx(getattr(limits, kind)[j], rel=1e-12)
        assert item.value == values[k, j]
    assert worst["torque"].limit == pytest.approx(
        limits.torque[names.index(worst["torque"].what)], rel=1e-12
    )
    for kind in ("tcp_speed", "elbow_speed", "momentum", "power"):
        assert worst[kind].limit == pytest.approx(getattr(safety, kind), rel=1e-12)
    for kind in RATIOS:
        item = worst[kind]
        assert item.required == (0.0 if kind in ("position", "acceleration") else free)
        if kind != "position":
            assert item.margin == pytest.approx(1 - abs(item.value) / item.limit, abs=1e-12)


def test_a_motion_exactly_on_its_limits_passes() -> None:
    robot = load_robot("ur5")
    for seed in range(5):
        certificate = certify(
            random_excitation(robot.limits, seed=seed, margin=1.0), paper_constraints(robot)
        )
        assert certificate.feasible
        assert min(certificate.margins[k] or 0 for k in ("position", "velocity")) < 0.02


def test_transfers_are_judged_too() -> None:
    robot = load_robot("ur5")
    home = np.array([0.0, -1.2, 0.9, -1.2, -1.5, 0.0])
    slow = Quintic(start=home, goal=home + 0.3, travel_time=4.0)
    fast = Quintic(start=home, goal=home + 0.3, travel_time=0.15)
    judge = paper_constraints(robot)
    certificate = certify(slow, judge)
    assert certificate.feasible
    assert certificate.proven == ("position", "velocity", "acceleration")
    assert set(certify(fast, judge).broken) == {"velocity", "acceleration"}


def test_json_has_the_keys_of_dynid_check() -> None:
    robot = load_robot("ur5")
    document = certify(random_excitation(robot.limits, seed=0), safe_constraints(robot)).to_json()
    assert isinstance(document["feasible"], bool)
    for key in ("position", "velocity", "acceleration", "torque", "tcp_speed", "self_collision_m"):
        assert isinstance(document["margins"][key], float)
    assert isinstance(document["margins"]["environment_m"], float)
    assert document["worst"]["velocity"].keys() == {"t", "joint", "value", "limit", "required"}
    assert document["worst"]["velocity"]["required"] == 0.05
    assert document["worst"]["self_collision"].keys() == {
        "t", "bodies", "value", "limit", "required",
    }  # fmt: skip


def test_a_motion_of_another_robot_is_refused() -> None:
    series = random_excitation(random_arm(3, 0).limits, seed=0)
    with pytest.raises(InputError, match="joints of the motion"):
        certify(series, paper_constraints(load_robot("ur5")))
