from __future__ import annotations

import numpy as np
import pytest

from dynid.constraints import safe_constraints, scene_from_json
from dynid.core import JsonFields
from dynid.robot import joint_poses, load_robot
from dynid.robot.body import beyond
from dynid.studio.scene_editing import instant

CLOSE = 1e-9
UR5 = load_robot("ur5")
SCENE = scene_from_json(
    JsonFields(
        {
            "shapes": [
                {"type": "floor", "height": -0.1},
                {"type": "box", "size": [0.3, 0.2, 0.4], "position": [0.7, 0.2, 0.3]},
                {"type": "cylinder", "radius": 0.1, "length": 0.5, "position": [-0.6, 0.5, 0.3]},
            ]
        }
    )
)


def distance_to_bodies(point: np.ndarray, q: np.ndarray, names: set[str]) -> float:
    """From a point to the surface of the moving arm, by brute force over some of its bodies."""
    poses = np.concatenate([np.eye(4)[None], joint_poses(UR5, q)])
    least = np.inf
    for item in UR5.bodies:
        if item.name not in names:
            continue
        pose = poses[item.link]
        local = (point - pose[:3, 3]) @ pose[:3, :3]
        least = min(least, float(beyond(local[None], item.points)[0]) - item.radius)
    return least


@pytest.mark.parametrize("seed", range(4))
def test_the_drawn_ways_are_as_long_as_the_distances_that_are_judged(seed: int) -> None:
    constraints = safe_constraints(UR5, SCENE)
    q = np.random.default_rng(seed).uniform(-2, 2, 6)
    _, near = instant(constraints, q, np.zeros(6), np.zeros(6))
    usage = constraints.usage(q[None], np.zeros((1, 6)), np.zeros((1, 6)))
    assert {item.kind for item in near} == {"self_collision", "environment"}
    for item in near:
        # Links that are never far apart have a smaller clearance of their own.
        left = usage[item.kind].room
        assert item.distance - item.clearance == pytest.approx(left, abs=CLOSE)
        assert 0 < item.clearance <= constraints.settings.clearances[item.kind]
        assert item.names == usage[item.kind].what
        if item.kind == "environment" and item.distance > 0:
            assert np.linalg.norm(item.end - item.start) == pytest.approx(item.distance, abs=1e-6)
            # It starts on the arm and ends on the shape, as a sweep over all bodies sees it.
            shape = item.names.partition(" - ")[2]
            assert constraints.surroundings is not None
            pairs = constraints.surroundings.pairs["environment"].names
            # What keeps its distance whatever the arm does, as the shoulder does, is not judged.
            judged = {pair.partition(" - ")[0] for pair in pairs if pair.endswith(f" - {shape}")}
            assert len(judged) > 3
            assert distance_to_bodies(item.start, q, judged) <= 1e-6
            assert distance_to_bodies(item.end, q, judged) == pytest.approx(item.distance, abs=1e-6)


def test_the_margins_of_an_instant_are_those_of_the_judge() -> None:
    constraints = safe_constraints(UR5)
    generator = np.random.default_rng(7)
    q, dq, ddq = generator.normal(size=(3, 6))
    worst, _ = instant(constraints, q, dq, ddq)
    judged = constraints.usage(q[None], dq[None], ddq[None])
    assert worst.keys() == judged.keys()
    for kind, item in judged.items():
        np.testing.assert_equal(worst[kind].margin, item.margin)
