"""Which bodies must keep apart: capsules of the links, the payload, the shapes of the scene."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.constraints.arm import arm_geometry
from dynid.constraints.collision import Bodies
from dynid.constraints.judged_pairs import free_holds, free_pairs, reachable
from dynid.constraints.payload_shapes import carried_shapes, covering
from dynid.constraints.settings import ConstraintSettings
from dynid.constraints.shapes import HALF_SPACE, Shape, outermost, packed
from dynid.core.arrays import Array, read_only
from dynid.core.errors import InputError
from dynid.robot.capsule import Capsule
from dynid.robot.model import RobotModel

ARM, TO_ALL, TO_SOLIDS, TO_HALF_SPACES = range(4)
"""A capsule of the arm, or one that stands for a payload towards these shapes of the scene."""
_POSES = 1000
_FEW_JOINTS = 3
"""Poses tried cover what this many joints do."""
_FAR = 0.03
"""Pairs that keep this distance in all poses tried are left to the certificate [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Surroundings:
    """The bodies to judge."""

    bodies: Bodies
    """Every pair, for the certificate."""
    likely: Bodies
    """Without the pairs of near links that no pose tried brings together, for a search."""
    names: dict[str, list[str]]
    """Kind of distance to the names of its pairs."""
    complete: dict[str, bool]
    """Kind of distance to whether the capsules are known to hold every link that it is about."""


def surroundings_of(
    robot: RobotModel, settings: ConstraintSettings, notes: list[str]
) -> Surroundings | None:
    """The bodies, and the names of their pairs; None where nothing is to be judged.

    Neighbouring links are not judged, nor links that the robot says stay apart, nor is the base
    against the scene it stands on; what the flange carries is judged against every other link.
    What is near by construction is left out; see `judged_pairs`.

    Raises:
        InputError: A shape that touches a moving link in every pose.
    """
    scene = settings.scene
    shapes = () if scene is None else scene.shapes
    carried = () if scene is None else carried_shapes(robot, scene.payload)
    complete = True
    if settings.self_collision or shapes:
        complete = _note_capsules(robot, settings, notes)
    capsules, sides = _capsules(robot, carried)
    if shapes and not any(item.link for item in capsules):
        raise InputError(
            "a scene needs a robot with self-collision shapes",
            where=robot.name,
            value="no capsules",
            next_step="Add [[capsule]] tables to a robot file, or collision geometry to a URDF.",
        )
    if not capsules:
        return None
    of_link = [
        [k for k, item in enumerate(capsules) if item.link == link]
        for link in range(robot.joints + 1)
    ]
    arm = [[k for k in members if sides[k] == ARM] for members in of_link]
    judged = range(robot.joints + 1) if settings.self_collision else ()
    pairs = [
        (a, b)
        for first in judged
        for second in judged[first + 2 :]
        for a in arm[first]
        for b in arm[second]
        if (first, second) not in robot.apart
    ]
    holds = [(a, s) for first in judged[:-1] for s in range(len(carried)) for a in arm[first]]
    meetings = [
        (a, s)
        for members in of_link[1:]
        for s, shape in enumerate(shapes)
        for a in members
        if sides[a] != (TO_SOLIDS if shape.kind == HALF_SPACE else TO_HALF_SPACES)
    ]
    every = _bodies(robot, capsules, shapes, carried, pairs, holds, meetings)
    poses = _poses(settings)
    own, around = every.distances(poses)
    own, held = own[:, : len(pairs)], own[:, len(pairs) :]
    pairs, left_out = free_pairs(robot, pairs, own, capsules, settings.self_clearance, notes)
    every_hold = holds
    holds = free_holds(holds, held, capsules, carried, robot.joints, settings.self_clearance, notes)
    left_out |= len(holds) < len(every_hold)
    nearer = reachable(meetings, around, capsules, shapes, settings.clearance, notes)
    if not pairs and not holds and not meetings:
        return None
    names = {
        "self_collision": [
            *(f"{capsules[a].name} - {capsules[b].name}" for a, b in pairs),
            *(f"{capsules[a].name} - {carried[s].name}" for a, s in holds),
        ],
        "environment": [f"{capsules[a].name} - {shapes[s].name}" for a, s in meetings],
    }
    bodies = _bodies(robot, capsules, shapes, carried, pairs, holds, meetings)
    bodies = replace(bodies, nearer=read_only(np.array(nearer)))
    links = bodies.link[bodies.pairs]
    met = bodies.distances(poses)[0][:, : len(pairs)].min(axis=0, initial=np.inf) < _FAR
    met |= links[:, 1] - links[:, 0] > _FEW_JOINTS
    likely = replace(bodies, pairs=bodies.pairs[met], overlap=read_only(bodies.overlap[met]))
    return Surroundings(
        bodies=bodies,
        likely=likely,
        names=names,
        complete={"self_collision": complete and not left_out, "environment": complete},
    )


def _capsules(
    robot: RobotModel, carried: tuple[Shape, ...]
) -> tuple[tuple[Capsule, ...], tuple[int, ...]]:
    """The robot's capsules and those that stand for what it carries, and what each is for."""
    covers = [covering(robot, shape) for shape in carried]
    found = [(item, ARM) for item in robot.capsules]
    for cover in covers:
        found += [(item, TO_SOLIDS if cover.edges else TO_ALL) for item in cover.solid]
        found += [(item, TO_HALF_SPACES) for item in cover.edges]
    # By link: pairs of two links then stand together, as the kernels want them.
    found.sort(key=lambda row: row[0].link)
    return tuple(item for item, _ in found), tuple(side for _, side in found)


def _note_capsules(robot: RobotModel, settings: ConstraintSettings, notes: list[str]) -> bool:
    """Whether the capsules are known to hold all of the moving links."""
    notes.extend(robot.capsule_notes)
    if not robot.capsules:
        if settings.self_collision:
            notes.append(
                "self-collision is not judged: no shapes are known of the robot ([[capsule]] in a"
                " robot file, or collision geometry in a URDF)"
            )
        return False
    known = {item.link for item in robot.capsules}
    bare = [name for k, name in enumerate(robot.joint_names, start=1) if k not in known]
    if bare:
        notes.append(f"no shapes are known of what {', '.join(bare)} moves: not judged")
    return not bare and not robot.capsule_notes


def _bodies(
    robot: RobotModel,
    capsules: tuple[Capsule, ...],
    shapes: tuple[Shape, ...],
    carried: tuple[Shape, ...],
    pairs: list[tuple[int, int]],
    holds: list[tuple[int, int]],
    meetings: list[tuple[int, int]],
) -> Bodies:
    held = np.array([(a, len(shapes) + s) for a, s in holds], dtype=np.intp).reshape(-1, 2)
    corners = np.array([outermost(shape) for shape in carried]).reshape(-1, 8, 3)
    return Bodies(
        arm=arm_geometry(robot),
        link=np.array([item.link for item in capsules], dtype=np.intp),
        ends=read_only(np.array([[item.start, item.end] for item in capsules])),
        radius=read_only(np.array([item.radius for item in capsules])),
        spheres=read_only(np.array([_around(capsules, k) for k in range(robot.joints + 1)])),
        shapes=read_only(packed((*shapes, *carried))),
        corners=read_only(corners),
        pairs=np.array(pairs, dtype=np.intp).reshape(-1, 2),
        overlap=read_only(_overlaps(robot, capsules, pairs)),
        holds=held,
        nearer=read_only(np.zeros(len(meetings))),
        meetings=np.array(meetings, dtype=np.intp).reshape(-1, 2),
    )


def _around(capsules: tuple[Capsule, ...], link: int) -> Array:
    """(4) centre and radius of a sphere around a link's capsules."""
    own = [item for item in capsules if item.link == link]
    if not own:
        return np.zeros(4)
    corners = np.array([end for item in own for end in (item.start, item.end)])
    radii = np.repeat([item.radius for item in own], 2)
    low, high = (corners - radii[:, None]).min(axis=0), (corners + radii[:, None]).max(axis=0)
    centre = (low + high) / 2
    reach = np.linalg.norm(corners - centre, axis=1) + radii
    return np.array([*centre, float(reach.max())])


def _overlaps(
    robot: RobotModel, capsules: tuple[Capsule, ...], pairs: list[tuple[int, int]]
) -> Array:
    """(P) what the robot's file allows."""
    known = {row[:2]: row[2] for row in robot.overlap}
    return np.array([known.get((capsules[a].link, capsules[b].link), 0.0) for a, b in pairs])


def _poses(settings: ConstraintSettings) -> Array:
    bounds = settings.bounds
    lower = np.maximum(bounds.lower, -np.pi)
    upper = np.minimum(bounds.upper, np.pi)
    lower, upper = (
        np.where(lower < upper, x, y) for x, y in ((lower, bounds.lower), (upper, bounds.upper))
    )
    return np.random.default_rng(0).uniform(lower, upper, (_POSES, bounds.joints))
