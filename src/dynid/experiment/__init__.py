"""From a design to an experiment: the plan, the checks before it, the run."""
