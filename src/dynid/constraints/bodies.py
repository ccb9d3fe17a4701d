"""Which bodies must keep apart: capsules of the links, the payload, the shapes of the scene."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.constraints.arm import arm_geometry
from dynid.constraints.collision import Bodies
from dynid.constraints.settings import ConstraintSettings
from dynid.constraints.shapes import BOX, SPHERE, Shape, packed
from dynid.core.arrays import Array, read_only
from dynid.core.errors import InputError
from dynid.robot.capsule import Capsule
from dynid.robot.model import RobotModel

_POSES = 1000
_NEAR = 2
"""Links this far apart, or from the base, may always be close together by construction."""
_FEW_JOINTS = 3
"""Poses tried cover what this many joints do."""
_TOUCHING = 0.0
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


def surroundings_of(
    robot: RobotModel, settings: ConstraintSettings, notes: list[str]
) -> Surroundings | None:
    """The bodies, and the names of their pairs; None where nothing is to be judged.

    Neighbouring links are not judged, nor links that the robot says stay apart (what the flange
    carries is judged against those), nor is the base against the scene it stands on. Pairs
    nearer than the clearance in every pose are so by construction and are left out.

    Raises:
        InputError: A shape that touches a moving link in every pose.
    """
    scene = settings.scene
    shapes = () if scene is None else scene.shapes
    capsules = (*robot.capsules, *_payload(robot, () if scene is None else scene.payload))
    if settings.self_collision and not robot.capsules:
        notes.append(
            "self-collision is not judged: the robot has no capsules ([[capsule]] in a robot file)"
        )
    if shapes and not any(item.link for item in capsules):
        raise InputError(
            "a scene needs a robot with self-collision shapes",
            where=robot.name,
            value="no capsules",
            next_step="Add [[capsule]] tables to a robot file, or leave the scene out.",
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
    pairs = _free(pairs, own, capsules, settings.self_clearance, notes)
    meetings = _reachable(meetings, around, capsules, shapes, settings.clearance, notes)
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
    return Surroundings(bodies=bodies, likely=likely, names=names)


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


def _free(
    pairs: list[tuple[int, int]],
    own: Array,
    capsules: tuple[Capsule, ...],
    clearance: float,
    notes: list[str],
) -> list[tuple[int, int]]:
    kept: list[tuple[int, int]] = []
    for pair, far in zip(pairs, own.T, strict=True):
        a, b = (capsules[k] for k in pair)
        if abs(a.link - b.link) <= _NEAR and float(far.max()) < clearance:
            notes.append(f"{a.name} and {b.name} are never farther apart: not judged")
        else:
            kept.append(pair)
    return kept


def _reachable(
    meetings: list[tuple[int, int]],
    around: Array,
    capsules: tuple[Capsule, ...],
    shapes: tuple[Shape, ...],
    clearance: float,
    notes: list[str],
) -> list[tuple[int, int]]:
    kept: list[tuple[int, int]] = []
    for (a, s), far in zip(meetings, around.T, strict=True):
        name, shape = capsules[a].name, shapes[s].name
        if float(far.max()) <= 0:
            raise InputError(
                f"the scene leaves the robot no room: {name} is in '{shape}' in every pose",
                where=shape,
                value=f"{float(far.max()):.3f} m",
                limit="0 m",
                next_step="Shapes are solid and stand in the robot's base frame; build a cell"
                " from walls.",
            )
        least = float(far.min())
        if capsules[a].link <= _NEAR and _TOUCHING < least < clearance:
            # Such as the shoulder of an arm that stands on the floor.
            notes.append(f"{name} and '{shape}' keep {least:.3f} m in every pose: not judged")
        else:
            kept.append((a, s))
    return kept


def _payload(robot: RobotModel, payload: tuple[Shape, ...]) -> tuple[Capsule, ...]:
    """Capsules around what the flange carries."""
    return tuple(_enclosing(robot, shape) for shape in payload)


def _enclosing(robot: RobotModel, shape: Shape) -> Capsule:
    pose = robot.flange @ shape.pose
    if shape.kind == SPHERE:
        along, radius = np.zeros(3), float(shape.size[0])
    elif shape.kind == BOX:
        longest = int(np.argmax(shape.size))
        along = pose[:3, longest] * shape.size[longest]
        radius = float(np.linalg.norm(np.delete(shape.size, longest)))
    else:
        along, radius = pose[:3, 2] * shape.size[1], float(shape.size[0])
    return Capsule(
        name=f"payload {shape.name}",
        link=robot.joints,
        start=pose[:3, 3] - along,
        end=pose[:3, 3] + along,
        radius=radius,
    )
