"""A payload on the simulated arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from dynid.core.arrays import frozen
from dynid.core.errors import InputError
from dynid.simulation.inertia import in_parent_frame, link_parameters
from dynid.simulation.truth import SimulatedArm


def with_payload(
    arm: SimulatedArm, mass: float, centre: ArrayLike, tensor: ArrayLike
) -> SimulatedArm:
    """The arm with a body fixed to its flange; its controller does not know of it.

    Args:
        arm: The arm.
        mass: Mass [kg], positive.
        centre: (3) centre of mass in the flange frame [m].
        tensor: (3, 3) inertia about the centre of mass, along the flange's axes [kg.m^2].

    Raises:
        InputError: A mass that is not positive, or shapes that are wrong.
    """
    if not mass > 0:
        raise InputError("a payload needs a positive mass", value=mass)
    body = link_parameters(
        mass,
        frozen(centre, shape=(3,), name="centre of mass"),
        frozen(tensor, shape=(3, 3), name="inertia tensor"),
    )
    inertials = np.array(arm.truth.inertials)
    inertials[-1] += in_parent_frame(body, arm.robot.flange)
    return replace(arm, truth=replace(arm.truth, inertials=inertials))
