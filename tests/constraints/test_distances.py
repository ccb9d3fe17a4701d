import itertools
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
    least_distance,
    scene_from_json,
)
from dynid.core import JsonFields
from dynid.robot import Body, RobotModel, joint_poses
from dynid.trajectory import usable_bounds

WITHIN = 1e-8
SHAPES_WITHIN = 2e-6
"""coal walks to the nearest point of a box or cylinder in steps."""


def judged(robot: RobotModel, **settings: object) -> tuple[CollisionBodies, dict[str, JudgedPairs]]:
    held = ConstraintSettings(bounds=usable_bounds(robot.limits), self_clearance=0.0, **settings)
    found = MotionConstraints(robot, held).surroundings
    assert found is not None
    return found.bodies, found.pairs


@pytest.mark.parametrize(("seed", "size"), [(0, 1), (1, 1), (2, 3), (3, 3)])
def test_distances_and_depths_are_those_of_coal(seed: int, size: int) -> None:
    robot = random_arm(5, seed)
    wide = (replace(body, points=size * body.points) for body in robot.bodies)
    robot = replace(robot, bodies=tuple(wide))
    bodies, kinds = judged(robot)
    pairs = kinds["self_collision"].bodies
    hulls = [hull_in_coal(body) for body in robot.bodies]
    apart = deep = 0
    for q in np.random.default_rng(seed).uniform(-2, 2, (10, 5)):
        own = bodies.distances(q[None], pairs)
        poses = np.concatenate([np.eye(4)[None], joint_poses(robot, q)])
        for (a, b), ours in zip(pairs, own[0], strict=True):
            first, second = robot.bodies[a], robot.bodies[b]
            theirs = coal_distance(hulls[a], poses[first.link], hulls[b], poses[second.link])
            assert abs(ours - theirs + first.radius + second.radius) < WITHIN
            apart += theirs > 0
            deep += theirs < -1e-3
    assert apart > 100
    assert deep > 15 or size == 1


def test_parallel_crossing_and_degenerate_bodies() -> None:
    def body(*points: list[float], link: int = 0, radius: float = 0.1) -> Body:
        return Body(name="x", link=link, points=np.array(points), radius=radius)

    shapes = (
        body([0, 0, 0], [1, 0, 0]),
        body([0.2, 0.5, 0], [0.7, 0.5, 0]),
        body([2, 0, 0], [3, 0, 0]),
        body([0.5, -1, 0], [0.5, 1, 0]),
        body([0.5, 1, 0]),
        body([0, 0, 1], [1, 0, 1], [0, 1, 1], radius=0.0),
        body([0, 0, 0], [3, 3, 3], link=2, radius=0.1),
    )
    robot = random_arm(2, 0, slides=False)
    bodies, _ = judged(replace(robot, bodies=shapes))
    pairs = np.array([[0, k] for k in range(1, 6)] + [[4, 4]])
    own = bodies.distances(np.zeros((1, 2)), pairs)
    np.testing.assert_allclose(own[0], [0.3, 0.8, -0.2, 0.8, 0.9, -0.2], atol=1e-9)


def test_depths_of_bodies_whose_centres_are_in_line() -> None:
    """The origin lies on the first edge or face of their difference: depths were zero."""
    cube = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    diamond = np.concatenate([np.eye(3), -np.eye(3)])
    centres = [0, 0, 0], [0.5, 0, 0], [0, 1.4, 0], [0.3, 0.3, 0.3], [1.2, 1.2, 1.2]
    points = [cube, diamond, *(cube / 2 + centre for centre in centres)]
    bodies = [Body(name="x", link=0, points=p, radius=0.0) for p in points]
    # One that may meet another.
    bodies.append(Body(name="y", link=2, points=points[0], radius=0.0))
    judge, _ = judged(replace(random_arm(2, 0, slides=False), bodies=tuple(bodies)))
    pairs = np.array([[0, 2], [0, 3], [0, 4], [0, 5], [0, 6], [0, 1], [1, 1], [1, 2]])
    deep = [1.5, 1.0, 0.1, 1.2, 0.3, 2.0, 2 / 3**0.5, 2**0.5]
    own = judge.distances(np.zeros((1, 2)), pairs)
    np.testing.assert_allclose(own[0], np.negative(deep), rtol=0, atol=WITHIN)


SHAPES = {
    "box": (
        {"type": "box", "size": [0.3, 0.2, 0.5], "position": [0.4, 0.1, 0.2], "rpy": [0.3, 1, 2]},
        coal.Box(0.3, 0.2, 0.5),
    ),
    "cylinder": (
        {
            "type": "cylinder",
            "radius": 0.12,
            "length": 0.5,
            "position": [-0.4, 0.3, 0.1],
            "rpy": [1, -0.4, 0],
        },
        coal.Cylinder(0.12, 0.5),
    ),
    "sphere": ({"type": "sphere", "radius": 0.2, "position": [0.2, 0.6, 0]}, coal.Sphere(0.2)),
    "floor": ({"type": "floor", "height": -0.5}, coal.Halfspace(np.array([0.0, 0, 1]), 0.0)),
    "wall": (
        {"type": "wall", "point": [0.7, 0.2, 0], "normal": [-2, 1, 0.5]},
        coal.Halfspace(np.array([0.0, 0, 1]), 0.0),
    ),
    "table": (
        {"type": "table", "size": [0.5, 0.4], "position": [0.3, 0.3, -0.2], "thickness": 0.1},
        coal.Box(0.5, 0.4, 0.1),
    ),
}


@pytest.mark.parametrize("kind", SHAPES)
def test_distances_to_shapes_are_those_of_coal(kind: str) -> None:
    robot = random_arm(4, 7)
    fields, theirs_shape = SHAPES[kind]
    scene = scene_from_json(JsonFields({"shapes": [fields]}))
    bodies, kinds = judged(robot, scene=scene)
    pairs = kinds["environment"].bodies
    round_by = CYLINDER_WITHIN * 0.12 if kind == "cylinder" else 0.0
    hulls = [hull_in_coal(body) for body in robot.bodies]
    apart = 0
    for q in np.random.default_rng(0).uniform(-2, 2, (20, 4)):
        around = bodies.distances(q[None], pairs)
        poses = np.concatenate([np.eye(4)[None], joint_poses(robot, q)])
        for (_, b), ours in zip(pairs, around[0], strict=True):
            item = robot.bodies[b]
            theirs = coal_distance(hulls[b], poses[item.link], theirs_shape, scene.shapes[0].pose)
            if theirs > 1e-3:
                apart += 1
                assert -round_by - SHAPES_WITHIN < ours - theirs + item.radius < SHAPES_WITHIN
            else:
                assert ours < 1e-3 + SHAPES_WITHIN
    assert apart > 20


@pytest.mark.parametrize("seed", range(3))
def test_closest_points_are_as_far_apart_as_their_bodies(seed: int) -> None:
    robot = random_arm(4, seed)
    scene = scene_from_json(JsonFields({"shapes": [SHAPES["wall"][0], SHAPES["box"][0]]}))
    bodies, kinds = judged(robot, scene=scene)
    for q in np.random.default_rng(seed).uniform(-2, 2, (10, 4)):
        for pairs in kinds.values():
            far = bodies.distances(q[None], pairs.bodies)[0]
            for (a, b), distance in zip(pairs.bodies, far, strict=True):
                found, ends = bodies.closest(q, int(a), int(b))
                assert found == pytest.approx(distance, abs=WITHIN)
                assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(abs(found), abs=WITHIN)
                if a >= len(bodies.link):
                    normal, height = np.split(bodies.planes[a - len(bodies.link)], [3])
                    assert normal @ ends[0] == pytest.approx(height, abs=WITHIN)


@pytest.mark.parametrize("size", [0.2, 5])
def test_the_nearest_pair_is_found_among_small_and_large_bodies(size: float) -> None:
    """The search that spares far pairs gives what all distances give."""
    robot = random_arm(5, 4)
    wide = tuple(replace(body, points=size * body.points) for body in robot.bodies)
    bodies, kinds = judged(replace(robot, bodies=wide))
    pairs = kinds["self_collision"]
    q = np.random.default_rng(0).uniform(-2, 2, (200, 5))
    room = bodies.distances(q, pairs.bodies) - np.array(pairs.required)
    np.testing.assert_allclose(bodies.nearest(q, pairs).room, room.min(axis=1), atol=WITHIN)


def test_what_is_proven_of_two_joints_holds_and_what_is_not_so_is_not_proven() -> None:
    bodies, kinds = judged(random_arm(4, 5, slides=False))
    lower, upper = np.full(4, -1.0), np.full(4, 1.0)
    random = np.random.default_rng(0)
    proven = 0
    for a, b in kinds["self_collision"].bodies:
        if bodies.link[b] - bodies.link[a] != 2:
            continue
        q = random.uniform(-1, 1, (3000, 4))
        least = float(bodies.distances(q, np.array([[a, b]])).min())
        for sure in (least - 0.01, least + 0.001):
            found = least_distance(bodies, int(a), int(b), lower, upper, sure)
            if sure > least:
                assert found < sure
            elif found >= sure:
                proven += 1
                assert found <= least
    assert proven > 3


def test_what_is_kept_of_a_proof_is_for_the_same_question_alone() -> None:
    bodies, kinds = judged(random_arm(4, 5, slides=False))
    other = judged(random_arm(4, 6, slides=False))[0]
    wider = replace(bodies, radius=bodies.radius + 1e-3)
    moved = replace(bodies, arm=other.arm)
    (a, b), (c, d) = kinds["self_collision"].bodies[[0, -1]].tolist()
    half, narrow = np.full(4, 0.2), np.full(4, 0.1)
    asked = [
        (bodies, a, b, -half, half, 1e-4),
        (wider, a, b, -half, half, 1e-4),
        (moved, a, b, -half, half, 1e-4),
        (bodies, c, d, -half, half, 1e-4),
        (bodies, a, b, -narrow, half, 1e-4),
        (bodies, a, b, -half, half, 10.0),
    ]
    found = [least_distance(*question) for question in asked]
    assert [least_distance(*question) for question in asked] == found
    assert len(set(found)) == len(asked)
