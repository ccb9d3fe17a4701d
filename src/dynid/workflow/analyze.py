"""`dynid analyze`: how many parameters a robot's motion can show, and which."""

from dataclasses import dataclass
from typing import Any

from dynid import constraints, core, reduction, regressor
from dynid.robot import RobotLike, load_robot


@dataclass(frozen=True, slots=True, kw_only=True)
class Analysis:
    """The structure of a robot's dynamics."""

    base: reduction.BaseParametrization
    """The base parameters and their expressions."""

    @property
    def warnings(self) -> tuple[core.Finding, ...]:
        """Findings of the rank and of the mounting."""
        return self.base.warnings

    def to_json(self) -> dict[str, Any]:
        """The keys of the design."""
        base = self.base
        names, doubts = base.model.names, constraints.doubted_units(base.model.robot)
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
            "gap": list(base.classes.gap),
            "samples": base.samples,
            "seed": base.seed,
            "terms": base.model.friction.describe(),
            "alone_names": [names[i] for i in base.classes.alone],
            "combined_names": [names[i] for i in base.classes.combined],
            "unidentifiable_names": [names[i] for i in base.classes.unidentifiable],
            "notes": [*(one.message for one in doubts), *base.model.robot.notes],
            **core.told(self.warnings),
        }


def analyze(
    robot: RobotLike,
    *,
    frames: str = "",
    samples: int = 25,
    seed: int = 0,
    terms: str | regressor.FrictionTerms = "fc,fv,im",
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
    friction = regressor.parse_terms(terms) if isinstance(terms, str) else terms
    plain = load_robot(robot, collision=False)
    model = regressor.InverseDynamicModel(robot=plain, frames=frames, friction=friction)
    return Analysis(base=reduction.reduce_model(model, samples=samples, seed=seed))
