"""The inverse dynamic model: torques linear in the standard parameters, Y p = tau."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, InputError, Value, check_word, frozen, read_only
from dynid.regressor import inertial
from dynid.regressor.columns import Column, ColumnBlock, column_blocks, coupled_motors, motor_turns
from dynid.regressor.terms import FrictionTerms, friction_state, smooth_sign, stribeck
from dynid.robot import PARAMETER_UNITS, PARAMETERS, RobotModel

CHUNK = 2000
"""Samples evaluated at once where a whole stack would not fit in the cache. Not a power of two:
columns then start at the same place of the cache and push each other out (three times slower)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class InverseDynamicModel(Value):
    """The regressor of a robot with chosen parameter frames and column blocks.

    Raises:
        InputError: Frames that the robot does not have.
    """

    robot: RobotModel
    """Kinematics, mounting, drives."""
    frames: str = ""
    """`dh`, `mdh` or `urdf`; empty for the robot's own."""
    friction: FrictionTerms = field(default_factory=FrictionTerms)
    """Columns beside the inertial ones; the paper's are Coulomb, viscous, motor inertia."""
    blocks: tuple[tuple[ColumnBlock, slice], ...] = field(init=False)
    """What stands beside the inertial columns, and where, counted from the first behind them."""
    columns: tuple[Column, ...] = field(init=False)
    """Name, unit and joint of the p standard parameters, in order."""
    constants: inertial.ChainConstants = field(init=False)
    """Numbers of the kernels."""
    beside: int = field(init=False)
    """Number of columns of all blocks."""

    def __post_init__(self) -> None:
        robot = self.robot
        frames = self.frames or robot.default_frames
        check_word(frames, robot.parameter_frames, "--frames")
        self.friction.check_joints(robot.joints)
        blocks = column_blocks(self.friction, coupled=bool(coupled_motors(robot)))
        standard = tuple(
            Column(f"{name}{i + 1}", unit, i)
            for i in range(robot.joints)
            for name, unit in zip(PARAMETERS, PARAMETER_UNITS, strict=True)
        )
        own = [block.columns(robot) for block in blocks]
        stops = np.cumsum([0, *map(len, own)]).tolist()
        added = tuple(column for columns in own for column in columns)
        if self.friction.load is not None:
            added += tuple(Column(f"Fl{j + 1}", "1", j) for j in self.friction.load.joints)
        added += tuple(Column(f"Fw{r.joint + 1}", "1", r.joint) for r in self.friction.ripples)
        object.__setattr__(self, "frames", frames)
        parts = map(slice, stops[:-1], stops[1:])
        object.__setattr__(self, "blocks", tuple(zip(blocks, parts, strict=True)))
        object.__setattr__(self, "beside", stops[-1])
        object.__setattr__(self, "columns", standard + added)
        object.__setattr__(self, "constants", inertial.chain_constants(robot, frames))

    def with_coulomb_width(self, width: float) -> "InverseDynamicModel":
        """The same model with Coulomb steps of another width [rad/s or m/s].

        A wider step has a slope that an optimiser can follow.

        Raises:
            InputError: A width below 0.
        """
        return replace(self, friction=replace(self.friction, width=width))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the p standard parameters."""
        return tuple(column.name for column in self.columns)

    def states(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> tuple[Array, Array, Array]:
        """Samples from outside as arrays, each (N, n); NaN is let through.

        Raises:
            InputError: Not numbers, or shapes that do not fit the robot or each other.
        """
        shape = (None, self.robot.joints)
        q = frozen(q, shape=shape, name="q", finite=False)
        others = (("dq", dq), ("ddq", ddq))
        dq, ddq = (frozen(x, shape=q.shape, name=name, finite=False) for name, x in others)
        return q, dq, ddq

    def friction_state(self, q: ArrayLike, *, periodic: bool = False) -> Array | None:
        """The state (n + k, N) of presliding friction along a motion q (N, n); None without any.

        Of the joints, then of k coupled motors, each over its own joint's displacement; NaN
        without presliding.

        Args:
            q: (N, n) positions in the order of time [rad or m].
            periodic: The motion is one period of many.

        Raises:
            InputError: Not numbers, or a shape that does not fit the robot.
        """
        q = frozen(q, shape=(None, self.robot.joints), name="q", finite=False)
        if not any(self.friction.presliding):
            return None
        over = np.array(self.friction.presliding)
        turned = q.T
        if motors := coupled_motors(self.robot):
            over = np.concatenate([over, over[[*motors]]])
            turned = np.concatenate([turned, motor_turns(self.robot) @ turned])
        state, has = np.full(turned.shape, np.nan), over > 0
        state[has] = friction_state(turned[has], over[has], periodic=periodic)
        return state

    def stack(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        out: Array | None = None,
        state: Array | None = None,
    ) -> Array:
        """The regressor of a batch, ordered for linear algebra.

        Args:
            q: (N, n) positions [rad or m].
            dq: (N, n) velocities.
            ddq: (N, n) accelerations.
            out: What an earlier call with the same N returned, to be written again.
            state: (n + k, N) see `friction_state`; None for samples that are no motion: friction is
                then what it is while sliding.

        Returns:
            (p, n, N): column, joint row, sample.

        Raises:
            InputError: Shapes that do not fit the robot or each other.
        """
        robot = self.robot
        first = 10 * robot.joints
        motion = self.motion(q, dq, ddq)
        shape = (len(self.columns), robot.joints, motion.shape[2])
        if out is None:
            out = np.zeros(shape)
        elif out.shape != shape:
            raise InputError("out does not fit", value=out.shape, limit=shape)
        position, velocity, acceleration = motion
        inertial.inertial_columns(self.constants, motion, out[:first])
        self.fill_beside(velocity, acceleration, out[first:])
        first += self.beside
        past = () if state is None else self.friction.presliding
        before = [j for j, displacement in enumerate(past) if displacement > 0]
        if state is not None:
            rest = stribeck(velocity, self.friction.stribeck_velocity)
            for j in before:
                for name, share in ((f"Fc{j + 1}", 1.0), (f"Fs{j + 1}", rest[j])):
                    if name in self.names:
                        out[self.names.index(name), j] = share * state[j]
            turns = motor_turns(self.robot)
            for k, m in enumerate(coupled_motors(self.robot)):
                if m in before:
                    own = state[robot.joints + k]
                    out[self.names.index(f"Fcm{m + 1}")] = turns[k][:, None] * own
        load = self.friction.load
        if load is not None:
            carried = np.tensordot(np.array(load.parameters), out[: 10 * robot.joints], axes=1)
            carried -= self.known_torque(position.T).T
            direction = smooth_sign(velocity, self.friction.width)
            for j in before:
                direction[j] = direction[j] if state is None else state[j]
            for k, j in enumerate(load.joints):
                out[first + k, j] = np.abs(carried[j]) * direction[j]
            first += len(load.joints)
        for k, ripple in enumerate(self.friction.ripples, start=first):
            out[k, ripple.joint] = ripple.torque(position, velocity)
        return out

    def motion(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array:
        """(3, n, N) of q, dq, ddq, each (N, n): what the kernels take.

        Raises:
            InputError: Shapes that do not fit the robot or each other.
        """
        # The compiled kernels trust their shapes: they would read beyond shorter arrays.
        q, dq, ddq = self.states(q, dq, ddq)
        # A copy, never a view: read-only arrays would make Numba compile the kernels once more.
        # Samples next to each other: stack() would keep the order of the transposes.
        return np.stack([q.T, dq.T, ddq.T], out=np.empty((3, *q.T.shape)))

    def fill_beside(self, dq: Array, ddq: Array, out: Array) -> None:
        """Write the blocks' columns for dq, ddq (n, N) into out (p - 10 n, n, N)."""
        for block, part in self.blocks:
            block.fill(self.robot, dq, ddq, out[part])

    def pull_beside(self, motion: Array, weights: Array, out: Array) -> None:
        """Add to out (3, n, N) the derivative of sum(weights * blocks' columns) by the motion.

        The motion is q, dq, ddq (3, n, N), the weights are (p - 10 n, n, N).
        """
        for block, part in self.blocks:
            block.pull(self.robot, motion[1], motion[2], weights[part], out[1:])

    def observation_matrix(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array:
        """W (n N, p), rows joint-major: all samples of joint 1 first; see `states`."""
        stack = self.stack(*self.states(q, dq, ddq))
        return stack.reshape(len(stack), -1).T

    def regressor(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array:
        """Y (N, n, p); see `states`."""
        return self.stack(*self.states(q, dq, ddq)).transpose(2, 1, 0)

    def inverse_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        parameters: ArrayLike,
        state: Array | None = None,
    ) -> Array:
        """Torques (N, n) [N.m or N] for standard parameters (p), known torques not included.

        The motion and the state of friction are those of `stack`.

        Raises:
            InputError: Shapes that do not fit the model or each other.
        """
        q, dq, ddq = self.states(q, dq, ddq)
        shape = (len(self.columns),)
        parameters = frozen(parameters, shape=shape, name="parameters", finite=False)
        torque = np.empty(q.shape)
        for first in range(0, len(q), CHUNK):
            part = slice(first, first + CHUNK)
            now = None if state is None else state[:, part]
            if now is None and 10 * self.robot.joints + self.beside == len(self.columns):
                torque[part] = self._recursive(q[part], dq[part], ddq[part], parameters)
            else:
                stack = self.stack(q[part], dq[part], ddq[part], state=now)
                torque[part] = np.tensordot(parameters, stack, axes=1).T
        return read_only(torque)

    def mass_matrix(self, q: ArrayLike, parameters: ArrayLike) -> Array:
        """(N, n, n) of standard parameters (p) at poses (N, n), motor inertias included.

        Raises:
            InputError: Shapes that do not fit the model.
        """
        rest = np.zeros_like(q, dtype=np.float64)
        weight = self.inverse_dynamics(q, rest, rest, parameters)
        pushes = np.eye(self.robot.joints)
        torques = [self.inverse_dynamics(q, rest, rest + push, parameters) for push in pushes]
        return np.stack([torque - weight for torque in torques], axis=2)

    def _recursive(self, q: Array, dq: Array, ddq: Array, parameters: Array) -> Array:
        """Torques (N, n) without the regressor, where every column is one of a block."""
        state = inertial.in_lanes(self.motion(q, dq, ddq))
        out, first = np.empty(state.shape[1:]), 10 * self.robot.joints
        links, others = parameters[:first].reshape(-1, 10), parameters[first:]
        inertial.torque_kernel(*self.constants, links, inertial.turns(state[0]), state, out)
        for block, part in self.blocks:
            block.add_torque(self.robot, state[1], state[2], others[part], out)
        return out[:, : len(q)].T

    def known_torque(self, q: ArrayLike) -> Array:
        """Torques (N, n) of the counterbalances at positions q (N, n).

        Raises:
            InputError: A shape that does not fit the robot.
        """
        q = frozen(q, shape=(None, self.robot.joints), name="q", finite=False)
        torque = np.zeros(q.shape)
        for spring in self.robot.counterbalances:
            torque[:, spring.joint] += spring.torque(q[:, spring.joint])
        return torque
