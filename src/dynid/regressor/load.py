"""Friction that grows with the load of a gear, |tau_load| tanh(dq / width)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from dynid.core.errors import InputError


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadFriction:
    """Which joints have it, and what their load is.

    The load is the torque of known inertial parameters. They come from an earlier fit and are
    part of the column's shape, as a Stribeck velocity is: so the column stays linear in its own
    parameter (Bittencourt and Axelsson 2014; the load of the previous iterate).

    Raises:
        InputError: No, repeated or negative joints, or parameters that are not finite.
    """

    joints: tuple[int, ...]
    """From 0."""
    parameters: tuple[float, ...]
    """(10 n) inertial parameters whose torque is the load, in the model's frames."""

    def __post_init__(self) -> None:
        if not self.joints or len(set(self.joints)) < len(self.joints) or min(self.joints) < 0:
            raise InputError("load friction needs joints, each once", value=self.joints)
        if not all(math.isfinite(value) for value in self.parameters):
            raise InputError("the parameters of the load must be finite")

    def check_joints(self, joints: int) -> None:
        """Check against the number of joints of a robot.

        Raises:
            InputError: A joint that the robot does not have, or a load of another robot.
        """
        if max(self.joints) >= joints or len(self.parameters) != 10 * joints:
            raise InputError(
                "load friction of another robot",
                value=(max(self.joints) + 1, len(self.parameters)),
                limit=(joints, 10 * joints),
            )

    def describe(self) -> str:
        """In the form of `--terms`."""
        return f"fl:{'+'.join(str(j + 1) for j in self.joints)}"

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {"joints": [j + 1 for j in self.joints], "parameters": list(self.parameters)}


def load_from_json(data: Mapping[str, Any] | None) -> LoadFriction | None:
    """The inverse of `LoadFriction.to_json`."""
    if data is None:
        return None
    return LoadFriction(
        joints=tuple(int(j) - 1 for j in data["joints"]),
        parameters=tuple(float(value) for value in data["parameters"]),
    )
