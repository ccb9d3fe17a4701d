"""Column blocks: what stands beside the inertial columns of the regressor.

A block says which columns it adds, fills them and differentiates them. What a new term of single
joints needs is in docs/architecture.md.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynid.core import Array
from dynid.regressor.terms import (
    PAPER_WIDTH,
    TERMS,
    FrictionTerms,
    Width,
    by_joint,
    smooth_sign,
    smooth_slope,
    stribeck,
)
from dynid.robot import RobotModel


@dataclass(frozen=True, slots=True)
class Column:
    """The name and unit of one parameter."""

    name: str
    unit: str
    joint: int
    """Index of the joint it belongs to, from 0."""


class ColumnBlock(ABC):
    """Columns that are linear parameters of the joint torques."""

    @abstractmethod
    def columns(self, robot: RobotModel) -> tuple[Column, ...]:
        """Names and units of the columns, in order."""

    @abstractmethod
    def fill(self, robot: RobotModel, dq: Array, ddq: Array, out: Array) -> None:
        """Write the columns for dq, ddq (n, N) into out (k, n, N), which is zero."""

    @abstractmethod
    def pull(self, robot: RobotModel, dq: Array, ddq: Array, weights: Array, bars: Array) -> None:
        """Add the derivative of sum(weights * columns) by dq, ddq to the bars (2, n, N).

        The weights are (k, n, N).
        """

    def add_torque(
        self, robot: RobotModel, dq: Array, ddq: Array, parameters: Array, out: Array
    ) -> None:
        """Add what the columns with parameters (k) give to out (n, N)."""
        columns = np.zeros((len(parameters), *out.shape))
        self.fill(robot, dq, ddq, columns)
        out += np.tensordot(parameters, columns, axes=1)


def _stribeck(shape: FrictionTerms, dq: Array) -> Array:
    return stribeck(dq, shape.stribeck_velocity) * smooth_sign(dq, shape.width)


def _stribeck_slope(shape: FrictionTerms, dq: Array) -> Array:
    fall = 2.0 * dq / by_joint(shape.stribeck_velocity) ** 2 * smooth_sign(dq, shape.width)
    return stribeck(dq, shape.stribeck_velocity) * (smooth_slope(dq, shape.width) - fall)


def _root_slope(_shape: FrictionTerms, dq: Array) -> Array:
    # Infinite at rest, where nothing can use it: zero there.
    root = np.square(np.cbrt(dq))
    return np.divide(1.0, 3.0 * root, out=np.zeros_like(dq), where=root > 0)


@dataclass(frozen=True, slots=True)
class JointTerm:
    """What a parameter of one joint multiplies."""

    symbol: str
    power: int
    """Which unit, see `unit`."""
    values: Callable[[FrictionTerms, Array, Array], Array]
    """(n, N) the entries for dq, ddq (n, N)."""
    slope: Callable[[FrictionTerms, Array], Array | float]
    """(n, N) derivative of the entries by dq, or by ddq for columns of `power` 2."""


JOINT_TERMS = {
    "fc": JointTerm(
        "Fc", 0, lambda s, v, _: smooth_sign(v, s.width), lambda s, v: smooth_slope(v, s.width)
    ),
    "fv": JointTerm("Fv", 1, lambda _, v, __: v, lambda _, __: 1.0),
    "im": JointTerm("Im", 2, lambda _, __, a: a, lambda _, __: 1.0),
    "fo": JointTerm("Fo", 0, lambda _, v, __: np.ones_like(v), lambda _, __: 0.0),
    "fca": JointTerm(
        "Fca",
        0,
        lambda s, v, _: np.abs(smooth_sign(v, s.width)),
        lambda s, v: np.sign(v) * smooth_slope(v, s.width),
    ),
    "fva": JointTerm("Fva", 1, lambda _, v, __: np.abs(v), lambda _, v: np.sign(v)),
    "fs": JointTerm("Fs", 0, lambda s, v, _: _stribeck(s, v), _stribeck_slope),
    "fr": JointTerm("Fr", -3, lambda _, v, __: np.cbrt(v), _root_slope),
}
"""Coulomb friction as a step of given width, viscous, reflected motor inertia, a constant,
differences of Coulomb and viscous friction by direction, Stribeck friction
exp(-(dq / velocity)^2) tanh(dq / width), and sign(dq) |dq|^(1/3) as strain-wave gears show."""


@dataclass(frozen=True, kw_only=True)
class JointColumns(ColumnBlock):
    """One column a joint that acts on that joint alone.

    Raises:
        KeyError: An unknown term.
    """

    term: str
    """One of `JOINT_TERMS`."""
    shape: FrictionTerms
    """Where widths and velocities come from."""
    joints: tuple[int, ...] | None = None
    """The joints that have the column, from 0; None for all."""

    def values(self, dq: Array, ddq: Array) -> Array:
        """(n, N) the entries for dq, ddq (n, N)."""
        return JOINT_TERMS[self.term].values(self.shape, dq, ddq)

    def columns(self, robot: RobotModel) -> tuple[Column, ...]:
        """See `ColumnBlock`."""
        term, slides = JOINT_TERMS[self.term], robot.prismatic
        return tuple(
            Column(f"{term.symbol}{j + 1}", unit(term.power, slides[j]), j)
            for j in self._rows(robot)
        )

    def _rows(self, robot: RobotModel) -> list[int]:
        return list(range(robot.joints) if self.joints is None else self.joints)

    def fill(self, robot: RobotModel, dq: Array, ddq: Array, out: Array) -> None:
        """See `ColumnBlock`."""
        rows = self._rows(robot)
        out[range(len(rows)), rows] = self.values(dq, ddq)[rows]

    def pull(self, robot: RobotModel, dq: Array, ddq: Array, weights: Array, bars: Array) -> None:
        """See `ColumnBlock`."""
        term = JOINT_TERMS[self.term]
        slope, target = term.slope(self.shape, dq), bars[1 if term.power == 2 else 0]
        rows = self._rows(robot)
        target[rows] += weights[range(len(rows)), rows] * np.broadcast_to(slope, dq.shape)[rows]

    def add_torque(
        self, robot: RobotModel, dq: Array, ddq: Array, parameters: Array, out: Array
    ) -> None:
        """See `ColumnBlock`."""
        rows = self._rows(robot)
        out[rows] += parameters[:, None] * self.values(dq, ddq)[rows]


def unit(power: int, prismatic: bool) -> str:
    """Unit of what multiplies 1 (0), a speed (1), an acceleration (2), a speed's cube root (-3)."""
    angular = {0: "N.m", 1: "N.m.s/rad", 2: "kg.m^2", -3: "N.m.(s/rad)^(1/3)"}
    linear = {0: "N", 1: "N.s/m", 2: "kg", -3: "N.(s/m)^(1/3)"}
    return (linear if prismatic else angular)[power]


@dataclass(frozen=True, kw_only=True)
class Coupling(ColumnBlock):
    """Friction and inertia of motors that drive several joints (Staubli, ABB wrists).

    Motor m turns at r' dq with r = N[m] / N[m, m]; its inertia, viscous and Coulomb torques act
    on the joints through r (methods.md, BIRDy's TX40).
    """

    width: Width = PAPER_WIDTH

    def columns(self, robot: RobotModel) -> tuple[Column, ...]:
        """See `ColumnBlock`."""
        rows = coupled_motors(robot)
        return tuple(
            Column(f"{symbol}{m + 1}", unit(power, robot.prismatic[m]), m)
            for symbol, power in (("Fcm", 0), ("Fvm", 1), ("Imm", 2))
            for m in rows
        )

    def fill(self, robot: RobotModel, dq: Array, ddq: Array, out: Array) -> None:
        """See `ColumnBlock`."""
        rows = coupled_motors(robot)
        for k, (share, width) in enumerate(self._motors(robot)):
            speed = share @ dq
            terms = (smooth_sign(speed, width), speed, share @ ddq)
            for block, term in enumerate(terms):
                out[block * len(rows) + k] = share[:, None] * term

    def pull(self, robot: RobotModel, dq: Array, ddq: Array, weights: Array, bars: Array) -> None:
        """See `ColumnBlock`."""
        rows = coupled_motors(robot)
        for k, (share, width) in enumerate(self._motors(robot)):
            coulomb, viscous, inertia = (share @ weights[b * len(rows) + k] for b in range(3))
            speed_bar = coulomb * smooth_slope(share @ dq, width) + viscous
            bars[0] += share[:, None] * speed_bar
            bars[1] += share[:, None] * inertia

    def _motors(self, robot: RobotModel) -> list[tuple[Array, float]]:
        """Each motor's turns per joint turn (n) and its Coulomb width."""
        motors = coupled_motors(robot)
        widths = [self.width[m] if isinstance(self.width, tuple) else self.width for m in motors]
        return list(zip(motor_turns(robot), widths, strict=True))


def coupled_motors(robot: RobotModel) -> tuple[int, ...]:
    """Motors whose row of the coupling matrix reaches more than their own joint."""
    if robot.drives.coupling is None:
        return ()
    return tuple(m for m, row in enumerate(robot.drives.coupling) if np.count_nonzero(row) > 1)


def motor_turns(robot: RobotModel) -> Array:
    """(k, n) turns of each coupled motor per turn of the joints, its own joint's being 1."""
    motors, ratios = list(coupled_motors(robot)), robot.drives.motor_from_joint
    return ratios[motors] / ratios[motors, motors][:, None]


def column_blocks(friction: FrictionTerms, *, coupled: bool = False) -> tuple[ColumnBlock, ...]:
    """The blocks for a choice of terms, in the order of `TERMS`, and those of coupled motors."""
    terms = dict(friction.terms)
    blocks = tuple(
        JointColumns(term=term, shape=friction, joints=terms[term])
        for term in TERMS
        if term in terms
    )
    return (*blocks, Coupling(width=friction.width)) if coupled else blocks
