"""Which bodies must keep apart: links, what the flange carries, the shapes of the scene.

Pairs that no pose in the range can bring together are left out: the least distance over whole
ranges of joints is found by branch and bound.
"""

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from dynid.constraints.arm import arm_geometry
from dynid.constraints.collision import CollisionBodies, JudgedPairs, gap_of, memory, place_bodies
from dynid.constraints.scene import BOX, HALF_SPACE, SPHERE, ConstraintSettings, Scene, Shape
from dynid.core import Array, Indices, InputError, compiled, read_only
from dynid.robot import Body, RobotModel, box_points, cylinder_points

_MOST_CELLS = 40_000


def least_distance(
    bodies: CollisionBodies, a: int, b: int, lower: Array, upper: Array, sure: float
) -> float:
    """A distance that bodies keep wherever the joints between them stand.

    Args:
        bodies: The bodies.
        a: The inner body, or a half-space.
        b: The outer body.
        lower: (n) lower ends of the joints' ranges [rad or m].
        upper: (n) upper ends.
        sure: The distance to be proven [m].

    Returns:
        At least `sure` if that is proven (branch and bound); else a distance that was seen
        and is smaller, or -inf where the search was cut short.
    """
    pair = np.array([[a, b]], dtype=np.intp)
    rates = bodies.rates(pair, np.maximum(np.abs(lower), np.abs(upper)))[0]
    half = np.where(rates > 0, (upper - lower) / 2, 0.0)
    # A whole turn is all of a joint's range.
    half = np.where(bodies.arm.prismatic, half, np.minimum(half, np.pi))
    middle = (upper + lower) / 2
    arrays = (bodies.arm.joints, *bodies.parts, pair, middle, half, rates)
    return _searched(_DistanceQuery(tuple(array.tobytes() for array in arrays), arrays, sure))


@dataclass(frozen=True, slots=True)
class _DistanceQuery:
    """Arguments of a search; equal where their arrays hold the same numbers."""

    contents: tuple[bytes, ...]
    arrays: tuple[Any, ...] = field(compare=False)
    sure: float


@lru_cache(maxsize=256)
def _searched(query: _DistanceQuery) -> float:
    """Kept: it takes 20 ms a pair, and one robot in one scene is judged often."""
    joints, *parts, pair, middle, half, rates = query.arrays
    args = (pair, middle, half, rates, query.sure, _MOST_CELLS)
    return float(_least(joints, tuple(parts), *args))


@compiled(error_model="numpy")
def _least(
    joints: Array,
    parts: Any,
    pairs: Indices,
    middle: Array,
    half: Array,
    rates: Array,
    sure: float,
    most: int,
) -> float:
    """Branch and bound over the joints that have a rate: see `least_distance`."""
    n = len(middle)
    room = memory(n, len(parts[0]))
    cells, way, a, b = np.empty((256, 2, n)), np.zeros(3), pairs[0, 0], pairs[0, 1]
    q, wide = np.empty(n), np.empty(n)
    for j in range(n):
        cells[0, 0, j], cells[0, 1, j] = middle[j], half[j]
    open_, low = 1, np.inf
    for _ in range(most):
        open_ -= 1
        slack, widest = 0.0, 0
        for j in range(n):
            q[j], wide[j] = cells[open_, 0, j], cells[open_, 1, j]
            slack += rates[j] * wide[j]
            if rates[j] * wide[j] > rates[widest] * wide[widest]:
                widest = j
        place_bodies(joints, parts, q, room)
        far = gap_of(parts, a, b, room, sure + slack, way)
        if far < sure:
            return far
        if far - slack >= sure:
            low = min(low, far - slack)
            if open_ == 0:
                return low
            continue
        if open_ + 2 > len(cells):
            break
        wide[widest] /= 2
        for side in (-1.0, 1.0):
            for j in range(n):
                cells[open_, 0, j], cells[open_, 1, j] = q[j], wide[j]
            cells[open_, 0, widest] += side * wide[widest]
            open_ += 1
    return -np.inf


_NEAR = 2
"""Links this far apart, or from the base: all their poses can be searched."""
_SURE = 0.001
"""Bodies that are proven to keep this distance cannot meet [m]."""
_TOUCHING = 1e-9
"""Bodies no farther apart touch [m]."""
_MOSTLY = 0.5
"""Share of poses beyond which bodies of near links say more of themselves than of the arm."""
_FAR = 3.0
"""Lengths of the arm from which nobody would describe what is there: another unit, probably."""
_POSES = 400


@dataclass(frozen=True, slots=True, kw_only=True)
class Surroundings:
    """The bodies to judge."""

    bodies: CollisionBodies
    pairs: dict[str, JudgedPairs]
    """Kind of distance to its pairs, where there are any."""
    far: frozenset[str]
    """Shapes of the scene that are much too far away to matter."""
    lacking: dict[str, tuple[str, ...]]
    """Kind of distance to why it cannot be judged in full: links that no body holds, pairs that
    were left out though they can meet."""

    @property
    def all_pairs(self) -> Indices:
        """(P, 2) the pairs of all kinds, one kind after the other."""
        return np.concatenate([pairs.bodies for pairs in self.pairs.values()])


def surroundings_of(
    robot: RobotModel, settings: ConstraintSettings, notes: list[str]
) -> Surroundings | None:
    """The bodies, and the names of their pairs; None where no bodies move.

    Neighbouring links are not judged, nor is the base against the scene it stands on; what the
    flange carries is judged against every other link. A pair of near links is left out where
    it is proven that it cannot meet, whatever the joints between do.

    Raises:
        InputError: A shape that touches a moving link in every pose.
    """
    scene = settings.scene or Scene()
    carried = tuple(
        body_of(replace(shape, name=f"payload {shape.name}"), robot.joints, robot.flange)
        for shape in scene.payload
    )
    moving = (*sorted(robot.bodies, key=lambda body: body.link), *carried)
    notes += robot.notes
    bare = not_held(robot) if settings.self_collision or scene.shapes else ()
    notes += [note for note in bare if note not in notes]
    if scene.shapes and not any(body.link for body in moving):
        raise InputError(
            "no moving link has a collision body to judge against the scene",
            where=robot.name,
            next_step=GIVE_SHAPES,
        )
    if not moving:
        return None
    # Half-spaces are numbered after all bodies.
    shapes = sorted(scene.shapes, key=lambda shape: shape.kind == HALF_SPACE)
    solids = tuple(body_of(shape) for shape in shapes if shape.kind != HALF_SPACE)
    planes = [shape.pose for shape in shapes if shape.kind == HALF_SPACE]
    bodies = CollisionBodies(
        arm=arm_geometry(robot),
        link=_numbers([body.link for body in (*moving, *solids)]),
        starts=_numbers(np.cumsum([0, *(len(body.points) for body in (*moving, *solids))])),
        points=read_only(np.vstack([body.points for body in (*moving, *solids)]).T.copy()),
        radius=read_only(np.array([body.radius for body in (*moving, *solids)])),
        spheres=read_only(np.array([_around(body) for body in (*moving, *solids)])),
        planes=read_only(
            np.array([[*pose[:3, 2], pose[:3, 2] @ pose[:3, 3]] for pose in planes]).reshape(-1, 4)
        ),
    )
    names = [body.name for body in moving] + [shape.name for shape in shapes]
    poses = _poses(settings)
    arm = len(moving) - len(carried)
    own = _numbers(_own_pairs(moving, arm) if settings.self_collision else [])
    own, clearances, left_out = _free_pairs(bodies, own, poses, settings, names, arm, notes)
    notes += left_out
    around = [
        (len(moving) + s, j)
        for s in range(len(shapes))
        for j, body in enumerate(moving)
        if body.link
    ]
    around, out = _reachable(bodies, _numbers(around), poses, settings, names, notes)
    pairs = {
        "self_collision": JudgedPairs(
            bodies=own,
            required=read_only(clearances),
            names=tuple(f"{names[a]} - {names[b]}" for a, b in own),
        ),
        "environment": JudgedPairs(
            bodies=around,
            required=read_only(np.full(len(around), settings.clearance)),
            names=tuple(f"{names[b]} - {names[a]}" for a, b in around),
        ),
    }
    return Surroundings(
        bodies=bodies,
        pairs={kind: found for kind, found in pairs.items() if found.names},
        far=out,
        lacking={"self_collision": (*bare, *left_out), "environment": bare},
    )


def body_of(shape: Shape, link: int = 0, frame: Array | None = None) -> Body:
    """A solid that is no half-space as a collision body, fixed in a link.

    The frame (4, 4) of its pose is given in the joint frame of that link; None for the same.
    """
    pose = shape.pose if frame is None else frame @ shape.pose
    points, radius = np.zeros((1, 3)), float(shape.size[0])
    if shape.kind != SPHERE:
        radius = 0.0
        points = (
            box_points(shape.size)
            if shape.kind == BOX
            else cylinder_points(float(shape.size[0]), float(shape.size[1]))
        )
    return Body(
        name=shape.name, link=link, points=points @ pose[:3, :3].T + pose[:3, 3], radius=radius
    )


def _numbers(values: object) -> Indices:
    found = np.array(values, dtype=np.intp)
    return found if found.size else found.reshape(0, 2)


def _own_pairs(moving: tuple[Body, ...], arm: int) -> list[tuple[int, int]]:
    return [
        (a, b)
        for a, inner in enumerate(moving[:arm])
        for b, outer in enumerate(moving)
        if outer.link - inner.link >= (1 if b >= arm else 2)
    ]


GIVE_SHAPES = (
    "Give its links shapes that fit: [[capsule]] in a robot file, or meshes (--mesh-dir DIR)."
)


def not_held(robot: RobotModel) -> tuple[str, ...]:
    """Why its bodies may not hold all of the moving links."""
    if not robot.bodies:
        text = "no bodies are known of the robot ([[body]] in a robot file, or geometry in a URDF)"
        return (*robot.body_notes, text)
    known = {body.link for body in robot.bodies}
    bare = [name for k, name in enumerate(robot.joint_names, start=1) if k not in known]
    words = (f"no bodies are known of what {', '.join(bare)} moves: not judged",) if bare else ()
    return (*robot.body_notes, *words)


def _free_pairs(
    bodies: CollisionBodies,
    own: Indices,
    poses: Array,
    settings: ConstraintSettings,
    names: list[str],
    arm: int,
    notes: list[str],
) -> tuple[Indices, Array, tuple[str, ...]]:
    """The pairs that are judged of all own pairs (P, 2).

    Bodies that can never be twice the clearance apart must keep half of the largest distance seen
    at the poses (N, n), those that are mostly nearer than it their median distance: `notes` is
    told. Bodies from number `arm` on are carried.

    Returns:
        The pairs, the clearance that each must keep [m], and in words which others are left out
            though they may meet.

    Raises:
        InputError: What is carried meets a link in every pose, beside the neighbour of the last.
    """
    inner, outer = own.T
    gap = bodies.link[outer] - bodies.link[inner]
    near = (gap <= _NEAR) | (outer >= arm)
    far = bodies.distances(poses, own[near]).T
    kept, clearances = ~near, np.full(len(near), settings.self_clearance)
    left_out: list[str] = []
    for row, k in zip(far, np.flatnonzero(near), strict=True):
        a, b = (int(x) for x in own[k])
        what = f"{names[a]} and {names[b]}"
        most = float(row.max())
        # By touching, not by the clearance: a larger one must not judge fewer pairs.
        often = float(np.quantile(row, 1.0 if b >= arm else _MOSTLY, method="higher"))
        clearances[k] = min(settings.self_clearance, most / 2, often)
        if gap[k] <= _NEAR and _proven(bodies, a, b, row, settings, _SURE):
            continue
        kept[k] = often > _TOUCHING
        if not kept[k] and b >= arm and gap[k] > 1:
            raise InputError(
                "the robot cannot carry this: it is in collision in every pose",
                where=f"{names[a]} - {names[b]}",
                value=f"{most:.3f} m",
                limit=f"{settings.self_clearance:g} m",
                next_step="Sizes are in metres, places in the flange's frame.",
            )
        if not kept[k]:
            share = float((row <= _TOUCHING).mean())
            left_out.append(f"{what} are not judged: their bodies touch in {share:.0%} of poses")
        elif clearances[k] < settings.self_clearance:
            limit = f"the limit is {clearances[k]:.4f} m"
            notes.append(f"{what} have little room, at most {most:.4f} m: {limit}")
    return own[kept], clearances[kept], tuple(left_out)


def _reachable(
    bodies: CollisionBodies,
    around: Indices,
    poses: Array,
    settings: ConstraintSettings,
    names: list[str],
    notes: list[str],
) -> tuple[Indices, frozenset[str]]:
    """The pairs that are judged of all with the scene (P, 2), and shapes beyond `_FAR`.

    Shapes that are farther away than the arm is long are told: lengths in another unit are.
    Arguments as in `_free_pairs`.

    Bodies beside the base that are near a shape and cannot touch it, such as the shoulder of an
    arm that stands on the floor, are left out.

    Raises:
        InputError: A body of a moving link is in a shape in every pose.
    """
    kept = np.ones(len(around), dtype=bool)
    far = bodies.distances(poses, around).T
    out: set[str] = set()
    # With the largest body: the axis of a single joint has no length of its own.
    length = bodies.arm.length + 2 * float(bodies.spheres[around[:, 1], 3].max(initial=0.0))
    for shape in map(int, np.unique(around[:, 0])):
        least = float(far[around[:, 0] == shape].min())
        if least > _FAR * length:
            out.add(names[shape])
        if least > length:
            notes.append(
                f"'{names[shape]}' is out of reach, about {least:.3g} m from the arm at least"
                " (lengths are in metres)"
            )
    for k, row in enumerate(far):
        a, b = (int(x) for x in around[k])
        if row.max() <= 0:
            raise InputError(
                f"the scene leaves the robot no room: {names[b]} is in '{names[a]}' in every pose",
                where=names[a],
                value=f"{float(row.max()):.3f} m",
                limit="0 m",
                next_step="Shapes are solid and stand in the robot's base frame; build a cell"
                " from walls.",
            )
        if bodies.link[b] > _NEAR:
            continue
        if _proven(bodies, a, b, row, settings, settings.clearance):
            kept[k] = False
        elif row.max() < settings.clearance and _proven(bodies, a, b, row, settings, _SURE):
            kept[k] = False
            notes.append(
                f"{names[b]} is {float(row.min()):.3f} m from '{names[a]}' whatever the arm does"
            )
    return around[kept], frozenset(out)


def _proven(
    bodies: CollisionBodies, a: int, b: int, seen: Array, settings: ConstraintSettings, sure: float
) -> bool:
    """Whether a pair keeps a distance at all positions; `seen` are distances at some."""
    bounds = settings.bounds
    if float(seen.min()) < sure or not np.isfinite([bounds.lower, bounds.upper]).all():
        return False
    return least_distance(bodies, a, b, bounds.lower, bounds.upper, sure) >= sure


def _around(body: Body) -> Array:
    """(4) centre and radius of a sphere around a body."""
    middle = (body.points.min(axis=0) + body.points.max(axis=0)) / 2
    reach = float(np.linalg.norm(body.points - middle, axis=1).max())
    return np.array([*middle, reach + body.radius])


def _poses(settings: ConstraintSettings) -> Array:
    bounds = settings.bounds
    lower = np.maximum(bounds.lower, -np.pi)
    upper = np.minimum(bounds.upper, np.pi)
    lower, upper = (
        np.where(lower < upper, x, y) for x, y in ((lower, bounds.lower), (upper, bounds.upper))
    )
    return np.random.default_rng(0).uniform(lower, upper, (_POSES, bounds.joints))
