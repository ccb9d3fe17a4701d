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
from dynid.excitation.gram import GramKernel
from dynid.excitation.multistart import Effort, workers
from dynid.excitation.optimise import (
    METHODS,
    ExcitationDesign,
    Optimised,
    by_genetic_algorithm,
    by_gradient,
)
from dynid.excitation.problem import ExcitationProblem
from dynid.excitation.purpose import (
    Expected,
    Purpose,
    assumed_noise,
    expected,
    purpose_of,
    whole_workspace,
    without_friction,
)
from dynid.excitation.region import region_of

__all__ = [
    "CRITERIA",
    "METHODS",
    "AOptimal",
    "Criterion",
    "DesignEvaluation",
    "Effort",
    "ExcitationDesign",
    "ExcitationProblem",
    "Expected",
    "GramKernel",
    "Optimised",
    "Purpose",
    "all_criteria",
    "assumed_noise",
    "by_genetic_algorithm",
    "by_gradient",
    "check_room",
    "expected",
    "parse_criterion",
    "prior_scale",
    "purpose_of",
    "region_of",
    "scaled_condition_number",
    "whole_workspace",
    "without_friction",
    "workers",
]
