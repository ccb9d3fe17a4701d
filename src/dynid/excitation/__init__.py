"""Excitation trajectories: criteria, optimisers, designs."""

from dynid.excitation.criteria import (
    CRITERIA,
    AOptimal,
    Criterion,
    all_criteria,
    parse_criterion,
    prior_scale,
    scaled_condition_number,
)
from dynid.excitation.evaluation import DesignEvaluation
from dynid.excitation.feasible import check_room
from dynid.excitation.genetic import evolve
from dynid.excitation.gram import GramKernel
from dynid.excitation.multistart import Effort
from dynid.excitation.optimise import (
    METHODS,
    ExcitationDesign,
    Optimised,
    by_genetic_algorithm,
    by_gradient,
)
from dynid.excitation.problem import (
    Candidate,
    ExcitationProblem,
    HistoryEntry,
    Search,
    SearchProgress,
)
from dynid.excitation.purpose import (
    Expected,
    Purpose,
    assumed_noise,
    expected,
    purpose_of,
    safe_motions,
    whole_workspace,
    without_friction,
)
from dynid.excitation.region import MotionRegion, random_numbers, region_of

__all__ = [
    "CRITERIA",
    "METHODS",
    "AOptimal",
    "Candidate",
    "Criterion",
    "DesignEvaluation",
    "Effort",
    "ExcitationDesign",
    "ExcitationProblem",
    "Expected",
    "GramKernel",
    "HistoryEntry",
    "MotionRegion",
    "Optimised",
    "Purpose",
    "Search",
    "SearchProgress",
    "all_criteria",
    "assumed_noise",
    "by_genetic_algorithm",
    "by_gradient",
    "check_room",
    "evolve",
    "expected",
    "parse_criterion",
    "prior_scale",
    "purpose_of",
    "random_numbers",
    "region_of",
    "safe_motions",
    "scaled_condition_number",
    "whole_workspace",
    "without_friction",
]
