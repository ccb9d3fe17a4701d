"""Which bodies must keep apart: capsules of the links, the payload, the shapes of the scene.

Which pairs of bodies can be judged at all: some are close together by construction.

What the flange carries: solids against the arm, capsules that cover them against the scene.

Against the arm's capsules a box, cylinder or sphere is judged as it is. Against the scene's
solids it is a bundle of thin capsules that holds it and reaches beyond it by a third of their
spacing; against half-spaces a box is its four long edges, which is exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dynid.constraints.arm import arm_geometry
from dynid.constraints.collision import Bodies
from dynid.constraints.scene import (
    BOX,
    HALF_SPACE,
    SPHERE,
    ConstraintSettings,
    Shape,
    outer_half,
    outermost,
    packed,
)
from dynid.core import Array, InputError, read_only
from dynid.robot import Capsule, RobotModel

_NEAR = 2
"""Links this far apart, or from the base, may always be close together by construction."""
_MOSTLY = 0.5
"""Share of poses beyond which the capsules of near links say more of themselves than of the arm."""


def free_pairs(
    robot: RobotModel,
    pairs: list[tuple[int, int]],
    own: Array,
    capsules: tuple[Capsule, ...],
    clearance: float,
    notes: list[str],
) -> tuple[list[tuple[int, int]], bool]:
    """The pairs of capsules that can be judged, and whether some links are left out.

    Args:
        robot: The robot.
        pairs: Candidates (P).
        own: (N, P) their distances in poses all over [m].
        capsules: The robot's.
        clearance: What they must keep [m].
        notes: Told what is left out.
    """
    kept: list[tuple[int, int]] = []
    wide = _too_wide(robot, pairs, own, capsules, clearance, notes)
    for pair, far in zip(pairs, own.T, strict=True):
        a, b = (capsules[k] for k in pair)
        if (a.link, b.link) in wide:
            continue
        if abs(a.link - b.link) <= _NEAR and float(far.max()) < clearance:
            notes.append(f"{a.name} and {b.name} are never farther apart: not judged")
        else:
            kept.append(pair)
    return kept, bool(wide)


def free_holds(
    holds: list[tuple[int, int]],
    own: Array,
    capsules: tuple[Capsule, ...],
    carried: tuple[Shape, ...],
    last: int,
    clearance: float,
    notes: list[str],
) -> list[tuple[int, int]]:
    """The pairs of capsule and carried shape that can be judged; arguments as in `free_pairs`.

    Raises:
        InputError: A shape meets a link in every pose, beside the neighbour of the `last`.
    """
    kept: list[tuple[int, int]] = []
    for (a, s), far in zip(holds, own.T, strict=True):
        item, shape = capsules[a], carried[s]
        if float(far.max()) >= clearance:
            kept.append((a, s))
        elif item.link == last - 1:
            # The wrist in front of the flange: a tool may reach around it by construction.
            notes.append(f"{item.name} and {shape.name} are never farther apart: not judged")
        else:
            raise InputError(
                "the robot cannot carry this: it is in collision in every pose",
                where=f"{item.name} - {shape.name}",
                value=f"{float(far.max()):.3f} m",
                limit=f"{clearance:g} m",
                next_step="Sizes are in metres, places in the flange's frame.",
            )
    return kept


def _too_wide(
    robot: RobotModel,
    pairs: list[tuple[int, int]],
    own: Array,
    capsules: tuple[Capsule, ...],
    clearance: float,
    notes: list[str],
) -> set[tuple[int, int]]:
    """Links whose capsules overlap mostly, if near, or always: arms are not built like that."""
    links = [(capsules[a].link, capsules[b].link) for a, b in pairs]
    found: set[tuple[int, int]] = set()
    for two in sorted(set(links)):
        rows = [k for k, pair in enumerate(links) if pair == two]
        share = float((own[:, rows] < clearance).any(axis=1).mean())
        if share == 1.0 or (two[1] - two[0] <= _NEAR and share > _MOSTLY):
            names = " and ".join(("base", *robot.joint_names)[link] for link in two)
            notes.append(
                f"{names} are not judged against each other: their capsules overlap"
                f" in {share:.0%} of all poses (give better ones: [[capsule]] in a robot file)"
            )
            found.add(two)
    return found


def reachable(
    meetings: list[tuple[int, int]],
    around: Array,
    capsules: tuple[Capsule, ...],
    shapes: tuple[Shape, ...],
    clearance: float,
    notes: list[str],
) -> list[float]:
    """How much nearer than the clearance each pair of capsule and shape may be [m].

    Arguments as in `free_pairs`. Bodies beside the base that are near a shape and never touch it,
    such as the shoulder of an arm that stands on the floor, must keep half of their least distance.

    Raises:
        InputError: A capsule of a moving link is in a shape in every pose.
    """
    found: list[float] = []
    near: dict[tuple[str, str], float] = {}
    for (a, s), far in zip(meetings, around.T, strict=True):
        item, shape = capsules[a], shapes[s].name
        if float(far.max()) <= 0:
            raise InputError(
                f"the scene leaves the robot no room: {item.name} is in '{shape}' in every pose",
                where=shape,
                value=f"{float(far.max()):.3f} m",
                limit="0 m",
                next_step="Shapes are solid and stand in the robot's base frame; build a cell"
                " from walls.",
            )
        least = float(far.min())
        beside = item.link <= _NEAR and 0.0 < least < clearance
        found.append(clearance - least / 2 if beside else 0.0)
        if beside:
            part = (item.name.rsplit(" ", 1)[0], shape)
            near[part] = min(least, near.get(part, clearance))
    notes += [
        f"{part} is {least:.3f} m from '{shape}' whatever the arm does: held to half of that there"
        for (part, shape), least in near.items()
    ]
    return found


SPACING = 0.025
"""Of the capsules of a bundle, where that takes no more than `MOST` [m]."""
MOST = 36
"""Capsules of a bundle."""
_WIDER = 1.2
"""Radius of a capsule over that of the cell that it covers: its ends may then be drawn in."""
_ROUND = 32
"""Sides of the polygon around a cylinder."""
_EDGE = 1e-7
"""Radius of an edge [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Carried:
    """Capsules on the last link that stand for one shape."""

    solid: tuple[Capsule, ...]
    """That cover it."""
    edges: tuple[Capsule, ...]
    """That are the same to a half-space; none where `solid` serves there too."""


def carried_shapes(robot: RobotModel, payload: tuple[Shape, ...]) -> tuple[Shape, ...]:
    """The shapes (given in the flange's frame) in the joint frame of the last link."""
    return tuple(
        replace(shape, name=f"payload {shape.name}", pose=robot.flange @ shape.pose)
        for shape in payload
    )


def covering(robot: RobotModel, shape: Shape) -> Carried:
    """Capsules that hold a shape of `carried_shapes`."""
    axes, centre = shape.pose[:3, :3], shape.pose[:3, 3]

    def capsule(across: Array, reach: float, radius: float) -> Capsule:
        middle, way = centre + axes[:, order[:2]] @ across, axes[:, order[2]] * reach
        return Capsule(
            name=shape.name,
            link=robot.joints,
            start=middle - way,
            end=middle + way,
            radius=radius,
        )

    if shape.kind == SPHERE:
        order = [0, 1, 2]
        return Carried(solid=(capsule(np.zeros(2), 0.0, float(shape.size[0])),), edges=())
    half = outer_half(shape)
    order = [int(k) for k in np.argsort(half, kind="stable")]
    length, radius = float(half[order[2]]), float(shape.size[0])
    outline = half[order[:2]] * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    edges: tuple[Capsule, ...] = ()
    if shape.kind == BOX:
        edges = tuple(capsule(corner, length, _EDGE) for corner in outline)
    elif order[2] == 2:
        turns = 2 * np.pi * np.arange(_ROUND) / _ROUND
        outline = np.column_stack([np.cos(turns), np.sin(turns)])
        outline *= radius / math.cos(math.pi / _ROUND)
    solid: list[Capsule] = []
    for cell in _cells(outline):
        middle = (cell.min(axis=0) + cell.max(axis=0)) / 2
        inner = float(np.linalg.norm(cell - middle, axis=1).max())
        reach = length
        if shape.kind != BOX and order[2] != 2:
            # A disc: its capsules are chords.
            beside = cell[:, order.index(1 - order[2])]
            off = float(np.abs(beside).min()) if beside.min() * beside.max() > 0 else 0.0
            reach = math.sqrt(max(radius**2 - off**2, 0.0))
        # The rim of the cell's end (inner from the middle line) must lie within the cap.
        wide = _WIDER * inner
        drawn = max(reach - math.sqrt(wide**2 - inner**2), 0.0)
        solid.append(capsule(middle, drawn, max(wide, math.hypot(inner, reach - drawn))))
    return Carried(solid=tuple(solid), edges=edges)


def _cells(outline: Array) -> list[Array]:
    """The parts (., 2) of a convex outline (., 2) in the squares of a grid."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    spacing = SPACING
    while (counts := np.ceil((high - low) / spacing - 1e-9)).prod() > MOST:
        spacing *= 1.05
    x, y = (
        np.linspace(float(low[k]), float(high[k]), max(int(counts[k]), 1) + 1).tolist()
        for k in range(2)
    )
    found: list[Array] = []
    for left, right in pairwise(x):
        column = _clipped(_clipped(outline, 0, 1.0, right), 0, -1.0, -left)
        for below, above in pairwise(y):
            cell = _clipped(_clipped(column, 1, 1.0, above), 1, -1.0, -below)
            if len(cell):
                found.append(cell)
    return found


def _clipped(outline: Array, axis: int, sign: float, most: float) -> Array:
    """The part of a convex outline where sign * coordinate <= most."""
    over = sign * outline[:, axis] - most if len(outline) else np.empty(0)
    kept: list[Array] = []
    for k in range(len(outline)):
        last = k - 1
        if (over[k] > 0) != (over[last] > 0):
            share = over[last] / (over[last] - over[k])
            kept.append(outline[last] + share * (outline[k] - outline[last]))
        if over[k] <= 0:
            kept.append(outline[k])
    return np.array(kept).reshape(-1, 2)


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
