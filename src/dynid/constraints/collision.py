"""Distances between the bodies of the arm and from them to the scene, and how they change."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynid.constraints.arm import ArmGeometry, collect, place_joints, place_point, samples_of
from dynid.constraints.distance import WORK, gap_along, separation
from dynid.core import Array, Indices, compiled

LENGTH = 0.1
"""The distance that counts as much as a limit exceeded by its whole value [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedPairs:
    """Pairs of bodies that must keep apart.

    The body of the inner link stands first; a first number of B + h stands for half-space h.
    """

    bodies: Indices
    """(P, 2) numbers of bodies."""
    required: Array
    """(P) smallest allowed distances [m]."""
    names: tuple[str, ...]
    """(P) both bodies in words."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Nearest:
    """The pair with the least room at each sample."""

    room: Array
    """(N) its signed distance less what is required of it [m]."""
    pair: Indices
    """(N) its row in the list of pairs."""
    bound: Array
    """(N) what no pair's room is below while the joints move on; see `CollisionBodies.nearest`."""


@dataclass(slots=True, kw_only=True)
class Proximity:
    """How far apart pairs were at samples that were looked at before.

    A pair is not measured again while the joints have moved too little to bring it near. Values
    do not depend on what was known, except by rounding; `forget` removes that, too.
    """

    rates: Array
    """(P, n) how fast each joint can change each distance [m/rad or 1]."""
    last: Array
    """(M, n) positions of the samples seen last; sample k of a motion is compared with row k mod
    M, so that one row compares each sample with the one before."""
    room: Array
    """(M, P) no distance was below this there [m]."""
    axes: Array
    """(M, P, 3) directions found there: where to begin."""

    def forget(self) -> None:
        """Begin anew."""
        self.room[:] = -np.inf
        self.axes[:] = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CollisionBodies:
    """Convex bodies fixed in links or in the base frame, and half-spaces.

    A body is the hull of points, inflated by a radius.
    """

    arm: ArmGeometry
    link: Indices
    """(B) the link of each body; 0 the base, and what stands in its frame."""
    starts: Indices
    """(B + 1) where each body's points start."""
    points: Array
    """(3, T) points in the joint frames of their links [m]."""
    radius: Array
    """(B) [m]"""
    spheres: Array
    """(B, 4) centre and radius of a sphere around each body [m]."""
    planes: Array
    """(H, 4) outward unit normal of each half-space, and its height along that [m]."""

    def distances(self, q: Array, pairs: Indices) -> Array:
        """Signed distances (N, P) of pairs (P, 2) at q (N, n) [m].

        Negative where bodies overlap: the least way that parts them.
        """
        found = np.empty((len(q), len(pairs)))
        _distances(self.arm.joints, self.parts, pairs, samples_of(q), found)
        return found

    def nearest(
        self, q: Array, pairs: JudgedPairs, *, travel: Array | None = None, way: Array | None = None
    ) -> Nearest:
        """The pair with the least room at each sample, and a bound nearby.

        Args:
            q: (N, n) positions [rad or m].
            pairs: Whom to judge.
            travel: (n) largest |q| of each joint anywhere [rad or m].
            way: (N, n) how far each joint may move from q [rad or m]; None for not at all.
        """
        slack = np.zeros((len(q), len(pairs.bodies)))
        if way is not None and travel is not None:
            slack = np.ascontiguousarray(way @ self.rates(pairs.bodies, travel).T)
        found, pair = np.empty((2, len(q))), np.empty(len(q), dtype=np.intp)
        joints, required = self.arm.joints, np.array(pairs.required)
        _nearest(joints, self.parts, pairs.bodies, samples_of(q), required, slack, found, pair)
        return Nearest(room=found[0], pair=pair, bound=found[1])

    def proximity(self, pairs: Indices, samples: int, travel: Array) -> Proximity:
        """An empty memory of pairs (P, 2) for motions of so many samples.

        With one sample, each is compared with the one before. `travel` (n) is the largest |q| of
        each joint anywhere [rad or m].
        """
        known = Proximity(
            rates=self.rates(pairs, travel),
            last=np.zeros((samples, self.arm.count)),
            room=np.empty((samples, len(pairs))),
            axes=np.empty((samples, len(pairs), 3)),
        )
        known.forget()
        return known

    def violation(
        self,
        q: Array,
        pairs: Indices,
        clearance: Array,
        *,
        known: Proximity | None = None,
        most: float = np.inf,
    ) -> tuple[float, Array]:
        """Sum of squared clearance violations, in units of `LENGTH`.

        Args:
            q: (N, n) positions [rad or m].
            pairs: (P, 2) whom to judge.
            clearance: (P) smallest allowed distances [m].
            known: From `proximity`, for the same pairs and samples; it is brought up to date.
            most: Where the sum is beyond this, later samples are left out.

        Returns:
            The sum over samples and pairs, and its derivative (N, n).
        """
        slope = np.zeros(q.shape)
        if known is None:
            known = self.proximity(pairs, 1, np.abs(q).max(axis=0))
        arm = self.arm
        total = _violation(
            arm.joints, arm.prismatic, self.parts, pairs, clearance, samples_of(q),
            known.rates, known.last, known.room, known.axes, most, slope,
        )  # fmt: skip
        return float(total), slope

    def closest(self, q: Array, a: int, b: int) -> tuple[float, Array]:
        """Signed distance of one pair at q (n), and the nearest points (2, 3) of both bodies.

        In the base frame [m].
        """
        parts, pose, way = self.parts, np.array(q, dtype=np.float64), np.zeros(3)
        room = memory(self.arm.count, len(self.link))
        place_bodies(self.arm.joints, parts, pose, room)
        far = gap_of(parts, a, b, room, np.inf, way)
        turn, origin, touch = room[0], room[1], room[4]
        plane = a >= len(self.link)
        first = 0 if plane else int(self.link[a])
        along = turn[first] @ way
        end = origin[first] + turn[first] @ touch
        end = end + (-far - self.radius[b] if plane else self.radius[a]) * along
        return float(far), np.array([end, end + far * along])

    def rates(self, pairs: Indices, travel: Array) -> Array:
        """(P, n) how fast each joint can change the distance of a pair [m/rad or 1]."""
        used = np.unique(pairs[:, 1])
        reach = {int(b): self._reach(int(b), travel) for b in used}
        rates = np.array([reach[int(b)] for b in pairs[:, 1]]).reshape(-1, self.arm.count)
        for row, a in zip(rates, pairs[:, 0], strict=True):
            # Joints up to the inner link move both bodies together.
            row[: self.link[a] if a < len(self.link) else 0] = 0.0
        return rates

    def _reach(self, body: int, travel: Array) -> Array:
        points = self.points[:, self.starts[body] : self.starts[body + 1]].T
        farthest = points[int(np.argmax(np.linalg.norm(points, axis=1)))]
        return self.arm.reach(int(self.link[body]), farthest, travel)

    @property
    def parts(self) -> tuple[Indices, Indices, Array, Array, Array, Array]:
        """What kernels need to know of the bodies."""
        # Writable copies: read-only arrays would make Numba compile once more.
        return (
            self.link.copy(), self.starts.copy(), self.points.copy(),
            self.radius.copy(), self.spheres.copy(), self.planes.copy(),
        )  # fmt: skip


@compiled(error_model="numpy")
def memory(joints: int, bodies: int) -> Any:
    """Memory of `place_bodies` and `gap_of` for an arm of so many joints.

    Joint frames (n + 1, 3, 3), (n + 1, 3) and axes (n, 3), middles (B, 3) of the bodies in the base
    frame; then a nearest point (3), a frame and the work of a distance.
    """
    return (
        np.empty((joints + 1, 3, 3)),
        np.empty((joints + 1, 3)),
        np.empty((joints, 3)),
        np.empty((bodies, 3)),
        np.empty(3),
        np.empty((4, 3)),
        np.empty((WORK, 6)),
    )


@compiled(error_model="numpy")
def place_bodies(joints: Array, parts: Any, q: Array, room: Any) -> None:
    """Write the joint frames and the middles of the bodies at q (n) into their `memory`."""
    link, spheres = parts[0], parts[4]
    turn, origin, axis, centres = room[:4]
    place_joints(joints, q, turn, origin, axis)
    for b in range(len(link)):
        place_point(turn[link[b]], origin[link[b]], spheres[b, :3], centres[b])


@compiled(error_model="numpy")
def gap_of(parts: Any, a: int, b: int, room: Any, enough: float, axis: Array) -> float:
    """Signed distance of a pair, or something not above it that is at least `enough` [m].

    Of bodies that `place_bodies` has placed. Writes the direction from a to b, and as the nearest
    point that of a in the frame of a's link; of a half-space the other body's, which is on the same
    line.
    """
    link, starts, points, radius, spheres, planes = parts
    turn, origin, _, centres, touch, frame, work = room
    if a >= len(link):
        normal = planes[a - len(link)]
        height = normal[3] + radius[b]
        low = -height - spheres[b, 3] + radius[b]
        for r in range(3):
            axis[r] = normal[r]
            low += normal[r] * centres[b, r]
        if low >= enough:
            return low
        least = np.inf
        x, y, z = np.empty(3), np.empty(3), np.empty(3)
        for k in range(starts[b], starts[b + 1]):
            for r in range(3):
                x[r] = points[r, k]
            place_point(turn[link[b]], origin[link[b]], x, y)
            along = normal[0] * y[0] + normal[1] * y[1] + normal[2] * y[2] - height
            if along < least:
                least = along
                z[0], z[1], z[2] = y[0], y[1], y[2]
        touch[0], touch[1], touch[2] = z[0], z[1], z[2]
        return least
    x0 = centres[b, 0] - centres[a, 0]
    x1 = centres[b, 1] - centres[a, 1]
    x2 = centres[b, 2] - centres[a, 2]
    far = math.sqrt(x0 * x0 + x1 * x1 + x2 * x2)
    low = far - spheres[a, 3] - spheres[b, 3]
    if low >= enough:
        return low
    la, lb = link[a], link[b]
    inner, outer = turn[la], turn[lb]
    relative, place = frame[:3], frame[3]
    for r in range(3):
        for c in range(3):
            relative[r, c] = (
                inner[0, r] * outer[0, c] + inner[1, r] * outer[1, c] + inner[2, r] * outer[2, c]
            )
        place[r] = (
            inner[0, r] * (origin[lb, 0] - origin[la, 0])
            + inner[1, r] * (origin[lb, 1] - origin[la, 1])
            + inner[2, r] * (origin[lb, 2] - origin[la, 2])
        )
    if axis[0] == 0.0 and axis[1] == 0.0 and axis[2] == 0.0:
        if far > 0.0:
            for r in range(3):
                axis[r] = (inner[0, r] * x0 + inner[1, r] * x1 + inner[2, r] * x2) / far
        else:
            axis[0] = 1.0
    wide = radius[a] + radius[b]
    pair = points, starts[a : a + 2], starts[b : b + 2], relative, place
    low = gap_along(pair, axis) - wide
    if low >= enough:
        return low
    return separation(pair, enough + wide, axis, touch, work) - wide


@compiled(error_model="numpy")
def _distances(joints: Array, parts: Any, pairs: Indices, q: Array, out: Array) -> None:
    """Write the distances (N, P)."""
    room, axes = memory(q.shape[1], len(parts[0])), np.zeros((len(pairs), 3))
    for k in range(len(q)):
        place_bodies(joints, parts, q[k], room)
        for p in range(len(pairs)):
            a, b = pairs[p, 0], pairs[p, 1]
            out[k, p] = gap_of(parts, a, b, room, np.inf, axes[p])


@compiled(error_model="numpy")
def _nearest(
    joints: Array,
    parts: Any,
    pairs: Indices,
    q: Array,
    required: Array,
    slack: Array,
    found: Array,
    pair: Indices,
) -> None:
    """Write the least room and the least of room less slack (2, N), and the pair (N)."""
    room, axes = memory(q.shape[1], len(parts[0])), np.zeros((len(pairs), 3))
    last = 0
    for k in range(len(q)):
        place_bodies(joints, parts, q[k], room)
        least, low, index = np.inf, np.inf, 0
        # The nearest pair of the last sample first: it may spare the others.
        for turned in range(len(pairs)):
            p = (last + turned) % len(pairs)
            off = slack[k, p]
            enough = max(least, low + off) + required[p]
            a, b = pairs[p, 0], pairs[p, 1]
            far = gap_of(parts, a, b, room, enough, axes[p])
            far -= required[p]
            if far < least:
                least, index = far, p
            low = min(low, far - off)
        found[0, k], found[1, k], pair[k] = least, low, index
        last = index


@compiled(error_model="numpy")
def _violation(
    joints: Array,
    prismatic: Indices,
    parts: Any,
    pairs: Indices,
    clearance: Array,
    q: Array,
    rates: Array,
    last: Array,
    seen: Array,
    axes: Array,
    most: float,
    out: Array,
) -> float:
    """Sum of squared violations of clearances (P); adds its derivative (N, n) to `out`."""
    n = q.shape[1]
    link, room, moved = parts[0], memory(n, len(parts[0])), np.empty(n)
    turn, origin, axis, _, touch = room[:5]
    force, moment, way, at = np.empty((n + 1, 3)), np.empty((n + 1, 3)), np.empty(3), np.empty(3)
    total = 0.0
    for k in range(len(q)):
        before, placed, row = total, False, k % len(last)
        for j in range(n):
            moved[j] = abs(q[k, j] - last[row, j])
            last[row, j] = q[k, j]
        for p in range(len(pairs)):
            left = seen[row, p]
            for j in range(n):
                left -= rates[p, j] * moved[j]
            seen[row, p] = left
            if left >= clearance[p]:
                continue
            if not placed:
                place_bodies(joints, parts, q[k], room)
                placed = True
            a, b = pairs[p, 0], pairs[p, 1]
            far = gap_of(parts, a, b, room, clearance[p], axes[row, p])
            seen[row, p] = far
            if far >= clearance[p]:
                continue
            if total == before:
                for i in range(n + 1):
                    for r in range(3):
                        force[i, r] = moment[i, r] = 0.0
            short = (clearance[p] - far) / LENGTH
            total += short * short
            first = link[a] if a < len(link) else 0
            place_point(turn[first], origin[first], touch, at)
            for r in range(3):
                way[r] = (-2.0 * short / LENGTH) * (
                    turn[first, r, 0] * axes[row, p, 0]
                    + turn[first, r, 1] * axes[row, p, 1]
                    + turn[first, r, 2] * axes[row, p, 2]
                )
            # Along the line of action the moment is the same, wherever on it the bodies touch.
            m0 = at[1] * way[2] - at[2] * way[1]
            m1 = at[2] * way[0] - at[0] * way[2]
            m2 = at[0] * way[1] - at[1] * way[0]
            for r in range(3):
                force[link[b], r] += way[r]
                force[first, r] -= way[r]
            moment[link[b], 0] += m0
            moment[link[b], 1] += m1
            moment[link[b], 2] += m2
            moment[first, 0] -= m0
            moment[first, 1] -= m1
            moment[first, 2] -= m2
        if total > before:
            collect(origin, axis, prismatic, force, moment, out[k])
            if total > most:
                break
    return total
