"""Sine and cosine in a form that compilers run for several samples side by side.

The mathematical library's functions are called one number at a time: half of the regressor's time.
Reduction and polynomials are those of fdlibm (Sun Microsystems, 1993), good to the last digit.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from dynid.core.arrays import Array

QUARTERS = 2.0 / math.pi
# Half pi in three parts; whole numbers of quarter turns times the first are exact up to 2^20.
PART1, PART2, PART3 = 1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063e-21
S1, S2, S3 = -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04
S4, S5, S6 = 2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10
C1, C2, C3 = 4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05
C4, C5, C6 = -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11


# Not fastmath, nor called from what is: the parts of half pi must not be added up.
@njit(cache=True, boundscheck=False, error_model="numpy")
def cosines_sines(angles: Array, out: Array) -> None:
    """Write cosine and sine of angles (n, N) [rad] into out (2, n, N)."""
    rows, samples = angles.shape
    for i in range(rows):
        for x in range(samples):
            angle = angles[i, x]
            k = math.floor(angle * QUARTERS + 0.5)
            r = ((angle - k * PART1) - k * PART2) - k * PART3
            z = r * r
            s = S4 + z * (S5 + z * S6)
            s = r + r * (z * (S1 + z * (S2 + z * (S3 + z * s))))
            c = C4 + z * (C5 + z * C6)
            c = 1.0 - (0.5 * z - z * (z * (C1 + z * (C2 + z * (C3 + z * c)))))
            quarter = k - 4.0 * math.floor(0.25 * k)
            turned = quarter == 1.0 or quarter == 3.0
            cosine = s if turned else c
            sine = c if turned else s
            out[0, i, x] = -cosine if quarter == 1.0 or quarter == 2.0 else cosine
            out[1, i, x] = -sine if quarter >= 2.0 else sine


def turns(q: Array) -> Array:
    """(2, n, N) cosine and sine of angles (n, N) [rad]."""
    out = np.empty((2, *q.shape))
    cosines_sines(q, out)
    return out
