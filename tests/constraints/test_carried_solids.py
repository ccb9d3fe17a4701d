"""What the flange carries, against coal and against points drawn in it."""

from dataclasses import replace

import coal
import numpy as np
import pytest
from chains_for_constraints import CYLINDER_WITHIN, coal_distance, hull_in_coal, random_arm

from dynid.constraints import (
    CollisionBodies,
    ConstraintSettings,
    JudgedPairs,
    MotionConstraints,
    body_of,
    certify,
    safe_constraints,
    scene_from_json,
)
from dynid.core import JsonFields
from dynid.robot import joint_poses, load_robot
from dynid.trajectory import FourierSeries, usable_bounds

WITHIN = 2e-6
"""coal walks to the nearest point of a box or cylinder in steps."""
GRADIENT_WITHIN = 1e-6
STEP = 1e-6
CARRIED = {
    "box": ({"size": [0.3, 0.2, 0.12], "rpy": [0.3, 1, 2]}, coal.Box(0.3, 0.2, 0.12)),
    "plate": ({"type": "box", "size": [0.5, 0.4, 0.01]}, coal.Box(0.5, 0.4, 0.01)),
    "cylinder": (
        {"radius": 0.12, "length": 0.3, "rpy": [1, -0.4, 0]},
        coal.Cylinder(0.12, 0.3),
    ),
    "disc": ({"type": "cylinder", "radius": 0.2, "length": 0.02}, coal.Cylinder(0.2, 0.02)),
    "sphere": ({"radius": 0.1}, coal.Sphere(0.1)),
}


def judge_with(kind: str, joints: int = 5, seed: int = 3, **settings: object) -> MotionConstraints:
    shape = {"type": kind, "position": [0.05, -0.02, 0.15], **CARRIED[kind][0]}
    robot = random_arm(joints, seed, slides=False)
    scene = scene_from_json(JsonFields({"payload": [shape]}))
    off = dict.fromkeys(("torque", "power", "tcp_speed", "elbow_speed", "momentum"), False)
    held = ConstraintSettings(
        bounds=usable_bounds(robot.limits, 10.0), scene=scene, **{**off, **settings}
    )
    return MotionConstraints(robot, held)


def judged(judge: MotionConstraints) -> tuple[CollisionBodies, JudgedPairs]:
    """The pairs with what is carried alone."""
    assert judge.surroundings is not None
    own = judge.surroundings.pairs["self_collision"]
    held = own.bodies[own.bodies[:, 1] == len(judge.robot.bodies)]
    return judge.surroundings.bodies, replace(own, bodies=held, required=np.zeros(len(held)))


@pytest.mark.parametrize("kind", CARRIED)
def test_distances_from_the_arm_to_what_it_carries_are_those_of_coal(kind: str) -> None:
    judge = judge_with(kind)
    robot, scene = judge.robot, judge.settings.scene
    assert scene is not None
    bodies, pairs = judged(judge)
    local, solid = robot.flange @ scene.payload[0].pose, CARRIED[kind][1]
    round_by = {"cylinder": 0.12, "disc": 0.2}.get(kind, 0.0) * CYLINDER_WITHIN
    arm = sorted(robot.bodies, key=lambda body: body.link)
    hulls = [hull_in_coal(body) for body in arm]
    apart = links = 0
    for q in np.random.default_rng(0).uniform(-2, 2, (20, robot.joints)):
        own = bodies.distances(q[None], pairs.bodies)
        poses = np.concatenate([np.eye(4)[None], joint_poses(robot, q)])
        for (a, _), ours in zip(pairs.bodies, own[0], strict=True):
            theirs = coal_distance(hulls[a], poses[arm[a].link], solid, poses[-1] @ local)
            if theirs > 1e-3:
                apart += 1
                assert -round_by - WITHIN < ours - theirs + arm[a].radius < WITHIN
            else:
                assert ours < 1e-3 + WITHIN
            links = max(links, arm[a].link)
    assert apart > 20
    assert links == robot.joints - 1  # the link before the flange too


def test_a_box_above_a_floor_is_as_high_as_its_lowest_corner() -> None:
    shape = {"type": "box", "size": [0.3, 0.2, 0.4], "position": [0, 0, 0.2], "rpy": [0.2, 1, 0]}
    fields = {"payload": [shape], "shapes": [{"type": "floor", "height": -3.0}]}
    robot = load_robot("ur5")
    judge = safe_constraints(robot, scene_from_json(JsonFields(fields)))
    assert judge.surroundings is not None
    scene = judge.settings.scene
    assert scene is not None
    still = np.zeros((1, 6))
    seen = 0
    for q in np.random.default_rng(2).uniform(-np.pi, np.pi, (30, 6)):
        pose = joint_poses(robot, q)[-1] @ robot.flange
        corners = pose[:3, 3] + body_of(scene.payload[0]).points @ pose[:3, :3].T
        usage = judge.usage(q[None], still, still)
        if "payload" in usage["environment"].what:
            seen += 1
            assert abs(usage["environment"].margin - corners[:, 2].min() - 3.0) < 1e-6
    assert seen > 5


@pytest.mark.parametrize("kind", CARRIED)
def test_pushing_a_payload_away_from_the_arm_has_exact_derivatives(kind: str) -> None:
    judge = judge_with(kind, self_clearance=0.08)
    bounds = judge.settings.bounds
    random = np.random.default_rng(5)
    q = random.uniform(bounds.lower, bounds.upper, (80, judge.robot.joints)) * 0.9
    still, way = np.zeros(q.shape), random.standard_normal(q.shape)
    bodies, pairs = judged(judge)
    held = bodies.distances(q, pairs.bodies)
    assert ((held > 0) & (held < 0.08)).sum() > 10
    slope = judge.violation(q, still, still)[1]
    up, down = (judge.violation(q + h * way, still, still)[0] for h in (STEP, -STEP))
    exact, scale = float(np.vdot(slope, way)), float(np.abs(slope * way).sum())
    assert scale > 0
    assert abs((up - down) / (2 * STEP) - exact) < GRADIENT_WITHIN * scale


@pytest.mark.parametrize("seed", range(4))
def test_between_samples_a_payload_is_never_nearer_than_certified(seed: int) -> None:
    judge = judge_with("box", seed=3, self_clearance=0.0)
    random = np.random.default_rng(seed)
    bounds = judge.settings.bounds
    a, b = random.standard_normal((2, 5, 3)) * (0.05 if seed % 2 else 0.3)
    motion = FourierSeries(period=6.0, offset=0.5 * (bounds.lower + bounds.upper) + 0.3, a=a, b=b)
    found = certify(motion, judge).worst["self_collision"]
    assert judge.surroundings is not None
    dense = motion.evaluate(np.linspace(0, 6, 60001)).q
    around = judge.surroundings
    least = float(around.bodies.nearest(dense, around.pairs["self_collision"]).room.min())
    if found.margin >= 0:
        assert found.margin <= least + 1e-9
        assert found.margin > least - 1e-3 - 0.11 * least
    else:
        assert least < 0


@pytest.mark.parametrize("kind", CARRIED)
def test_no_step_brings_a_payload_nearer_than_its_bound(kind: str) -> None:
    judge = judge_with(kind)
    bodies, pairs = judged(judge)
    random = np.random.default_rng(4)
    travel, most = np.full(judge.robot.joints, 3.0), 0.0
    for q in random.uniform(-2, 2, (20, judge.robot.joints)):
        way = random.uniform(0, 0.1, q.shape)
        at = bodies.nearest(q[None], pairs, travel=travel, way=way[None])
        steps = q + way * random.choice([-1.0, 1.0], (200, len(q)))
        least = float(bodies.nearest(steps, pairs).room.min())
        assert least >= at.bound[0] - 1e-12
        most = max(most, (at.room[0] - least) / (at.room[0] - at.bound[0]))
    assert most > 0.2  # of what the bound allows for


def test_a_wide_box_on_a_ur5_is_free_where_it_is_free() -> None:
    # The old judge put a capsule of 71 mm radius around it, which reached into the wrist.
    box = {"type": "box", "size": [0.1, 0.1, 0.2], "position": [0, 0, 0.1]}
    judge = safe_constraints(load_robot("ur5"), scene_from_json(JsonFields({"payload": [box]})))
    still = np.zeros((1, 6))
    home = np.array([[0.0, -1.2, 0.9, 0.0, -1.57, 0.0]])
    assert judge.holds(home, still, still)
    bare = safe_constraints(load_robot("ur5"))
    random = np.random.default_rng(0)
    hit = 0
    for q in random.uniform(-np.pi, np.pi, (200, 1, 6)):
        with_box, without = (j.holds(q, still, still) for j in (judge, bare))
        assert without or not with_box
        hit += without and not with_box
    # Folded back the box stands in the arm where the flange alone would not.
    assert 5 < hit < 100
