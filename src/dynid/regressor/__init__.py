"""What every torque is made of: the columns that multiply the parameters."""

from dynid.regressor.adjoint import Gradient as Gradient
from dynid.regressor.adjoint import by_sample as by_sample
from dynid.regressor.adjoint import check_differentiable as check_differentiable
from dynid.regressor.adjoint import regressor_pullback as regressor_pullback
from dynid.regressor.adjoint import torque_adjoint as torque_adjoint
from dynid.regressor.columns import JointColumns as JointColumns
from dynid.regressor.columns import coupled_motors as coupled_motors
from dynid.regressor.columns import motor_turns as motor_turns
from dynid.regressor.inertial import Places as Places
from dynid.regressor.inertial import in_lanes as in_lanes
from dynid.regressor.inertial import inertial_rows as inertial_rows
from dynid.regressor.inertial import turns as turns
from dynid.regressor.model import CHUNK as CHUNK
from dynid.regressor.model import InverseDynamicModel as InverseDynamicModel
from dynid.regressor.spatial import LANES as LANES
from dynid.regressor.terms import TERMS as TERMS
from dynid.regressor.terms import FrictionTerms as FrictionTerms
from dynid.regressor.terms import Gear as Gear
from dynid.regressor.terms import LoadFriction as LoadFriction
from dynid.regressor.terms import TorqueRipple as TorqueRipple
from dynid.regressor.terms import friction_state as friction_state
from dynid.regressor.terms import parse_terms as parse_terms
from dynid.regressor.terms import ripples_from_json as ripples_from_json
from dynid.regressor.terms import smooth_sign as smooth_sign
from dynid.regressor.terms import stribeck as stribeck
from dynid.regressor.terms import terms_from_json as terms_from_json
