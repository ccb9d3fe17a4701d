"""Joint motions as functions of time: Fourier series, polynomials, files."""

from dynid.trajectory.bounds import (
    Extremes,
    largest_scale,
    peaks,
    random_excitation,
    usable_bounds,
)
from dynid.trajectory.bspline import BSpline, BSplineFamily
from dynid.trajectory.files import (
    FAMILY_NAMES,
    StoredTrajectory,
    csv_text,
    joint_trajectory_yaml,
    motion_family,
    read_trajectory,
    sampled,
    trajectory_from_json,
    trajectory_to_json,
    write_trajectory,
)
from dynid.trajectory.fourier import (
    FourierFamily,
    FourierSeries,
    ModifiedFourierFamily,
    harmonic_basis,
    rest_basis,
    rest_series,
)
from dynid.trajectory.points import (
    LANGUAGES,
    MotionSequence,
    PointsFamily,
    PointToPoint,
    Repetition,
    points_text,
    through_poses,
)
from dynid.trajectory.quintic import FourierQuintic, Quintic, rest_to_rest
from dynid.trajectory.trajectory import JointMotion, MotionFamily, Trajectory
from dynid.trajectory.urscript import Piece, pieces, ur_program

__all__ = [
    "FAMILY_NAMES",
    "LANGUAGES",
    "BSpline",
    "BSplineFamily",
    "Extremes",
    "FourierFamily",
    "FourierQuintic",
    "FourierSeries",
    "JointMotion",
    "ModifiedFourierFamily",
    "MotionFamily",
    "MotionSequence",
    "Piece",
    "PointToPoint",
    "PointsFamily",
    "Quintic",
    "Repetition",
    "StoredTrajectory",
    "Trajectory",
    "csv_text",
    "harmonic_basis",
    "joint_trajectory_yaml",
    "largest_scale",
    "motion_family",
    "peaks",
    "pieces",
    "points_text",
    "random_excitation",
    "read_trajectory",
    "rest_basis",
    "rest_series",
    "rest_to_rest",
    "sampled",
    "through_poses",
    "trajectory_from_json",
    "trajectory_to_json",
    "ur_program",
    "usable_bounds",
    "write_trajectory",
]
