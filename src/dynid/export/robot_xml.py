"""What URDF and MJCF files share: bodies with a centre of mass, and what they cannot hold.

Rotations in the forms that robot files use.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from dynid.core import Array, JobError
from dynid.export.model import ExportModel, NearestFriction
from dynid.robot import tensor


def roll_pitch_yaw(rotation: Array) -> tuple[float, float, float]:
    """Angles about the fixed axes x, y, z, in that order [rad], as URDF has them.

    Args:
        rotation: (3, 3) rotation.
    """
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    c, s = math.cos(yaw), math.sin(yaw)
    pitch = math.atan2(-rotation[2, 0], c * rotation[0, 0] + s * rotation[1, 0])
    # Of the rotation turned back by the yaw: near upright, where the yaw is all rounding, the
    # roll takes its error back.
    roll = math.atan2(
        s * rotation[0, 2] - c * rotation[1, 2], c * rotation[1, 1] - s * rotation[0, 1]
    )
    return roll, pitch, yaw


def quaternion(rotation: Array) -> Array:
    """(4) w, x, y, z of a rotation (3, 3), w not negative."""
    # The eigenvector of Bar-Itzhack's symmetric matrix: no case is badly conditioned.
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    matrix = np.array(
        [
            [a + e + i, h - f, c - g, d - b],
            [h - f, a - e - i, b + d, c + g],
            [c - g, b + d, e - a - i, f + h],
            [d - b, c + g, f + h, i - a - e],
        ]
    )
    largest: Array = np.linalg.eigh(matrix)[1][:, -1]
    return np.copysign(1.0, largest[0]) * largest


def upright(gravity: Array) -> Array:
    """(3, 3) the rotation that takes a gravity vector (3) to straight down, -z."""
    size = float(np.linalg.norm(gravity))
    if size == 0.0:
        return np.eye(3)
    z = -gravity / size
    if z[2] > 1.0 - 1e-15:
        return np.eye(3)
    helper = np.eye(3)[0] if abs(z[0]) < 0.9 else np.eye(3)[1]
    across = helper - (helper @ z) * z
    x = across / float(np.linalg.norm(across))
    return np.array([x, np.cross(z, x), z], dtype=np.float64)


ADVICE = "Identify with --estimator sdp, or export to json, c or python."
_LONG = {
    "Im": "motor inertias",
    "Fo": "friction offsets",
    "Fca": "Coulomb asymmetries",
    "Fva": "viscous asymmetries",
    "Fs": "Stribeck terms",
    "Fr": "cube-root friction",
    "Fcm": "friction of coupled motors",
    "Fvm": "friction of coupled motors",
    "Imm": "inertias of coupled motors",
    "Fl": "friction that grows with load",
    "Fw": "torque ripple of gears",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class CentredBody:
    """A link by its centre of mass."""

    mass: float
    """[kg]"""
    centre: Array
    """(3) in the joint frame [m]."""
    central: Array
    """(3, 3) tensor about the centre of mass, along the joint frame [kg.m^2]."""


def bodies(model: ExportModel) -> list[CentredBody]:
    """The links, base to tip.

    Raises:
        JobError: A link whose mass is not positive, which has no centre of mass that loaders
            take.
    """
    found: list[CentredBody] = []
    for i, row in enumerate(model.inertials):
        mass = float(row[0])
        if not mass > 0.0:
            raise JobError(
                f"not physical: the mass of link {i + 1} is not positive, and loaders refuse it",
                value=mass,
                next_step=ADVICE,
            )
        centre = row[1:4] / mass
        steiner = mass * ((centre @ centre) * np.eye(3) - np.outer(centre, centre))
        found.append(CentredBody(mass=mass, centre=centre, central=tensor(row) - steiner))
    return found


def refuse_negative_friction(model: ExportModel) -> None:
    """Check what loaders check.

    Raises:
        JobError: Negative Coulomb or viscous friction.
    """
    for symbol, word in (("Fc", "Coulomb friction"), ("Fv", "viscous friction")):
        low = int(np.argmin(model.terms[symbol]))
        if model.terms[symbol][low] < 0.0:
            raise JobError(
                f"not physical: the {word} of joint {low + 1} is negative, and loaders refuse it",
                value=float(model.terms[symbol][low]),
                next_step=ADVICE,
            )


def left_out(model: ExportModel, held: Iterable[str]) -> tuple[str, ...]:
    """What the identified model has and a file with the terms `held` has not, in words."""
    gone = [
        _LONG[symbol]
        for symbol, values in model.terms.items()
        if symbol not in held and values.any()
    ]
    springs = ["torques of counterbalances"] if model.springs else []
    return tuple(dict.fromkeys([*gone, *springs]))


def stand_in_words(friction: NearestFriction | None) -> list[str]:
    """Lines of a comment where the friction of a file is not the identified one."""
    if friction is None or not friction.stands_in:
        return []
    left = " ".join(f"{value:.3g}" for value in friction.missing)
    return [
        "Damping and dry friction: the two that are nearest to all friction that was identified,",
        f"over the recorded range. RMS of what they leave, by joint: {left} N.m (N).",
    ]


def numbers(values: Iterable[float]) -> str:
    """Numbers that read back exactly, with blanks between them."""
    return " ".join(repr(float(value) + 0.0) for value in values)


def attribute(text: str) -> str:
    """A quoted attribute value."""
    return quoteattr("".join(c if c.isprintable() else "?" for c in text))


def comment(text: str) -> list[str]:
    """Lines of an XML comment."""
    lines = [
        escape("".join(c if c.isprintable() else "?" for c in line)).replace("--", "- -")
        for line in text.splitlines()
    ]
    return ["<!--", *(f"  {line}" for line in lines), "-->"] if lines else []
