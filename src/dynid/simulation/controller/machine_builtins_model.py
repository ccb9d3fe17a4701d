"""Built-ins of software 5.23 for the controller's own model of the arm; matrices are lists."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynid.core import Array
from dynid.simulation.controller.machine_core import Core
from dynid.simulation.controller.urscript.builtin import Builtin, Kind, builtin
from dynid.simulation.controller.urscript.pose_functions import matrix_of, numbers
from dynid.simulation.controller.urscript.values import Value

_WEIGHT = 1_500


def _joints(core: Core, q: Value) -> Array:
    actual = core.arm.state.q
    return actual if q is None else np.array(numbers(q, 6, "joint positions"))


def _speeds(core: Core, qd: Value) -> Array:
    actual = core.arm.state.dq
    return actual if qd is None else np.array(numbers(qd, 6, "joint speeds"))


def _mass_matrix(core: Core, q: Value = None, include_rotors_inertia: Value = False) -> Value:
    return core.arm.plant.tracker.mass_matrix(_joints(core, q)).tolist()


def _coriolis(core: Core, q: Value = None, qd: Value = None) -> Value:
    return core.arm.plant.tracker.coriolis(_joints(core, q), _speeds(core, qd)).tolist()


def _jacobian(core: Core, q: Value = None, tcp: Value = None) -> Value:
    tool = core.tcp_matrix if tcp is None else matrix_of(tcp)
    return core.arm.kinematics.jacobian(_joints(core, q).tolist(), tool)[1].tolist()


def _jacobian_rate(core: Core, q: Value = None, qd: Value = None, tcp: Value = None) -> Value:
    tool = core.tcp_matrix if tcp is None else matrix_of(tcp)
    joints, speeds = _joints(core, q).tolist(), _speeds(core, qd)
    return core.arm.kinematics.jacobian_rate(joints, speeds, tool).tolist()


_TABLE: dict[str, Any] = {
    "get_mass_matrix": _mass_matrix,
    "get_coriolis_and_centrifugal_torques": _coriolis,
    "get_jacobian": _jacobian,
    "get_jacobian_time_derivative": _jacobian_rate,
}
MODEL: list[Builtin] = [
    builtin(function, Kind.INSTANT, name=name, weight=_WEIGHT) for name, function in _TABLE.items()
]
"""Built-ins about the controller's model."""
