"""Recordings of a three-joint arm whose torques pinocchio has worked out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin

from dynid import identify
from dynid.core import Array
from dynid.identification import Estimate
from dynid.recording import ExperimentRecord
from dynid.robot import RobotModel, load_robot
from dynid.signals import Samples, process
from dynid.workflow import IdentifySettings

RATE = 125.0
SECONDS = 12.0
NOISE = np.array([0.1, 0.2, 0.05])
"""[N.m] 1 to 2 % of the torques."""
COULOMB = np.array([3.0, 4.0, 1.0])
VISCOUS = np.array([2.0, 3.0, 0.7])

_LINK = """
<link name="l{k}"><inertial><origin xyz="{com}"/><mass value="{m}"/>
<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j{k}" type="revolute"><parent link="l{p}"/><child link="l{k}"/>
<origin xyz="{xyz}"/><axis xyz="{axis}"/>
<limit lower="-3" upper="3" velocity="4" effort="200"/></joint>"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wrong:
    """What is wrong with the recording."""

    scales: tuple[float, float, float] = (1.0, 1.0, 1.0)
    tilt_deg: float = 0.0
    friction: float = 1.0
    """Coulomb and viscous friction over the usual one."""
    load_friction: float = 0.0
    push: float = 0.0
    """Force on the flange from 6.0 s [N]."""
    push_stop: float = 6.4
    """Its end [s]."""
    warming: float = 0.0
    """Share of the viscous friction that is lost along the record."""
    late: int = 0
    """Rows by which torques are stamped too late."""
    carried: float = 0.0
    """Mass on the last link [kg]."""
    carried_from: float = 0.0
    """When it is taken up [s]."""
    carried_for: float = np.inf
    """After which it is put down; it is taken up again as long after that [s]."""
    exchanged: bool = False
    """Columns of the second and third joint."""
    coupled: float = 0.0
    """Turns of the third motor per turn of the second joint."""
    side: str = "friction"
    """What is told of coupled motors: joint values (`friction`), their `torques`, or `motors`."""
    still: tuple[int, ...] = ()
    """Joints that do not move; velocities are measured then."""
    seconds: float = 12.0
    seed: int = 0


@cache
def urdf() -> str:
    links = (
        {"com": "0.02 0.01 0.1", "m": 6, "i": 0.05, "xyz": "0 0 0.2", "axis": "0 0 1"},
        {"com": "0.2 0.03 0.02", "m": 5, "i": 0.04, "xyz": "0.05 0 0.1", "axis": "0 1 0"},
        {"com": "0.15 -0.02 0.01", "m": 2, "i": 0.01, "xyz": "0.4 0 0", "axis": "0 1 0"},
    )
    text = "".join(_LINK.format(k=k + 1, p=k, **link) for k, link in enumerate(links))
    return f'<robot name="arm"><link name="l0"/>{text}</robot>'


def arm(folder: Path) -> RobotModel:
    path = folder / "arm.urdf"
    path.write_text(urdf())
    return load_robot(path)


def motion(seconds: float = SECONDS) -> tuple[Array, Array, Array, Array]:
    """t, q, dq, ddq of three joints that never repeat within the record."""
    t = np.arange(int(seconds * RATE)) / RATE
    q, dq, ddq = np.zeros((3, len(t), 3))
    random = np.random.default_rng(5)
    for speed in 2 * np.pi * np.array([0.15, 0.31, 0.53, 0.79]):
        size, phase = random.uniform(0.2, 0.5, 3), random.uniform(0, 6, 3)
        angle = np.outer(t, np.full(3, speed)) + phase
        q += size * np.sin(angle)
        dq += size * speed * np.cos(angle)
        ddq -= size * speed**2 * np.sin(angle)
    return t, q, dq, ddq


def recording(wrong: Wrong) -> ExperimentRecord:
    t, q, dq, ddq = motion(wrong.seconds)
    for moved in (q, dq, ddq):
        moved[:, list(wrong.still)] = 0.0
    model = pin.buildModelFromXML(urdf())
    lean = np.radians(wrong.tilt_deg)
    model.gravity.linear = 9.80665 * np.array(
        [0.6 * np.sin(lean), 0.8 * np.sin(lean), -np.cos(lean)]
    )
    data = model.createData()
    link = np.array([pin.rnea(model, data, *state) for state in zip(q, dq, ddq, strict=True)])
    if wrong.carried:
        body = pin.Inertia(wrong.carried, np.array([0.25, 0.02, 0.0]), 0.002 * np.eye(3))
        model.appendBodyToJoint(3, body, pin.SE3.Identity())
        turns = (t - wrong.carried_from) // wrong.carried_for
        for k in np.flatnonzero((t >= wrong.carried_from) & (turns % 2 == 0)):
            link[k] = pin.rnea(model, data, q[k], dq[k], ddq[k])
    push = np.array([0.0, wrong.push, wrong.push, 0.0, 0.0, 0.0])
    for k in np.flatnonzero((t > 6.0) & (t < wrong.push_stop)):
        pin.computeJointJacobians(model, data, q[k])
        frame = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        link[k] += pin.getJointJacobian(model, data, 3, frame).T @ push
    viscous = wrong.friction * VISCOUS * (1 - wrong.warming * t[:, None] / t[-1])
    turns = np.eye(3)
    turns[2, 1] = wrong.coupled
    motor, turned = link @ np.linalg.inv(turns), dq @ turns.T
    coulomb = wrong.friction * COULOMB
    motor += (coulomb + wrong.load_friction * np.abs(motor)) * np.tanh(turned / 0.001)
    motor += viscous * turned
    torque = motor @ turns if wrong.side == "friction" else motor
    if wrong.side == "motors":
        q = q @ turns.T
    noise = NOISE * np.random.default_rng(wrong.seed).normal(size=q.shape)
    torque = (torque + noise) * np.array(wrong.scales)
    torque = np.roll(torque, wrong.late, axis=0)
    if wrong.exchanged:
        q, torque = q[:, [0, 2, 1]], torque[:, [0, 2, 1]]
    signals = {"q": q, "effort": torque}
    if wrong.still:
        draw = np.random.default_rng([wrong.seed, 1])
        signals["q"] = q + 5e-6 * draw.normal(size=q.shape)
        signals["qd"] = dq + 1e-3 * draw.normal(size=q.shape)
    return ExperimentRecord(t=t, signals=signals)


def identified(folder: Path, wrong: Wrong) -> tuple[Estimate, Samples]:
    """The estimate from a recording, and the samples that it was fitted to."""
    robot, record = arm(folder), recording(wrong)
    estimate = identify(record, robot, IdentifySettings(preset="paper", estimator="wls")).estimate
    return estimate, process(record, robot, replace(estimate.settings, decimate=True))
