"""Scene files: what stands around the robot, and what it carries.

    {"shapes":  [{"type": "floor",    "height": 0.0},
                 {"type": "wall",     "point": [0.8, 0, 0], "normal": [-1, 0, 0]},
                 {"type": "table",    "size": [1.2, 0.8], "position": [0, 0, 0], "thickness": 0.05},
                 {"type": "box",      "size": [x, y, z], "position": [x, y, z], "rpy": [r, p, y]},
                 {"type": "cylinder", "radius": r, "length": l, "position": ..., "rpy": ...},
                 {"type": "sphere",   "radius": r, "position": ...}],
     "payload": [box, cylinder or sphere, in the flange's frame]}

Everything is in the robot's base frame, in metres and radians; every shape may have a `name`.
A floor fills all that is below it and a wall all that is behind it (its normal points to the
free side); a table is solid from its top, whose middle is `position`, down to `thickness`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from dynid.constraints.shapes import BOX, CYLINDER, HALF_SPACE, SPHERE, Shape
from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.robot.transforms import from_axes, from_xyz_rpy
from dynid.trajectory.json_fields import JsonFields, load_object

MOST_SHAPES = 500
_TABLE = 0.05
_KEYS = {
    "floor": ("height",),
    "wall": ("point", "normal"),
    "table": ("size", "position", "rpy", "thickness"),
    "box": ("size", "position", "rpy"),
    "cylinder": ("radius", "length", "position", "rpy"),
    "sphere": ("radius", "position"),
}
_OPTIONAL = ("height", "rpy", "thickness")
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


def read_scene(path: Path) -> Scene:
    """Read a scene file.

    Raises:
        InputError: A file that cannot be read or is not a scene; the message names shape
            and key.
    """
    return scene_from_json(load_object(path), str(path))


def scene_from_json(fields: JsonFields, where: str = "scene") -> Scene:
    """A scene from its JSON object.

    Args:
        fields: The object.
        where: The file's name, for errors.

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
        code, pose, size = _solid(name, fields)
        return Shape(name=label, kind=code, pose=pose, size=size)
    except InputError as error:
        raise InputError(
            error.what, where=f"{where} ({name})", value=error.value, limit=error.limit
        ) from error


def _solid(kind: str, fields: JsonFields) -> tuple[int, Array, Array]:
    if kind == "floor":
        height = fields.number("height") if "height" in fields.values else 0.0
        return HALF_SPACE, from_xyz_rpy([0, 0, height], [0, 0, 0]), np.zeros(3)
    if kind == "wall":
        return HALF_SPACE, _facing(_three(fields, "point"), _three(fields, "normal")), np.zeros(3)
    rpy = _three(fields, "rpy") if "rpy" in fields.values else np.zeros(3)
    pose = from_xyz_rpy(_three(fields, "position").tolist(), rpy.tolist())
    if kind == "box":
        return BOX, pose, _three(fields, "size") / 2
    if kind == "table":
        sides = _some(fields, "size", 2)
        thick = fields.number("thickness") if "thickness" in fields.values else _TABLE
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
    x = side - (side @ z) * z
    return from_axes(x / np.linalg.norm(x), z, point)


def _three(fields: JsonFields, key: str) -> Array:
    return _some(fields, key, 3)


def _some(fields: JsonFields, key: str, count: int) -> Array:
    values = fields.vector(key)
    if len(values) != count:
        raise InputError(f"'{key}' must hold {count} numbers", value=values.tolist())
    return values
