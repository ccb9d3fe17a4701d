import pickle
import sys
from dataclasses import replace

import numpy as np
import pytest
from chains_for_constraints import random_arm, random_states
from numba.core.dispatcher import Dispatcher

from dynid.constraints import ConstraintSettings, MotionConstraints, Scene, scene_from_json
from dynid.core import JsonFields
from dynid.robot import Counterbalance, RobotModel, load_robot
from dynid.trajectory import usable_bounds

GRADIENT_WITHIN = 1e-6
STEP = 1e-6

SCENE = scene_from_json(
    JsonFields(
        {
            "shapes": [
                {"type": "floor", "height": -0.5},
                {"type": "wall", "point": [0.5, 0.5, 0], "normal": [-1, -1, 0.2]},
                {"type": "box", "size": [0.3, 0.2, 0.4], "position": [0.3, -0.2, 0.3]},
                {
                    "type": "cylinder",
                    "radius": 0.1,
                    "length": 0.4,
                    "position": [-0.3, 0.2, 0.2],
                    "rpy": [0.4, 0.2, 0],
                },
                {"type": "sphere", "radius": 0.15, "position": [0.0, 0.4, 0.5]},
            ],
            "payload": [{"type": "box", "size": [0.1, 0.05, 0.2], "position": [0, 0, 0.1]}],
        }
    )
)


def everything(robot: RobotModel, scene: Scene | None = SCENE) -> MotionConstraints:
    settings = ConstraintSettings(
        bounds=usable_bounds(robot.limits, 10.0), scene=scene, self_clearance=0.01
    )
    return MotionConstraints(robot, settings)


CYLINDER = Counterbalance(
    joint=0,
    outer=0.6,
    inner=0.2,
    rest_length=0.4,
    offset=0.3,
    piston_area=1e-3,
    gas_work=100.0,
    gas_volume=2e-3,
)
ONLY = {
    "bounds": {},
    "torque": {"torque": True},
    "torque beside a cylinder": {"torque": True},
    "power": {"power": True},
    "tcp_speed": {"tcp_speed": True},
    "elbow_speed": {"elbow_speed": True},
    "momentum": {"momentum": True},
    "self_collision": {"self_collision": True},
    "environment": {"scene": SCENE},
}


def only(robot: RobotModel, kind: str) -> MotionConstraints:
    off = dict.fromkeys(
        ("torque", "power", "tcp_speed", "elbow_speed", "momentum", "self_collision"), False
    )
    settings = ConstraintSettings(bounds=usable_bounds(robot.limits, 10.0), **{**off, **ONLY[kind]})
    return MotionConstraints(robot, settings)


@pytest.mark.parametrize("kind", ONLY)
@pytest.mark.parametrize(("joints", "seed"), [(2, 0), (4, 1), (6, 2), (7, 3)])
def test_derivatives_equal_central_differences(kind: str, joints: int, seed: int) -> None:
    arm = random_arm(joints, seed)
    if kind == "torque beside a cylinder":
        arm = replace(arm, counterbalances=(CYLINDER,))
    judge = only(arm, kind)
    state = random_states(joints, 25, seed)
    if kind != "bounds":  # inside the bounds, or they would drown the rest
        state = tuple(part * 0.85 for part in state)
    total, *slopes = judge.violation(*state, tighten=0.05)
    if kind in ("self_collision",) and joints == 2:
        assert total >= 0
    else:
        assert total > 0
    random = np.random.default_rng(seed)
    ways = [random.standard_normal(state[0].shape) for _ in range(3)]
    for k in range(3):
        up, down = list(state), list(state)
        up[k], down[k] = state[k] + STEP * ways[k], state[k] - STEP * ways[k]
        numeric = (
            judge.violation(*up, tighten=0.05)[0] - judge.violation(*down, tighten=0.05)[0]
        ) / (2 * STEP)
        exact = float(np.vdot(slopes[k], ways[k]))
        scale = float(np.abs(slopes[k] * ways[k]).sum())
        assert abs(numeric - exact) <= GRADIENT_WITHIN * scale + 1e-9 * total


def test_a_cylinder_relieves_the_motor_that_it_helps() -> None:
    """Its torque was added to that of gravity, not taken off."""
    robot = replace(load_robot("ur5"), counterbalances=(replace(CYLINDER, joint=1),))
    q = random_states(6, 200, 0)[0]
    rest = np.zeros_like(q)
    without, beside = (only(arm, "torque").torque for arm in (load_robot("ur5"), robot))
    assert without is not None
    assert beside is not None
    gravity = without.prior.torque(q, rest, rest)
    left = gravity[:, 1] - robot.counterbalances[0].torque(q[:, 1])
    margin = without.largest(q, rest, rest)[0] - without.prior.coulomb
    margin = margin[:, 1] / np.abs(gravity[:, 1])
    largest = beside.largest(q, rest, rest)[0][:, 1] - beside.prior.coulomb[1]
    np.testing.assert_allclose(largest, margin * np.abs(left), rtol=1e-9)


def test_violation_is_zero_exactly_where_usage_is_feasible() -> None:
    robot = load_robot("ur5")
    judge = everything(robot, None)
    home = np.array([0.0, -1.2, 0.9, 0.0, -1.57, 0.0])
    seen = set()
    for seed in range(60):
        size = (0.02, 0.3, 1.0)[seed % 3]
        q, dq, ddq = (size * part for part in random_states(6, 1, seed))
        holds = judge.holds(home + q, dq, ddq)
        assert (judge.violation(home + q, dq, ddq)[0] == 0) == holds
        seen.add(holds)
    assert seen == {True, False}


@pytest.mark.parametrize("rows", [1, 40])
def test_known_distances_spare_work_and_change_nothing(rows: int) -> None:
    judge = everything(random_arm(5, 4))
    around = judge.surroundings
    assert around is not None
    q = 0.4 * random_states(5, 40, 2)[0]
    pairs, wide = around.all_pairs, np.full(len(around.all_pairs), 0.02)
    known = around.bodies.proximity(pairs, rows, np.full(5, np.pi))
    random, looked = np.random.default_rng(0), []
    for _ in range(12):
        q = q + 0.01 * random.standard_normal(q.shape)
        before = known.axes.copy()
        found = around.bodies.violation(q, pairs, wide, known=known)
        fresh = around.bodies.violation(q, pairs, wide)
        assert found[0] == pytest.approx(fresh[0], rel=1e-9)
        np.testing.assert_allclose(found[1], fresh[1], atol=1e-6 * np.abs(fresh[1]).max())
        looked.append(float((known.axes != before).any(axis=2).mean()))
    assert found[0] > 0
    if rows > 1:
        assert max(looked[1:]) < 0.7 * looked[0]
    capped = around.bodies.violation(q, pairs, wide, most=found[0] / 4)[0]
    assert found[0] / 4 < capped < found[0]


def _compiled() -> dict[str, int]:
    """How often Numba has compiled each kernel of dynid."""
    own = [module for name, module in sys.modules.items() if name.startswith("dynid.")]
    things = {name: thing for module in own for name, thing in vars(module).items()}
    return {name: len(k.signatures) for name, k in things.items() if isinstance(k, Dispatcher)}


def test_what_workers_judge_with_needs_no_second_compilation() -> None:
    robot = load_robot("ur5")
    judge, state = everything(robot), random_states(robot.joints, 20, 5)
    there = pickle.loads(pickle.dumps(judge))
    total, *_ = judge.violation(*state)
    before = _compiled()
    assert before["_violation"]
    assert there.violation(*state)[0] == total
    assert _compiled() == before


def test_tightening_shrinks_every_limit() -> None:
    robot = load_robot("ur5")
    judge = only(robot, "bounds")
    at = np.zeros((1, 6))
    speed = np.full((1, 6), 0.97 * np.pi)
    assert judge.violation(at, speed, at)[0] == 0
    assert judge.violation(at, speed, at, tighten=0.05)[0] > 0


def test_a_range_that_is_not_about_zero_ends_where_it_says() -> None:
    bounds = usable_bounds(load_robot("ur5").limits, 10.0)
    lower, upper = np.array([0.2, -3, -1, 1, -2, 0.5]), np.array([2.0, -1, 0, 3, 0, 0.6])
    settings = ConstraintSettings(
        bounds=replace(bounds, lower=lower, upper=upper), torque=False, self_collision=False
    )
    judge, rest = MotionConstraints(load_robot("ur5"), settings), np.zeros((1, 6))
    for q in (lower + 0.01, upper - 0.01):
        assert judge.holds(q[None], rest, rest)
        assert judge.violation(q[None], rest, rest)[0] == 0
    for j, (end, by) in enumerate([(lower, -0.01), (upper, 0.01)] * 3):
        q = (lower + upper) / 2
        q[j] = end[j] + by
        assert not judge.holds(q[None], rest, rest)
        assert judge.violation(q[None], rest, rest)[0] > 0


def test_caution_asks_for_more_room_than_the_limit() -> None:
    judge = only(load_robot("ur5"), "environment")
    q, rest = 0.3 * random_states(6, 60, 3)[0], np.zeros((60, 6))
    less, more = (judge.violation(q, rest, rest, caution=by)[0] for by in (0.0, 0.02))
    assert 0 < less < more
    assert judge.violation(q, rest, rest, caution=-0.02)[0] < less


def test_the_guess_of_friction_has_the_units_of_the_joints() -> None:
    said = "8% per {} and 1% per {} of the torque limits"
    for slides, units in (
        (False, ("rad/s", "rad/s^2")),
        (True, ("rad/s or m/s", "rad/s^2 or m/s^2")),
    ):
        robot = random_arm(3, 0, slides=slides)
        settings = ConstraintSettings(bounds=usable_bounds(robot.limits), self_clearance=0.01)
        assert said.format(*units) in "; ".join(MotionConstraints(robot, settings).notes)


def test_what_is_unknown_does_not_bind_and_is_null() -> None:
    robot = random_arm(3, 0)
    bare = replace(
        robot,
        bodies=(),
        safety=type(robot.safety)(),
        limits=replace(
            robot.limits,
            lower=np.array([-2.0, np.nan, -2.0]),
            velocity=np.array([np.nan, 2.0, np.nan]),
            acceleration=np.full(3, np.nan),
        ),
        inertias=np.full((3, 10), np.nan),
    )
    settings = ConstraintSettings(bounds=usable_bounds(bare.limits), self_clearance=0.01)
    judge = MotionConstraints(bare, settings)
    worst = judge.usage(*random_states(3, 5, 0))
    assert {kind for kind, item in worst.items() if np.isnan(item.margin)} == {
        "acceleration",
        "torque",
        "tcp_speed",
        "elbow_speed",
        "momentum",
        "power",
        "self_collision",
        "environment",
    }
    kinds = {item.kind for item in judge.unjudged}
    # A joint that turns may be guessed to turn once; this one slides.
    assert kinds == {"position", "velocity", "acceleration", "torque", "self_collision"}
    text = "; ".join(judge.notes)
    assert "no position limits are known of joint_2: taken as -3.142 to 2" in text
    said = {item.kind: item.message for item in judge.unjudged}
    assert said["position"] == "no position limit is known of joint_2"
    assert said["velocity"] == "no velocity limit is known of joint_1, joint_3"
    assert said["acceleration"] == "no acceleration limit is known of any joint"
