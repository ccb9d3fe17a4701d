"""The limits of a design as a value that its file keeps, scene included."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dynid.constraints.motion import MotionConstraints
from dynid.constraints.presets import PRESETS, paper_constraints, safe_constraints
from dynid.constraints.scene import Scene, scene_from_json
from dynid.core.errors import InputError
from dynid.robot.model import RobotModel
from dynid.trajectory.json_fields import JsonFields, load_object

CLEARANCE = 0.01
"""Kept to the scene [m]. An arm that stands on its table has no more under its shoulder: the UR5
keeps 13 mm there whatever it does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignLimits:
    """Which limits hold, and around what.

    Raises:
        InputError: Limits that are not known.
    """

    preset: str = "safe"
    """`safe` or `paper`."""
    collision: bool = True
    scene: Mapping[str, Any] | None = None
    """The scene file's content."""
    scene_file: str = ""
    """Where it was read."""

    def __post_init__(self) -> None:
        if self.preset not in PRESETS:
            raise InputError(
                "unknown limits", where="--limits", value=self.preset, limit=", ".join(PRESETS)
            )

    def constraints(
        self,
        robot: RobotModel,
        *,
        payload_mass: float = 0.0,
        payload_com: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> MotionConstraints:
        """The judge of these limits.

        Args:
            robot: The robot.
            payload_mass: What it carries [kg].
            payload_com: Where, in the flange's frame [m].

        Raises:
            InputError: Contradictory bounds, a scene that is none, or one without room for the
                robot.
        """
        if self.preset == "paper":
            return paper_constraints(robot)
        return safe_constraints(
            robot,
            self._scene(),
            collision=self.collision,
            clearance=CLEARANCE,
            payload_mass=payload_mass,
            payload_com=payload_com,
        )

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {
            "preset": self.preset,
            "collision": self.collision,
            "scene": None if self.scene is None else dict(self.scene),
            "scene_file": self.scene_file or None,
        }

    def _scene(self) -> Scene | None:
        if self.scene is None:
            return None
        return scene_from_json(JsonFields(self.scene), self.scene_file or "scene")


def given_limits(preset: str, collision: bool, scene: Path | None) -> DesignLimits:
    """Limits from the command line's words.

    Raises:
        InputError: An unknown word, or a scene that cannot be read.
    """
    return DesignLimits(
        preset=preset,
        collision=collision,
        scene=None if scene is None else load_object(scene).values,
        scene_file="" if scene is None else str(scene),
    )


def limits_from_json(fields: JsonFields) -> DesignLimits:
    """The inverse of `DesignLimits.to_json`.

    Raises:
        InputError: Missing keys or values of the wrong type.
    """
    preset, collision = fields.text("preset"), fields.get("collision")
    if not isinstance(collision, bool):
        raise InputError("collision must be true or false", value=collision)
    scene = fields.get("scene")
    return DesignLimits(
        preset=preset,
        collision=collision,
        scene=None if scene is None else fields.object("scene").values,
        scene_file=str(fields.get("scene_file") or ""),
    )
