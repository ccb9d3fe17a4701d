"""The limits of a motion, as a value that a design's file keeps."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from dynid import constraints, settings
from dynid.core import InputError, JsonFields, check_word, load_object
from dynid.robot import RobotModel, with_tool


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
    """Where it was read; an absolute path, but in older designs."""
    floor: float | str = "mount"
    """Height of the floor in the base frame [m]; `mount`: at the mounting plane; `none`."""
    tool: tuple[float, ...] | None = None
    """(3) the tool's point in the flange's frame [m]; None for the robot's own."""
    payload: tuple[float, ...] | None = None
    """(4) mass that the flange carries [kg] and its centre [m]; None for the robot's own."""
    margin_percent: float = 100.0 * constraints.MARGIN
    """Of the limits of velocity, speed, torque, momentum and power, kept free."""
    clearance: float = constraints.CLEARANCE
    """Smallest distance between bodies [m]."""
    mesh_dirs: tuple[str, ...] = ()
    """Folders where meshes of the robot are looked for, beside the usual places."""

    def __post_init__(self) -> None:
        check_word(self.preset, constraints.PRESETS, "--limits")
        for name, numbers, count in (("--tool", self.tool, 3), ("--payload", self.payload, 4)):
            if numbers is not None and not (
                len(numbers) == count and all(math.isfinite(x) for x in numbers)
            ):
                raise InputError(f"needs {count} numbers", where=name, value=list(numbers))

    def equipped(self, robot: RobotModel) -> RobotModel:
        """The robot with the tool and the payload.

        Raises:
            RobotError: They make no sense.
        """
        return with_tool(robot, tcp=self.tool, payload=self.payload)

    def constraints(self, robot: RobotModel) -> constraints.MotionConstraints:
        """The judge of these limits, for the robot with its tool.

        Raises:
            InputError: Contradictory bounds, a scene that is none, or one without room for the
                robot.
        """
        if self.preset == "paper":
            return constraints.paper_constraints(robot)
        scene = None
        if self.scene is not None:
            scene = constraints.scene_from_json(JsonFields(self.scene), self.scene_file or "scene")
        return constraints.safe_constraints(
            self.equipped(robot),
            scene,
            collision=self.collision,
            clearance=self.clearance,
            margin=self.margin_percent / 100.0,
            floor=self.floor,
        )

    def to_json(self) -> dict[str, Any]:
        """A JSON object; tuples become lists."""
        values = asdict(self) | {"scene_file": self.scene_file or None}
        return {name: list(x) if isinstance(x, tuple) else x for name, x in values.items()}  # pyright: ignore[reportUnknownArgumentType]


def given_limits(asked: settings.SceneSettings, base: DesignLimits | None = None) -> DesignLimits:
    """The limits that are asked for; what is None is that of `base`.

    Surroundings alone are asked for with all safe limits.

    Raises:
        InputError: A scene that cannot be read, or surroundings that would not be looked at.
    """
    preset, collision = "safe", True
    around: dict[str, object] = {"--scene": asked.scene, "--floor": asked.floor}
    if isinstance(asked, settings.LimitSettings):
        preset, collision = asked.limits, asked.collision
        around["--clearance"] = asked.clearance
        if preset == "paper":
            _refuse_given({"--margin": asked.margin_percent}, "--limits safe")
    unchecked = preset == "paper" or not collision
    if unchecked:
        _refuse_given(around, "--limits safe and collisions on")
    known = {item.name for item in fields(DesignLimits)} - {"scene"}
    given: dict[str, Any] = {
        item.name: getattr(asked, item.name)
        for item in fields(asked)
        if item.name in known and getattr(asked, item.name) is not None
    }
    if asked.scene is not None:
        file = Path(asked.scene).resolve()
        given |= {"scene": load_object(asked.scene).values, "scene_file": str(file)}
    elif unchecked:
        given |= {"scene": None, "scene_file": ""}
    return replace(base or DesignLimits(), **given | {"preset": preset, "collision": collision})


def _refuse_given(values: Mapping[str, object], needed: str) -> None:
    for name, value in values.items():
        if value is not None and value not in constraints.FLOORS:
            said = f"it is looked at only with {needed}"
            raise InputError(said, where=name, value=str(value))


def limits_from_json(fields: JsonFields) -> DesignLimits:
    """The inverse of `DesignLimits.to_json`; what release 0.1 did not know has its default.

    Raises:
        InputError: Values of the wrong type.
    """
    values = {name: value for name, value in fields.values.items() if value is not None}
    return JsonFields(values, fields.prefix).made(DesignLimits)
