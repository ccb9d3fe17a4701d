"""What is checked before a real robot moves."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from dynid.constraints import Certificate, MotionConstraints, certify
from dynid.core import InputError, JobError
from dynid.drivers import ControllerState, mode_name
from dynid.experiment.approach import Approach
from dynid.experiment.plan import ExperimentPlan
from dynid.protocol import RobotMode, RuntimeState, SafetyMode
from dynid.robot import Tool

_E_SERIES = 5
_SLIDER = 1e-3
_STILL = 1e-3
_MASS, _COG, _TCP = 0.01, 0.005, 0.005


@dataclass(frozen=True, slots=True)
class PreflightCheck:
    """One thing that was looked at."""

    name: str
    """What, in a word or two."""
    passed: bool
    """Whether the robot may move."""
    finding: str
    """What was found, in words."""


def check_design(
    plan: ExperimentPlan, constraints: MotionConstraints, accepted: Collection[str] = ()
) -> Certificate:
    """Certify the motion of a plan.

    Args:
        plan: What is to be executed.
        constraints: What it is held to.
        accepted: Kinds that need not be judged.

    Raises:
        InputError: The motion breaks a limit or touches something, or that cannot be judged.
    """
    certificate = certify(plan.trajectory, constraints)
    missing = [item for item in certificate.unjudged if item.kind not in accepted]
    if certificate.holds and missing:
        raise InputError(
            f"the design must not run on {plan.robot.name}: "
            + "; ".join(f"{item.kind} cannot be judged: {item.message}" for item in missing),
            next_step=f"{missing[0].next_step} Or pass --accept-unjudged {missing[0].kind}.",
        )
    if not certificate.holds:
        raise InputError(
            f"the design must not run on {plan.robot.name}: {_broken(certificate)}",
            next_step="See: dynid check DESIGN.json, and design again with --limits safe.",
        )
    return certificate


def check_robot(
    plan: ExperimentPlan, state: ControllerState, approach: Approach
) -> tuple[PreflightCheck, ...]:
    """Look at a controller before it gets a plan.

    Args:
        plan: What is to be executed.
        state: The controller, as it says it is.
        approach: The way from where it stands to the start.
    """
    mode = mode_name(RobotMode, state.robot_mode)
    safety = mode_name(SafetyMode, state.safety_mode)
    program = mode_name(RuntimeState, state.runtime_state)
    speed = float(np.abs(state.target_qd).max())
    return (
        _model(plan.robot.name, state),
        PreflightCheck("rate", plan.rate_hz == state.rate_hz, f"{state.rate_hz:g} cycles a second"),
        PreflightCheck("robot mode", state.robot_mode == RobotMode.RUNNING, mode),
        PreflightCheck("safety mode", state.safety_mode == SafetyMode.NORMAL, safety),
        PreflightCheck("program", state.runtime_state == RuntimeState.STOPPED, program),
        PreflightCheck("remote control", state.remote is not False, _remote(state)),
        PreflightCheck(
            "speed slider",
            abs(state.speed_fraction - 1.0) <= _SLIDER,
            f"{100 * state.speed_fraction:.4g} %",
        ),
        PreflightCheck("at rest", speed <= _STILL, f"{speed:.3g} rad/s"),
        _payload(plan.robot.tool, state),
        _tool(plan.robot.tool, state),
        _approach(approach),
    )


def require_ready(checks: tuple[PreflightCheck, ...], where: str) -> None:
    """Refuse a robot that is not ready.

    Args:
        checks: What was looked at.
        where: The robot's address.

    Raises:
        JobError: Something was found; the message names all of it.
    """
    wrong = [f"{check.name}: {check.finding}" for check in checks if not check.passed]
    if wrong:
        raise JobError(f"the robot is not ready; {'; '.join(wrong)}", where=where)


def _model(name: str, state: ControllerState) -> PreflightCheck:
    """The dashboard calls a UR5e a UR5; the major version tells them apart."""
    version = ".".join(str(part) for part in state.version[:3])
    finding = f"{state.model or 'unknown model'}, software {version}"
    called = name.lower()
    # Without a dashboard there is only the version to go by.
    known = not state.model or state.model.lower().removesuffix("e") == called.removesuffix("e")
    e_series = called.endswith("e")
    fits = not called.startswith("ur") or (state.version[0] >= _E_SERIES) == e_series
    return PreflightCheck("model", known and fits, f"{finding}, design for {name}")


def _remote(state: ControllerState) -> str:
    if state.remote is None:
        return "no such switch"
    return "on" if state.remote else "off: switch it on at the pendant"


def _payload(asked: Tool, state: ControllerState) -> PreflightCheck:
    if state.payload is None:
        return PreflightCheck(
            "payload", True, f"unknown to RTDE; {asked.mass:g} kg are meant to be set"
        )
    finding = f"{state.payload:.3g} kg set, {asked.mass:.3g} kg asked for"
    fits = abs(state.payload - asked.mass) <= _MASS
    if fits and state.payload_cog is not None and asked.mass > 0:
        away = float(np.abs(state.payload_cog - asked.com).max())
        fits = away <= _COG
        finding += f", centres {1e3 * away:.3g} mm apart"
    return PreflightCheck("payload", fits, finding)


def _tool(asked: Tool, state: ControllerState) -> PreflightCheck:
    if state.tcp_offset is None:
        return PreflightCheck(
            "tool", True, f"unknown to RTDE; {asked.tcp.tolist()} m is meant to be set"
        )
    away = float(np.abs(state.tcp_offset - asked.tcp).max())
    finding = f"the point set is {1e3 * away:.3g} mm from the one asked for"
    # The arm is held to the design's point; the controller will watch its own.
    fits = away <= _TCP
    return PreflightCheck("tool", fits, finding if fits else f"{finding} (--tool X,Y,Z)")


def _approach(approach: Approach) -> PreflightCheck:
    finding = approach.describe()
    if approach.refused is not None:
        start = [round(float(value), 3) for value in approach.poses[-1]]
        finding += f", {_broken(approach.refused)}: jog the robot closer to {start}"
    return PreflightCheck("way to the start", approach.free, finding)


def _broken(certificate: Certificate) -> str:
    found: list[str] = []
    for kind in certificate.broken:
        item = certificate.worst[kind]
        place = f" ({item.what})" if item.what else ""
        found.append(f"{kind.replace('_', ' ')}{place} by {-item.room:.3g} at {item.t:.3g} s")
    return ", ".join(found)
