"""A scene that is being edited, shape by shape, and what is near the arm in it at an instant."""

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynid import constraints, export, robot
from dynid.core import Array, InputError, JsonFields, check_word, write_json

KINDS = ("box", "cylinder", "sphere", "table", "floor", "wall")
"""What can be added."""
DIMENSIONS = {
    "box": ("size x", "size y", "size z"),
    "cylinder": ("radius", "length"),
    "sphere": ("radius",),
    "table": ("size x", "size y", "thickness"),
    "floor": (),
    "wall": (),
}
"""The sizes of each kind [m]."""
_NEW: dict[str, dict[str, Any]] = {
    "box": {"size": [0.2, 0.2, 0.2], "position": [0.7, 0.0, 0.1]},
    "cylinder": {"radius": 0.1, "length": 0.3, "position": [0.7, 0.0, 0.15]},
    "sphere": {"radius": 0.1, "position": [0.7, 0.0, 0.1]},
    "table": {"size": [0.8, 0.8], "position": [0.7, 0.0, 0.0], "thickness": 0.05},
    "floor": {"height": -0.05},
    "wall": {"point": [-0.9, 0.0, 0.0], "normal": [1.0, 0.0, 0.0]},
}
_THICKNESS = 0.05
"""Of a table whose file does not say [m]."""
_DIGITS = 4
"""Of what is written: a tenth of a millimetre."""


class SceneEditor:
    """The shapes of a scene by number; numbers are never used again.

    What the flange carries (`payload`) is kept as it is.

    Args:
        document: A scene file's content; None for an empty scene.
        changes: How often the scene has been changed before.

    Raises:
        InputError: The document is no scene.
    """

    def __init__(self, document: Mapping[str, Any] | None = None, changes: int = 0) -> None:
        given = copy.deepcopy(dict(document or {"shapes": []}))
        constraints.scene_from_json(JsonFields(given))
        shapes: list[dict[str, Any]] = given.get("shapes", [])
        self._items = dict(enumerate(shapes, start=1))
        self._payload: list[Any] = given.get("payload", [])
        self._next = len(self._items) + 1
        self.changes = changes
        """How often the scene has been changed."""

    @property
    def items(self) -> dict[int, dict[str, Any]]:
        """Number to shape, as the file has it; copies."""
        return copy.deepcopy(self._items)

    def add(self, kind: str) -> int:
        """Add a shape of a usual size within reach; its number."""
        check_word(kind, KINDS)
        number = self._next
        self._items[number] = {"type": kind, "name": f"{kind} {number}"} | copy.deepcopy(_NEW[kind])
        self._next += 1
        self.changes += 1
        return number

    def remove(self, number: int) -> None:
        """Take a shape away."""
        self._item(number)
        del self._items[number]
        self.changes += 1

    def label(self, number: int) -> str:
        """What a shape is called."""
        item = self._item(number)
        return str(item.get("name") or f"{item['type']} {number}")

    def shape(self, number: int) -> constraints.Shape:
        """A shape as the judge sees it."""
        return constraints.scene_from_json(JsonFields({"shapes": [self._item(number)]})).shapes[0]

    def pose(self, number: int) -> Array:
        """(4, 4) where a shape is held: its middle; a table's top, a floor's or wall's surface."""
        item, pose = self._item(number), np.array(self.shape(number).pose)
        if item["type"] == "table":
            return pose @ robot.translation(0.0, 0.0, float(item.get("thickness", _THICKNESS)) / 2)
        return pose

    def place(self, number: int, pose: Array) -> None:
        """Move a shape to a pose (4, 4); a floor only goes up and down, a sphere does not turn."""
        item = self._item(number)
        before = copy.deepcopy(item)
        position = _rounded(pose[:3, 3])
        kind = item["type"]
        if kind == "floor":
            item["height"] = position[2]
        elif kind == "wall":
            item["point"], item["normal"] = position, _rounded(pose[:3, 2])
        else:
            item["position"] = position
            if kind != "sphere":
                item["rpy"] = _rounded(export.roll_pitch_yaw(pose[:3, :3]))
        self._keep(number, before)

    def sizes(self, number: int) -> dict[str, float]:
        """The sizes that a shape has, by the names of `DIMENSIONS` [m]."""
        item: dict[str, Any] = {"thickness": _THICKNESS, **self._item(number)}
        found: dict[str, float] = {}
        for name in DIMENSIONS[item["type"]]:
            word, _, axis = name.partition(" ")
            found[name] = float(item["size"]["xyz".index(axis)] if axis else item[word])
        return found

    def resize(self, number: int, name: str, value: float) -> None:
        """Change one of the `DIMENSIONS` of a shape [m], unless that makes no solid."""
        item = self._item(number)
        if name not in DIMENSIONS[item["type"]]:
            raise InputError("no such size", where=self.label(number), value=name)
        before = copy.deepcopy(item)
        word, _, axis = name.partition(" ")
        if axis:
            item["size"]["xyz".index(axis)] = float(value)
        else:
            item[word] = float(value)
        self._keep(number, before)

    def _keep(self, number: int, before: dict[str, Any]) -> None:
        """Count a change, unless it makes no shape: what was there before is put back then."""
        try:
            self.shape(number)
        except InputError:
            self._items[number] = before
            raise
        self.changes += 1

    def to_json(self) -> dict[str, Any]:
        """The content of a scene file."""
        document: dict[str, Any] = {"shapes": list(self.items.values())}
        return document | ({"payload": copy.deepcopy(self._payload)} if self._payload else {})

    def save(self, path: Path) -> None:
        """Write the scene file; it appears whole or not at all."""
        write_json(path, self.to_json())

    def _item(self, number: int) -> dict[str, Any]:
        if number not in self._items:
            raise InputError("there is no such shape any more", value=number)
        return self._items[number]


def _rounded(values: Any) -> list[float]:
    # Adding zero turns -0.0 into 0.0.
    return [round(float(value), _DIGITS) + 0.0 for value in values]


@dataclass(frozen=True, slots=True, kw_only=True)
class Near:
    """Two bodies and the way between them."""

    kind: str
    """`self_collision` or `environment`."""
    names: str
    distance: float
    """Between their surfaces [m]."""
    clearance: float
    """The smallest that is allowed to this pair [m]."""
    start: Array
    """(3) on the first body's surface, in the base frame [m]."""
    end: Array
    """(3) on the other's."""


def instant(
    judge: constraints.MotionConstraints, q: Array, dq: Array, ddq: Array
) -> tuple[dict[str, constraints.Worst], list[Near]]:
    """Judge (n) positions, velocities, accelerations: limits used, nearest pair of each kind."""
    rows = [np.array(values, dtype=np.float64)[None] for values in (q, dq, ddq)]
    around = judge.surroundings
    near: list[Near] = []
    if around is not None:
        near = [_near(around.bodies, kind, pairs, rows[0]) for kind, pairs in around.pairs.items()]
    return judge.usage(*rows), near


def _near(
    bodies: constraints.CollisionBodies, kind: str, pairs: constraints.JudgedPairs, q: Array
) -> Near:
    row = int(bodies.nearest(q, pairs).pair[0])
    first, second = pairs.bodies[row]
    distance, ends = bodies.closest(q[0], int(first), int(second))
    # The arm first: names stand so.
    start, end = ends[::-1] if kind == "environment" else ends
    return Near(
        kind=kind,
        names=pairs.names[row],
        distance=distance,
        clearance=float(pairs.required[row]),
        start=start,
        end=end,
    )
