"""Estimators, their statistics, and the choice of settings."""

from dynid.identification.bayesian import (
    CENTRE_SPREAD_M,
    MASS_SPREAD,
    TENSOR_SPREAD,
    TowardPublished,
    deviations,
    inertial_prior,
)
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
    MotionRange,
    StandardParameters,
    read_estimate,
    write_estimate,
)
from dynid.identification.fitting import ESTIMATORS, AllRows, estimator_of, fit_estimate, plan_pass
from dynid.identification.fleet import (
    RecordStatistics,
    friction_names,
    record_statistics,
    shared_names,
    solve_robot,
)
from dynid.identification.instrumental import ClosedLoop
from dynid.identification.least_squares import (
    PRIOR_GAIN,
    Estimator,
    Fit,
    WeightedLeastSquares,
    autocorrelation,
)
from dynid.identification.payload import Payload, payload_of
from dynid.identification.physical import PhysicallyConsistent, standard_posterior
from dynid.identification.problem import IdentificationProblem, motion_state
from dynid.identification.ripple import with_ripple
from dynid.identification.selection import PURPOSES, Selection, select, with_load
from dynid.identification.shared import (
    SharedFit,
    SharedProblem,
    base_order,
    fit_shared,
    friction_places,
    shared_estimates,
)
from dynid.identification.sums import PanelRows, PassPlan, RowSums, no_sums, sum_rows, sums_from
from dynid.identification.temperature import LEAST_SPREAD_K, JointTemperatureLaw, fit_law
from dynid.identification.temperature_model import (
    EstimateLike,
    TemperatureModel,
    open_estimate,
    read_temperature,
    write_temperature,
)
from dynid.identification.trends import (
    CONFIDENCE,
    JointState,
    Trend,
    judge,
    repeated_motions,
    trend,
)

__all__ = [
    "CENTRE_SPREAD_M",
    "CONFIDENCE",
    "ESTIMATORS",
    "FORMAT",
    "LARGEST_STD",
    "LEAST_SPREAD_K",
    "MASS_SPREAD",
    "PRIOR_GAIN",
    "PURPOSES",
    "TENSOR_SPREAD",
    "WIDTH",
    "AllRows",
    "ClosedLoop",
    "DriveGains",
    "Estimate",
    "EstimateLike",
    "Estimator",
    "Fit",
    "IdentificationProblem",
    "JointState",
    "JointTemperatureLaw",
    "MotionRange",
    "PanelRows",
    "PassPlan",
    "Payload",
    "PhysicallyConsistent",
    "RecordStatistics",
    "RowSums",
    "Selection",
    "SharedFit",
    "SharedProblem",
    "StandardParameters",
    "TemperatureModel",
    "TowardPublished",
    "Trend",
    "WeighedGains",
    "WeightedLeastSquares",
    "autocorrelation",
    "base_order",
    "deviations",
    "drive_gains",
    "estimator_of",
    "fit_estimate",
    "fit_law",
    "fit_shared",
    "friction_names",
    "friction_places",
    "inertial_prior",
    "judge",
    "motion_state",
    "no_sums",
    "open_estimate",
    "payload_of",
    "plan_pass",
    "read_estimate",
    "read_temperature",
    "record_statistics",
    "repeated_motions",
    "select",
    "shared_estimates",
    "shared_names",
    "solve_robot",
    "standard_posterior",
    "sum_rows",
    "sums_from",
    "trend",
    "weighed_gains",
    "with_load",
    "with_ripple",
    "write_estimate",
    "write_temperature",
]
