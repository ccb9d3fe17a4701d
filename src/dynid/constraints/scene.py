"""What stands around the robot, and what a motion is held to."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from dynid.core import Array, InputError, JsonFields, MotionBounds, freeze
from dynid.robot import RobotModel, from_axes, from_xyz_rpy, require_rigid

HALF_SPACE, BOX, CYLINDER, SPHERE = 0, 1, 2, 3
KINDS = ("half-space", "box", "cylinder", "sphere")


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """A convex solid.

    A half-space is what lies below its own xy plane; a cylinder stands along its own z axis.

    Raises:
        InputError: An unknown kind, sizes that are not positive and finite, a pose that scales or
            mirrors, or a shape that is hundreds of metres large or away: one in millimetres.
    """

    name: str
    kind: int
    """One of HALF_SPACE, BOX, CYLINDER, SPHERE."""
    pose: Array
    """(4, 4) the shape's frame in the base frame [m]."""
    size: Array
    """(3) a box: half its sides; a cylinder: radius, half its length, 0; a sphere: radius,
    0, 0; a half-space: zeros [m]."""

    def __post_init__(self) -> None:
        if self.kind not in range(len(KINDS)):
            raise InputError("unknown kind of shape", where=self.name, value=self.kind)
        freeze(self, "shape", pose=(4, 4), size=(3,))
        require_rigid(self.pose[None], self.name)
        needed = (0, 3, 2, 1)[self.kind]
        if not all(math.isfinite(x) and x > 0 for x in self.size[:needed]):
            said = "sizes must be positive"
            raise InputError(said, where=self.name, value=self.size[:needed].tolist())
        most = float(np.abs([*self.pose[:3, 3], *self.size]).max())
        if most > _FARTHEST:
            raise InputError(
                "sizes and places are in metres",
                where=self.name,
                value=f"{most:g} m",
                limit=f"{_FARTHEST:g} m",
            )


MOST_SHAPES = 500
_FARTHEST = 100.0
_KEYS = {
    "floor": ("height",),
    "wall": ("point", "normal"),
    "table": ("size", "position", "rpy", "thickness"),
    "box": ("size", "position", "rpy"),
    "cylinder": ("radius", "length", "position", "rpy"),
    "sphere": ("radius", "position"),
}
_OPTIONAL = {"height": 0.0, "rpy": [0.0, 0.0, 0.0], "thickness": 0.05}
"""What a file may leave out [m and rad]."""
_CARRIED = ("box", "cylinder", "sphere")


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """Shapes around the robot and on its flange."""

    shapes: tuple[Shape, ...] = ()
    """In the base frame."""
    payload: tuple[Shape, ...] = ()
    """In the flange's frame; boxes, cylinders and spheres."""
    source: str = ""
    """The file it is from."""

    def __post_init__(self) -> None:
        for shape in self.payload:
            if shape.kind == HALF_SPACE:
                raise InputError("a payload cannot be a half-space", where=shape.name)


def scene_from_json(fields: JsonFields, where: str = "scene") -> Scene:
    """A scene from its JSON object; `where` is the file's name.

    Raises:
        InputError: An unknown key or shape, a missing or wrong value.
    """
    _known(fields.values, ("shapes", "payload"), where)
    if not any(key in fields.values for key in ("shapes", "payload")):
        raise InputError("a scene needs 'shapes' or 'payload'", where=where)
    found = {
        key: tuple(
            _shape(item, f"{where}: {key} {k + 1}", tuple(_KEYS) if key == "shapes" else _CARRIED)
            for k, item in enumerate(_items(fields, key, where))
        )
        for key in ("shapes", "payload")
    }
    return Scene(shapes=found["shapes"], payload=found["payload"], source=where)


def _items(fields: JsonFields, key: str, where: str) -> list[object]:
    value = fields.values.get(key, [])
    if not isinstance(value, list):
        raise InputError(f"'{key}' must be a list of shapes", where=where, value=value)
    items = cast("list[object]", value)
    if len(items) > MOST_SHAPES:
        raise InputError(f"too many {key}", where=where, value=len(items), limit=MOST_SHAPES)
    return items


def _known(values: Mapping[str, Any], keys: tuple[str, ...], where: str) -> None:
    for key in values:
        if key not in keys:
            raise InputError(f"unknown key '{key}'", where=where, limit=", ".join(keys))


def _shape(item: object, where: str, kinds: tuple[str, ...]) -> Shape:
    if not isinstance(item, dict):
        raise InputError("a shape must be a JSON object", where=where, value=item)
    fields = JsonFields(cast("dict[str, Any]", item))
    kind = fields.get("type")
    if kind not in kinds:
        raise InputError("unknown shape", where=where, value=kind, limit=", ".join(kinds))
    name = str(kind)
    _known(fields.values, ("type", "name", *_KEYS[name]), f"{where} ({name})")
    for key in _KEYS[name]:
        if key not in fields.values and key not in _OPTIONAL:
            raise InputError(f"'{key}' is missing", where=f"{where} ({name})")
    label = fields.text("name") if "name" in fields.values else f"{name} {where.split()[-1]}"
    try:
        code, pose, size = _solid(name, JsonFields(_OPTIONAL | dict(fields.values)))
        return Shape(name=label, kind=code, pose=pose, size=size)
    except InputError as error:
        raise error.changed(where=f"{where} ({name})", next_step=None) from error


def _solid(kind: str, fields: JsonFields) -> tuple[int, Array, Array]:
    if kind == "floor":
        pose = from_xyz_rpy([0, 0, fields.number("height")], [0, 0, 0])
        return HALF_SPACE, pose, np.zeros(3)
    if kind == "wall":
        return HALF_SPACE, _facing(_vector(fields, "point"), _vector(fields, "normal")), np.zeros(3)
    rpy = _vector(fields, "rpy")
    if (np.abs(rpy) > 2 * math.pi).any():
        raise InputError("'rpy' is in radians", value=rpy.tolist(), limit="2 pi")
    pose = from_xyz_rpy(_vector(fields, "position").tolist(), rpy.tolist())
    if kind == "box":
        return BOX, pose, _vector(fields, "size") / 2
    if kind == "table":
        sides = _vector(fields, "size", 2)
        thick = fields.number("thickness")
        pose[:3, 3] -= pose[:3, 2] * thick / 2
        return BOX, pose, np.array([sides[0], sides[1], thick]) / 2
    radius = fields.number("radius")
    if kind == "cylinder":
        return CYLINDER, pose, np.array([radius, fields.number("length") / 2, 0.0])
    return SPHERE, pose, np.array([radius, 0.0, 0.0])


def _facing(point: Array, normal: Array) -> Array:
    length = float(np.linalg.norm(normal))
    if not length > 1e-9:
        raise InputError("'normal' has no length", value=normal.tolist())
    z = normal / length
    side = np.eye(3)[int(np.argmin(np.abs(z)))]
    x: Array = side - (side @ z) * z
    return from_axes(x / np.linalg.norm(x), z, point)


def _vector(fields: JsonFields, key: str, count: int = 3) -> Array:
    values = fields.vector(key)
    if len(values) != count:
        raise InputError(f"'{key}' must hold {count} numbers", value=values.tolist())
    return values


FLOORS = ("mount", "none")
MARGIN_KINDS = ("velocity", "torque", "tcp_speed", "elbow_speed", "momentum", "power")
_UPRIGHT = 0.9


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstraintSettings:
    """The limits that are switched on.

    What is on but unknown for a robot (no torque limits, no bodies) does not bind; the
    judge reports it as not judged.

    Raises:
        InputError: Bounds with NaN, or a clearance, share or tool point out of range.
    """

    bounds: MotionBounds
    """Position, velocity, acceleration; usable, that is without NaN."""
    torque: bool = True
    """Hold the robot's torque limits, with the prior model."""
    tcp_speed: bool = True
    elbow_speed: bool = True
    momentum: bool = True
    power: bool = True
    self_collision: bool = True
    scene: Scene | None = None
    """What stands around the robot and what it carries; None for nothing."""
    clearance: float = 0.01
    """Smallest distance to the scene that counts as safe [m]."""
    self_clearance: float = 0.001
    """The same between bodies of the arm [m]."""
    floor: float | str = "none"
    """Height in the base frame below which everything is solid [m], `mount` for the mounting plane
    unless the scene brings a floor, or `none`; walls and ceilings that the robot hangs on too."""
    margin: float = 0.0
    """Share of the limits in `MARGIN_KINDS` that is kept free; `bounds` is less it already."""

    def __post_init__(self) -> None:
        for name in ("lower", "upper", "velocity", "acceleration"):
            if np.isnan(getattr(self.bounds, name)).any():
                raise InputError(
                    f"the {name} bounds hold an unknown number", next_step="Use usable_bounds."
                )
        if (self.bounds.lower >= self.bounds.upper).any():
            joint = int(np.argmax(self.bounds.lower >= self.bounds.upper))
            raise InputError(
                f"joint {joint + 1}: the position limits leave no room to move",
                value=(float(self.bounds.lower[joint]), float(self.bounds.upper[joint])),
            )
        if not (isinstance(self.floor, str) or abs(self.floor) < _FARTHEST):
            raise InputError("height of the floor", value=self.floor, limit=f"{_FARTHEST:g} m")
        if isinstance(self.floor, str) and self.floor not in FLOORS:
            raise InputError("unknown floor", value=self.floor, limit="HEIGHT, mount or none")
        if not 0 <= self.margin < 1:
            raise InputError("margin of the limits", value=self.margin, limit="0 to 1")
        for name in ("clearance", "self_clearance"):
            value = getattr(self, name)
            if not (math.isfinite(value) and 0 <= value < 1):
                raise InputError(name, value=value, limit="0 to 1 m")

    @property
    def clearances(self) -> dict[str, float]:
        """Kind of distance to the smallest that is allowed [m]."""
        return {"self_collision": self.self_clearance, "environment": self.clearance}

    def required(self, kind: str) -> float:
        """What must be left of a limit: a distance [m], or a share."""
        if kind in self.clearances:
            return self.clearances[kind]
        return self.margin if kind in MARGIN_KINDS else 0.0


def stands(robot: RobotModel) -> bool:
    """Whether the robot stands on its base: gravity is along its axis."""
    return bool(-robot.gravity[2] > _UPRIGHT * np.linalg.norm(robot.gravity))


def own_floors(scene: Scene | None) -> list[str]:
    """Names of the planes of a scene on whose free side the base frame's axis points."""
    shapes = () if scene is None else scene.shapes
    planes = (item for item in shapes if item.kind == HALF_SPACE)
    return [item.name for item in planes if float(item.pose[2, 2]) > _UPRIGHT]


def surrounded(
    settings: ConstraintSettings, robot: RobotModel, *, floor: bool = True
) -> ConstraintSettings:
    """The settings with a scene that holds the floor, if asked for, and the tool's body too.

    That is a rod to the tool's point, and one to its centre of mass where the scene gives the
    payload no shape. A floor of the scene takes the place of that at the mounting plane of a robot
    that stands on it; a wall or a ceiling stays.
    """
    scene, tool = settings.scene or Scene(), robot.tool
    shapes, payload = list(scene.shapes), list(scene.payload)
    replaced = settings.floor == "mount" and bool(own_floors(scene)) and stands(robot)
    if floor and settings.floor != "none" and not replaced:
        name, height = "floor", settings.floor
        if isinstance(height, str):
            name, height = "mounting plane", 0.0
        pose = from_xyz_rpy([0, 0, height], [0, 0, 0])
        shapes.append(Shape(name=name, kind=HALF_SPACE, pose=pose, size=np.zeros(3)))
    ends = {"tool": tool.tcp}
    if tool.mass and not scene.payload:
        ends["centre"] = tool.com
    for name, end in ends.items():
        length = float(np.linalg.norm(end))
        if length > 0:
            pose = _facing(end / 2, end)
            size = np.array([tool.radius, length / 2, 0.0])
            payload.append(Shape(name=name, kind=CYLINDER, pose=pose, size=size))
    whole = Scene(shapes=tuple(shapes), payload=tuple(payload), source=scene.source)
    return replace(settings, scene=whole)
