from dataclasses import replace

import coal
import numpy as np
import pytest
from chains_for_constraints import random_arm

from dynid.constraints import ConstraintSettings, MotionConstraints, scene_from_json
from dynid.core import JsonFields
from dynid.robot import joint_poses
from dynid.trajectory import usable_bounds

CAPSULES_WITHIN = 1e-9
SHAPES_WITHIN = 2e-6
"""coal walks to the nearest point of a box or cylinder in steps."""


def coal_distance(a: object, at_a: np.ndarray, b: object, at_b: np.ndarray) -> float:
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.gjk_tolerance = 1e-12
    places = [coal.Transform3s(pose[:3, :3], pose[:3, 3]) for pose in (at_a, at_b)]
    return float(coal.distance(a, places[0], b, places[1], request, result))


def capsule_in_coal(start: np.ndarray, end: np.ndarray, radius: float) -> tuple[object, np.ndarray]:
    way = end - start
    length = float(np.linalg.norm(way))
    z = way / length
    side = np.eye(3)[np.argmin(np.abs(z))]
    x = np.cross(side, z) / np.linalg.norm(np.cross(side, z))
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    pose[:3, 3] = (start + end) / 2
    return coal.Capsule(radius, length), pose


@pytest.mark.parametrize("seed", range(5))
def test_distances_between_capsules_are_those_of_coal(seed: int) -> None:
    robot = random_arm(5, seed)
    settings = ConstraintSettings(bounds=usable_bounds(robot.limits))
    bodies = MotionConstraints(robot, settings).surroundings
    assert bodies is not None
    bodies = bodies.bodies
    apart = 0
    for q in np.random.default_rng(seed).uniform(-2, 2, (10, 5)):
        own, _ = bodies.distances(q[None])
        poses = np.concatenate([np.eye(4)[None], joint_poses(robot, q)])
        for (a, b), ours in zip(bodies.pairs, own[0], strict=True):
            two = []
            for item in (robot.capsules[a], robot.capsules[b]):
                pose = poses[item.link]
                start, end = (pose[:3, :3] @ p + pose[:3, 3] for p in (item.start, item.end))
                two += capsule_in_coal(start, end, item.radius)
            theirs = coal_distance(*two)
            if theirs > 1e-3:
                apart += 1
                assert abs(ours - theirs) < CAPSULES_WITHIN
            else:
                assert ours < 1e-3 + CAPSULES_WITHIN
    assert apart > 100


def test_parallel_crossing_and_degenerate_segments() -> None:
    robot = random_arm(2, 0, slides=False)
    item = robot.capsules[0]
    fixed = {
        "a": replace(item, link=0, start=np.zeros(3), end=np.array([1.0, 0, 0]), radius=0.1),
        "beside": replace(
            item, link=0, start=np.array([0.2, 0.5, 0]), end=np.array([0.7, 0.5, 0]), radius=0.1
        ),
        "behind": replace(
            item, link=0, start=np.array([2.0, 0, 0]), end=np.array([3.0, 0, 0]), radius=0.1
        ),
        "across": replace(
            item, link=0, start=np.array([0.5, -1, 0]), end=np.array([0.5, 1, 0]), radius=0.1
        ),
        "ball": replace(
            item, link=0, start=np.array([0.5, 1, 0]), end=np.array([0.5, 1, 0]), radius=0.1
        ),
    }
    arm = replace(robot, capsules=tuple(fixed.values()))
    judge = MotionConstraints(
        replace(arm, capsules=(*fixed.values(), replace(item, link=2))),
        ConstraintSettings(bounds=usable_bounds(robot.limits)),
    )
    assert judge.surroundings is not None
    count = len(fixed)
    pairs = np.array([[0, k] for k in range(1, count)] + [[4, 4]])
    own, _ = replace(
        judge.surroundings.bodies, pairs=pairs, overlap=np.zeros(len(pairs))
    ).distances(np.zeros((1, 2)))
    np.testing.assert_allclose(own[0], [0.3, 0.8, -0.2, 0.8, -0.2], atol=1e-12)


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
    bodies = MotionConstraints(
        robot, ConstraintSettings(bounds=usable_bounds(robot.limits), scene=scene)
    ).surroundings
    assert bodies is not None
    bodies = bodies.bodies
    apart = 0
    for q in np.random.default_rng(0).uniform(-2, 2, (20, 4)):
        _, around = bodies.distances(q[None])
        poses = np.concatenate([np.eye(4)[None], joint_poses(robot, q)])
        for (a, _), ours in zip(bodies.meetings, around[0], strict=True):
            item = robot.capsules[a]
            pose = poses[item.link]
            start, end = (pose[:3, :3] @ p + pose[:3, 3] for p in (item.start, item.end))
            theirs = coal_distance(
                *capsule_in_coal(start, end, item.radius), theirs_shape, scene.shapes[0].pose
            )
            if theirs > 1e-3:
                apart += 1
                assert abs(ours - theirs) < SHAPES_WITHIN
            else:
                assert ours < 1e-3 + SHAPES_WITHIN
    assert apart > 20


def test_depth_within_a_box_is_the_way_to_its_nearest_face() -> None:
    robot = random_arm(2, 1, slides=False)
    item = replace(
        robot.capsules[2],
        link=1,
        start=np.array([0.0, 0, 0]),
        end=np.array([0.0, 0, 0.1]),
        radius=0.01,
    )
    arm = replace(robot, placements=np.tile(np.eye(4), (2, 1, 1)), capsules=(item,))
    scene = scene_from_json(
        JsonFields({"shapes": [{"type": "box", "size": [1, 1, 1], "position": [0.4, 0, 3]}]})
    )
    bodies = MotionConstraints(
        arm, ConstraintSettings(bounds=usable_bounds(arm.limits), scene=scene)
    ).surroundings
    assert bodies is not None
    bodies = bodies.bodies
    shapes = np.array(bodies.shapes)
    shapes[0, 10:13] = [0.4, 0, 0]
    _, around = replace(bodies, shapes=shapes).distances(np.zeros((1, 2)))
    np.testing.assert_allclose(around, [[-0.1 - 0.01]], atol=1e-12)
