"""Numbers and poses from URDF attributes: finite, within reason, and named in errors."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET

from dynid.core.arrays import Array
from dynid.core.errors import RobotError
from dynid.robot.transforms import from_xyz_rpy, translation

_LARGEST = 1e6
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_UNBOUNDED = re.compile(r"[+-]?inf(inity)?", re.IGNORECASE)


def read_origin(element: ET.Element, where: str) -> Array:
    """The `origin` within an element (4, 4), or none at all.

    Raises:
        RobotError: Not three finite numbers.
    """
    found = element.find("origin")
    if found is None:
        return translation(0, 0, 0)
    zero = [0.0, 0.0, 0.0]
    xyz = read_vector(found, "xyz", where) if found.get("xyz") is not None else zero
    rpy = read_vector(found, "rpy", where) if found.get("rpy") is not None else zero
    return from_xyz_rpy(xyz, rpy)


def read_vector(element: ET.Element, key: str, where: str) -> list[float]:
    """Three numbers.

    Raises:
        RobotError: Not three finite numbers within reason.
    """
    words = (element.get(key) or "").split()
    if len(words) != 3:
        raise RobotError(
            f"<{element.tag} {key}> needs three numbers", where=where, value=element.get(key)
        )
    return [_number(word, f"<{element.tag} {key}>", where) for word in words]


def read_number(
    element: ET.Element | None, key: str, where: str, default: float | None = None
) -> float:
    """One number, or the default where there is none.

    Raises:
        RobotError: Missing without a default, or not a finite number within reason.
    """
    text = element.get(key) if element is not None else None
    if element is None or text is None:
        if default is None:
            raise RobotError(f"the mass or its '{key}' is missing", where=where)
        return default
    return _number(text.strip(), f"<{element.tag} {key}>", where)


def read_bound(element: ET.Element, key: str, where: str) -> float:
    """A joint limit; NaN where there is none, or one far beyond any robot.

    Raises:
        RobotError: Not a number.
    """
    text = element.get(key)
    if text is None or _UNBOUNDED.fullmatch(text.strip()):
        return math.nan
    value = _number(text.strip(), f"<{element.tag} {key}>", where, math.inf)
    return value if abs(value) <= _LARGEST else math.nan


def _number(text: str, what: str, where: str, largest: float = _LARGEST) -> float:
    if not _NUMBER.fullmatch(text) or not text.isascii():
        step = "Run: xacro FILE > FILE.urdf" if "${" in text or "$(" in text else None
        raise RobotError(f"{what} is not a finite number", where=where, value=text, next_step=step)
    value = float(text)
    if abs(value) > largest:
        raise RobotError(f"{what} is out of range", where=where, value=text, limit=largest)
    return value
