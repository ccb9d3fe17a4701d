"""From the choice of terms to column blocks."""

from __future__ import annotations

from dynid.regressor.blocks import (
    ColumnBlock,
    Coulomb,
    CoulombAsymmetry,
    CubeRoot,
    JointColumns,
    MotorInertia,
    Offset,
    Stribeck,
    Viscous,
    ViscousAsymmetry,
)
from dynid.regressor.coupling import Coupling
from dynid.regressor.terms import TERMS, FrictionTerms


def friction_block(
    term: str, friction: FrictionTerms, joints: tuple[int, ...] | None = None
) -> JointColumns:
    """The block of one term.

    Args:
        term: One of `TERMS`.
        friction: Where widths and velocities come from.
        joints: The joints that have it, from 0; None for all.

    Raises:
        ValueError: A term without a block.
    """
    width = friction.width
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
            return Stribeck(velocity=friction.stribeck_velocity, width=width, joints=joints)
        case "fr":
            return CubeRoot(joints=joints)
        case _:
            raise ValueError(f"no column block for the term {term!r}")


def column_blocks(friction: FrictionTerms, *, coupled: bool = False) -> tuple[ColumnBlock, ...]:
    """The blocks for a choice of terms, in the order of `TERMS`.

    Args:
        friction: Terms, their joints, their shapes.
        coupled: Add the columns of coupled motors.
    """
    terms = dict(friction.terms)
    blocks = tuple(friction_block(term, friction, terms[term]) for term in TERMS if term in terms)
    return (*blocks, Coupling(width=friction.width)) if coupled else blocks
