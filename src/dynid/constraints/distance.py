"""Signed distances between convex bodies, compiled.

A body is the hull of points, inflated by a radius. Gilbert, Johnson and Keerthi (1988) walk to
the point of the Minkowski difference A - B that is nearest to the origin; where the hulls
overlap, the expanding polytope (van den Bergh 2001) gives the depth. The direction found last is
kept by the caller, so that a far pair costs one look along it.
"""

import math
from typing import Any

import numpy as np

from dynid.core import Array, Indices, compiled

_WITHIN = 1e-14
"""Relative error of a distance; that of its direction is as the root of it."""
_ON_SIMPLEX = 1e-9
"""Distance below which the origin lies on a simplex [m]."""
_DEPTH_WITHIN = 1e-13
"""Error of a depth [m]."""
_STEPS = 64
_CORNERS, _FACES = 64, 160
"""Of the polytope that measures a depth."""
WORK = _CORNERS + 4
"""Rows of the work array."""


@compiled(fastmath=True, error_model="numpy")
def gap_along(pair: Any, axis: Array) -> float:
    """How far apart two hulls are along an axis from A to B: no more than their distance.

    A pair is points (3, T) of all bodies in the frames of their links [m], start and stop (2) of
    those of A and of B, and how B's link is turned (3, 3) and placed (3) in the frame of A's, in
    which the unit axis (3) is, too.
    """
    points, a, b, turn, place = pair
    x, y, z = axis[0], axis[1], axis[2]
    most = -1e300
    for k in range(a[0], a[1]):
        most = max(most, points[0, k] * x + points[1, k] * y + points[2, k] * z)
    u = turn[0, 0] * x + turn[1, 0] * y + turn[2, 0] * z
    v = turn[0, 1] * x + turn[1, 1] * y + turn[2, 1] * z
    w = turn[0, 2] * x + turn[1, 2] * y + turn[2, 2] * z
    least = 1e300
    for k in range(b[0], b[1]):
        least = min(least, points[0, k] * u + points[1, k] * v + points[2, k] * w)
    return place[0] * x + place[1] * y + place[2] * z + least - most


@compiled(error_model="numpy")
def _corner(pair: Any, axis: Array, row: Array) -> float:
    """Write the corner (3) of A - B farthest along an axis, then its point (3) of A.

    Returns how far that is.
    """
    points, a, b, turn, place = pair
    x, y, z = axis[0], axis[1], axis[2]
    most, i = -np.inf, 0
    for k in range(a[0], a[1]):
        along = points[0, k] * x + points[1, k] * y + points[2, k] * z
        if along > most:
            most, i = along, k
    u = turn[0, 0] * x + turn[1, 0] * y + turn[2, 0] * z
    v = turn[0, 1] * x + turn[1, 1] * y + turn[2, 1] * z
    w = turn[0, 2] * x + turn[1, 2] * y + turn[2, 2] * z
    least, j = np.inf, 0
    for k in range(b[0], b[1]):
        along = points[0, k] * u + points[1, k] * v + points[2, k] * w
        if along < least:
            least, j = along, k
    for r in range(3):
        row[3 + r] = points[r, i]
        row[r] = points[r, i] - place[r]
        for c in range(3):
            row[r] -= turn[r, c] * points[c, j]
    return most - least - (place[0] * x + place[1] * y + place[2] * z)


@compiled(error_model="numpy")
def _dot(a: Array, b: Array) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled(error_model="numpy")
def _normal(a: Array, b: Array, c: Array, out: Array) -> float:
    """Write (b - a) x (c - a); returns its squared length."""
    u0, u1, u2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    v0, v1, v2 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    out[0], out[1], out[2] = u1 * v2 - u2 * v1, u2 * v0 - u0 * v2, u0 * v1 - u1 * v0
    return out[0] * out[0] + out[1] * out[1] + out[2] * out[2]


@compiled(error_model="numpy")
def _near_edge(a: Array, b: Array) -> tuple[float, float]:
    """Squared distance of the origin from segment ab, and the share of b."""
    u0, u1, u2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    square = u0 * u0 + u1 * u1 + u2 * u2
    t = -(a[0] * u0 + a[1] * u1 + a[2] * u2)
    t = min(max(t / square, 0.0), 1.0) if square > 0.0 else 0.0
    x, y, z = a[0] + t * u0, a[1] + t * u1, a[2] + t * u2
    return x * x + y * y + z * z, t


@compiled(error_model="numpy")
def _near_face(a: Array, b: Array, c: Array, share: Array, normal: Array) -> float:
    """Squared distance of the origin from triangle abc; writes the shares (3) of its corners."""
    square = _normal(a, b, c, normal)
    if square > 0.0:
        # Areas of the triangles between the origin's foot and each edge.
        u = normal[0] * (b[1] * c[2] - b[2] * c[1])
        u += normal[1] * (b[2] * c[0] - b[0] * c[2]) + normal[2] * (b[0] * c[1] - b[1] * c[0])
        v = normal[0] * (c[1] * a[2] - c[2] * a[1])
        v += normal[1] * (c[2] * a[0] - c[0] * a[2]) + normal[2] * (c[0] * a[1] - c[1] * a[0])
        w = square - u - v
        if u >= 0.0 and v >= 0.0 and w >= 0.0:
            share[0], share[1], share[2] = u / square, v / square, w / square
            height = _dot(normal, a)
            return height * height / square
    far, t = _near_edge(a, b)
    share[0], share[1], share[2] = 1.0 - t, t, 0.0
    other, t = _near_edge(b, c)
    if other < far:
        far = other
        share[0], share[1], share[2] = 0.0, 1.0 - t, t
    other, t = _near_edge(c, a)
    if other < far:
        far = other
        share[0], share[1], share[2] = t, 0.0, 1.0 - t
    return far


@compiled(error_model="numpy")
def _reduce(rows: Array, count: int, share: Array, three: Array, normal: Array) -> int:
    """Keep the corners of a simplex (count, 6) that hold its point nearest to the origin.

    Writes their shares (4). Returns how many are left, 4 where the origin is inside.
    """
    if count == 1:
        share[0] = 1.0
    elif count == 2:
        share[1] = _near_edge(rows[0], rows[1])[1]
        share[0] = 1.0 - share[1]
    elif count == 3:
        _near_face(rows[0], rows[1], rows[2], share, normal)
    else:
        best, inside = np.inf, True
        for f in range(4):
            i, j, k = (f + 1) % 4, (f + 2) % 4, (f + 3) % 4
            square = _normal(rows[i], rows[j], rows[k], normal)
            height = _dot(normal, rows[i])
            other = _dot(normal, rows[f]) - height
            # Of a flat tetrahedron every face counts.
            if other * other > 1e-20 * square and height * other < 0.0:
                continue
            inside = False
            far = _near_face(rows[i], rows[j], rows[k], three, normal)
            if far < best:
                best = far
                share[f] = 0.0
                share[i], share[j], share[k] = three[0], three[1], three[2]
        if inside:
            return 4
    left = 0
    for k in range(count):
        if share[k] > 0.0:
            for r in range(6):
                rows[left, r] = rows[k, r]
            share[left] = share[k]
            left += 1
    return left


@compiled(error_model="numpy")
def _completed(pair: Any, rows: Array, count: int) -> bool:
    """Add corners of A - B to a simplex (count, 6) until it has four; False where A - B is flat."""
    axis = np.array([1.0, 0.0, 0.0])
    while count < 4:
        if count == 2:
            x, y, z = rows[1, 0] - rows[0, 0], rows[1, 1] - rows[0, 1], rows[1, 2] - rows[0, 2]
            # Across the edge: the cross product with z or x that is not short.
            if abs(x) > abs(z):
                axis[0], axis[1], axis[2] = y, -x, 0.0
            else:
                axis[0], axis[1], axis[2] = 0.0, z, -y
        elif count == 3:
            _normal(rows[0], rows[1], rows[2], axis)
        size = math.sqrt(_dot(axis, axis))
        if size == 0.0:
            return False
        for r in range(3):
            axis[r] /= size
        height = _dot(axis, rows[0])
        if _corner(pair, axis, rows[count]) - height < _ON_SIMPLEX:
            for r in range(3):
                axis[r] = -axis[r]
            if _corner(pair, axis, rows[count]) + height < _ON_SIMPLEX:
                return False
        count += 1
    return True


@compiled(error_model="numpy")
def separation(pair: Any, enough: float, axis: Array, touch: Array, work: Array) -> float:
    """Signed distance [m] between two hulls, or a lower bound of it that is at least `enough`.

    The pair is that of `gap_along`. The axis is a guess, replaced by the direction found: the
    distance grows as B moves along it. Writes A's point (3) nearest to B, in A's frame, unless the
    pair is far apart. Where the hulls overlap, it is less the depth. `work` is (WORK, 6).
    """
    share, three, normal = np.empty(4), np.empty(3), np.empty(3)
    _corner(pair, axis, work[0])
    count, far = 0, np.inf
    for _ in range(_STEPS):
        count = _reduce(work, count + 1, share, three, normal)
        if count == 4:
            return -_depth(pair, axis, touch, work)
        x = y = z = 0.0
        for k in range(count):
            x += share[k] * work[k, 0]
            y += share[k] * work[k, 1]
            z += share[k] * work[k, 2]
        last, far = far, math.sqrt(x * x + y * y + z * z)
        if far < _ON_SIMPLEX and _completed(pair, work, count):
            return -_depth(pair, axis, touch, work)
        if far < _ON_SIMPLEX or far >= last:
            break
        axis[0], axis[1], axis[2] = -x / far, -y / far, -z / far
        low = -_corner(pair, axis, work[count])
        if low >= enough:
            return low
        if far - low <= _WITHIN * far:
            break
    for r in range(3):
        touch[r] = 0.0
        for k in range(count):
            touch[r] += share[k] * work[k, 3 + r]
    # Flat hulls in one plane that cross: no depth, but no touching either.
    return far if far >= _ON_SIMPLEX else -_ON_SIMPLEX


@compiled(error_model="numpy")
def _depth(pair: Any, axis: Array, touch: Array, rows: Array) -> float:
    """How deep the origin is in A - B, from a tetrahedron (4, 6) around it."""
    faces, edges = np.empty((_FACES, 3), dtype=np.intp), np.empty((3 * _FACES, 2), dtype=np.intp)
    normals, heights = np.empty((_FACES, 3)), np.empty(_FACES)
    share, spare = np.empty(3), np.empty(3)
    count, corners = 0, 4
    for f in range(4):
        i, j, k = (f + 1) % 4, (f + 2) % 4, (f + 3) % 4
        _normal(rows[i], rows[j], rows[k], spare)
        if _dot(spare, rows[f]) > _dot(spare, rows[i]):
            j, k = k, j
        count = _add_face(rows, i, j, k, faces, normals, heights, count)
    nearest = 0
    while True:
        nearest = 0
        for f in range(1, count):
            if heights[f] < heights[nearest]:
                nearest = f
        if corners == _CORNERS or count > _FACES - 32:
            break
        top = rows[corners]
        reach = _corner(pair, normals[nearest], top)
        if reach - heights[nearest] <= _DEPTH_WITHIN:
            break
        kept = loose = 0
        for f in range(count):
            if _dot(normals[f], top) <= heights[f] + 1e-12:
                for r in range(3):
                    faces[kept, r] = faces[f, r]
                    normals[kept, r] = normals[f, r]
                heights[kept] = heights[f]
                kept += 1
                continue
            # Edges that two such faces share are inside the hole; the others are its rim.
            for s in range(3):
                i, j = faces[f, s], faces[f, (s + 1) % 3]
                found = -1
                for e in range(loose):
                    if edges[e, 0] == j and edges[e, 1] == i:
                        found = e
                if found >= 0:
                    loose -= 1
                    edges[found, 0], edges[found, 1] = edges[loose, 0], edges[loose, 1]
                else:
                    edges[loose, 0], edges[loose, 1] = i, j
                    loose += 1
        count = kept
        for e in range(min(loose, _FACES - kept)):
            i, j = edges[e, 0], edges[e, 1]
            count = _add_face(rows, i, j, corners, faces, normals, heights, count)
        corners += 1
    # Of faces in one plane, the one over the origin.
    height, best = heights[nearest], np.inf
    for f in range(count):
        if heights[f] <= height + 1e-9:
            i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
            far = _near_face(rows[i], rows[j], rows[k], share, spare)
            if far < best:
                best, nearest = far, f
    i, j, k = faces[nearest, 0], faces[nearest, 1], faces[nearest, 2]
    _near_face(rows[i], rows[j], rows[k], share, spare)
    for r in range(3):
        axis[r] = normals[nearest, r]
        touch[r] = share[0] * rows[i, 3 + r] + share[1] * rows[j, 3 + r] + share[2] * rows[k, 3 + r]
    return heights[nearest]


@compiled(error_model="numpy")
def _add_face(
    rows: Array, i: int, j: int, k: int, faces: Indices, normals: Array, heights: Array, count: int
) -> int:
    """Add a face with its unit normal and its height above the origin; returns the new count."""
    square = _normal(rows[i], rows[j], rows[k], normals[count])
    size = math.sqrt(square)
    for r in range(3):
        normals[count, r] = normals[count, r] / size if size > 1e-15 else 0.0
    # A face that is a line is no candidate, and goes as soon as it can be seen.
    heights[count] = _dot(normals[count], rows[i]) if size > 1e-15 else np.inf
    faces[count, 0], faces[count, 1], faces[count, 2] = i, j, k
    return count + 1
