"""From a design to an experiment: the plan, the checks before it, the run."""

from dynid.experiment.plan import ExperimentPlan, RunResult, interruptible, run, stop_on_signals
from dynid.experiment.preflight import check_design, check_robot, plan_approach, require_ready

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
