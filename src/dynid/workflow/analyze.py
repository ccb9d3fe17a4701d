"""`dynid analyze`: how many parameters a robot's motion can show, and which."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dynid.core.notices import Notice
from dynid.reduction.base import BaseParametrization, reduce_model
from dynid.regressor.model import InverseDynamicModel
from dynid.regressor.terms import FrictionTerms, parse_terms
from dynid.robot.load import load_robot
from dynid.robot.model import RobotModel
from dynid.workflow.robot_units import unit_notes


@dataclass(frozen=True, slots=True, kw_only=True)
class Analysis:
    """The structure of a robot's dynamics."""

    base: BaseParametrization
    """Which parameters stand for all, and how they were found."""

    @property
    def warnings(self) -> tuple[Notice, ...]:
        """What was set straight to find the structure."""
        return self.base.warnings

    def to_json(self) -> dict[str, Any]:
        """The keys of the design."""
        base = self.base
        names = base.model.names
        return {
            "robot": base.model.robot.name,
            "standard_parameters": len(names),
            "base_parameters": base.rank,
            "identifiable_alone": len(base.classes.alone),
            "identifiable_combined": len(base.classes.combined),
            "unidentifiable": len(base.classes.unidentifiable),
            "singular_values": base.singular_values.tolist(),
            "cumulative_energy": base.cumulative_energy.tolist(),
            "names": list(base.names),
            "expressions": list(base.expressions),
            "units": list(base.units),
            "frames": base.model.frames,
            "mount": base.model.robot.mount,
            "tolerance": base.tolerance,
            "gap": list(base.gap),
            "samples": base.samples,
            "seed": base.seed,
            "terms": base.model.friction.describe(),
            "alone_names": [names[i] for i in base.classes.alone],
            "combined_names": [names[i] for i in base.classes.combined],
            "unidentifiable_names": [names[i] for i in base.classes.unidentifiable],
            "notes": [*unit_notes(base.model.robot), *base.model.robot.notes],
            "warnings": [notice.to_json() for notice in self.warnings],
        }


def analyze(
    robot: RobotModel | str | Path,
    *,
    frames: str = "",
    samples: int = 25,
    seed: int = 0,
    terms: str | FrictionTerms = "fc,fv,im",
) -> Analysis:
    """Base parameters of a robot.

    Args:
        robot: The robot, mounting included; or its name or file.
        frames: `dh`, `mdh` or `urdf`; empty for the robot's own.
        samples: Random points of the observation matrix.
        seed: Seed of the points.
        terms: Friction terms beside the inertial parameters.

    Raises:
        InputError: Unknown frames or terms, or samples below one.
    """
    if not isinstance(robot, RobotModel):
        robot = load_robot(robot)
    friction = parse_terms(terms) if isinstance(terms, str) else terms
    model = InverseDynamicModel(robot=robot, frames=frames, friction=friction)
    return Analysis(base=reduce_model(model, samples=samples, seed=seed))
