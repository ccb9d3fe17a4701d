"""How the base stands in gravity."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import RobotError
from dynid.robot.model import STANDARD_GRAVITY, RobotModel
from dynid.robot.transforms import cos_sin

MOUNTS = ("floor", "wall", "ceiling", "tilt:DEG")
"""The words that `--mount` takes; DEG is a number of degrees about the base's x axis."""


def mount_gravity(mount: str) -> Array:
    """Gravity in the base frame (3) [m/s^2] for a mounting.

    `tilt:DEG` turns the floor's gravity about the base's x axis: 0 is the floor, 90 the wall,
    180 the ceiling.

    Args:
        mount: `floor`, `wall`, `ceiling` or `tilt:DEG`.

    Raises:
        RobotError: None of these, or DEG is not a number within -360 and 360.
    """
    fixed = {"floor": 0.0, "wall": 90.0, "ceiling": 180.0}
    kind, _, number = mount.partition(":")
    if mount in fixed:
        degrees = fixed[mount]
    elif kind == "tilt":
        degrees = _degrees(number)
    else:
        raise RobotError("unknown mounting", value=mount, limit=", ".join(MOUNTS))
    c, s = cos_sin(math.radians(degrees))
    # The sum turns a negative zero into zero.
    return np.array([0.0, -s, -c]) * STANDARD_GRAVITY + 0.0


def with_mount(robot: RobotModel, mount: str) -> RobotModel:
    """The same robot mounted otherwise.

    Raises:
        RobotError: The mounting is not known.
    """
    return replace(robot, gravity=mount_gravity(mount), mount=mount)


def _degrees(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) <= 360:
        raise RobotError(
            "tilt needs degrees, as in tilt:45", where="mount", value=text, limit="-360 to 360"
        )
    return value
