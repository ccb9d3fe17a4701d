"""What the flange carries weighs on torque, momentum and power; judged by pinocchio."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from dynid.constraints import prior_link, safe_constraints
from dynid.core import InputError
from dynid.robot import (
    Body,
    SafetyLimits,
    box_points,
    cylinder_points,
    joint_poses,
    load_robot,
    robot_from_chain,
    translation,
    with_tool,
)

MASS, COM = 4.0, np.array([0.02, -0.01, 0.08])
CLOSE = 1e-9


def pinocchio_arm() -> tuple[pin.Model, np.ndarray]:
    """The UR5's links as point masses would do for momentum; here masses and centres alone."""
    robot = load_robot("ur5")
    model, parent = pin.Model(), 0
    for k in range(robot.joints):
        joint = pin.JointModelRevoluteUnaligned(robot.axes[k])
        parent = model.addJoint(parent, joint, pin.SE3(robot.placements[k]), f"j{k}")
        mass, lever = float(robot.inertias[k, 0]), robot.inertias[k, 1:4]
        model.appendBodyToJoint(
            parent, pin.Inertia(mass, lever / mass, np.zeros((3, 3))), pin.SE3.Identity()
        )
    place = robot.flange[:3, :3] @ COM + robot.flange[:3, 3]
    return model, place


def test_momentum_is_pinocchios_with_the_payload_on() -> None:
    robot = load_robot("ur5")
    judge = safe_constraints(with_tool(robot, payload=[MASS, *COM]), collision=False)
    model, place = pinocchio_arm()
    model.appendBodyToJoint(6, pin.Inertia(MASS, place, np.zeros((3, 3))), pin.SE3.Identity())
    data = model.createData()
    random = np.random.default_rng(0)
    points, _ = judge.points["momentum"]
    q, dq = random.uniform(-3, 3, (2, 8, 6))
    theirs = [
        np.linalg.norm(np.asarray(pin.computeCentroidalMomentum(model, data, a, b).linear))
        for a, b in zip(q, dq, strict=True)
    ]
    np.testing.assert_allclose(points.norms(q, dq), theirs, rtol=CLOSE)


def test_torque_at_rest_grows_by_the_payloads_weight() -> None:
    robot = load_robot("ur5")
    q = np.random.default_rng(1).uniform(-3, 3, (6, 6))
    rest = np.zeros(q.shape)
    step = 1e-6
    height = []
    for sign in (1, -1):
        for k in range(6):
            moved = q.copy()
            moved[:, k] += sign * step
            poses = np.array([joint_poses(robot, one)[-1] @ robot.flange for one in moved])
            height.append(poses[:, 2, :3] @ COM + poses[:, 2, 3])
    weight = MASS * -robot.gravity[2]
    expected = weight * (np.array(height[:6]) - np.array(height[6:])).T / (2 * step)
    bare, loaded = (
        safe_constraints(with_tool(robot, payload=[mass, *COM]), collision=False)
        for mass in (0.0, MASS)
    )
    assert bare.torque is not None
    assert loaded.torque is not None
    # Taken at their worst both, so look at the models beneath.
    share = 1.15
    signed = []
    for judge in (bare.torque, loaded.torque):
        model = judge.prior.model
        signed.append(model.inverse_dynamics(q, rest, rest, judge.prior.parameters))
        worst = share * np.abs(signed[-1]) + judge.prior.coulomb
        np.testing.assert_allclose(judge.largest(q, rest, rest)[0], worst, rtol=CLOSE)
    np.testing.assert_allclose(signed[1] - signed[0], expected, atol=1e-6)


def test_no_mass_changes_nothing_and_unknown_arms_stay_unjudged() -> None:
    robot = load_robot("ur5")
    bare = replace(robot, inertias=np.full((6, 10), np.nan))
    judge = safe_constraints(with_tool(bare, payload=[MASS, *COM]), collision=False)
    assert judge.torque is None
    assert "momentum" not in judge.points
    assert {item.kind for item in judge.unjudged} == {"torque", "power", "momentum"}


@pytest.mark.parametrize("mass", [-1.0, np.nan, np.inf, 1e6])
def test_a_mass_that_cannot_be_is_refused(mass: float) -> None:
    with pytest.raises(InputError, match="payload's mass"):
        with_tool(load_robot("ur5"), payload=[mass, 0, 0, 0])


def test_an_unknown_tensor_is_that_of_the_links_own_solid() -> None:
    arm, edges = load_robot("ur5"), np.array([0.1, 0.2, 0.4])
    boxes = [
        Body(name=f"box {link}", link=link, points=box_points(size * edges / 2), radius=0.0)
        for link, size in ((1, 1.0), (2, 2.0))
    ]
    mass = 3.0
    row = [mass, 0.0, 0.0, 0.0, *[np.nan] * 6]
    robot = replace(arm, inertias=np.tile(row, (6, 1)), bodies=tuple(boxes))
    square = edges**2
    uniform = mass / 12 * (square.sum() - square)
    np.testing.assert_allclose(prior_link(robot, 0)[4:7], uniform, rtol=1e-6)
    np.testing.assert_allclose(prior_link(robot, 1)[4:7], 4 * uniform, rtol=1e-6)


def test_a_payload_above_the_rating_is_refused_and_an_unknown_rating_is_reported() -> None:
    # Held above the shoulder, 200 kg need hardly any torque.
    with pytest.raises(InputError, match=r"ur5.*rated.*200 kg.*5 kg"):
        safe_constraints(with_tool(load_robot("ur5"), payload=[200.0, 0, 0, 0]), collision=False)
    held = safe_constraints(with_tool(load_robot("ur10e"), payload=[12.5, 0, 0, 0]))
    assert not any("rated" in note for note in held.notes)
    bare = replace(load_robot("ur5"), safety=SafetyLimits())
    assert not any("rated" in note for note in safe_constraints(bare, collision=False).notes)
    loaded = safe_constraints(with_tool(bare, payload=[200.0, 0, 0, 0]), collision=False)
    assert any("no rated payload" in note for note in loaded.notes)


def test_a_payload_within_its_neighbour_is_left_out_and_not_kept_apart_by_rounding() -> None:
    turn = robot_from_chain(
        placements=[np.eye(4), translation(0, 0, -0.1)],
        axes=[[0, 0, -1], [0, 0, 1]],
        joint_types=["prismatic", "revolute"],
    )
    slide = Body(name="slide", link=1, points=cylinder_points(0.04, 0.05), radius=0.0)
    robot = with_tool(replace(turn, bodies=(slide,)), payload=[3, 0, 0, 0.1])
    judge = safe_constraints(robot, floor="none")
    assert judge.surroundings is None or "self_collision" not in judge.surroundings.pairs
