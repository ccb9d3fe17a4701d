"""Spatial vectors for compiled kernels: angular part, then linear part.

A kernel keeps all that it works on in one small array, a row for each number and a column for each
of the samples that run side by side: with rows known when it is compiled, the compiler sees that
nothing overlaps and uses whole vector registers. Equations: Featherstone, Rigid Body Dynamics
Algorithms, ch. 2.
"""

from __future__ import annotations

from numba import njit

from dynid.core.arrays import Array

Six = tuple[float, float, float, float, float, float]


@njit(fastmath=True, error_model="numpy")
def read(work: Array, row: int, x: int) -> Six:
    """The vector in six rows of column x."""
    return (
        work[row, x],
        work[row + 1, x],
        work[row + 2, x],
        work[row + 3, x],
        work[row + 4, x],
        work[row + 5, x],
    )


@njit(fastmath=True, error_model="numpy")
def write(work: Array, row: int, x: int, a: Six) -> None:
    """Store a vector in six rows of column x."""
    work[row, x] = a[0]
    work[row + 1, x] = a[1]
    work[row + 2, x] = a[2]
    work[row + 3, x] = a[3]
    work[row + 4, x] = a[4]
    work[row + 5, x] = a[5]


@njit(fastmath=True, error_model="numpy")
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


@njit(fastmath=True, error_model="numpy")
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


@njit(fastmath=True, error_model="numpy")
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


@njit(fastmath=True, error_model="numpy")
def dot(a: Six, b: Six) -> float:
    """The power of a wrench and a motion."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4] + a[5] * b[5]


@njit(fastmath=True, error_model="numpy")
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


@njit(fastmath=True, error_model="numpy")
def to_child(work: Array, pose: int, x: int, a: Six) -> Six:
    """A motion of the parent frame in the child frame; R row-major, then p, from row pose."""
    p0, p1, p2 = work[pose + 9, x], work[pose + 10, x], work[pose + 11, x]
    r0, r1, r2 = work[pose, x], work[pose + 1, x], work[pose + 2, x]
    r3, r4, r5 = work[pose + 3, x], work[pose + 4, x], work[pose + 5, x]
    r6, r7, r8 = work[pose + 6, x], work[pose + 7, x], work[pose + 8, x]
    f0 = a[3] + a[1] * p2 - a[2] * p1
    f1 = a[4] + a[2] * p0 - a[0] * p2
    f2 = a[5] + a[0] * p1 - a[1] * p0
    return (
        r0 * a[0] + r3 * a[1] + r6 * a[2],
        r1 * a[0] + r4 * a[1] + r7 * a[2],
        r2 * a[0] + r5 * a[1] + r8 * a[2],
        r0 * f0 + r3 * f1 + r6 * f2,
        r1 * f0 + r4 * f1 + r7 * f2,
        r2 * f0 + r5 * f1 + r8 * f2,
    )


@njit(fastmath=True, error_model="numpy")
def to_parent(work: Array, pose: int, x: int, f: Six) -> Six:
    """A wrench of the child frame in the parent frame, the transpose of `to_child`."""
    p0, p1, p2 = work[pose + 9, x], work[pose + 10, x], work[pose + 11, x]
    r0, r1, r2 = work[pose, x], work[pose + 1, x], work[pose + 2, x]
    r3, r4, r5 = work[pose + 3, x], work[pose + 4, x], work[pose + 5, x]
    r6, r7, r8 = work[pose + 6, x], work[pose + 7, x], work[pose + 8, x]
    g0 = r0 * f[3] + r1 * f[4] + r2 * f[5]
    g1 = r3 * f[3] + r4 * f[4] + r5 * f[5]
    g2 = r6 * f[3] + r7 * f[4] + r8 * f[5]
    return (
        r0 * f[0] + r1 * f[1] + r2 * f[2] + p1 * g2 - p2 * g1,
        r3 * f[0] + r4 * f[1] + r5 * f[2] + p2 * g0 - p0 * g2,
        r6 * f[0] + r7 * f[1] + r8 * f[2] + p0 * g1 - p1 * g0,
        g0,
        g1,
        g2,
    )


@njit(fastmath=True, error_model="numpy")
def place(work: Array, pose: int, geom: Array, cosine: Array, sine: Array, q: Array) -> None:
    """Write the pose of a frame in its parent, R row-major then p, for one lane each."""
    lanes = work.shape[1]
    for r in range(9):
        for x in range(lanes):
            work[pose + r, x] = geom[r] + geom[9 + r] * cosine[x] + geom[18 + r] * sine[x]
    for r in range(3):
        for x in range(lanes):
            turned = geom[30 + r] * cosine[x] + geom[33 + r] * sine[x]
            work[pose + 9 + r, x] = geom[27 + r] + turned + geom[36 + r] * q[x]


@njit(fastmath=True, error_model="numpy")
def load(store: Array, work: Array, row: int) -> None:
    """Copy a block of rows into the working array, from its row `row`."""
    for r in range(store.shape[0]):
        for x in range(work.shape[1]):
            work[row + r, x] = store[r, x]


@njit(fastmath=True, error_model="numpy")
def save(work: Array, row: int, store: Array) -> None:
    """Copy a block of rows out of the working array, from its row `row`."""
    for r in range(store.shape[0]):
        for x in range(work.shape[1]):
            store[r, x] = work[row + r, x]
