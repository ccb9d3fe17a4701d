"""Estimators, their statistics, and the choice of settings."""

from dynid.identification.bayesian import TowardPublished, inertial_prior
from dynid.identification.drive_gains import (
    LARGEST_STD,
    WIDTH,
    DriveGains,
    WeighedGains,
    drive_gains,
    weighed_gains,
)
from dynid.identification.estimate import (
    FORMAT,
    Estimate,
    TorquePrediction,
    estimate_to_json,
    read_estimate,
    write_estimate,
)
from dynid.identification.fitting import ESTIMATORS, estimator_of, fit_estimate
from dynid.identification.instrumental import ClosedLoop
from dynid.identification.least_squares import (
    PRIOR_GAIN,
    Estimator,
    WeightedLeastSquares,
    autocorrelation,
)
from dynid.identification.payload import Payload, payload_of
from dynid.identification.physical import PhysicallyConsistent
from dynid.identification.problem import (
    ILL_CONDITIONED,
    IdentificationProblem,
    block_mean,
    chunk_size,
    motion_state,
    recorded_rows,
)
from dynid.identification.ripple import with_ripple
from dynid.identification.selection import (
    PURPOSES,
    Assessment,
    ModelError,
    Selection,
    TorqueInterval,
    select,
    with_load,
)
from dynid.identification.shared import (
    SharedFit,
    SharedProblem,
    base_order,
    fit_shared,
    shared_estimates,
)
from dynid.identification.temperature import LEAST_SPREAD_K, JointTemperatureLaw, fit_law

__all__ = [
    "ESTIMATORS",
    "FORMAT",
    "ILL_CONDITIONED",
    "LARGEST_STD",
    "LEAST_SPREAD_K",
    "PRIOR_GAIN",
    "PURPOSES",
    "WIDTH",
    "Assessment",
    "ClosedLoop",
    "DriveGains",
    "Estimate",
    "Estimator",
    "IdentificationProblem",
    "JointTemperatureLaw",
    "ModelError",
    "Payload",
    "PhysicallyConsistent",
    "Selection",
    "SharedFit",
    "SharedProblem",
    "TorqueInterval",
    "TorquePrediction",
    "TowardPublished",
    "WeighedGains",
    "WeightedLeastSquares",
    "autocorrelation",
    "base_order",
    "block_mean",
    "chunk_size",
    "drive_gains",
    "estimate_to_json",
    "estimator_of",
    "fit_estimate",
    "fit_law",
    "fit_shared",
    "inertial_prior",
    "motion_state",
    "payload_of",
    "read_estimate",
    "recorded_rows",
    "select",
    "shared_estimates",
    "weighed_gains",
    "with_load",
    "with_ripple",
    "write_estimate",
]
