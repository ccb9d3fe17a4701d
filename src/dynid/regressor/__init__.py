"""What every torque is made of: the columns that multiply the parameters."""

from dynid.regressor.adjoint import (
    Gradient,
    by_sample,
    check_differentiable,
    regressor_pullback,
    torque_adjoint,
)
from dynid.regressor.columns import JointColumns, coupled_motors, smooth_sign
from dynid.regressor.inertial import Places, in_lanes, inertial_rows, turns
from dynid.regressor.model import CHUNK, INERTIAL, InverseDynamicModel
from dynid.regressor.spatial import LANES
from dynid.regressor.terms import (
    TERMS,
    FrictionTerms,
    Gear,
    LoadFriction,
    TorqueRipple,
    friction_state,
    parse_terms,
    ripples_from_json,
    stribeck,
    terms_from_json,
)

__all__ = [
    "CHUNK",
    "INERTIAL",
    "LANES",
    "TERMS",
    "FrictionTerms",
    "Gear",
    "Gradient",
    "InverseDynamicModel",
    "JointColumns",
    "LoadFriction",
    "Places",
    "TorqueRipple",
    "by_sample",
    "check_differentiable",
    "coupled_motors",
    "friction_state",
    "in_lanes",
    "inertial_rows",
    "parse_terms",
    "regressor_pullback",
    "ripples_from_json",
    "smooth_sign",
    "stribeck",
    "terms_from_json",
    "torque_adjoint",
    "turns",
]
