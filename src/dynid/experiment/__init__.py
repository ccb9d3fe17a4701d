"""From a design to an experiment: the plan, the checks before it, the run."""

from dynid.experiment.plan import ExperimentPlan as ExperimentPlan
from dynid.experiment.plan import RunResult as RunResult
from dynid.experiment.plan import interruptible as interruptible
from dynid.experiment.plan import run as run
from dynid.experiment.plan import stop_on_signals as stop_on_signals
from dynid.experiment.preflight import Approach as Approach
from dynid.experiment.preflight import check_design as check_design
from dynid.experiment.preflight import check_robot as check_robot
from dynid.experiment.preflight import plan_approach as plan_approach
from dynid.experiment.preflight import require_ready as require_ready
