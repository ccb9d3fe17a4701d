"""Joint motions as functions of time: Fourier series, polynomials, files."""

from dynid.trajectory.bounds import (
    MotionBounds,
    copied_bounds,
    peaks,
    random_excitation,
    usable_bounds,
)
from dynid.trajectory.bspline import BSpline
from dynid.trajectory.files import (
    FAMILY_NAMES,
    StoredTrajectory,
    csv_text,
    joint_trajectory_yaml,
    motion_family,
    read_trajectory,
    trajectory_to_json,
    write_trajectory,
)
from dynid.trajectory.fourier import FourierSeries, harmonic_basis
from dynid.trajectory.points import LANGUAGES, PointToPoint, points_text
from dynid.trajectory.quintic import FourierQuintic, Quintic
from dynid.trajectory.sequence import MotionSequence, Repetition, through_poses
from dynid.trajectory.trajectory import JointMotion, MotionFamily, Trajectory
from dynid.trajectory.urscript import (
    Piece,
    UrProgramOptions,
    pieces,
    ur_program,
)

__all__ = [
    "FAMILY_NAMES",
    "LANGUAGES",
    "BSpline",
    "FourierQuintic",
    "FourierSeries",
    "JointMotion",
    "MotionBounds",
    "MotionFamily",
    "MotionSequence",
    "Piece",
    "PointToPoint",
    "Quintic",
    "Repetition",
    "StoredTrajectory",
    "Trajectory",
    "UrProgramOptions",
    "copied_bounds",
    "csv_text",
    "harmonic_basis",
    "joint_trajectory_yaml",
    "motion_family",
    "peaks",
    "pieces",
    "points_text",
    "random_excitation",
    "read_trajectory",
    "through_poses",
    "trajectory_to_json",
    "ur_program",
    "usable_bounds",
    "write_trajectory",
]
