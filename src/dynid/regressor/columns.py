"""From the choice of terms to column blocks.

Column blocks: what stands beside the inertial columns of the regressor.

A block says which columns it adds, fills them and differentiates them. To add one: a frozen
dataclass that extends `ColumnBlock`, one word in `terms.TERMS`, one case in
`layout.friction_block`, one test against its formula.

Columns of motors that drive several joints.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynid.core import Array
from dynid.regressor.terms import (
    PAPER_WIDTH,
    STRIBECK_VELOCITY,
    TERMS,
    FrictionTerms,
    Width,
    smooth_sign,
    smooth_slope,
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
    def pull(
        self,
        robot: RobotModel,
        dq: Array,
        ddq: Array,
        weights: Array,
        dq_bar: Array,
        ddq_bar: Array,
    ) -> None:
        """Add the derivative of sum(weights * columns), weights (k, n, N), to the bars (n, N)."""

    def add_torque(
        self, robot: RobotModel, dq: Array, ddq: Array, parameters: Array, out: Array
    ) -> None:
        """Add what the columns with parameters (k) give to out (n, N)."""
        columns = np.zeros((len(parameters), *out.shape))
        self.fill(robot, dq, ddq, columns)
        out += np.tensordot(parameters, columns, axes=1)


@dataclass(frozen=True, kw_only=True)
class JointColumns(ColumnBlock):
    """One column a joint that acts on that joint alone."""

    symbol: ClassVar[str] = ""
    power: ClassVar[int] = 0
    """Which unit, see `unit`."""
    joints: tuple[int, ...] | None = None
    """The joints that have the column, from 0; None for all."""

    @abstractmethod
    def values(self, dq: Array, ddq: Array) -> Array:
        """(n, N) the entries for dq, ddq (n, N)."""

    @abstractmethod
    def slope(self, dq: Array) -> Array | float:
        """(n, N) derivative of the entries by dq, or by ddq for columns of `power` 2."""

    def columns(self, robot: RobotModel) -> tuple[Column, ...]:
        """See `ColumnBlock`."""
        slides = robot.prismatic
        return tuple(
            Column(f"{self.symbol}{j + 1}", unit(self.power, slides[j]), j)
            for j in self._rows(robot)
        )

    def fill(self, robot: RobotModel, dq: Array, ddq: Array, out: Array) -> None:
        """See `ColumnBlock`."""
        values = self.values(dq, ddq)
        if self.joints is None:
            np.einsum("jjk->jk", out)[:] = values
        else:
            out[range(len(self.joints)), self.joints] = values[self.joints, :]

    def pull(
        self,
        robot: RobotModel,
        dq: Array,
        ddq: Array,
        weights: Array,
        dq_bar: Array,
        ddq_bar: Array,
    ) -> None:
        """See `ColumnBlock`."""
        slope = self.slope(dq)
        target = ddq_bar if self.power == 2 else dq_bar
        if self.joints is None:
            target += np.einsum("jjk->jk", weights) * slope
            return
        own = weights[range(len(self.joints)), self.joints]
        target[self.joints, :] += own * np.broadcast_to(slope, dq.shape)[self.joints, :]

    def add_torque(
        self, robot: RobotModel, dq: Array, ddq: Array, parameters: Array, out: Array
    ) -> None:
        """See `ColumnBlock`."""
        rows = slice(None) if self.joints is None else list(self.joints)
        out[rows] += parameters[:, None] * self.values(dq, ddq)[rows]

    def _rows(self, robot: RobotModel) -> tuple[int, ...]:
        return tuple(range(robot.joints)) if self.joints is None else self.joints


def unit(power: int, prismatic: bool) -> str:
    """Unit of what multiplies 1 (0), a speed (1), an acceleration (2), a speed's cube root (-3)."""
    angular = {0: "N.m", 1: "N.m.s/rad", 2: "kg.m^2", -3: "N.m.(s/rad)^(1/3)"}
    linear = {0: "N", 1: "N.s/m", 2: "kg", -3: "N.(s/m)^(1/3)"}
    return (linear if prismatic else angular)[power]


@dataclass(frozen=True, kw_only=True)
class Coulomb(JointColumns):
    """Coulomb friction tanh(dq / width): a step with a given width."""

    width: Width = PAPER_WIDTH
    symbol: ClassVar[str] = "Fc"

    def values(self, dq: Array, ddq: Array) -> Array:
        """See `JointColumns`."""
        return smooth_sign(dq, self.width)

    def slope(self, dq: Array) -> Array | float:
        """See `JointColumns`."""
        return smooth_slope(dq, self.width)


@dataclass(frozen=True, kw_only=True)
class Viscous(JointColumns):
    """Viscous friction dq."""

    symbol: ClassVar[str] = "Fv"
    power: ClassVar[int] = 1

    def values(self, dq: Array, ddq: Array) -> Array:
        """See `JointColumns`."""
        return dq

    def slope(self, dq: Array) -> Array | float:
        """See `JointColumns`."""
        return 1.0


@dataclass(frozen=True, kw_only=True)
class MotorInertia(JointColumns):
    """Reflected motor inertia ddq."""

    symbol: ClassVar[str] = "Im"
    power: ClassVar[int] = 2

    def values(self, dq: Array, ddq: Array) -> Array:
        """See `JointColumns`."""
        return ddq

    def slope(self, dq: Array) -> Array | float:
        """See `JointColumns`."""
        return 1.0


@dataclass(frozen=True, kw_only=True)
class Offset(JointColumns):
    """A constant: sensor zero, or friction's asymmetry."""

    symbol: ClassVar[str] = "Fo"

    def values(self, dq: Array, ddq: Array) -> Array:
        """See `JointColumns`."""
        return np.ones_like(dq)

    def slope(self, dq: Array) -> Array | float:
        """See `JointColumns`."""
        return 0.0


@dataclass(frozen=True, kw_only=True)
class CoulombAsymmetry(JointColumns):
    """Difference of Coulomb friction by direction, |tanh(dq / width)|."""

    width: Width = PAPER_WIDTH
    symbol: ClassVar[str] = "Fca"

    def values(self, dq: Array, ddq: Array) -> Array:
        """See `JointColumns`."""
        return np.abs(smooth_sign(dq, self.width))

    def slope(self, dq: Array) -> Array | float:
        """See `JointColumns`."""
        return np.sign(dq) * smooth_slope(dq, self.width)


@dataclass(frozen=True, kw_only=True)
class ViscousAsymmetry(JointColumns):
    """Difference of viscous friction by direction, |dq|."""

    symbol: ClassVar[str] = "Fva"
    power: ClassVar[int] = 1

    def values(self, dq: Array, ddq: Array) -> Array:
        """See `JointColumns`."""
        return np.abs(dq)

    def slope(self, dq: Array) -> Array | float:
        """See `JointColumns`."""
        return np.sign(dq)


@dataclass(frozen=True, kw_only=True)
class Stribeck(JointColumns):
    """Stribeck friction exp(-(dq / velocity)^2) tanh(dq / width), velocity given."""

    velocity: float = STRIBECK_VELOCITY
    """Stribeck velocity [rad/s or m/s]."""
    width: Width = PAPER_WIDTH
    symbol: ClassVar[str] = "Fs"

    def values(self, dq: Array, ddq: Array) -> Array:
        """See `JointColumns`."""
        return np.exp(-np.square(dq / self.velocity)) * smooth_sign(dq, self.width)

    def slope(self, dq: Array) -> Array | float:
        """See `JointColumns`."""
        bell = np.exp(-np.square(dq / self.velocity))
        fall = 2.0 * dq / self.velocity**2 * smooth_sign(dq, self.width)
        return bell * (smooth_slope(dq, self.width) - fall)


@dataclass(frozen=True, kw_only=True)
class CubeRoot(JointColumns):
    """Sub-linear friction sign(dq) |dq|^(1/3), as strain-wave gears show."""

    symbol: ClassVar[str] = "Fr"
    power: ClassVar[int] = -3

    def values(self, dq: Array, ddq: Array) -> Array:
        """See `JointColumns`."""
        return np.cbrt(dq)

    def slope(self, dq: Array) -> Array | float:
        """See `JointColumns`."""
        # Infinite at rest, where nothing can use it: zero there.
        root = np.square(np.cbrt(dq))
        return np.divide(1.0, 3.0 * root, out=np.zeros_like(dq), where=root > 0)


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
        for k, m in enumerate(rows):
            share, width = self._motor(robot, m)
            speed = share @ dq
            terms = (smooth_sign(speed, width), speed, share @ ddq)
            for block, term in enumerate(terms):
                out[block * len(rows) + k] = share[:, None] * term

    def pull(
        self,
        robot: RobotModel,
        dq: Array,
        ddq: Array,
        weights: Array,
        dq_bar: Array,
        ddq_bar: Array,
    ) -> None:
        """See `ColumnBlock`."""
        rows = coupled_motors(robot)
        for k, m in enumerate(rows):
            share, width = self._motor(robot, m)
            coulomb, viscous, inertia = (share @ weights[b * len(rows) + k] for b in range(3))
            speed_bar = coulomb * smooth_slope(share @ dq, width) + viscous
            dq_bar += share[:, None] * speed_bar
            ddq_bar += share[:, None] * inertia

    def _motor(self, robot: RobotModel, motor: int) -> tuple[Array, float]:
        """The motor's turns per joint turn (n), its own joint 1, and its Coulomb width."""
        ratio = robot.drives.motor_from_joint[motor]
        width = self.width[motor] if isinstance(self.width, tuple) else self.width
        return ratio / ratio[motor], width


def coupled_motors(robot: RobotModel) -> tuple[int, ...]:
    """Motors whose row of the coupling matrix reaches more than their own joint."""
    if robot.drives.coupling is None:
        return ()
    return tuple(m for m, row in enumerate(robot.drives.coupling) if np.count_nonzero(row) > 1)


def friction_block(
    term: str, friction: FrictionTerms, joints: tuple[int, ...] | None = None
) -> JointColumns:
    """The block of one term.

    Args:
        term: One of `TERMS`.
        friction: Where widths and velocities come from.
        joints: The joints that have it, from 0; None for all.

    Raises:
        ValueError: A term without a block.
    """
    width = friction.width
    match term:
        case "fc":
            return Coulomb(width=width, joints=joints)
        case "fv":
            return Viscous(joints=joints)
        case "im":
            return MotorInertia(joints=joints)
        case "fo":
            return Offset(joints=joints)
        case "fca":
            return CoulombAsymmetry(width=width, joints=joints)
        case "fva":
            return ViscousAsymmetry(joints=joints)
        case "fs":
            return Stribeck(velocity=friction.stribeck_velocity, width=width, joints=joints)
        case "fr":
            return CubeRoot(joints=joints)
        case _:
            raise ValueError(f"no column block for the term {term!r}")


def column_blocks(friction: FrictionTerms, *, coupled: bool = False) -> tuple[ColumnBlock, ...]:
    """The blocks for a choice of terms, in the order of `TERMS`.

    Args:
        friction: Terms, their joints, their shapes.
        coupled: Add the columns of coupled motors.
    """
    terms = dict(friction.terms)
    blocks = tuple(friction_block(term, friction, terms[term]) for term in TERMS if term in terms)
    return (*blocks, Coupling(width=friction.width)) if coupled else blocks
