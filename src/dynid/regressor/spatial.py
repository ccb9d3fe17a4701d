"""Spatial vectors of the recursions, several samples side by side (Featherstone, ch. 2)."""

from dynid.core import Array, compiled

LANES = 16
"""Whole cache lines and several vector registers; 8 cost half as much again, 32 gain little."""
REPEATABLE = {"nnan", "ninf", "nsz", "arcp", "contract", "afn"}
"""Fast arithmetic that keeps the order of sums: with `reassoc`, code that Numba has just compiled
and the same code from its cache round differently, and a design would depend on which it was."""
Six = tuple[float, float, float, float, float, float]


@compiled(cache=False, fastmath=REPEATABLE, error_model="numpy")
def motion_cross(a: Six, b: Six) -> Six:
    """`a x b` of two motions."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
        a[1] * b[5] - a[2] * b[4] + a[4] * b[2] - a[5] * b[1],
        a[2] * b[3] - a[0] * b[5] + a[5] * b[0] - a[3] * b[2],
        a[0] * b[4] - a[1] * b[3] + a[3] * b[1] - a[4] * b[0],
    )


@compiled(cache=False, fastmath=REPEATABLE, error_model="numpy")
def force_cross(a: Six, f: Six) -> Six:
    """`a x* f` of a motion and a wrench, the negative transpose of a x."""
    return (
        a[1] * f[2] - a[2] * f[1] + a[4] * f[5] - a[5] * f[4],
        a[2] * f[0] - a[0] * f[2] + a[5] * f[3] - a[3] * f[5],
        a[0] * f[1] - a[1] * f[0] + a[3] * f[4] - a[4] * f[3],
        a[1] * f[5] - a[2] * f[4],
        a[2] * f[3] - a[0] * f[5],
        a[0] * f[4] - a[1] * f[3],
    )


@compiled(cache=False, fastmath=REPEATABLE, error_model="numpy")
def momentum(link: Array, a: Six) -> Six:
    """I a, the inertia given by the ten parameters of a link."""
    m, mx, my, mz = link[0], link[1], link[2], link[3]
    xx, yy, zz, yz, xz, xy = link[4], link[5], link[6], link[7], link[8], link[9]
    return (
        xx * a[0] + xy * a[1] + xz * a[2] + my * a[5] - mz * a[4],
        xy * a[0] + yy * a[1] + yz * a[2] + mz * a[3] - mx * a[5],
        xz * a[0] + yz * a[1] + zz * a[2] + mx * a[4] - my * a[3],
        m * a[3] + a[1] * mz - a[2] * my,
        m * a[4] + a[2] * mx - a[0] * mz,
        m * a[5] + a[0] * my - a[1] * mx,
    )


@compiled(cache=False, fastmath=REPEATABLE, error_model="numpy")
def dot(a: Six, b: Six) -> float:
    """The power of a wrench and a motion."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4] + a[5] * b[5]


@compiled(cache=False, fastmath=REPEATABLE, error_model="numpy")
def read(block: Array, x: int) -> Six:
    """The vector of lane x of a (6, LANES) block."""
    return block[0, x], block[1, x], block[2, x], block[3, x], block[4, x], block[5, x]


@compiled(cache=False, fastmath=REPEATABLE, error_model="numpy")
def write(block: Array, x: int, a: Six) -> None:
    """Store a vector in lane x of a (6, LANES) block."""
    block[0, x], block[1, x], block[2, x] = a[0], a[1], a[2]
    block[3, x], block[4, x], block[5, x] = a[3], a[4], a[5]


@compiled(cache=False, fastmath=REPEATABLE, error_model="numpy")
def plus(a: Six, b: Six, factor: float) -> Six:
    """`a + factor b`."""
    return (
        a[0] + factor * b[0],
        a[1] + factor * b[1],
        a[2] + factor * b[2],
        a[3] + factor * b[3],
        a[4] + factor * b[4],
        a[5] + factor * b[5],
    )


@compiled(cache=False, fastmath=REPEATABLE, error_model="numpy")
def to_child(pose: Array, x: int, a: Six) -> Six:
    """A motion of the parent frame in the child frame; pose holds R row-major, then p."""
    p0, p1, p2 = pose[9, x], pose[10, x], pose[11, x]
    f0 = a[3] + a[1] * p2 - a[2] * p1
    f1 = a[4] + a[2] * p0 - a[0] * p2
    f2 = a[5] + a[0] * p1 - a[1] * p0
    return (
        pose[0, x] * a[0] + pose[3, x] * a[1] + pose[6, x] * a[2],
        pose[1, x] * a[0] + pose[4, x] * a[1] + pose[7, x] * a[2],
        pose[2, x] * a[0] + pose[5, x] * a[1] + pose[8, x] * a[2],
        pose[0, x] * f0 + pose[3, x] * f1 + pose[6, x] * f2,
        pose[1, x] * f0 + pose[4, x] * f1 + pose[7, x] * f2,
        pose[2, x] * f0 + pose[5, x] * f1 + pose[8, x] * f2,
    )


@compiled(cache=False, fastmath=REPEATABLE, error_model="numpy")
def to_parent(pose: Array, x: int, f: Six) -> Six:
    """A wrench of the child frame in the parent frame, the transpose of `to_child`."""
    p0, p1, p2 = pose[9, x], pose[10, x], pose[11, x]
    g0 = pose[0, x] * f[3] + pose[1, x] * f[4] + pose[2, x] * f[5]
    g1 = pose[3, x] * f[3] + pose[4, x] * f[4] + pose[5, x] * f[5]
    g2 = pose[6, x] * f[3] + pose[7, x] * f[4] + pose[8, x] * f[5]
    return (
        pose[0, x] * f[0] + pose[1, x] * f[1] + pose[2, x] * f[2] + p1 * g2 - p2 * g1,
        pose[3, x] * f[0] + pose[4, x] * f[1] + pose[5, x] * f[2] + p2 * g0 - p0 * g2,
        pose[6, x] * f[0] + pose[7, x] * f[1] + pose[8, x] * f[2] + p0 * g1 - p1 * g0,
        g0,
        g1,
        g2,
    )


@compiled(cache=False, fastmath=REPEATABLE, boundscheck=False, error_model="numpy")
def outward(
    geom: Array,
    screw: Array,
    grav: Array,
    turn: Array,
    state: Array,
    first: int,
    pose: Array,
    vel: Array,
    acc: Array,
) -> None:
    """Placements, velocities and accelerations of all links, from the base on.

    Of `LANES` samples from `first` on, written to pose (n, 12, LANES), each link in the one before,
    and to vel and acc (n, 6, LANES) in the links' frames, gravity included. See `ChainConstants`
    for the chain and `turns` for the cosines and sines (2, n, N) of the state (3, n, N).
    """
    for i in range(len(geom)):
        g = geom[i]
        s = (screw[i, 0], screw[i, 1], screw[i, 2], screw[i, 3], screw[i, 4], screw[i, 5])
        here, vel_here, acc_here = pose[i], vel[i], acc[i]
        vel_before, acc_before = vel[max(i - 1, 0)], acc[max(i - 1, 0)]
        for x in range(LANES):
            c, sn, qx = turn[0, i, first + x], turn[1, i, first + x], state[0, i, first + x]
            for r in range(9):
                here[r, x] = g[r] + g[9 + r] * c + g[18 + r] * sn
            for r in range(3):
                here[9 + r, x] = g[27 + r] + g[30 + r] * c + g[33 + r] * sn + g[36 + r] * qx
        for x in range(LANES):
            v = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            a = (0.0, 0.0, 0.0, -grav[0], -grav[1], -grav[2])
            if i > 0:
                v, a = read(vel_before, x), read(acc_before, x)
            speed = state[1, i, first + x]
            v = plus(to_child(here, x, v), s, speed)
            a = plus(to_child(here, x, a), s, state[2, i, first + x])
            write(vel_here, x, v)
            write(acc_here, x, plus(a, motion_cross(v, s), speed))


@compiled(cache=False, fastmath=REPEATABLE, boundscheck=False, error_model="numpy")
def origin_motion(vel: Array, acc: Array, origin: Array, b: Array) -> None:
    """Classical acceleration (3, LANES) of a frame's origin and B = [dw]x + [w]x [w]x (9, LANES).

    Of the frame's velocity and acceleration (6, LANES).
    """
    for x in range(LANES):
        v, a = read(vel, x), read(acc, x)
        w0, w1, w2 = v[0], v[1], v[2]
        origin[0, x] = a[3] + w1 * v[5] - w2 * v[4]
        origin[1, x] = a[4] + w2 * v[3] - w0 * v[5]
        origin[2, x] = a[5] + w0 * v[4] - w1 * v[3]
        b[0, x] = -w1 * w1 - w2 * w2
        b[1, x] = w0 * w1 - a[2]
        b[2, x] = w0 * w2 + a[1]
        b[3, x] = w0 * w1 + a[2]
        b[4, x] = -w0 * w0 - w2 * w2
        b[5, x] = w1 * w2 - a[0]
        b[6, x] = w0 * w2 - a[1]
        b[7, x] = w1 * w2 + a[0]
        b[8, x] = -w0 * w0 - w1 * w1
