"""`dynid analyze`: how many parameters a robot's motion can show, and which."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynid.core import Finding, told
from dynid.reduction import BaseParametrization, reduce_model
from dynid.regressor import FrictionTerms, InverseDynamicModel, parse_terms
from dynid.robot import RobotLike, RobotModel, load_robot

MOST_TURNS = 4.0
"""No joint with cables through it makes more, to either side."""
FASTEST = 30.0
"""[rad/s] Faster than the joints of any arm that carries its own weight."""
UNLIMITED = 1e4
"""Files write such numbers, or larger ones, where there is no limit."""
LONGEST = 20.0
"""[m] Longer than any arm with serial joints."""


def unit_notes(robot: RobotModel) -> tuple[str, ...]:
    """What in a robot's description is probably not in SI units; nothing where all is well."""
    limits = robot.limits
    reach = float(np.linalg.norm(robot.placements[:, :3, 3], axis=1).sum())
    found: list[str] = []
    position = np.fmax(np.abs(limits.lower), np.abs(limits.upper))
    for what, unit, values, most, given in (
        ("position", "rad", position, MOST_TURNS * 2 * math.pi, "degrees"),
        ("velocity", "rad/s", limits.velocity, FASTEST, "degrees a second"),
    ):
        # A comparison with an unknown limit (NaN) is false.
        beyond = (values > most) & (values < UNLIMITED) & ~np.array(robot.prismatic)
        joints = np.flatnonzero(beyond).tolist()
        if joints:
            found.append(
                f"the {what} limits of joint {', '.join(str(j + 1) for j in joints)} reach "
                f"{values[joints].max():.4g} {unit}, and look like {given}"
            )
    if reach > LONGEST:
        found.append(f"the arm is {reach:.4g} m long: its lengths look like millimetres")
    return tuple(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class Analysis:
    """The structure of a robot's dynamics."""

    base: BaseParametrization
    """The base parameters and their expressions."""

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """Findings of the rank and of the mounting."""
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
            "gap": list(base.classes.gap),
            "samples": base.samples,
            "seed": base.seed,
            "terms": base.model.friction.describe(),
            "alone_names": [names[i] for i in base.classes.alone],
            "combined_names": [names[i] for i in base.classes.combined],
            "unidentifiable_names": [names[i] for i in base.classes.unidentifiable],
            "notes": [*unit_notes(base.model.robot), *base.model.robot.notes],
            **told(self.warnings),
        }


def analyze(
    robot: RobotLike,
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
    friction = parse_terms(terms) if isinstance(terms, str) else terms
    model = InverseDynamicModel(robot=load_robot(robot), frames=frames, friction=friction)
    return Analysis(base=reduce_model(model, samples=samples, seed=seed))
