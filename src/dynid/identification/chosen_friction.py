"""The friction terms that choices of joints stand for."""

from __future__ import annotations

from dynid.identification.candidate_columns import DISPLACEMENTS, LOAD, WIDTHS
from dynid.identification.joint_choice import JointChoice
from dynid.regressor.load import LoadFriction
from dynid.regressor.terms import TERMS, FrictionTerms


def chosen_friction(
    choices: tuple[JointChoice, ...],
    extras: tuple[str, ...],
    given: FrictionTerms | None,
    stribeck_velocity: float,
) -> FrictionTerms:
    """The friction terms of the choices.

    Args:
        choices: One a joint.
        extras: The words that their terms are indices of.
        given: Terms given by the user; None for those of the paper.
        stribeck_velocity: [rad/s or m/s]
    """
    joints_of = dict((given or FrictionTerms()).terms)
    load = None
    for k, term in enumerate(extras):
        joints = tuple(j for j, choice in enumerate(choices) if k in choice.terms)
        if joints and term == LOAD:
            # What the load is, the fit will find.
            load = LoadFriction(joints=joints, parameters=(0.0,) * (10 * len(choices)))
        elif joints:
            joints_of[term] = joints if len(joints) < len(choices) else None
    over = tuple(
        0.0 if choice.displacement is None else DISPLACEMENTS[choice.displacement]
        for choice in choices
    )
    return FrictionTerms(
        terms=tuple((term, joints_of[term]) for term in TERMS if term in joints_of),
        width=tuple(WIDTHS[choice.width] for choice in choices),
        stribeck_velocity=stribeck_velocity,
        presliding=over if any(over) else (),
        load=load,
    )
