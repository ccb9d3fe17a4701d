"""From a design to an experiment: the plan, the checks before it, the run."""

from dynid.experiment.approach import plan_approach
from dynid.experiment.plan import ExperimentPlan
from dynid.experiment.preflight import check_design, check_robot, require_ready
from dynid.experiment.run import (
    RunResult,
    interruptible,
    run,
    stop_on_signals,
)

__all__ = [
    "ExperimentPlan",
    "RunResult",
    "check_design",
    "check_robot",
    "interruptible",
    "plan_approach",
    "require_ready",
    "run",
    "stop_on_signals",
]
