"""Presliding: friction builds up over a small displacement after each reversal.

Teeth and balls deform before they slide. Dahl's model (Dahl 1968; the rate-independent part of
LuGre, Canudas de Wit et al. 1995) has one state z a joint, dz/dq = (1 - z sign(dq)) / delta: it
stands in for the sign of the velocity, and at rest stays what it was. The state follows from the
positions alone, so that the Coulomb column stays linear in its parameter.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from dynid.core.arrays import Array


def friction_state(q: Array, displacement: Array, *, periodic: bool = False) -> Array:
    """The state of friction along a motion.

    Args:
        q: (n, N) positions in the order of time [rad or m].
        displacement: (n) delta, over which friction builds up [rad or m], above 0.
        periodic: The motion is one period of many: it begins as it ends. Else it begins at 0,
            and is forgotten after a few displacements.

    Returns:
        (n, N) from -1 to 1.
    """
    samples = q.shape[1]
    if not samples:
        return np.zeros(q.shape)
    whole = np.concatenate([q, q], axis=1) if periodic else np.array(q, order="C")
    state = np.zeros(whole.shape)
    _follow(whole, np.array(displacement), state)
    return state[:, -samples:]


@njit(cache=True)
def _follow(q: Array, displacement: Array, state: Array) -> None:
    for j in range(q.shape[0]):
        z = 0.0
        for i in range(1, q.shape[1]):
            step = (q[j, i] - q[j, i - 1]) / displacement[j]
            # Exact between two samples: the velocity keeps its sign.
            if step > 0.0:
                z = 1.0 - (1.0 - z) * math.exp(-step)
            elif step < 0.0:
                z = (1.0 + z) * math.exp(step) - 1.0
            state[j, i] = z
