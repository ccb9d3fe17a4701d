"""Distances between segments and from points to solids, compiled.

Segments: Ericson, Real-Time Collision Detection, 5.1.9. A solid is judged by its signed
distance, which is convex for a convex solid, so its least value along a segment is found by
halving where its slope changes sign.
"""

from __future__ import annotations

import math

from numba import njit

from dynid.constraints.shapes import BOX, CYLINDER, HALF_SPACE
from dynid.core.arrays import Array

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
