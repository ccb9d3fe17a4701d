"""Whether a record was made with another payload than the one that was identified from."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from dynid.core.arrays import Array
from dynid.core.notices import Notice
from dynid.identification.estimate import Estimate
from dynid.signals.samples import Samples

LEFT = 0.2
"""Share of the squared error that a payload has to leave at most."""
CERTAIN = 7.0
"""Mass over its standard deviation, from leaving stretches out."""
LEAST_KG = 0.05
STRETCHES = 6
RIDGE = 1e-6
POINT = 4
"""Mass and first moments: a load as small as a point leaves less room for other faults."""
FARTHEST_M = 0.6
"""Of its centre from the last joint's frame."""
CARRIED = "at the last link than the identification's"


def carried_mass(estimate: Estimate, samples: Samples, error: Array) -> tuple[float, float] | None:
    """Mass [kg] that explains the errors, and its standard deviation.

    Args:
        estimate: The estimate.
        samples: The record that it predicts.
        error: (N, n) measured minus predicted torques of its used rows [N.m or N].

    Returns:
        None where a payload does not explain nearly all of them.
    """
    model, rows = estimate.model, samples.rows
    last = 10 * (model.robot.joints - 1)
    stack = model.stack(samples.q, samples.dq, samples.ddq)[last : last + 10]
    columns = samples.as_recorded(stack)[..., rows] / estimate.noise[:, None]
    weighted = error.T / estimate.noise[:, None]
    count = weighted.shape[1]
    cuts = [k * count // STRETCHES for k in range(STRETCHES + 1)]
    parts = [slice(a, b) for a, b in pairwise(cuts)]
    square = np.array([np.einsum("rjt,sjt->rs", columns[..., p], columns[..., p]) for p in parts])
    cross = np.array([np.einsum("rjt,jt->r", columns[..., p], weighted[:, p]) for p in parts])
    scale = np.sqrt(np.maximum(np.diag(square.sum(axis=0)), 1e-300))
    square, cross = square / scale / scale[:, None], cross / scale

    def fitted(chosen: list[int], size: int) -> Array:
        matrix = square[chosen].sum(axis=0)[:size, :size] + RIDGE * np.eye(size)
        inverse: Array = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
        return inverse @ cross[chosen].sum(axis=0)[:size]

    everything = list(range(STRETCHES))
    point = fitted(everything, POINT)
    matrix, vector = square.sum(axis=0)[:POINT, :POINT], cross.sum(axis=0)[:POINT]
    before = float(np.square(weighted).sum())
    if before + float(point @ matrix @ point - 2 * point @ vector) > LEFT * before:
        return None
    lever = float(np.linalg.norm(point[1:] / scale[1:POINT])) * scale[0]
    # Its inertia counts for the mass: a load far from the joint's frame has much of it.
    masses = [fitted([k for k in everything if k != out], 10)[0] for out in everything]
    spread = float(np.sqrt((STRETCHES - 1) * np.var(masses)) / scale[0])
    mass = float(fitted(everything, 10)[0] / scale[0])
    if abs(mass) < max(CERTAIN * spread, LEAST_KG) or lever > FARTHEST_M * abs(point[0]):
        return None
    return mass, spread


def another_payload(estimate: Estimate, samples: Samples, error: Array) -> tuple[Notice, ...]:
    """`carried_mass` in words."""
    found = carried_mass(estimate, samples, error)
    if found is None:
        return ()
    mass, spread = found
    text = (
        f"this record carries {abs(mass):.2f} +- {spread:.2g} kg {'more' if mass > 0 else 'less'} "
        f"{CARRIED}: predict what is carried, or find it with dynid payload"
    )
    return (Notice("unit_suspect", text),)
