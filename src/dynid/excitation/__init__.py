"""Excitation trajectories: criteria, optimisers, designs."""

from dynid.excitation.criteria import (
    CRITERIA,
    AOptimal,
    Criterion,
    all_criteria,
    parse_criterion,
    prior_scale,
)
from dynid.excitation.evaluation import DesignEvaluation
from dynid.excitation.finishing import check_room
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
    "GramKernel",
    "Optimised",
    "all_criteria",
    "by_genetic_algorithm",
    "by_gradient",
    "check_room",
    "parse_criterion",
    "prior_scale",
    "region_of",
    "workers",
]
