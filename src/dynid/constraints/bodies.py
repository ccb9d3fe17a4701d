"""Which bodies must keep apart: capsules of the links, the payload, the shapes of the scene."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.constraints.arm import arm_geometry
from dynid.constraints.collision import Bodies
from dynid.constraints.judged_pairs import free_pairs, reachable
from dynid.constraints.payload_shapes import payload_capsules
from dynid.constraints.settings import ConstraintSettings
from dynid.constraints.shapes import Shape, packed
from dynid.core.arrays import Array, read_only
from dynid.core.errors import InputError
from dynid.robot.capsule import Capsule
from dynid.robot.model import RobotModel

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

    Neighbouring links are not judged, nor links that the robot says stay apart (what the flange
    carries is judged against those), nor is the base against the scene it stands on. What is
    near by construction is left out; see `judged_pairs`.

    Raises:
        InputError: A shape that touches a moving link in every pose.
    """
    scene = settings.scene
    shapes = () if scene is None else scene.shapes
    capsules = (*robot.capsules, *payload_capsules(robot, () if scene is None else scene.payload))
    complete = True
    if settings.self_collision or shapes:
        complete = _note_capsules(robot, settings, notes)
    if shapes and not any(item.link for item in capsules):
        raise InputError(
            "a scene needs a robot with self-collision shapes",
            where=robot.name,
            value="no capsules",
            next_step="Add [[capsule]] tables to a robot file, or collision geometry to a URDF.",
        )
    if not capsules:
        return None
    # By link: pairs of two links then stand together, as the kernels want them.
    own_count = len(robot.capsules)
    order = sorted(range(len(capsules)), key=lambda k: capsules[k].link)
    carried = [k >= own_count for k in order]
    capsules = tuple(capsules[k] for k in order)
    of_link = [
        [k for k, item in enumerate(capsules) if item.link == link]
        for link in range(robot.joints + 1)
    ]
    pairs = [
        (a, b)
        for first in range(robot.joints + 1)
        for second in range(first + 2, robot.joints + 1)
        for a in of_link[first]
        for b in of_link[second]
        if settings.self_collision and (carried[b] or (first, second) not in robot.apart)
    ]
    meetings = [(a, s) for members in of_link[1:] for s in range(len(shapes)) for a in members]
    every = _bodies(robot, capsules, shapes, pairs, meetings)
    poses = _poses(settings)
    own, around = every.distances(poses)
    pairs, left_out = free_pairs(robot, pairs, own, capsules, settings.self_clearance, notes)
    meetings = reachable(meetings, around, capsules, shapes, settings.clearance, notes)
    if not pairs and not meetings:
        return None
    names = {
        "self_collision": [f"{capsules[a].name} - {capsules[b].name}" for a, b in pairs],
        "environment": [f"{capsules[a].name} - {shapes[s].name}" for a, s in meetings],
    }
    bodies = _bodies(robot, capsules, shapes, pairs, meetings)
    links = bodies.link[bodies.pairs]
    met = bodies.distances(poses)[0].min(axis=0, initial=np.inf) < _FAR
    met |= links[:, 1] - links[:, 0] > _FEW_JOINTS
    likely = replace(bodies, pairs=bodies.pairs[met], overlap=read_only(bodies.overlap[met]))
    return Surroundings(
        bodies=bodies,
        likely=likely,
        names=names,
        complete={"self_collision": complete and not left_out, "environment": complete},
    )


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
    pairs: list[tuple[int, int]],
    meetings: list[tuple[int, int]],
) -> Bodies:
    return Bodies(
        arm=arm_geometry(robot),
        link=np.array([item.link for item in capsules], dtype=np.intp),
        ends=read_only(np.array([[item.start, item.end] for item in capsules])),
        radius=read_only(np.array([item.radius for item in capsules])),
        spheres=read_only(np.array([_around(capsules, k) for k in range(robot.joints + 1)])),
        shapes=read_only(packed(shapes)),
        pairs=np.array(pairs, dtype=np.intp).reshape(-1, 2),
        overlap=read_only(_overlaps(robot, capsules, pairs)),
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
    """(P) what the robot's file allows; what the flange carries may not overlap."""
    known = {row[:2]: row[2] for row in robot.overlap}
    own = {id(item) for item in robot.capsules}
    found = np.zeros(len(pairs))
    for k, (a, b) in enumerate(pairs):
        inner, outer = capsules[a], capsules[b]
        if id(inner) in own and id(outer) in own:
            found[k] = known.get((inner.link, outer.link), 0.0)
    return found


def _poses(settings: ConstraintSettings) -> Array:
    bounds = settings.bounds
    lower = np.maximum(bounds.lower, -np.pi)
    upper = np.minimum(bounds.upper, np.pi)
    lower, upper = (
        np.where(lower < upper, x, y) for x, y in ((lower, bounds.lower), (upper, bounds.upper))
    )
    return np.random.default_rng(0).uniform(lower, upper, (_POSES, bounds.joints))
