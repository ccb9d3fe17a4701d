"""From the choice of terms to column blocks."""

from __future__ import annotations

from dynid.regressor.blocks import (
    ColumnBlock,
    Coulomb,
    CoulombAsymmetry,
    CubeRoot,
    MotorInertia,
    Offset,
    Stribeck,
    Viscous,
    ViscousAsymmetry,
)
from dynid.regressor.coupling import Coupling
from dynid.regressor.terms import TERMS, FrictionTerms


def column_blocks(friction: FrictionTerms, *, coupled: bool = False) -> tuple[ColumnBlock, ...]:
    """The blocks for a choice of terms, in the order of `TERMS`.

    Args:
        friction: Terms, their joints, their shapes.
        coupled: Add the columns of coupled motors.
    """
    width, speed = friction.width, friction.stribeck_velocity

    def block(term: str, joints: tuple[int, ...] | None) -> ColumnBlock:
        match term:
            case "fc":
                return Coulomb(width=width, joints=joints)
            case "fv":
                return Viscous(joints=joints)
            case "im":
                return MotorInertia(joints=joints)
            case "fo":
                return Offset(joints=joints)
            case "fca":
                return CoulombAsymmetry(width=width, joints=joints)
            case "fva":
                return ViscousAsymmetry(joints=joints)
            case "fs":
                return Stribeck(velocity=speed, width=width, joints=joints)
            case "fr":
                return CubeRoot(joints=joints)
            case _:
                raise ValueError(f"no column block for the term {term!r}")

    terms = dict(friction.terms)
    blocks = tuple(block(term, terms[term]) for term in TERMS if term in terms)
    return (*blocks, Coupling(width=width)) if coupled else blocks
