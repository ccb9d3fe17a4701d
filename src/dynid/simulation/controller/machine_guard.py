"""What the safety system checks in every cycle."""

from __future__ import annotations

import math

import numpy as np

from dynid.protocol import RobotMode
from dynid.simulation.controller.machine_core import Core

_AT_REST = 1e-4
"""Too slow to break any limit [rad/s]."""


def watch(core: Core) -> None:
    """Judge the new set point and the state of the arm; a violation is a protective stop."""
    if core.safety.stopped or core.mode != RobotMode.RUNNING:
        core.arm.refuse()
        return
    reason = _setpoint(core) or _state(core)
    if reason is not None:
        core.protective_stop(reason)


def _setpoint(core: Core) -> str | None:
    arm = core.arm
    if arm.pending is None:
        return None
    return core.safety.judge_setpoint(arm.pending, arm.setpoint, arm.lower, arm.upper)


def _state(core: Core) -> str | None:
    arm, limits = core.arm, core.safety.limits
    state = arm.state
    speeds: list[float] = state.target.dq.tolist()
    fastest = max(map(abs, speeds))
    if fastest < _AT_REST and arm.still > 0:
        return None
    if fastest > limits.joint_speed:
        joint = max(range(len(speeds)), key=lambda k: abs(speeds[k]))
        return (
            f"C191A{32 + joint}: Joint {joint} speed violation: {fastest:.3f} rad/s, "
            f"limit {limits.joint_speed:.3f} rad/s"
        )
    deviation = float(np.max(np.abs(state.q - state.target.q)))
    if deviation > limits.deviation:
        return f"C153: Position deviates from path: {deviation:.3f} rad"
    if math.isfinite(limits.tool_speed):
        point = arm.tool_point(core.tcp_matrix)
        speed = arm.plant.tracker.tool_speed(point)
        if speed > limits.tool_speed:
            return f"Tool speed limit: {speed:.3f} m/s, limit {limits.tool_speed:.3f} m/s"
    if math.isfinite(limits.momentum):
        momentum = arm.plant.tracker.momentum()
        if momentum > limits.momentum:
            return f"Momentum limit: {momentum:.2f} kg.m/s, limit {limits.momentum:.2f} kg.m/s"
    if math.isfinite(limits.power):
        power = float(np.sum(np.abs(state.torque * state.dq)))
        if power > limits.power:
            return f"Power limit: {power:.0f} W, limit {limits.power:.0f} W"
    return None
