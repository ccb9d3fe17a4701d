"""Base parameters: the combinations of standard parameters that motion can show.

Random states excite every identifiable direction; numerical rank, base columns and classes come
from their observation matrix. Panels are the base columns that can differ from zero in the rows of
a joint.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from dynid import core
from dynid.regressor import InverseDynamicModel, Places
from dynid.robot import RobotModel, nominal_geometry, structural_gravity

SPEED = np.pi
"""[rad/s or m/s] the paper's UR5 limit; the structure does not depend on it."""
ACCELERATION = 5.5 * np.pi
"""[rad/s^2 or m/s^2]"""


def random_states(
    robot: RobotModel, samples: int, seed: int, speed: float | core.Array = SPEED
) -> tuple[core.Array, core.Array, core.Array]:
    """Uniform random q, dq, ddq, each (samples, n); q spans +-pi rad or +-1 m, dq +-speed (n)."""
    generator = np.random.default_rng(seed)
    shape = (samples, robot.joints)
    reach = np.where(robot.prismatic, 1.0, np.pi)
    q = generator.uniform(-1, 1, shape) * reach
    dq = generator.uniform(-speed, speed, shape)
    ddq = generator.uniform(-ACCELERATION, ACCELERATION, shape)
    return q, dq, ddq


RANK_TOLERANCE = 1e-9
"""Of the largest singular value, columns normalised; the UR5's gap is 1e-2 to 1e-16."""
ZERO_COLUMN = 1e-9
"""Columns below this share of the largest norm are zero."""
CLASS_TOLERANCE = 1e-7
"""A column with less than this of its norm in the null space is identifiable alone."""
NO_SHARE = 1e-9
"""Smaller entries of K, columns normalised, are zero."""
ROUNDING = 1e-12
"""No tolerance may ask for more."""
WEAK = 1e-5
"""A direction with less of the largest singular value is hardly there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rank(core.Value):
    """Rank and classes that do not depend on the choice of base columns."""

    rank: int
    normalised_singular_values: core.Array
    """(p) singular values with columns scaled to unit norm."""
    alone: tuple[int, ...]
    """Columns in the row space: identifiable alone."""
    combined: tuple[int, ...]
    """Identifiable only together with others."""
    unidentifiable: tuple[int, ...]
    """Zero columns."""

    @property
    def gap(self) -> tuple[float, float]:
        """The singular values, relative to the first, on both sides of the rank."""
        s = self.normalised_singular_values
        after = s[self.rank] / s[0] if self.rank < len(s) else 0.0
        return float(s[self.rank - 1] / s[0]), float(after)


def rank_and_classes(w: core.Array, tolerance: float = RANK_TOLERANCE) -> Rank:
    """Rank and classes of W (M, p).

    Class by null space V2 and row space V1: column j is unidentifiable if W e_j = 0, alone if
    row j of V2 is zero, combined otherwise (methods.md 1.2).
    """
    scaled, _, zero = _unit_columns(w)
    # The triangle has the same singular values and row space, whatever the number of rows.
    _, s, vt = np.linalg.svd(core.upper_triangle(scaled))
    rank = int((s > tolerance * s[0]).sum())
    null_norms = np.linalg.norm(vt[rank:], axis=0)
    alone = null_norms < CLASS_TOLERANCE
    return Rank(
        rank=rank,
        normalised_singular_values=core.read_only(s),
        alone=tuple(np.flatnonzero(alone).tolist()),
        combined=tuple(np.flatnonzero(~alone & ~zero).tolist()),
        unidentifiable=tuple(np.flatnonzero(zero).tolist()),
    )


def regrouping(
    w: core.Array, tolerance: float = RANK_TOLERANCE
) -> tuple[tuple[int, ...], tuple[int, ...], core.Array]:
    """First-come base columns and how the others regroup into them (Gautier 1991).

    Of W (M, p), columns normalised: base columns (r), dependent columns (p - r)
    and K (r, p - r) with W2 = W1 K. A column that hardly differs from those before makes way for
    a later one: with a right angle written as 1.5708, K had entries of 200 000.
    """
    scaled, scale, _ = _unit_columns(w)
    columns = core.upper_triangle(scaled)
    base = _first_come(columns, max(tolerance, ROUNDING))
    rank = _rank(columns, tolerance)
    # Rounding over the share of a column that hardly differs can look like a direction of its own,
    # and over those of several in turn like a clear one.
    clear = [_first_come(columns, max(tolerance, share)) for share in (WEAK, 1e-4, 1e-3, 1e-2)]
    alike = clear[0] if len(clear[0]) == len(base) else base
    told = (found for found in clear if len(found) == rank == _rank(columns[:, found], tolerance))
    base = next(told, alike)
    dependent = [j for j in range(scaled.shape[1]) if j not in base]
    r = len(base)
    upper = core.upper_triangle(scaled[:, [*base, *dependent]])
    # Rounding over a diagonal that is hardly more would be terms of every row above it.
    k = core.solve_upper(
        upper[:r, :r], np.where(np.abs(upper[:r, r:]) < ROUNDING, 0.0, upper[:r, r:])
    )
    k[np.abs(k) < NO_SHARE] = 0.0
    k = k * (scale[dependent][None, :] / scale[base][:, None])
    return tuple(base), tuple(dependent), k


def _rank(columns: core.Array, tolerance: float) -> int:
    values = np.linalg.svd(columns, compute_uv=False)
    return int((values > tolerance * values[0]).sum())


def _first_come(columns: core.Array, tolerance: float) -> list[int]:
    """Columns (p, p) of which more than a share is not in the span of the chosen ones before.

    Not by the diagonal of one QR: there the rounding that dependent columns leave becomes a
    direction too, and the few rows that some joints have run out of directions.
    """
    basis, chosen = np.zeros_like(columns), list[int]()
    for j, column in enumerate(columns.T):
        rest: core.Array = column
        for _ in range(2):
            rest = rest - basis @ (rest @ basis)
        size = float(np.linalg.norm(rest))
        if size > tolerance:
            basis[:, len(chosen)] = rest / size
            chosen.append(j)
    return chosen


def _unit_columns(w: core.Array) -> tuple[core.Array, core.Array, core.Mask]:
    """W with columns of unit norm or exactly zero; what it was divided by (p); zero columns (p)."""
    norms = np.linalg.norm(w, axis=0)
    zero = norms <= ZERO_COLUMN * norms.max(initial=1e-300)
    scale = np.where(zero, 1.0, norms)
    return np.where(zero, 0.0, w / scale), scale, zero


CLEAR_GAP = 1e-3
"""The first singular value that does not count over the last that does, at most."""
MATERIAL_ANGLE_DEG = 0.01
"""Geometry this close to nominal is nominal but for the digits of its file [deg]."""
MATERIAL_SHIFT = 1e-4
"""The same for places [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseParametrization(core.Value):
    """The r base parameters of p standard ones: p_B = p_1 + K p_2."""

    model: InverseDynamicModel
    """The model as mounted and calibrated; columns are evaluated with it."""
    independent: tuple[int, ...]
    """(r) base columns."""
    dependent: tuple[int, ...]
    """(p - r) columns regrouped into them."""
    regrouping: core.Array
    """K (r, p - r), W2 = W1 K; of a geometry that is not nominal, the nearest (least squares)."""
    nominal_regrouping: core.Array
    """(r, p - r) of the nominal geometry: exact zeros, in `expressions`."""
    classes: Rank
    """Rank, and which parameters are identifiable."""
    singular_values: core.Array
    """(p) of the observation matrix at the random points, unscaled, largest first."""
    tolerance: float
    """Singular values below this share of the largest count as zero."""
    seed: int
    """Of the random points."""
    samples: int
    """Number of random points."""
    warnings: tuple[core.Finding, ...] = field(default=())
    """Findings about the rank."""

    @property
    def rank(self) -> int:
        """Number of base parameters r."""
        return len(self.independent)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the base parameters: those of their first standard parameter."""
        return tuple(self.model.columns[i].name for i in self.independent)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the base parameters."""
        return tuple(self.model.columns[i].unit for i in self.independent)

    @property
    def expressions(self) -> tuple[str, ...]:
        """Each base parameter written out in standard parameters."""
        return tuple(self._expression(row) for row in range(self.rank))

    @property
    def cumulative_energy(self) -> core.Array:
        """(p) share of the squared singular values up to each (the paper's Figure 1)."""
        squares = np.square(self.singular_values)
        return core.read_only(np.cumsum(squares) / squares.sum())

    def from_standard(self, parameters: ArrayLike) -> core.Array:
        """Base parameters (r) of standard parameters (p).

        Raises:
            InputError: Another number of parameters.
        """
        shape = (len(self.model.columns),)
        every = core.frozen(parameters, shape=shape, name="standard parameters", finite=False)
        return every[list(self.independent)] + self.regrouping @ every[list(self.dependent)]

    def to_standard(self, values: ArrayLike) -> core.Array:
        """Standard parameters (p) with the torques of base ones (r): zero outside the base.

        Raises:
            InputError: Another number of parameters.
        """
        parameters = np.zeros(len(self.model.columns))
        own = core.frozen(values, shape=(self.rank,), name="base parameters", finite=False)
        parameters[list(self.independent)] = own
        return parameters

    def _expression(self, row: int) -> str:
        names = self.model.names
        text = names[self.independent[row]]
        for column, factor in zip(self.dependent, self.nominal_regrouping[row], strict=True):
            if factor != 0:
                size = abs(factor)
                times = "" if abs(size - 1) < 1e-9 else f"{size:.8g}*"
                text += f" {'+' if factor > 0 else '-'} {times}{names[column]}"
        return text


def reduce_model(
    model: InverseDynamicModel,
    *,
    samples: int = 25,
    seed: int = 0,
    tolerance: float = RANK_TOLERANCE,
    static: bool = False,
) -> BaseParametrization:
    """Find the base parameters of a model.

    The structure is that of the nominal geometry and of structural gravity: rounding, factory
    calibration and a mounting tilted by less than a degree do not create parameters that no
    motion can resolve; what was set straight stands in `warnings`. Where its base columns depend
    on each other in the real geometry, that one's structure is taken. How the other parameters act
    on the base columns is that of the real geometry.

    Args:
        model: The inverse dynamic model.
        samples: Random points; raised to give at least three rows for two columns.
        seed: Seed of the random points.
        tolerance: Relative tolerance of the rank.
        static: Of poses at rest: the base parameters are those of gravity.

    Raises:
        InputError: Samples below 1, a tolerance outside (0, 1), or poses without any gravity.
    """
    if samples < 1:
        raise core.InputError("needs at least one sample", where="--samples", value=samples)
    if not 0 < tolerance < 1:
        raise core.InputError("tolerance outside (0, 1)", where="tolerance", value=tolerance)
    structural, warnings = _structural_model(model)
    # Three rows for two columns determine the rank; the paper's 25 points give 150 for 78.
    rows = max(samples, -(-3 * len(model.columns) // (2 * model.robot.joints)))
    q, dq, ddq = random_states(model.robot, rows, seed)
    if static:
        dq = ddq = np.zeros_like(q)
    states = [(q, dq, ddq)]
    if not static and any(term == "fs" for term, _ in model.friction.terms):
        # Random speeds of pi rad/s rarely meet a Stribeck peak that ends near 0.1 rad/s.
        speed = 2 * np.array(model.friction.stribeck_velocity)
        states.append(random_states(model.robot, rows, seed + 1, speed))
    w = np.vstack([structural.observation_matrix(*some) for some in states])
    if np.abs(w).max() < ZERO_COLUMN:
        raise core.InputError(
            "no joint carries gravity: all turn about it or slide across it",
            where=model.robot.name,
            value=f"gravity {model.robot.gravity.tolist()}",
            next_step="Check the mounting, or identify from a motion: dynid identify RECORD.",
        )
    classes = rank_and_classes(w, tolerance)
    independent, dependent, k = regrouping(w, tolerance)
    if warnings:
        # Setting straight what is not can also create parameters: their columns depend on others.
        own = np.vstack([model.observation_matrix(*some) for some in states])
        if rank_and_classes(own[:, list(independent)], tolerance).rank < len(independent):
            structural, warnings, w = model, (), own
            classes = rank_and_classes(w, tolerance)
            independent, dependent, k = regrouping(w, tolerance)
    warnings = (*warnings, *_doubtful_rank(classes, len(independent)))
    return BaseParametrization(
        model=model,
        independent=independent,
        dependent=dependent,
        regrouping=core.read_only(
            _real_regrouping(model, structural, states, independent, dependent, k)
        ),
        nominal_regrouping=core.read_only(k),
        classes=classes,
        singular_values=core.read_only(
            np.asarray(np.linalg.svd(w, compute_uv=False), dtype=np.float64)
        ),
        tolerance=tolerance,
        seed=seed,
        samples=rows,
        warnings=warnings,
    )


def _real_regrouping(
    model: InverseDynamicModel,
    structural: InverseDynamicModel,
    states: list[tuple[core.Array, core.Array, core.Array]],
    independent: tuple[int, ...],
    dependent: tuple[int, ...],
    nominal: core.Array,
) -> core.Array:
    """(r, p - r) K that is nearest to W2 = W1 K for a geometry that is not the structural one.

    With the nominal K, bodies with the base parameters of a UR10e whose axes are 0.1 degree and
    1 mm off give torques that are up to 0.7 N.m off.
    """
    ours, theirs = model.robot, structural.robot
    same = all(
        np.array_equal(a, b)
        for a, b in (
            (ours.placements, theirs.placements),
            (ours.axes, theirs.axes),
            (ours.gravity, theirs.gravity),
            (ours.parameter_frames[model.frames], theirs.parameter_frames[model.frames]),
        )
    )
    if same or not dependent:
        return nominal
    w = np.vstack([model.observation_matrix(*some) for some in states])
    own, others = w[:, list(independent)], w[:, list(dependent)]
    size = np.linalg.norm(own, axis=0)
    size[size == 0] = 1.0
    left = others - own @ nominal
    found = np.asarray(np.linalg.lstsq(own / size, left, rcond=None)[0], dtype=np.float64)
    return nominal + found / size[:, None]


def _structural_model(
    model: InverseDynamicModel,
) -> tuple[InverseDynamicModel, tuple[core.Finding, ...]]:
    nominal = nominal_geometry(model.robot)
    gravity, tilt = structural_gravity(nominal)
    found = (_departure(model.robot, nominal, model.frames), tilt)
    robot = replace(nominal, gravity=gravity)
    return (
        InverseDynamicModel(robot=robot, frames=model.frames, friction=model.friction),
        tuple(core.Finding("ill_conditioned", text) for text in found if text),
    )


def _departure(robot: RobotModel, nominal: RobotModel, frames: str) -> str | None:
    """How far a geometry is from its nominal one, in words; None where rounding explains it."""
    given, taken = (
        np.concatenate([r.placements, r.parameter_frames[frames]]) for r in (robot, nominal)
    )
    turned = np.linalg.norm(given[:, :3, :3] - taken[:, :3, :3], axis=(1, 2)) / np.sqrt(2)
    moved = np.linalg.norm(given[:, :3, 3] - taken[:, :3, 3], axis=1)
    parts: list[str] = []
    for size, limit, unit in (
        (np.degrees(turned), MATERIAL_ANGLE_DEG, "deg"),
        (moved, MATERIAL_SHIFT, "m"),
    ):
        worst = int(np.argmax(size))
        if size[worst] > limit:
            name = robot.joint_names[worst % robot.joints]
            parts.append(f"{size[worst]:.2g} {unit} ({name})")
    if not parts:
        return None
    return (
        "rank and regrouping are those of the nominal geometry, whose axes are exactly parallel,"
        f" square or crossing; the robot's is up to {' and '.join(parts)} off it"
    )


def _doubtful_rank(classes: Rank, by_columns: int) -> Iterator[core.Finding]:
    before, after = classes.gap
    if not (before > WEAK and after < CLEAR_GAP * before):
        text = f"the rank {classes.rank} has no clear gap: the last singular value that counts is "
        text += f"{before:.1e} of the largest, the next {after:.1e}"
        yield core.Finding("ill_conditioned", text)
    if classes.rank != by_columns:
        text = "the tolerance cuts through the singular values: they give rank "
        text += f"{classes.rank}, the columns in order give {by_columns}"
        yield core.Finding("ill_conditioned", text)


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnPanel:
    """The base columns that can differ from zero in the rows of one joint."""

    rows: slice
    """Their rows in the kernel's memory: columns beside the inertial ones, then tip to base."""
    columns: core.Indices
    """Their base columns, in the order of the rows."""
    beside: core.Indices
    """The columns beside the inertial ones, counted from the first of those in the model."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GramLayout:
    """A panel a joint. A link loads only the joints before it: the panels shrink to the tip."""

    panels: tuple[ColumnPanel, ...]
    places: Places
    """(n, n, 10), see `regressor.inertial.inertial_rows`."""
    rows: int
    """R, rows of memory."""
    rank: int
    """b, base columns."""


def gram_layout(model: InverseDynamicModel, base: BaseParametrization) -> GramLayout:
    """The layout of the base columns of a model; a row of memory before each panel is free."""
    n = model.robot.joints
    inertial = 10 * n
    links = [c for c in base.independent if c < inertial]
    first = len(links)
    acting = acting_joints(model)
    beside = [
        [c - inertial for c in base.independent if c >= inertial and acting[c - inertial, j]]
        for j in range(n)
    ]
    width = max(map(len, beside)) + first + 1
    places = np.full((n, n, 10), -1, dtype=np.int64)
    panels: list[ColumnPanel] = []
    position = {column: k for k, column in enumerate(base.independent)}
    for j in range(n):
        begin = j * width + width - first - len(beside[j])
        # Tip to base: what joint j does not carry comes last and is left out.
        carried = [c for c in reversed(links) if c // 10 >= j]
        for k, column in enumerate(carried):
            places[column // 10, j, column % 10] = begin + len(beside[j]) + k
        count = len(beside[j]) + len(carried)
        columns = [position[c + inertial] for c in beside[j]] + [position[c] for c in carried]
        panels.append(
            ColumnPanel(
                rows=slice(begin, begin + count),
                columns=np.array(columns, dtype=np.intp),
                beside=np.array(beside[j], dtype=np.intp),
            )
        )
    return GramLayout(panels=tuple(panels), places=places, rows=n * width, rank=base.rank)


def acting_joints(model: InverseDynamicModel) -> core.Array:
    """(p - 10 n, n) 1 where a column beside the inertial ones acts on a joint, else 0."""
    robot = model.robot
    # What is zero at two unrelated states is zero everywhere, but for what ends at higher speeds.
    speed = np.random.default_rng(0).uniform(0.5, 1.0, (2, robot.joints, 2))
    speed *= np.minimum(np.min(model.friction.stribeck_velocity), 1.0)
    out = np.zeros((len(model.columns) - 10 * robot.joints, robot.joints, 2))
    model.fill_beside(speed[0], speed[1], out)
    # Load-dependent friction and ripple act on the joint that they are named after.
    first = 10 * robot.joints + model.beside
    for k, column in enumerate(model.columns[first:], start=model.beside):
        out[k, column.joint] = 1.0
    return np.asarray((out != 0).any(axis=2), dtype=np.float64)
