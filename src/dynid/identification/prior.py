"""What is known of the links before any data: CAD values, completed where unpublished."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array, frozen
from dynid.robot.inertia import from_pseudo_inertia, move, to_pseudo_inertia
from dynid.robot.model import RobotModel

THICKNESS = 0.1
"""Diameter of a body of unknown shape, over the arm's reach."""
DENSITY = 1500.0
"""Of a body of unknown mass: aluminium housings, motors and gears, not solid [kg/m^3]."""
THINNEST = 0.1
"""Smallest radius of gyration over that diameter: flatter published bodies are made thicker."""


@dataclass(frozen=True, slots=True, kw_only=True)
class InertialPrior:
    """Ten parameters a link that belong to real bodies.

    Raises:
        InputError: Not (n, 10) finite numbers.
    """

    parameters: Array
    """(n, 10) m, mx, my, mz, Jxx, Jyy, Jzz, Jyz, Jxz, Jxy in the parameter frames."""
    completed: tuple[str, ...] = ()
    """What was not published and how it was filled, in words."""

    def __post_init__(self) -> None:
        value = frozen(self.parameters, shape=(None, 10), name="prior inertias")
        object.__setattr__(self, "parameters", value)


def inertial_prior(robot: RobotModel, frames: str) -> InertialPrior:
    """The published inertias of a robot; missing ones are those of uniform bodies.

    A body without a published tensor is a uniform rod along its link, as thick as a tenth of the
    arm's reach; one without a centre has it half way; one without a mass gets that rod's volume
    at `DENSITY`. A published tensor that no body can have is rounded to one that can.

    Args:
        robot: The robot.
        frames: Parameter frames.
    """
    ends = [*robot.placements[1:, :3, 3], robot.flange[:3, 3]]
    thick = THICKNESS * max(float(sum(np.linalg.norm(end) for end in ends)), 1e-3)
    inverses = np.asarray(np.linalg.inv(robot.parameter_frames[frames]), dtype=np.float64)
    rows: list[Array] = []
    missing: dict[str, list[str]] = {}
    for i, (known, end) in enumerate(zip(robot.inertias, ends, strict=True)):
        row, words = _completed(np.array(known), end, thick)
        rows.append(move(row, inverses[i]))
        for word in words:
            missing.setdefault(word, []).append(str(i + 1))
    return InertialPrior(
        parameters=np.array(rows),
        completed=tuple(f"{word} of links {', '.join(ids)}" for word, ids in missing.items()),
    )


def _completed(known: Array, end: Array, thick: float) -> tuple[Array, list[str]]:
    words: list[str] = []
    length = float(np.linalg.norm(end))
    mass, first = float(known[0]), known[1:4]
    if not mass > 0:
        words.append("a uniform rod for the mass")
        mass = DENSITY * np.pi / 4 * thick**2 * (length + thick)
        first = mass * end / 2
    elif np.isnan(first).any():
        words.append("the middle of the link for the centre of mass")
        first = mass * end / 2
    centre = first / mass
    direction = end / length if length > 0 else np.zeros(3)
    rod = np.eye(3) * thick**2 / 16 + np.outer(direction, direction) * length**2 / 12
    spread = rod
    if np.isnan(known[4:]).any() or words:
        words.append("a uniform rod for the inertia tensor")
    else:
        second = to_pseudo_inertia(known)[:3, :3] / mass - np.outer(centre, centre)
        values, vectors = np.linalg.eigh(second)
        least = (THINNEST * thick) ** 2
        if values[0] < least:
            words.append("a thicker body for the inertia tensor")
        spread = (vectors * np.maximum(values, least)) @ vectors.T
    pseudo = np.empty((4, 4))
    pseudo[:3, :3] = mass * (spread + np.outer(centre, centre))
    pseudo[:3, 3] = pseudo[3, :3] = first
    pseudo[3, 3] = mass
    return from_pseudo_inertia(pseudo), words


def _orthonormal() -> Array:
    basis = np.zeros((10, 4, 4))
    rows, columns = np.tril_indices(4)
    count = np.arange(10)
    basis[count, rows, columns] = np.where(rows == columns, 1.0, np.sqrt(0.5))
    basis[count, columns, rows] = basis[count, rows, columns]
    return basis


ORTHONORMAL = _orthonormal()
"""(10, 4, 4) symmetric matrices, orthonormal by the trace of products: with J = L L', the moves
L E L' are the units of the pseudo-inertias' own metric at J."""
