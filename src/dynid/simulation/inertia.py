"""The ten inertial parameters of a link, and its mass, centre of mass and tensor.

The simulated arm has its own few lines for this: it must not borrow the model it is there to
test.
"""

from __future__ import annotations

import numpy as np

from dynid.core.arrays import Array

_TENSOR = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
"""Entries Jxx, Jyy, Jzz, Jyz, Jxz, Jxy."""


def link_parameters(mass: float, com: Array, tensor: Array) -> Array:
    """(10) m, mx, my, mz, Jxx, Jyy, Jzz, Jyz, Jxz, Jxy about the frame origin.

    Args:
        mass: Mass [kg].
        com: (3) centre of mass in the frame [m].
        tensor: (3, 3) inertia about the centre of mass, along the frame's axes [kg.m^2].
    """
    about_origin = tensor + mass * _steiner(com)
    return np.concatenate(
        [[mass], mass * com, [about_origin[row, column] for row, column in _TENSOR]]
    )


def link_body(parameters: Array) -> tuple[float, Array, Array]:
    """The mass [kg], centre of mass (3) [m] and tensor about it (3, 3) [kg.m^2].

    Args:
        parameters: (10) as `link_parameters` gives them, mass not zero.
    """
    mass = float(parameters[0])
    com = parameters[1:4] / mass
    tensor = np.empty((3, 3))
    for (row, column), value in zip(_TENSOR, parameters[4:], strict=True):
        tensor[row, column] = tensor[column, row] = value
    return mass, com, tensor - mass * _steiner(com)


def in_parent_frame(parameters: Array, placement: Array) -> Array:
    """The ten parameters (10) of the same body, about the parent frame.

    Args:
        parameters: (10) about the inner frame.
        placement: (4, 4) inner frame in the parent frame [m].
    """
    mass, com, tensor = link_body(parameters)
    rotation, origin = placement[:3, :3], placement[:3, 3]
    return link_parameters(mass, rotation @ com + origin, rotation @ tensor @ rotation.T)


def cylinder(mass: float, radius: float, length: float, axis: int) -> Array:
    """(3, 3) the tensor of a solid cylinder about its middle [kg.m^2].

    Args:
        mass: Mass [kg].
        radius: Radius [m].
        length: Length [m].
        axis: 0, 1 or 2: the frame axis along the cylinder.
    """
    diagonal = np.full(3, mass * (3 * radius**2 + length**2) / 12)
    diagonal[axis] = mass * radius**2 / 2
    return np.diag(diagonal)


def _steiner(com: Array) -> Array:
    return (com @ com) * np.eye(3) - np.outer(com, com)
