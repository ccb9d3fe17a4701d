"""The judge: everything that a motion of one robot is held to.

The two sets of limits that commands offer: the paper's, and all that is safe.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from dynid.constraints.bodies import surroundings_of
from dynid.constraints.dynamic import TorqueJudge, prior_dynamics, prior_link
from dynid.constraints.limits import (
    DISTANCES,
    RATIOS,
    MovingPoints,
    Usage,
    Worst,
    bound_notes,
    bound_ratios,
    bound_violation,
    judged_points,
)
from dynid.constraints.scene import ConstraintSettings, Scene
from dynid.core import Array, InputError
from dynid.robot import RobotModel, from_body
from dynid.trajectory import usable_bounds


class MotionConstraints:
    """Limits and collisions of one robot, for designs and for runs.

    Args:
        robot: The robot.
        settings: What to hold.

    Raises:
        InputError: Bounds for another number of joints, or a scene in which the robot cannot
            stand.
    """

    def __init__(self, robot: RobotModel, settings: ConstraintSettings) -> None:
        if settings.bounds.joints != robot.joints:
            raise InputError(
                "joints of the bounds", value=settings.bounds.joints, limit=robot.joints
            )
        self.robot = robot
        self.settings = settings
        notes = bound_notes(robot, settings.bounds)
        self.surroundings = surroundings_of(robot, settings, notes)
        loaded = _loaded(robot, settings)
        self.torque = _torque_judge(loaded, settings, notes)
        self.points: dict[str, tuple[MovingPoints, float]] = judged_points(loaded, settings, notes)
        self.notes = tuple(notes)
        """What is not judged, and what was assumed, in words."""

    def usage(self, q: Array, dq: Array, ddq: Array, t: Array | None = None) -> Usage:
        """The worst of every kind at samples.

        Args:
            q: (N, n) positions [rad or m].
            dq: (N, n) velocities.
            ddq: (N, n) accelerations.
            t: (N) times [s]; the samples' numbers if not given.
        """
        self._check(q, dq, ddq)
        times = np.arange(len(q), dtype=np.float64) if t is None else t
        worst = {kind: Worst(margin=math.nan) for kind in (*RATIOS, *DISTANCES)}
        bounds, joints = self.settings.bounds, self.robot.joint_names
        kinds = ("position", "velocity", "acceleration")
        limits = (bounds.upper, bounds.velocity, bounds.acceleration)
        ratios = bound_ratios(bounds, q, dq, ddq)
        for kind, value, limit, ratio in zip(kinds, (q, dq, ddq), limits, ratios, strict=True):
            if np.isfinite(limit).any():
                worst[kind] = _largest(ratio, value, limit, times, joints)
        position = worst["position"]
        if position.what:
            joint = joints.index(position.what)
            if position.value < (bounds.lower[joint] + bounds.upper[joint]) / 2:
                lower = float(bounds.lower[joint])
                worst["position"] = Worst(
                    margin=position.margin,
                    t=position.t,
                    what=position.what,
                    value=position.value,
                    limit=lower,
                )
        if self.torque is not None:
            torque, power = self.torque.largest(q, dq, ddq)
            if np.isfinite(self.torque.limits).any():
                limit = self.torque.limits
                worst["torque"] = _largest(torque / limit, torque, limit, times, joints)
            if not math.isnan(self.torque.power):
                worst["power"] = _over(power, self.torque.power, times)
        for kind, (points, limit) in self.points.items():
            worst[kind] = _over(points.norms(q, dq), limit, times)
        if self.surroundings is not None:
            for kind, names in self.surroundings.names.items():
                if names:
                    found = self.surroundings.bodies.nearest(q, around=kind == "environment")
                    k = int(np.argmin(found.distance))
                    least = float(found.distance[k])
                    worst[kind] = Worst(
                        margin=least,
                        t=float(times[k]),
                        what=names[int(found.pair[k])],
                        value=least,
                        limit=self.settings.clearances[kind],
                        distance=True,
                    )
        return Usage(worst=worst)

    def violation(
        self, q: Array, dq: Array, ddq: Array, *, tighten: float = 0.0
    ) -> tuple[float, Array, Array, Array]:
        """How much the limits are broken at samples, as one smooth number.

        The sum over samples and limits of the squared excess over the limit, as a share of the
        limit; a missing clearance counts in units of `shortfall_kernels.LENGTH`.

        Args:
            q: (N, n) positions [rad or m].
            dq: (N, n) velocities.
            ddq: (N, n) accelerations.
            tighten: Share by which every limit shrinks and the clearance grows.

        Returns:
            The sum, 0 where every limit holds, and its exact derivatives (N, n) with respect
            to q, dq and ddq.
        """
        self._check(q, dq, ddq)
        share = 1.0 - tighten
        total, q_bar, dq_bar, ddq_bar = bound_violation(self.settings.bounds, q, dq, ddq, share)
        if self.torque is not None:
            more, a, b, c = self.torque.violation(q, dq, ddq, share)
            total += more
            q_bar, dq_bar, ddq_bar = q_bar + a, dq_bar + b, ddq_bar + c
        for points, limit in self.points.values():
            more, a, b = points.violation(q, dq, share * limit)
            total += more
            q_bar, dq_bar = q_bar + a, dq_bar + b
        if self.surroundings is not None:
            own, around = ((1.0 + tighten) * x for x in self.settings.clearances.values())
            more, a = self.surroundings.bodies.violation(q, own, around)
            total += more
            q_bar = q_bar + a
        return total, q_bar, dq_bar, ddq_bar

    def check_pose(self, q: Array, name: str = "start pose") -> None:
        """Refuse a pose (n) that breaks a position bound or collides.

        Raises:
            InputError: It does; the message names the joint or the bodies.
        """
        pose = np.array(q, dtype=np.float64).reshape(1, -1)
        rest = np.zeros(pose.shape)
        worst = self.usage(pose, rest, rest).worst
        outside = worst["position"]
        if outside.margin < 0:
            raise InputError(
                f"the {name} is outside the position limits",
                where=outside.what,
                value=outside.value,
                limit=outside.limit,
            )
        for kind in DISTANCES:
            item = worst[kind]
            if item.room < 0:
                raise InputError(
                    f"the {name} is in collision, or nearer than the clearance",
                    where=item.what,
                    value=f"{item.value:.4f} m",
                    limit=f"{item.limit:g} m",
                    next_step="Choose another pose, or check the scene file.",
                )

    def _check(self, q: Array, dq: Array, ddq: Array) -> None:
        # The compiled kernels trust their shapes: they would read beyond shorter arrays.
        for name, array in (("q", q), ("dq", dq), ("ddq", ddq)):
            expected = (len(q), self.robot.joints)
            if array.shape != expected:
                raise InputError(f"{name} does not fit", value=array.shape, limit=expected)


def _loaded(robot: RobotModel, settings: ConstraintSettings) -> RobotModel:
    """The robot with its payload as a part of the last link."""
    if not settings.payload_mass or np.isnan(robot.inertias[-1, :4]).any():
        return robot
    place = robot.flange[:3, :3] @ settings.payload_com + robot.flange[:3, 3]
    inertias = np.array(robot.inertias)
    inertias[-1] = prior_link(robot, robot.joints - 1) + from_body(
        settings.payload_mass, place, np.zeros((3, 3))
    )
    return replace(robot, inertias=inertias)


def _torque_judge(
    robot: RobotModel, settings: ConstraintSettings, notes: list[str]
) -> TorqueJudge | None:
    nan = np.full(robot.joints, np.nan)
    limits = robot.limits.torque if settings.torque else nan
    power = robot.safety.power if settings.power else math.nan
    if settings.torque and np.isnan(robot.limits.torque).any():
        notes.append("torque is not judged where the robot gives no torque limit")
    if np.isnan(limits).all() and math.isnan(power):
        return None
    prior = prior_dynamics(robot)
    if prior is None:
        notes.append("torque and power are not judged: a mass or centre of mass is unknown")
        return None
    notes.extend(prior.notes)
    return TorqueJudge(
        prior=prior, limits=limits, power=power, uncertainty=settings.torque_uncertainty
    )


def _largest(
    ratio: Array, value: Array, limit: Array, times: Array, joints: tuple[str, ...]
) -> Worst:
    k, j = divmod(int(np.nanargmax(ratio)), ratio.shape[1])
    return Worst(
        margin=1.0 - float(ratio[k, j]),
        t=float(times[k]),
        what=joints[j],
        value=float(value[k, j]),
        limit=float(limit[j]),
    )


def _over(value: Array, limit: float, times: Array) -> Worst:
    k = int(np.argmax(value))
    return Worst(
        margin=1.0 - float(value[k]) / limit,
        t=float(times[k]),
        value=float(value[k]),
        limit=limit,
    )


PRESETS = ("safe", "paper")
"""The words of `--limits`."""


def paper_constraints(
    robot: RobotModel, *, acceleration: ArrayLike | None = None
) -> MotionConstraints:
    """The paper's problem alone: bounds of position, velocity and acceleration.

    Args:
        robot: The robot.
        acceleration: Bounds where the robot knows none [rad/s^2 or m/s^2].

    Raises:
        InputError: Bounds that leave no room.
    """
    settings = ConstraintSettings(
        bounds=usable_bounds(robot.limits, acceleration),
        torque=False,
        tcp_speed=False,
        elbow_speed=False,
        momentum=False,
        power=False,
        self_collision=False,
    )
    return MotionConstraints(robot, settings)


def safe_constraints(
    robot: RobotModel,
    scene: Scene | None = None,
    *,
    collision: bool = True,
    acceleration: ArrayLike | None = None,
    clearance: float = 0.01,
    payload_mass: float = 0.0,
    payload_com: ArrayLike = (0.0, 0.0, 0.0),
) -> MotionConstraints:
    """Everything that is known of the robot, and its surroundings.

    Args:
        robot: The robot.
        scene: What stands around it and what it carries.
        collision: Whether to look at collisions (`--no-collision` switches it off).
        acceleration: Bounds where the robot knows none [rad/s^2 or m/s^2].
        clearance: Smallest distance to the scene [m].
        payload_mass: Mass of what the flange carries [kg].
        payload_com: (3) its centre of mass in the flange's frame [m].

    Raises:
        InputError: Bounds that leave no room, or a scene in which the robot cannot stand.
    """
    settings = ConstraintSettings(
        bounds=usable_bounds(robot.limits, acceleration),
        self_collision=collision,
        scene=scene if collision else None,
        clearance=clearance,
        payload_mass=payload_mass,
        payload_com=np.asarray(payload_com, dtype=np.float64),
    )
    return MotionConstraints(robot, settings)
