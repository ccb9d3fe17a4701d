"""One pass over samples: what least squares, its statistics and left-out errors need, summed.

For a part of a recording the regressor is evaluated and multiplied in one go: the products of the
columns that can differ from zero, joint by joint, are added up by region and stretch of time;
scores are summed over windows for the long-run covariance. Sums of parts add up to those of the
whole, in any order and in any process.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from dynid import reduction, regressor, signals
from dynid.core import Array, Indices, compiled, upper_triangle
from dynid.identification.problem import block_mean, chunk_size, motion_state, recorded_rows
from dynid.identification.selection.gram import GramBlocks
from dynid.identification.selection.regions import Regions

WINDOWS_A_LAG = 16
"""Windows of scores that are summed within one lag."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PassPlan:
    """What is summed, the same for all parts."""

    base: reduction.BaseParametrization
    values: Array
    """(r) base parameters whose residuals are looked at: those of a part of the rows."""
    weights: Array
    """(n) weight of each joint's rows in the scores [1/(N.m)]."""
    lag: int
    """Rows over which scores are correlated."""
    regions: Regions | None
    """Regions that rows are told apart by; None where recordings are left out."""
    halved: tuple[int, ...] = ()
    """Recordings whose halves in time are left out instead of the whole."""
    stretches: int
    """Stretches of time that all rows are divided into."""
    factors: bool
    """Whether to factor the columns as well: products alone would be too coarse."""

    def left_out_with(self, recording: int, later: bool) -> int:
        """The part that a half of a recording is in."""
        before = sum(other < recording for other in self.halved)
        return recording + before + (later and recording in self.halved)


@dataclass(slots=True, kw_only=True)
class RowSums:
    """Sums over rows."""

    rows: int = 0
    cells: dict[tuple[int, int], tuple[int, Array]] = field(
        default_factory=dict[tuple[int, int], tuple[int, Array]]
    )
    """Part left out and stretch of time to rows, and (n, r + 1, r + 1) products, torque last."""
    factors: Array | None = None
    """(n, r + 1, r + 1) triangular factors, where asked for."""
    long_run: Array
    """(r, r) long-run covariance of the scores, times the rows."""
    moments: Array
    """(3, n) sums of residuals, their squares, and their products with the next row's."""
    lower: Array
    """(n) smallest position."""
    upper: Array
    """(n) largest position."""
    speed: Array
    """(n) largest speed."""

    def add(self, other: "RowSums") -> None:
        """Take in the sums of other rows."""
        self.rows += other.rows
        for key, (rows, products) in other.cells.items():
            known, total = self.cells.get(key, (0, 0.0))
            self.cells[key] = (known + rows, total + products)
        if self.factors is None:
            self.factors = other.factors
        elif other.factors is not None:
            pairs = zip(self.factors, other.factors, strict=True)
            self.factors = np.array([upper_triangle(np.vstack(pair)) for pair in pairs])
        self.long_run = self.long_run + other.long_run
        self.moments = self.moments + other.moments
        self.lower = np.minimum(self.lower, other.lower)
        self.upper = np.maximum(self.upper, other.upper)
        self.speed = np.maximum(self.speed, other.speed)

    def blocks(self) -> tuple[GramBlocks, Indices]:
        """The products of all cells, and (2, C) the part and the stretch of each."""
        keys = sorted(self.cells)
        rows = np.array([self.cells[key][0] for key in keys], dtype=np.float64)
        products = np.stack([self.cells[key][1] for key in keys], axis=1)
        n = len(products)
        return GramBlocks(products=products, rows=np.tile(rows, (n, 1))), np.array(keys).T

    def joint_factors(self) -> Array:
        """(n, r + 1, r + 1) triangular factors of each joint's columns and torque."""
        if self.factors is not None:
            return self.factors
        # In one order: that in which parts came in does not matter.
        total = np.sum([self.cells[key][1] for key in sorted(self.cells)], axis=0)
        return np.array([_root(products) for products in total])

    def arrays(self) -> dict[str, Array]:
        """Everything as arrays, for a file."""
        keys = sorted(self.cells)
        found = {
            "rows": np.array([self.rows, *(self.cells[key][0] for key in keys)], dtype=np.float64),
            "keys": np.array(keys, dtype=np.float64).reshape(-1, 2),
            "products": np.array([self.cells[key][1] for key in keys]),
            **{name: getattr(self, name) for name in _PLAIN},
        }
        return found if self.factors is None else {**found, "factors": self.factors}


_PLAIN = ("long_run", "moments", "lower", "upper", "speed")


def sums_from(arrays: Mapping[str, Array]) -> RowSums:
    """The inverse of `RowSums.arrays`."""
    keys = [(int(a), int(b)) for a, b in arrays["keys"]]
    rows = arrays["rows"]
    return RowSums(
        rows=int(rows[0]),
        cells={
            key: (int(count), products)
            for key, count, products in zip(keys, rows[1:], arrays["products"], strict=True)
        },
        factors=arrays.get("factors"),
        **{name: arrays[name] for name in _PLAIN},
    )


def no_sums(joints: int, rank: int) -> RowSums:
    """The sums over no rows."""
    return RowSums(
        long_run=np.zeros((rank, rank)),
        moments=np.zeros((3, joints)),
        lower=np.full(joints, np.inf),
        upper=np.full(joints, -np.inf),
        speed=np.zeros(joints),
    )


def _root(products: Array) -> Array:
    """R with R'R of products (m, m), columns scaled first."""
    scale = np.sqrt(np.maximum(np.diag(products), 1e-300))
    values, vectors = np.linalg.eigh(products / np.outer(scale, scale))
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    return upper_triangle(root) * scale


class PanelRows:
    """The torque of each joint and the base columns that can differ from zero, block by block.

    Where all columns are plain functions of the state, only the entries that are needed are
    evaluated, in memory that is used again: a pass over a recording takes half of the time.
    """

    def __init__(self, base: reduction.BaseParametrization) -> None:
        self.base, model = base, base.model
        self.layout: reduction.GramLayout = reduction.gram_layout(model, base)
        self.columns: list[Indices] = [panel.columns for panel in self.layout.panels]
        # What brings a panel's rows (m) into the order of the base columns, the torque behind them.
        place = [np.append(base.rank, columns) for columns in self.columns]
        self.spread: list[Array] = [np.eye(base.rank + 1)[one] for one in place]
        friction = model.friction
        self._plain = friction.load is None and not (friction.ripples or any(friction.presliding))
        self._memory: dict[int, tuple[Array, Array]] = {}

    def chunks(self, samples: signals.Samples, inner: slice) -> Iterator[tuple[slice, list[Array]]]:
        """Samples covered, and for each joint its panel (m, T): its torque, then columns.

        Of the samples, those beside the inner ones, a multiple of their block, are only looked at.
        The panels are overwritten by the next ones.
        """
        block = samples.block
        step = max(1, chunk_size(samples) // block) * block
        plain = self._plain and samples.torque_filter is None
        state = None if plain else motion_state(self.base.model, samples)
        for first in range(inner.start, inner.stop, step):
            part = slice(first, min(first + step, inner.stop))
            panels = self._evaluated(samples, part) if plain else self._picked(samples, part, state)
            yield part, panels

    def _picked(self, samples: signals.Samples, part: slice, state: Array | None) -> list[Array]:
        model, independent = self.base.model, list(self.base.independent)
        stack, torque = recorded_rows(model, samples, part, independent, state)
        panels = (np.vstack([torque[j], stack[own, j]]) for j, own in enumerate(self.columns))
        return [block_mean(panel, samples.block) for panel in panels]

    def _evaluated(self, samples: signals.Samples, part: slice) -> list[Array]:
        model, n = self.base.model, samples.joints
        motion = [values[part] for values in (samples.q, samples.dq, samples.ddq)]
        count = len(motion[0])
        state = regressor.in_lanes(model.motion(*motion))
        length = state.shape[2]
        if length not in self._memory:
            beside = np.zeros((len(model.columns) - 10 * n, n, length))
            self._memory[length] = np.zeros((self.layout.rows, length)), beside
        rows, beside = self._memory[length]
        turn = regressor.turns(state[0])
        regressor.inertial_rows(*model.constants, turn, state, rows, self.layout.places)
        model.fill_beside(state[1], state[2], beside)
        torque = samples.tau[part].T + model.known_torque(motion[0]).T
        found: list[Array] = []
        for j, panel in enumerate(self.layout.panels):
            here = rows[panel.rows.start : panel.rows.stop, :count]
            for row, column in zip(here, panel.beside, strict=False):
                row[:] = beside[column, j, :count]
            # The free row before the panel holds the torque.
            whole = rows[panel.rows.start - 1 : panel.rows.stop, :count]
            whole[0] = torque[j]
            found.append(block_mean(whole, samples.block))
        return found


@compiled(fastmath=True, error_model="numpy")
def _add_scores(panel: Array, weighted: Array, columns: Indices, scores: Array) -> None:
    """Add the columns (m, T) behind a panel's torque, times weighted residuals (T)."""
    for k in range(len(columns)):
        row = scores[columns[k]]
        for x in range(len(weighted)):
            row[x] += panel[k + 1, x] * weighted[x]


def sum_rows(
    panels: PanelRows, plan: PassPlan, samples: signals.Samples, inner: slice,
    first: int, total: int, part_left_out: int = 0,
) -> RowSums:  # fmt: skip
    """Sum a part of a recording, its panels by the plan.

    The inner samples, a multiple of their block, stand between those that the torque filter looks
    at. Of `total` rows of all recordings, `first` come before them; `part_left_out` says which part
    they are in, where recordings are left out.
    """
    n, rank, block = samples.joints, plan.base.rank, samples.block
    sums = no_sums(n, rank)
    count = (inner.stop - inner.start) // block
    own = [plan.values[columns] for columns in panels.columns]
    square = np.square(plan.weights)
    scores, residual = np.zeros((rank, count)), np.empty((n, count))
    cells: dict[tuple[int, int], tuple[int, list[Array]]] = {}
    nothing = [np.zeros((len(c) + 1, len(c) + 1)) for c in panels.columns]
    factors = list(nothing)
    row = 0
    for part, parts in panels.chunks(samples, inner):
        here = slice(row, row + parts[0].shape[1])
        row = here.stop
        own_scores = np.zeros((rank, row - here.start))
        for j, panel in enumerate(parts):
            error = panel[0] - own[j] @ panel[1:]
            residual[j, here] = error
            packed = np.ascontiguousarray(panel)
            _add_scores(packed, square[j] * error, panels.columns[j], own_scores)
            if plan.factors:
                factors[j] = upper_triangle(np.vstack([factors[j], panel.T]))
        scores[:, here] = own_scores
        poses = samples.q[part][::block]
        for key, chosen in _cells(plan, poses, first + here.start, total, part_left_out):
            known, total_products = cells.get(key, (0, nothing))
            products = [x @ x.T for x in (panel[:, chosen] for panel in parts)]
            together = [a + b for a, b in zip(total_products, products, strict=True)]
            cells[key] = (known + len(poses[chosen]), together)
    sums.rows = count
    for key, (many, products) in cells.items():
        pairs = zip(products, panels.spread, strict=True)
        sums.cells[key] = many, np.array([e.T @ p @ e for p, e in pairs])
    if plan.factors:
        # In the order of the base columns a panel's factor is no triangle any more.
        pairs = zip(factors, panels.spread, strict=True)
        sums.factors = np.array([upper_triangle(f @ e) for f, e in pairs])
    sums.long_run = window_covariance(scores, plan.lag)
    pairs = residual[:, 1:] * residual[:, :-1]
    sums.moments = np.array([x.sum(axis=1) for x in (residual, np.square(residual), pairs)])
    q, dq = samples.q[inner], samples.dq[inner]
    sums.lower, sums.upper = q.min(axis=0), q.max(axis=0)
    sums.speed = np.abs(dq).max(axis=0)
    return sums


def _cells(
    plan: PassPlan, poses: Array, first: int, total: int, part_left_out: int
) -> Iterator[tuple[tuple[int, int], slice | Indices]]:
    """Part left out and stretch of time, and which rows of a chunk belong there."""
    count = len(poses)
    stretch = (first + np.arange(count)) * plan.stretches // max(total, 1)
    regions = plan.regions
    region = np.full(count, part_left_out) if regions is None else regions.labels(poses, 0)
    label = region * plan.stretches + stretch
    if (label == label[0]).all():
        yield (int(region[0]), int(stretch[0])), slice(None)
        return
    order = np.argsort(label, kind="stable")
    found, starts = np.unique(label[order], return_index=True)
    for one, chosen in zip(found, np.split(order, starts[1:]), strict=True):
        yield (int(one) // plan.stretches, int(one) % plan.stretches), chosen


def window_covariance(scores: Array, lag: int) -> Array:
    """(r, r) sum of autocovariances of scores (r, N) with Bartlett weights up to `lag`.

    Bartlett weights are what sums over all windows of lag + 1 rows give, those that begin before
    the first row or end behind the last included; so the sums need only some windows.
    """
    count, long = scores.shape[1], lag + 1
    every = max(1, long // WINDOWS_A_LAG)
    running = np.concatenate([np.zeros((len(scores), 1)), np.cumsum(scores, axis=1)], axis=1)
    begins: Indices = np.arange(-lag, count, every, dtype=np.intp)
    ends = np.minimum(begins + long, count)
    windows = running[:, ends] - running[:, np.maximum(begins, 0)]
    return (every / long) * (windows @ windows.T)
