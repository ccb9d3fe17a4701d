"""Arms, motions and recordings for the scoreboard of verdicts, made without the identified model.

MuJoCo gives the rigid-body torques along a motion. Friction is this module's own: Stribeck, load
and a presliding state. The links differ from the robot's published inertias as real arms do, and
so do the axes of their tensors.
"""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core import Array, require, scipy_part
from dynid.robot import RobotModel, load_robot, to_pseudo_inertia
from dynid.trajectory import JointMotion

MOTIONS = ("fourier", "waypoints", "teach")
_WATER = 1000.0
_TURN = 0.15
"""Axes of inertia are turned by up to this from the published ones, about each axis [rad]."""

# A joint a line: kind, axis, origin [m], roll pitch yaw [deg], mass [kg] and centre [m], half sizes
# [m], torque limit [N.m or N], speed limit [rad/s or m/s], lower and upper limit [rad or m].
_SEVEN = """
r | 0 0 1 | 0 0 0.33 | 0 0 0 | 4 0 -0.03 -0.07 | 0.06 0.06 0.12 | 87 2 -2.8 2.8
r | 0 0 1 | 0 0 0 | -90 0 0 | 4.1 0 -0.08 0.03 | 0.06 0.12 0.06 | 87 2 -1.7 1.7
r | 0 0 1 | 0 -0.316 0 | 90 0 0 | 3.3 0.03 0.02 -0.06 | 0.06 0.06 0.1 | 87 2 -2.8 2.8
r | 0 0 1 | 0.0825 0 0 | 90 0 0 | 3.4 -0.05 0.06 0.03 | 0.06 0.1 0.06 | 87 2 -2.9 0.1
r | 0 0 1 | -0.0825 0.384 0 | -90 0 0 | 3.5 0 0.04 -0.1 | 0.05 0.06 0.13 | 12 2.4 -2.8 2.8
r | 0 0 1 | 0 0 0 | 90 0 0 | 1.6 0.05 0.01 0.01 | 0.05 0.05 0.05 | 12 2.4 0.1 3.6
r | 0 0 1 | 0.088 0 0 | 90 0 0 | 0.9 0.01 0 0.08 | 0.04 0.04 0.04 | 12 2.4 -2.8 2.8
"""
_HEAVY = """
r | 0 0 1 | 0 0 0.4 | 0 0 0 | 95 0.06 -0.02 0.08 | 0.25 0.25 0.2 | 1400 2.2 -2.9 2.9
r | 0 1 0 | 0.18 0 0.1 | 0 0 0 | 48 0.03 0.06 0.28 | 0.12 0.1 0.4 | 1400 2 -1.2 1.6
r | 0 1 0 | 0 0 0.6 | 0 0 0 | 42 0.08 -0.05 0.03 | 0.2 0.13 0.13 | 700 2.4 -1.6 1.6
r | 1 0 0 | 0.25 0 0.12 | 0 0 0 | 17 0.15 0.01 0 | 0.2 0.08 0.08 | 140 3 -3 3
r | 0 1 0 | 0.37 0 0 | 0 0 0 | 6.5 0.03 0.01 0 | 0.08 0.07 0.07 | 120 3 -1.9 1.9
r | 1 0 0 | 0.08 0 0 | 0 0 0 | 2.4 0.02 0.005 0.004 | 0.04 0.06 0.06 | 65 3.5 -3 3
"""
_SLIDING = """
r | 0 0 1 | 0 0 0.3 | 0 0 0 | 6 0.15 0 0.02 | 0.2 0.07 0.06 | 110 3 -2.2 2.2
r | 0 0 1 | 0.325 0 0.05 | 0 0 0 | 4.5 0.12 0.01 0.03 | 0.18 0.07 0.08 | 60 4 -2.4 2.4
p | 0 0 1 | 0.275 0 0 | 180 0 0 | 1.6 0 0 0.05 | 0.03 0.03 0.15 | 250 0.8 0 0.3
r | 0 0 1 | 0 0 0.1 | 0 0 0 | 1.1 0.02 0.01 0.03 | 0.05 0.05 0.05 | 12 5 -3 3
"""
_TABLES = {"seven": _SEVEN, "heavy": _HEAVY, "sliding": _SLIDING}
ARMS = ("ur5", "ur10e", "ur3", *_TABLES)
RANDOM = "random-"
"""Before a number: an arm that is drawn."""


def arm(name: str) -> RobotModel:
    """One of `ARMS`, three built-in ones and three of this module's, or a random one."""
    if name not in _TABLES and not name.startswith(RANDOM):
        return load_robot(name)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.urdf"
        path.write_text(urdf(name))
        return load_robot(str(path))


def _drawn(seed: int) -> str:
    """The table of an arm of 4 to 7 joints, 0.5 to 8 m long; of a third of them a joint slides."""
    draw = np.random.default_rng(seed)
    n, scale = int(draw.integers(4, 8)), 10 ** draw.uniform(-0.3, 0.5)
    slide = int(draw.integers(n)) if draw.random() < 0.35 else None
    mass = 8 * scale**2.2 * np.exp(-np.linspace(0, 1.8, n)) * draw.uniform(0.6, 1.5, n)
    lines: list[str] = []
    for k in range(n):
        axis = np.eye(3)[draw.integers(3)]
        if draw.random() < 0.25:
            axis = draw.normal(size=3)
        elif k == 0:
            axis = np.array([0.0, 0.0, 1.0])
        arrow = scale * np.array([draw.uniform(0.15, 0.5), 0.0, draw.uniform(0.0, 0.2)])
        turn = draw.choice([0, 90, -90, 180], 3) if draw.random() < 0.6 else np.zeros(3)
        weight = 9.81 * float(mass[k:].sum())
        limits = (0.6 * scale * weight * (n - k) ** 0.3, draw.uniform(1.5, 4),
                  -draw.uniform(1.2, 3), draw.uniform(1.2, 3))  # fmt: skip
        if k == slide:
            limits = (2.2 * weight, 0.8 * scale**0.3, -0.2 * scale, 0.25 * scale)
        body = (mass[k], *draw.normal(scale=0.06 * scale, size=3))
        half = scale * np.array([0.05, 0.05, 0.15]) * draw.uniform(0.5, 1.5, 3)
        parts = (axis / np.linalg.norm(axis), arrow, turn, body, half, limits)
        words = (" ".join(f"{x:.5g}" for x in part) for part in parts)
        lines.append(" | ".join(("p" if k == slide else "r", *words)))
    return "\n".join(["", *lines, ""])


def urdf(name: str) -> str:
    """The URDF of one of this module's arms."""
    drawn = name.startswith(RANDOM)
    table = _drawn(int(name.removeprefix(RANDOM))) if drawn else _TABLES[name]
    parts = [f'<robot name="{name}"><link name="link0"/>']
    for k, line in enumerate(table.split("\n")[1:-1], start=1):
        kind, axis, xyz, degrees, body, half, limits = (x.strip() for x in line.split("|"))
        rpy = " ".join(f"{np.radians(float(x)):.9g}" for x in degrees.split())
        mass, centre = body.split(" ", 1)
        second = float(mass) / 3 * np.square([float(x) for x in half.split()])
        xx, yy, zz = second.sum() - second
        torque, speed, lower, upper = limits.split()
        parts.append(
            f'<link name="link{k}"><inertial><origin xyz="{centre}"/><mass value="{mass}"/>'
            f'<inertia ixx="{xx:.6g}" iyy="{yy:.6g}" izz="{zz:.6g}" ixy="0" ixz="0" iyz="0"/>'
            f'</inertial></link><joint name="joint{k}" '
            f'type="{"revolute" if kind == "r" else "prismatic"}">'
            f'<parent link="link{k - 1}"/><child link="link{k}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
            f'<limit lower="{lower}" upper="{upper}" effort="{torque}" velocity="{speed}"/></joint>'
        )
    return "".join([*parts, "</robot>"])


@dataclass(frozen=True, slots=True, kw_only=True)
class Plant:
    """A real arm: what its torques are made of."""

    robot: RobotModel
    """The robot as built: true geometry and gravity."""
    mass: Array
    """(n) [kg]"""
    centre: Array
    """(n, 3) centres of mass in the joint frames [m]."""
    second: Array
    """(n, 3, 3) second moments of mass about the centre [kg.m^2]."""
    armature: Array
    """(n) rotor inertia, joint side [kg.m^2 or kg]."""
    coulomb: Array
    """(n) [N.m or N]"""
    viscous: Array
    """(n) [N.m.s/rad or N.s/m]"""
    stribeck: Array
    """(n) breakaway above Coulomb, share of it."""
    stribeck_velocity: Array
    """(n) [rad/s or m/s]"""
    load: Array
    """(n) Coulomb friction per rigid-body torque."""
    presliding: Array
    """(n) displacement over which friction builds up [rad or m]."""
    torque_noise: Array
    """(n) standard deviation [N.m or N]."""
    position_step: float = 5e-6
    """Resolution of the encoders [rad or m]."""

    def torque(self, q: Array, dq: Array, ddq: Array, wrench: Array | None = None) -> Array:
        """(N, n) rigid-body torques of a motion, and of a force (N, 3) at the flange [N]."""
        mujoco = require("mujoco", "sim")
        model = self._model()
        data = mujoco.MjData(model)
        out = np.empty_like(q)
        flange = model.nbody - 1
        jacobian = np.empty((3, model.nv))
        for k in range(len(q)):
            data.qpos[:], data.qvel[:], data.qacc[:] = q[k], dq[k], ddq[k]
            mujoco.mj_inverse(model, data)
            out[k] = data.qfrc_inverse
            if wrench is not None and wrench[k].any():
                point = (
                    data.xpos[flange] + data.xmat[flange].reshape(3, 3) @ self.robot.flange[:3, 3]
                )
                mujoco.mj_jac(model, data, jacobian, None, point, flange)
                out[k] -= jacobian.T @ wrench[k]
        return out

    def friction(self, dq: Array, rigid: Array, step_s: float) -> Array:
        """(N, n) friction along a motion that starts with a state of zero.

        The state z follows dz = dq/d (1 - z sign dq) dt (Dahl 1968) and friction is z times the
        Stribeck curve, which grows with the load.
        """
        curve = self.coulomb * (
            1 + self.stribeck * np.exp(-np.square(dq / self.stribeck_velocity))
        ) + self.load * np.abs(rigid)
        # Velocities are linear between samples: a joint goes on, or turns where they are zero.
        before = np.concatenate([dq[:1], dq[:-1]])
        turns = before * dq < 0
        share = np.where(turns, before / np.where(turns, before - dq, 1.0), 0.0)
        ways = np.stack([share * before, np.where(turns, (1 - share) * dq, before + dq)])
        travel = step_s * ways / 2 / self.presliding
        decay, sign = np.exp(-np.abs(travel)), np.sign(travel)
        state, now = np.empty_like(dq), np.zeros(dq.shape[1])
        for k in range(len(dq)):
            for part in range(2):
                now = sign[part, k] + (now - sign[part, k]) * decay[part, k]
            state[k] = now
        return state * curve + self.viscous * dq

    def _model(self) -> Any:
        mujoco = require("mujoco", "sim")
        spec = mujoco.MjSpec()
        spec.option.gravity = self.robot.gravity
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        body = spec.worldbody
        for k in range(self.robot.joints):
            quaternion = np.empty(4)
            mujoco.mju_mat2Quat(quaternion, self.robot.placements[k, :3, :3].ravel())
            body = body.add_body(pos=self.robot.placements[k, :3, 3], quat=quaternion)
            body.mass, body.ipos, body.explicitinertial = self.mass[k], self.centre[k], True
            tensor = np.trace(self.second[k]) * np.eye(3) - self.second[k]
            body.fullinertia = tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
            kind = "SLIDE" if self.robot.prismatic[k] else "HINGE"
            body.add_joint(
                type=getattr(mujoco.mjtJoint, f"mjJNT_{kind}"),
                axis=self.robot.axes[k],
                armature=self.armature[k],
            )
        return spec.compile()

    def with_payload(self, mass: float, centre: Array) -> "Plant":
        """The plant with a point mass [kg] at a place (3) in the last joint frame [m]."""
        total = self.mass[-1] + mass
        middle = (self.mass[-1] * self.centre[-1] + mass * centre) / total
        second = self.second[-1].copy()
        for m, c in ((self.mass[-1], self.centre[-1]), (mass, centre)):
            second += m * np.outer(c - middle, c - middle)
        return replace(
            self,
            mass=np.append(self.mass[:-1], total),
            centre=np.vstack([self.centre[:-1], middle]),
            second=np.concatenate([self.second[:-1], second[None]]),
        )


def plant(robot: RobotModel, seed: int) -> Plant:
    """Draw an arm of this type: near the published inertias, with friction of its own."""
    draw = np.random.default_rng(seed)
    n = robot.joints
    turns = np.random.default_rng([seed, 1]).uniform(-_TURN, _TURN, (n, 3))
    turned = scipy_part("spatial").transform.Rotation.from_rotvec(turns).as_matrix()
    mass = robot.inertias[:, 0].copy()
    centre = robot.inertias[:, 1:4] / mass[:, None]
    second = np.empty((n, 3, 3))
    for k in range(n):
        row = robot.inertias[k]
        if np.isnan(row).any():
            radius = (3 * mass[k] / (4 * np.pi * _WATER)) ** (1 / 3)
            second[k] = mass[k] * radius**2 / 5 * np.eye(3)
        else:
            about_frame = to_pseudo_inertia(row)[:3, :3]
            second[k] = about_frame - mass[k] * np.outer(centre[k], centre[k])
        size, axes = np.linalg.eigh(second[k])
        size = np.maximum(size, 1e-3 * size.max()) * draw.uniform(0.7, 1.3, 3)
        axes = turned[k] @ axes
        second[k] = axes * size @ axes.T
    mass *= draw.uniform(0.9, 1.1, n)
    centre = centre + draw.uniform(-0.01, 0.01, (n, 3))
    limit = np.where(np.isnan(robot.limits.torque), 50.0, robot.limits.torque)
    slow = np.where(robot.prismatic, 0.1, 1.0)
    coulomb = limit * draw.uniform(0.02, 0.07, n)
    return Plant(
        robot=robot,
        mass=mass,
        centre=centre,
        second=second,
        armature=limit * draw.uniform(0.003, 0.01, n) / slow,
        coulomb=coulomb,
        viscous=limit * draw.uniform(0.02, 0.08, n) / slow,
        stribeck=draw.uniform(0.0, 0.3, n),
        stribeck_velocity=draw.uniform(0.02, 0.1, n) * slow,
        load=draw.uniform(0.0, 0.04, n),
        presliding=10 ** draw.uniform(-4, -2.3, n) * slow,
        torque_noise=limit * draw.uniform(0.003, 0.01, n),
    )


Motion = JointMotion
"""A motion, its derivatives exact."""


def motion(robot: RobotModel, kind: str, seed: int, rate_hz: float, duration_s: float) -> Motion:
    """A motion within the robot's limits.

    Args:
        robot: The robot.
        kind: One of `MOTIONS`: repeated Fourier series, quick way points, slow way points with
            long stops.
        seed: Of the motion.
        rate_hz: Samples a second.
        duration_s: Its length [s].
    """
    draw = np.random.default_rng([seed, MOTIONS.index(kind)])
    t = np.arange(round(duration_s * rate_hz)) / rate_hz
    lower = np.fmax(robot.limits.lower, -2.6)
    upper = np.fmin(robot.limits.upper, 2.6)
    middle, half = (lower + upper) / 2, (upper - lower) / 2
    speed = np.where(np.isfinite(robot.limits.velocity), robot.limits.velocity, 2.0)
    if kind == "fourier":
        q, dq, ddq = _fourier(draw, t, middle, half, speed)
    else:
        share, stop_s = (0.9, 0.1) if kind == "waypoints" else (0.35, 0.8)
        q, dq, ddq = _points(draw, t, middle, half, share * speed, stop_s)
    return Motion(t=t, q=q, dq=dq, ddq=ddq)


def _fourier(
    draw: np.random.Generator, t: Array, middle: Array, half: Array, speed: Array
) -> tuple[Array, Array, Array]:
    n, order = len(middle), np.arange(1, 6)
    amplitude = draw.normal(size=(2, 5, n)) / np.sqrt(order)[:, None]
    # At rest at the start of each period: velocity and acceleration vanish there.
    amplitude[0] -= order[:, None] * (order @ amplitude[0]) / (order @ order)
    square = np.square(order)
    amplitude[1] -= square[:, None] * (square @ amplitude[1]) / (square @ square)
    period = min(10.0, t[-1] + t[1])
    angle = 2 * np.pi / period * np.outer(t, order)
    basis = (np.sin(angle), -np.cos(angle))
    rate = 2 * np.pi / period * order
    q = basis[0] @ amplitude[0] + basis[1] @ amplitude[1]
    dq = (rate * np.cos(angle)) @ amplitude[0] + (rate * np.sin(angle)) @ amplitude[1]
    ddq = -((rate**2) * basis[0]) @ amplitude[0] - ((rate**2) * basis[1]) @ amplitude[1]
    scale = np.minimum(
        0.9 * half / np.abs(q).max(axis=0),
        np.minimum(0.8 * speed / np.abs(dq).max(axis=0), 5 * speed / np.abs(ddq).max(axis=0)),
    )
    return middle + scale * q, scale * dq, scale * ddq


def _points(
    draw: np.random.Generator, t: Array, middle: Array, half: Array, speed: Array, stop_s: float
) -> tuple[Array, Array, Array]:
    """Quintic moves between random poses, all joints starting and stopping together."""
    q, dq, ddq = np.empty((3, len(t), len(middle)))
    here, start = middle + 0.9 * half * draw.uniform(-1, 1, len(middle)), 0.0
    while start <= t[-1]:
        there = middle + 0.9 * half * draw.uniform(-1, 1, len(middle))
        length = max(0.6, float((1.875 * np.abs(there - here) / speed).max()))
        stop = stop_s * draw.uniform(0.5, 2.0)
        rows = (t >= start) & (t < start + length + stop)
        s = np.clip((t[rows] - start) / length, 0, 1)[:, None]
        way = there - here
        q[rows] = here + way * s**3 * (10 - 15 * s + 6 * s**2)
        dq[rows] = way / length * 30 * s**2 * (1 - s) ** 2
        ddq[rows] = way / length**2 * 60 * s * (1 - s) * (1 - 2 * s)
        here, start = there, start + length + stop
    return q, dq, ddq
