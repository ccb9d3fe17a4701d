"""What URDF and MJCF files share: bodies with a centre of mass, and what they cannot hold."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import JobError
from dynid.export.model import ExportModel
from dynid.export.nearest_friction import NearestFriction
from dynid.robot.inertia import tensor

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
class Body:
    """A link by its centre of mass."""

    mass: float
    """[kg]"""
    centre: Array
    """(3) in the joint frame [m]."""
    central: Array
    """(3, 3) tensor about the centre of mass, along the joint frame [kg.m^2]."""


def bodies(model: ExportModel) -> list[Body]:
    """The links, base to tip.

    Raises:
        JobError: A link whose mass is not positive, which has no centre of mass that loaders
            take.
    """
    found: list[Body] = []
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
        found.append(Body(mass=mass, centre=centre, central=tensor(row) - steiner))
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
