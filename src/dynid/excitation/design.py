"""A finished excitation design: the motion, what it is worth, and the proof that it is safe."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from dynid.constraints.certificate import Certificate
from dynid.core.provenance import Provenance
from dynid.excitation.search import HistoryEntry
from dynid.trajectory.bounds import MotionBounds
from dynid.trajectory.trajectory import Trajectory


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcitationDesign:
    """An excitation trajectory with everything that is known about it."""

    trajectory: Trajectory
    """One period."""
    robot: str
    """Name or path of the robot, by which it can be loaded again."""
    robot_name: str
    """What the robot calls itself."""
    mount: str
    """The mounting it was designed for."""
    frames: str
    """Frames of the parameters behind the criteria."""
    terms: str
    """Friction terms beside the inertial parameters."""
    limits: MotionBounds
    """Bounds of position, velocity and acceleration."""
    criterion: str
    """What was minimised."""
    method: str
    """`ga` or `gradient`."""
    criteria: Mapping[str, float]
    """Every criterion by name, of all samples of one period, Coulomb steps as they are."""
    base_parameters: int
    """How many the motion shows."""
    samples: int
    """At which the criteria were computed."""
    certificate: Certificate
    """What is left of each limit."""
    repair: str
    """What the certificate made necessary: empty, `tightened` or `smaller`."""
    evaluations: int
    """Motions evaluated."""
    starts: int
    """Starts of the gradient method that ended, or generations."""
    wall_s: float
    """Time of the design [s]."""
    seed: int
    """Of all random numbers."""
    ended_by: str
    """`starts`, `generations`, `stagnation`, `budget` or `interrupt`."""
    history: tuple[HistoryEntry, ...]
    """How the best motion got better."""
    provenance: Provenance
    """Inputs, settings, seed and versions."""
    settings: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """How the limits were chosen, for `dynid check`."""

    @property
    def condition_number(self) -> float:
        """The paper's: first-come columns, unscaled, of one period."""
        return self.criteria["cond"]

    @property
    def scaled_condition_number(self) -> float:
        """With the columns scaled to unit norm."""
        return self.criteria["scaled-cond"]

    @property
    def log_det(self) -> float:
        """Logarithm of the determinant of the Gram matrix."""
        return -self.criteria["d-opt"]

    @property
    def feasible(self) -> bool:
        """Whether the certificate holds."""
        return self.certificate.feasible

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended the search."""
        return self.ended_by == "interrupt"

    def to_json(self) -> dict[str, Any]:
        """The keys that `dynid design --json` prints, and more."""
        return {
            "robot": self.robot_name,
            "mount": self.mount,
            "frames": self.frames,
            "terms": self.terms,
            "trajectory": type(self.trajectory).__name__,
            "duration_s": self.trajectory.duration,
            "base_parameters": self.base_parameters,
            "samples": self.samples,
            "condition_number": _known(self.condition_number),
            "scaled_condition_number": _known(self.scaled_condition_number),
            "log_det": _known(self.log_det),
            "criterion": self.criterion,
            "criteria": {name: _known(value) for name, value in self.criteria.items()},
            "method": self.method,
            "feasible": self.feasible,
            "margins": self.certificate.margins,
            "worst": self.certificate.to_json()["worst"],
            "proven": list(self.certificate.proven),
            "notes": list(self.certificate.notes),
            "repair": self.repair or None,
            "evaluations": self.evaluations,
            "starts": self.starts,
            "wall_s": self.wall_s,
            "seed": self.seed,
            "ended_by": self.ended_by,
            "interrupted": self.interrupted,
            "history": [
                {
                    "wall_s": round(entry.wall_s, 4),
                    "evaluations": entry.evaluations,
                    "value": _known(entry.value),
                    "feasible": entry.feasible,
                }
                for entry in self.history
            ],
            "limits": dict(self.settings),
        }


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
