"""The judge: everything that a motion of one robot is held to.

The two sets of limits that commands offer: the paper's, and all that is safe.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from dynid.constraints import arm, bodies, limits
from dynid.constraints.collision import Proximity
from dynid.constraints.scene import ConstraintSettings, Scene, own_floors, stands, surrounded
from dynid.core import Array, InputError
from dynid.robot import RobotModel, carried
from dynid.trajectory import usable_bounds


class MotionConstraints:
    """Limits and collisions of one robot, for designs and for runs.

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
        around = settings.scene is not None or settings.floor != "none"
        asked = {"torque": settings.torque, "self_collision": settings.self_collision}
        asked["environment"] = settings.self_collision and around
        doubts = limits.doubted_units(robot)
        unjudged: list[limits.Unjudged] = [item for item in doubts if asked.get(item.kind, True)]
        notes = limits.bound_notes(robot, settings.bounds, unjudged)
        self.surroundings = _surroundings(robot, settings, notes, unjudged)
        loaded = _loaded(robot)
        self.torque = _torque_judge(loaded, settings, notes, unjudged)
        self.points: dict[str, tuple[limits.MovingPoints, float]] = limits.judged_points(
            loaded, settings, unjudged
        )
        torque = np.zeros(robot.joints) if self.torque is None else self.torque.limits
        held = (self.torque is not None) & np.isfinite(torque)
        notes += limits.acceleration_notes(robot, settings.bounds, held, unjudged)
        self.notes = tuple(notes)
        """What was assumed, in words."""
        self.unjudged = tuple(unjudged)
        """What was asked for and cannot be judged."""

    def usage(
        self, q: Array, dq: Array, ddq: Array, t: Array | None = None
    ) -> dict[str, limits.Worst]:
        """Kind (`RATIOS`, `DISTANCES`) to its worst at samples; margins not judged are NaN.

        Args:
            q: (N, n) positions [rad or m].
            dq: (N, n) velocities.
            ddq: (N, n) accelerations.
            t: (N) times [s]; the samples' numbers if not given.
        """
        self._check(q, dq, ddq)
        times = np.arange(len(q), dtype=np.float64) if t is None else t
        worst = {
            kind: limits.Worst(margin=math.nan) for kind in (*limits.RATIOS, *limits.DISTANCES)
        }
        bounds, joints = self.settings.bounds, self.robot.joint_names
        free = self.settings.required
        end = np.where(q - bounds.lower < bounds.upper - q, bounds.lower, bounds.upper)
        ratios = limits.bound_ratios(bounds, q, dq, ddq)
        held = [
            ("position", q, end, ratios[0]),
            ("velocity", dq, bounds.velocity, ratios[1]),
            ("acceleration", ddq, bounds.acceleration, ratios[2]),
        ]
        if self.torque is not None:
            torque, power = self.torque.largest(q, dq, ddq)
            held.append(("torque", torque, self.torque.limits, torque / self.torque.limits))
            if not math.isnan(self.torque.power):
                worst["power"] = _over(power, self.torque.power, times, free("power"))
        for kind, value, limit, ratio in held:
            if np.isfinite(limit).any():
                worst[kind] = _largest(ratio, value, limit, times, joints, free(kind))
        for kind, (points, limit) in self.points.items():
            worst[kind] = _over(points.norms(q, dq), limit, times, free(kind))
        if self.surroundings is not None:
            for kind, pairs in self.surroundings.pairs.items():
                found = self.surroundings.bodies.nearest(q, pairs)
                k = int(np.argmin(found.room))
                pair = int(found.pair[k])
                required = float(pairs.required[pair])
                least = float(found.room[k]) + required
                worst[kind] = limits.Worst(
                    margin=least,
                    t=float(times[k]),
                    what=pairs.names[pair],
                    value=least,
                    limit=required,
                    required=required,
                    distance=True,
                )
        return worst

    def holds(self, q: Array, dq: Array, ddq: Array) -> bool:
        """Whether no judged limit is broken at any sample (N, n)."""
        return all(item.room >= 0 for item in self.usage(q, dq, ddq).values())

    def proximity(self, samples: int) -> Proximity | None:
        """A memory of distances for motions of so many samples; see `CollisionBodies`."""
        around, bounds = self.surroundings, self.settings.bounds
        if around is None:
            return None
        travel = np.maximum(np.abs(bounds.lower), np.abs(bounds.upper))
        return around.bodies.proximity(around.all_pairs, samples, travel)

    def violation(
        self,
        q: Array,
        dq: Array,
        ddq: Array,
        *,
        tighten: float = 0.0,
        caution: float = 0.0,
        known: Proximity | None = None,
        most: float = math.inf,
    ) -> tuple[float, Array, Array, Array]:
        """How much the limits are broken at samples, as one smooth number.

        The sum over samples and limits of the squared excess over the limit, as a share of the
        limit; a missing clearance counts in units of `collision.LENGTH`.

        Args:
            q: (N, n) positions [rad or m].
            dq: (N, n) velocities.
            ddq: (N, n) accelerations.
            tighten: Share by which every limit shrinks and the clearance grows.
            caution: What is added to the clearance where a pair has room for it [m].
            known: Distances of an earlier call for the same samples; see `proximity`.
            most: Where the sum is beyond this, the rest may be left out.

        Returns:
            The sum, 0 where every limit holds, and its exact derivatives (N, n) with respect
            to q, dq and ddq.
        """
        self._check(q, dq, ddq)
        share = 1.0 - tighten
        total, q_bar, dq_bar, ddq_bar = limits.bound_violation(
            self.settings.bounds, q, dq, ddq, share
        )
        if self.torque is not None:
            more, a, b, c = self.torque.violation(q, dq, ddq, share)
            total += more
            q_bar, dq_bar, ddq_bar = q_bar + a, dq_bar + b, ddq_bar + c
        if self.points:
            more, a, b = limits.speed_violation(list(self.points.values()), q, dq, share)
            total += more
            q_bar, dq_bar = q_bar + a, dq_bar + b
        around = self.surroundings
        if around is not None and total <= most:
            clearances: list[Array] = []
            for kind, pairs in around.pairs.items():
                # Pairs that can never be far apart have no room to be cautious with.
                roomy = pairs.required == self.settings.clearances[kind]
                wide = (1.0 + tighten) * (pairs.required + caution)
                clearances.append(np.where(roomy, wide, pairs.required))
            more, a = around.bodies.violation(
                q, around.all_pairs, np.concatenate(clearances), known=known, most=most - total
            )
            total += more
            q_bar = q_bar + a
        return total, q_bar, dq_bar, ddq_bar

    def check_pose(self, q: Array) -> None:
        """Refuse a pose (n) that breaks a position bound or collides.

        Raises:
            InputError: It does; the message names the joint or the bodies.
        """
        pose = np.array(q, dtype=np.float64).reshape(1, -1)
        rest = np.zeros(pose.shape)
        worst = self.usage(pose, rest, rest)
        outside = worst["position"]
        if outside.margin < 0:
            raise InputError(
                "the start pose is outside the position limits",
                where=outside.what,
                value=outside.value,
                limit=outside.limit,
            )
        for kind in limits.DISTANCES:
            item = worst[kind]
            if item.room < 0:
                raise InputError(
                    "the start pose is in collision, or nearer than the clearance",
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


def _surroundings(
    robot: RobotModel,
    settings: ConstraintSettings,
    notes: list[str],
    unjudged: list[limits.Unjudged],
) -> bodies.Surroundings | None:
    """The bodies to judge, the floor and the tool among them; None where no pair is judged."""
    turned = () if stands(robot) else own_floors(settings.scene)
    notes += [
        f"'{name}' is parallel to the mounting plane, it is not horizontal" for name in turned
    ]
    said = len(notes)
    whole = surrounded(settings, robot)
    try:
        found = bodies.surroundings_of(robot, whole, notes)
    except InputError as error:
        # Nobody asked for the floor at the mounting plane: where it cannot be, one must say so.
        if settings.floor != "mount":
            raise
        del notes[said:]
        bare = surrounded(settings, robot, floor=False)
        found = bodies.surroundings_of(robot, bare, notes)
        if robot.bodies:
            whole = bare
            unjudged.append(
                limits.Unjudged(
                    kind="environment",
                    causes=(f"there can be no floor at the mounting plane: {error.what}",),
                    next_step=f"{error.next_step or 'Say where it is: --floor HEIGHT.'} If there "
                    "is none: --floor none.",
                )
            )
    given = settings.scene.shapes if settings.scene is not None else ()
    if found is not None and given and {shape.name for shape in given} <= found.far:
        unjudged.append(
            limits.Unjudged(
                kind="environment",
                causes=("all of the scene is three lengths of the arm away, or more",),
                next_step="Give the scene in metres, in the base frame; without what is far away.",
            )
        )
    asked = {
        "self_collision": settings.self_collision,
        "environment": whole.scene is not None and bool(whole.scene.shapes),
    }
    for kind, on in asked.items():
        causes = bodies.not_held(robot) if found is None else found.lacking[kind]
        if on and causes:
            unjudged.append(limits.Unjudged(kind=kind, causes=causes, next_step=bodies.GIVE_SHAPES))
    return found if found is not None and found.pairs else None


def _loaded(robot: RobotModel) -> RobotModel:
    """The robot with its payload as a part of the last link."""
    if not robot.tool.mass or np.isnan(robot.inertias[-1, :4]).any():
        return robot
    inertias = np.array(robot.inertias)
    inertias[-1] = arm.prior_link(robot, robot.joints - 1) + carried(robot)
    return replace(robot, inertias=inertias)


def _torque_judge(
    robot: RobotModel,
    settings: ConstraintSettings,
    notes: list[str],
    unjudged: list[limits.Unjudged],
) -> arm.TorqueJudge | None:
    share = 1.0 - settings.margin
    torques = share * robot.limits.torque if settings.torque else np.full(robot.joints, np.nan)
    power = share * robot.safety.power if settings.power else math.nan
    unknown = ~np.isfinite(robot.limits.torque)
    if settings.torque and unknown.any():
        unjudged.append(limits.unknown_limit(robot, "torque", unknown))
    if np.isnan(torques).all() and math.isnan(power):
        return None
    prior = arm.prior_dynamics(robot)
    if prior is None:
        known = {"torque": not np.isnan(torques).all(), "power": not math.isnan(power)}
        unjudged += [limits.unknown_masses(kind) for kind, is_known in known.items() if is_known]
        return None
    notes.extend(prior.notes)
    return arm.TorqueJudge(prior=prior, limits=torques, power=power)


def _largest(
    ratio: Array, value: Array, limit: Array, times: Array, joints: tuple[str, ...], free: float
) -> limits.Worst:
    k, j = divmod(int(np.nanargmax(ratio)), ratio.shape[1])
    return limits.Worst(
        margin=limits.left_over(float(ratio[k, j]), free),
        t=float(times[k]),
        what=joints[j],
        value=float(value[k, j]),
        limit=float(np.broadcast_to(limit, ratio.shape)[k, j]) / (1.0 - free),
        required=free,
    )


def _over(value: Array, limit: float, times: Array, free: float) -> limits.Worst:
    alone = value[:, None]
    return _largest(alone / limit, alone, np.array(limit), times, ("",), free)


PRESETS = ("safe", "paper")
"""The words of `--limits`."""
MARGIN = 0.05
"""Share of a limit that a safe motion keeps free."""
CLEARANCE = 0.01
"""What a safe motion keeps between bodies and to the scene [m]. An arm that stands on its table has
no more under its shoulder: the UR5 keeps 13 mm there whatever it does."""


def paper_constraints(robot: RobotModel) -> MotionConstraints:
    """The paper's problem alone: bounds of position, velocity and acceleration.

    Raises:
        InputError: Bounds that leave no room.
    """
    settings = ConstraintSettings(
        bounds=usable_bounds(robot.limits),
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
    clearance: float = CLEARANCE,
    margin: float = MARGIN,
    floor: float | str = "mount",
) -> MotionConstraints:
    """Everything that is known of the robot with its tool, and its surroundings.

    Args:
        robot: The robot.
        scene: What stands around it and what it carries.
        collision: Whether to look at collisions (`--no-collision` switches it off).
        acceleration: Bounds where the robot knows none [rad/s^2 or m/s^2].
        clearance: Smallest distance between bodies, and to the scene [m].
        margin: Share kept free of the limits of velocity, speed, torque, momentum and power.
        floor: Where the floor is; see `ConstraintSettings`.

    Raises:
        InputError: Bounds that leave no room, a payload above the rated one, or a scene in which
            the robot cannot stand.
    """
    mass, rated = robot.tool.mass, robot.safety.payload
    if mass > rated:
        raise InputError(
            "the payload is above the rated one",
            where=robot.name,
            value=f"{mass:g} kg",
            limit=f"{rated:g} kg",
            next_step="Give the mass at the flange: --payload KG,X,Y,Z, or [tool] in a robot file.",
        )
    bounds = usable_bounds(robot.limits, acceleration)
    settings = ConstraintSettings(
        bounds=replace(bounds, velocity=(1.0 - margin) * bounds.velocity),
        self_collision=collision,
        scene=scene if collision else None,
        clearance=clearance,
        self_clearance=clearance,
        margin=margin,
        floor=floor if collision else "none",
    )
    judge = MotionConstraints(robot, settings)
    if mass and math.isnan(rated):
        judge.notes += ("no rated payload is known of the robot: the mass itself is not judged",)
    if not collision:
        judge.notes += ("collisions are not judged (--no-collision); dynid run judges them",)
    if margin == 0:
        judge.notes += ("no margin is kept: the controller may stop a motion that overshoots",)
    return judge
