"""Distances between bodies, compiled."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from dynid.constraints.arm import place_joints, place_point
from dynid.constraints.scene import BOX, CYLINDER, HALF_SPACE
from dynid.core import Array, Indices

_PARALLEL = 1e-12
_HALVINGS = 48


@njit(cache=True, error_model="numpy")
def closest_on_segments(a: Array, b: Array, c: Array, d: Array) -> tuple[float, float, float]:
    """Distance between segments ab and cd, and where on each (0 to 1) they are closest."""
    u0, u1, u2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    v0, v1, v2 = d[0] - c[0], d[1] - c[1], d[2] - c[2]
    w0, w1, w2 = a[0] - c[0], a[1] - c[1], a[2] - c[2]
    uu = u0 * u0 + u1 * u1 + u2 * u2
    vv = v0 * v0 + v1 * v1 + v2 * v2
    uw = u0 * w0 + u1 * w1 + u2 * w2
    vw = v0 * w0 + v1 * w1 + v2 * w2
    uv = u0 * v0 + u1 * v1 + u2 * v2
    s, t = 0.0, 0.0
    if uu > 0.0 and vv > 0.0:
        across = uu * vv - uv * uv
        if across > _PARALLEL * uu * vv:
            s = min(max((uv * vw - uw * vv) / across, 0.0), 1.0)
        t = (uv * s + vw) / vv
        if t < 0.0:
            t, s = 0.0, min(max(-uw / uu, 0.0), 1.0)
        elif t > 1.0:
            t, s = 1.0, min(max((uv - uw) / uu, 0.0), 1.0)
    elif uu > 0.0:
        s = min(max(-uw / uu, 0.0), 1.0)
    elif vv > 0.0:
        t = min(max(vw / vv, 0.0), 1.0)
    x = w0 + s * u0 - t * v0
    y = w1 + s * u1 - t * v1
    z = w2 + s * u2 - t * v2
    return math.sqrt(x * x + y * y + z * z), s, t


@njit(cache=True, error_model="numpy")
def point_to_segment(point: Array, a: Array, b: Array) -> float:
    """Distance from a point to the segment ab."""
    along = square = off = 0.0
    for r in range(3):
        u, w = b[r] - a[r], point[r] - a[r]
        along += u * w
        square += u * u
        off += w * w
    if along > 0.0:
        off -= along * along / square if along < square else 2.0 * along - square
    return math.sqrt(max(off, 0.0))


@njit(cache=True, error_model="numpy")
def _corner(x: float, y: float) -> tuple[float, float, float]:
    """Signed distance to the quadrant x, y <= 0, and its slopes."""
    if x > 0.0 and y > 0.0:
        far = math.sqrt(x * x + y * y)
        return far, x / far, y / far
    return (x, 1.0, 0.0) if x > y else (y, 0.0, 1.0)


@njit(cache=True, error_model="numpy")
def signed_distance(shape: Array, x: float, y: float, z: float, slope: Array) -> float:
    """Signed distance from a point in the base frame to a shape, and its gradient (3).

    Args:
        shape: (16) a row of `shapes.packed`.
        x: First coordinate of the point [m].
        y: Second.
        z: Third.
        slope: (3) where the gradient is written.
    """
    x, y, z = x - shape[10], y - shape[11], z - shape[12]
    p = shape[1] * x + shape[2] * y + shape[3] * z
    q = shape[4] * x + shape[5] * y + shape[6] * z
    r = shape[7] * x + shape[8] * y + shape[9] * z
    kind = int(shape[0])
    e, f, g = 0.0, 0.0, 0.0
    if kind == HALF_SPACE:
        far, g = r, 1.0
    elif kind == BOX:
        u, v, w = abs(p) - shape[13], abs(q) - shape[14], abs(r) - shape[15]
        if u > 0.0 or v > 0.0 or w > 0.0:
            e, f, g = max(u, 0.0), max(v, 0.0), max(w, 0.0)
            far = math.sqrt(e * e + f * f + g * g)
            e, f, g = e / far, f / far, g / far
        elif u >= v and u >= w:
            far, e = u, 1.0
        elif v >= w:
            far, f = v, 1.0
        else:
            far, g = w, 1.0
        e, f, g = math.copysign(e, p), math.copysign(f, q), math.copysign(g, r)
    elif kind == CYLINDER:
        rho = math.sqrt(p * p + q * q)
        far, radial, g = _corner(rho - shape[13], abs(r) - shape[14])
        if rho > 0.0:
            e, f = radial * p / rho, radial * q / rho
        g = math.copysign(g, r)
    else:
        rho = math.sqrt(p * p + q * q + r * r)
        far = rho - shape[13]
        if rho > 0.0:
            e, f, g = p / rho, q / rho, r / rho
    slope[0] = shape[1] * e + shape[4] * f + shape[7] * g
    slope[1] = shape[2] * e + shape[5] * f + shape[8] * g
    slope[2] = shape[3] * e + shape[6] * f + shape[9] * g
    return far


@njit(cache=True, error_model="numpy")
def segment_to_shape(shape: Array, a: Array, b: Array, slope: Array) -> tuple[float, float]:
    """Least signed distance from segment ab to a shape, and where on it (0 to 1).

    The gradient (3) at that place is written into `slope`.
    """
    u0, u1, u2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    if u0 * u0 + u1 * u1 + u2 * u2 == 0.0:
        return signed_distance(shape, a[0], a[1], a[2], slope), 0.0
    far = signed_distance(shape, a[0], a[1], a[2], slope)
    falls = slope[0] * u0 + slope[1] * u1 + slope[2] * u2
    if falls >= 0.0:
        return far, 0.0
    f0, f1, f2 = slope[0], slope[1], slope[2]
    far = signed_distance(shape, b[0], b[1], b[2], slope)
    rises = slope[0] * u0 + slope[1] * u1 + slope[2] * u2
    if rises <= 0.0:
        return far, 1.0
    r0, r1, r2 = slope[0], slope[1], slope[2]
    low, high, t = 0.0, 1.0, 0.5
    for _ in range(_HALVINGS):
        t = 0.5 * (low + high)
        far = signed_distance(shape, a[0] + t * u0, a[1] + t * u1, a[2] + t * u2, slope)
        along = slope[0] * u0 + slope[1] * u1 + slope[2] * u2
        if along > 0.0:
            high, rises = t, along
            r0, r1, r2 = slope[0], slope[1], slope[2]
        elif along < 0.0:
            low, falls = t, along
            f0, f1, f2 = slope[0], slope[1], slope[2]
        else:
            return far, t
    # Inside a solid the least value may lie where two faces are equally near: the gradient
    # is the mean of both sides that has no part along the segment.
    share = rises / (rises - falls)
    slope[0] = share * f0 + (1.0 - share) * r0
    slope[1] = share * f1 + (1.0 - share) * r1
    slope[2] = share * f2 + (1.0 - share) * r2
    return far, t


@njit(cache=True, error_model="numpy")
def place_capsules(
    joints: Array,
    link: Indices,
    ends: Array,
    q: Array,
    turn: Array,
    origin: Array,
    axis: Array,
    placed: Array,
) -> None:
    """Write the capsules' ends in the base frame (C, 2, 3)."""
    place_joints(joints, q, turn, origin, axis)
    for c in range(len(link)):
        for side in range(2):
            place_point(turn[link[c]], origin[link[c]], ends[c, side], placed[c, side])


@njit(cache=True, error_model="numpy")
def place_shapes(shapes: Array, carried: int, turn: Array, origin: Array, placed: Array) -> None:
    """Write the last `carried` shapes, which stand on one link, in the base frame.

    Args:
        shapes: (S, 16) packed; the last ones in the link's frame.
        carried: How many.
        turn: (3, 3) rotation of the link's frame.
        origin: (3) its origin [m].
        placed: (S, 16) where they are written; kind and size stand there already.
    """
    for s in range(len(shapes) - carried, len(shapes)):
        place_point(turn, origin, shapes[s, 10:13], placed[s, 10:13])
        for r in range(3):
            for c in range(3):
                placed[s, 1 + 3 * r + c] = (
                    shapes[s, 1 + 3 * r] * turn[c, 0]
                    + shapes[s, 2 + 3 * r] * turn[c, 1]
                    + shapes[s, 3 + 3 * r] * turn[c, 2]
                )


@njit(cache=True, error_model="numpy")
def all_distances(
    joints: Array,
    link: Indices,
    ends: Array,
    radius: Array,
    shapes: Array,
    carried: int,
    pairs: Indices,
    overlap: Array,
    holds: Indices,
    meetings: Indices,
    nearer: Array,
    q: Array,
    own: Array,
    around: Array,
) -> None:
    """Write the distances of all pairs, (N, P + H) and (N, E)."""
    n = q.shape[1]
    turn, origin, axis = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty((n, 3))
    placed, slope, solids = np.empty((len(link), 2, 3)), np.empty(3), shapes.copy()
    for k in range(len(q)):
        place_capsules(joints, link, ends, q[k], turn, origin, axis, placed)
        place_shapes(shapes, carried, turn[n], origin[n], solids)
        for p in range(len(pairs)):
            a, b = pairs[p]
            far = closest_on_segments(placed[a, 0], placed[a, 1], placed[b, 0], placed[b, 1])[0]
            own[k, p] = far - radius[a] - radius[b] + overlap[p]
        for p in range(len(holds)):
            a, s = holds[p]
            far = segment_to_shape(solids[s], placed[a, 0], placed[a, 1], slope)[0]
            own[k, len(pairs) + p] = far - radius[a]
        for p in range(len(meetings)):
            a, s = meetings[p]
            far = segment_to_shape(solids[s], placed[a, 0], placed[a, 1], slope)[0]
            around[k, p] = far - radius[a] + nearer[p]


@njit(cache=True, error_model="numpy")
def group_distance(
    around: bool,
    group: Indices,
    spheres: Array,
    centres: Array,
    shapes: Array,
    slope: Array,
) -> float:
    """What no pair of a group is below, from the spheres around the links."""
    a, b = group[0], group[1]
    if around:
        far = signed_distance(shapes[b], centres[a, 0], centres[a, 1], centres[a, 2], slope)
        return far - spheres[a, 3]
    x, y, z = (
        centres[a, 0] - centres[b, 0],
        centres[a, 1] - centres[b, 1],
        centres[a, 2] - centres[b, 2],
    )
    return math.sqrt(x * x + y * y + z * z) - spheres[a, 3] - spheres[b, 3]


@njit(cache=True, error_model="numpy")
def nearest(
    joints: Array,
    link: Indices,
    ends: Array,
    radius: Array,
    spheres: Array,
    shapes: Array,
    carried: int,
    pairs: Indices,
    overlap: Array,
    groups: Indices,
    around: bool,
    q: Array,
    slack: Array,
    found: Array,
    pair: Indices,
) -> None:
    """Write the least distance, its pair, and the least of distance less slack.

    Args:
        joints: See `ArmGeometry`; the next six see `Bodies`.
        link: (C).
        ends: (C, 2, 3).
        radius: (C).
        spheres: (n + 1, 4).
        shapes: (S, 16).
        carried: How many of them, the last ones, stand on the last link.
        pairs: (P, 2) pairs of capsules, or of capsule and shape if `around`.
        overlap: (P) added to the distances [m].
        groups: (G, 4) two links, or link and shape; first and last + 1 of its pairs.
        around: Whether pairs are with shapes.
        q: (N, n) positions.
        slack: (N, G) what is taken off the distances of a group [m].
        found: (2, N) least distance, and least distance less slack [m].
        pair: (N) the pair of least distance.
    """
    n = q.shape[1]
    turn, origin, axis = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty((n, 3))
    placed, slope, solids = np.empty((len(link), 2, 3)), np.empty(3), shapes.copy()
    centres = np.empty((n + 1, 3))
    for k in range(len(q)):
        place_capsules(joints, link, ends, q[k], turn, origin, axis, placed)
        place_shapes(shapes, carried, turn[n], origin[n], solids)
        for i in range(n + 1):
            place_point(turn[i], origin[i], spheres[i, :3], centres[i])
        least, low, index = np.inf, np.inf, 0
        for g in range(len(groups)):
            off = slack[k, g]
            floor = group_distance(around, groups[g], spheres, centres, solids, slope)
            if floor >= least and floor - off >= low:
                continue
            outer, last, far_off = groups[g, 1], -1, False
            for p in range(groups[g, 2], groups[g, 3]):
                a, b = pairs[p]
                if a != last and not around:
                    # Pairs stand capsule by capsule: one look may spare all those of this one.
                    last = a
                    floor = point_to_segment(centres[outer], placed[a, 0], placed[a, 1])
                    floor -= spheres[outer, 3] + radius[a]
                    far_off = floor >= least and floor - off >= low
                if far_off:
                    continue
                if around:
                    far = segment_to_shape(solids[b], placed[a, 0], placed[a, 1], slope)[0]
                    far -= radius[a] - overlap[p]
                else:
                    far = closest_on_segments(
                        placed[a, 0], placed[a, 1], placed[b, 0], placed[b, 1]
                    )[0]
                    far -= radius[a] + radius[b] - overlap[p]
                if far < least:
                    least, index = far, p
                low = min(low, far - off)
        found[0, k], found[1, k], pair[k] = least, low, index
