"""Drive gains from the targets of the controller, or from a payload of known mass."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from dynid import core
from dynid.identification import least_squares, statistics
from dynid.identification.shared import PAYLOAD, SINGULAR, SharedProblem, shared_sandwich

WIDTH = 0.01
"""Speed over which the controller's dry friction changes sign [rad/s]."""
LARGEST_STD = 0.05
"""Relative standard deviation above which a gain is not given."""
LEAST_SHARE = 1e-12
"""Part of the current that the moment must move apart from friction, over the current: less is
rounding. Whether more is enough, the residuals say."""
ROUNDING = 1e-12
"""Share of the largest current below which a residual is rounding, not noise."""
_COLUMNS = ("gain", "std", "coulomb", "viscous", "r2")


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveGains(core.Value):
    """Drive gains with their uncertainty; NaN where they are not identifiable.

    Raises:
        InputError: Shapes that disagree.
    """

    gain: core.Array
    """(n) joint torque per motor current [N.m/A]."""
    std: core.Array
    """(n) standard deviations that allow for correlated residuals [N.m/A]."""
    coulomb: core.Array
    """(n) dry friction that the controller compensates [N.m]."""
    viscous: core.Array
    """(n) viscous friction that the controller compensates [N.m.s/rad]."""
    r2: core.Array
    """(n) share of the current's variation that is explained."""
    samples: int
    """Rows a joint."""
    warnings: tuple[core.Finding, ...] = ()
    """Joints whose gain is not identified, and why."""

    def __post_init__(self) -> None:
        n = np.size(self.gain)
        core.freeze(self, gain=(n,), std=(n,), coulomb=(n,), viscous=(n,), r2=(n,), finite=False)

    def to_json(self, names: tuple[str, ...]) -> dict[str, Any]:
        """A JSON object for joints of these names; null where a gain is not known."""
        gains = core.table(joint=names, **{key: getattr(self, key) for key in _COLUMNS})
        return {"samples": self.samples, "gains": gains, **core.told(self.warnings)}


def drive_gains(
    current: core.Array,
    moment: core.Array,
    velocity: core.Array,
    *,
    rate_hz: float,
    names: tuple[str, ...],
) -> DriveGains:
    """Gains from the controller's targets.

    Args:
        current: (N, n) target currents [A].
        moment: (N, n) target moments [N.m].
        velocity: (N, n) target velocities, or measured ones [rad/s].
        rate_hz: Samples a second.
        names: (n) joint names, for messages.

    Raises:
        InputError: Too few samples.
        JobError: No joint's gain can be told.
    """
    if len(current) < 16:
        raise core.InputError("too few samples", value=len(current), limit="at least 16")
    rows, lost = np.empty((len(names), 5)), dict[str, str]()
    for j, name in enumerate(names):
        columns = np.stack([moment[:, j], np.tanh(velocity[:, j] / WIDTH), velocity[:, j]])
        rows[j], reason = _joint(columns, current[:, j], rate_hz)
        if reason:
            lost[name] = reason
    if np.isnan(rows[:, 0]).all():
        raise core.JobError(
            "no drive gain can be identified from this recording",
            value="; ".join(f"{name}: {reason}" for name, reason in lost.items()),
            next_step="Record a motion that loads and accelerates every joint.",
        )
    columns = dict(zip(_COLUMNS, rows.T, strict=True))
    warnings = tuple(_lost(name, reason) for name, reason in lost.items())
    return DriveGains(**columns, samples=len(current), warnings=warnings)


def _lost(name: str, reason: str) -> core.Finding:
    return core.Finding("low_excitation", f"no drive gain for {name}: {reason}")


def _joint(columns: core.Array, current: core.Array, rate_hz: float) -> tuple[core.Array, str]:
    """Gain, its deviation, Coulomb, viscous and r2 of one joint, and why there is none."""
    nothing = np.full(5, np.nan)
    norms = np.linalg.norm(columns, axis=1)
    if norms[1] < 1e-9 or norms[0] < 1e-9:
        return nothing, "the joint stands still or carries no moment"
    # The moment last: its pivot is what of it the friction columns cannot show.
    scaled = (columns / norms[:, None])[[1, 2, 0]].T
    upper = core.upper_triangle(np.column_stack([scaled, current]))
    pivots = np.abs(np.diag(upper)[:3])
    moved = float(np.abs(upper[2, 3]))
    if pivots.min() < 1e-9 or moved < LEAST_SHARE * np.linalg.norm(current):
        return nothing, "its moment has no effect on the current beyond friction"
    inverse = core.inverse_upper(upper[:3, :3])
    solution = inverse @ upper[:3, 3]
    residual = current - scaled @ solution
    residual[np.abs(residual) < ROUNDING * np.abs(current).max()] = 0.0
    if moved < np.linalg.norm(residual):
        return nothing, "the effect of its moment on the current is below the residual"
    scores = scaled.T * residual
    lag = statistics.correlation_lag(residual[None], rate_hz) if residual.any() else 1
    bread = inverse @ inverse.T
    covariance = bread @ statistics.long_run_covariance(scores, lag) @ bread
    friction = solution[:2] / norms[1:]
    per_moment = solution[2] / norms[0]
    relative = float(np.sqrt(max(covariance[2, 2], 0.0)) / abs(solution[2]))
    if relative > LARGEST_STD:
        return nothing, f"its standard deviation would be {100 * relative:.0f} %"
    gain = 1.0 / per_moment
    spread = float(np.square(current - current.mean()).sum())
    r2 = 1.0 - float(residual @ residual) / max(spread, 1e-300)
    return np.array([gain, abs(gain) * relative, *(gain * friction), r2]), ""


@dataclass(frozen=True, slots=True, kw_only=True)
class WeighedSystem:
    """The problem with its columns in one order: own of each record, arm, unknown payload.

    The arm's parameters are of each joint: one set for all would tie the gains together by what
    the model of the arm gets wrong, so that only the payload does.
    """

    problem: SharedProblem
    turn: core.Array
    """(10, 10) payload about the last link's frame from payload about the flange."""
    known: core.Array
    """(10) payload about the flange, NaN where unknown."""
    shown: tuple[core.Array, ...]
    """(n) combinations (k, s) of the arm's parameters that each joint shows."""
    carried: core.Array
    """(10, s) those of the unknown payload about the flange that any joint shows."""

    @property
    def size(self) -> int:
        """Number of unknowns x, gains apart."""
        records, own = len(self.problem.problems), len(self.problem.own)
        arm = sum(each.shape[1] for each in self.shown)
        return records * own + arm + self.carried.shape[1]

    def spread(self, record: int, columns: core.Array) -> tuple[core.Array, core.Array]:
        """Columns (w, ...) of a record as (size, ...), and the known payload's torque (...)."""
        problem, unknown = self.problem, np.isnan(self.known)
        own, records = len(problem.own), len(problem.problems)
        arm = columns[own : own + len(problem.common)]
        payload = np.tensordot(self.turn.T, columns[-PAYLOAD:], axes=1)
        wide = np.zeros((self.size, *columns.shape[1:]))
        wide[record * own : (record + 1) * own] = columns[:own]
        first = records * own
        for j, each in enumerate(self.shown):
            wide[first : first + each.shape[1], j] = np.tensordot(each.T, arm[:, j], axes=1)
            first += each.shape[1]
        wide[first:] = np.tensordot(self.carried.T, payload, axes=1)
        fixed = np.tensordot(self.known[~unknown], payload[~unknown], axes=1)
        return wide, np.asarray(fixed, dtype=np.float64)


RANK = 1e-9
"""Singular value over the largest above which a joint shows a combination."""
ITERATIONS = 50
CONVERGED = 1e-9
RUNAWAY = 30.0
"""Factor from the first gain at which one is lost."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GainsFromPayload(core.Value):
    """Drive gains from a known payload, and what could not be told."""

    gain: core.Array
    """(n) joint torque per motor current [N.m/A], NaN where the runs do not show it."""
    std: core.Array
    """(n) standard deviations that allow for correlated residuals [N.m/A], given for all."""
    payload: core.Array
    """(10) the payload about the flange: what was known, the rest as found, NaN where no joint
    shows it (all axes of an arm may be parallel)."""
    warnings: tuple[core.Finding, ...] = ()
    """Joints whose gain the runs do not show; what the runs tell of themselves."""


def gains_from_payload(
    problem: SharedProblem, turn: core.Array, known: core.Array, start: core.Array | None = None
) -> GainsFromPayload:
    """Drive gains of records, some of them with the payload.

    Args:
        problem: The records with currents [A] in place of torques.
        turn: (10, 10) payload about the last link's parameter frame from payload about the
            flange.
        known: (10) the payload about the flange, NaN where unknown; the mass must be known.
        start: (n) gains to start from; None for those of the linear problem.

    Raises:
        JobError: A singular problem, or one that does not converge.
    """
    records, joints = len(problem.problems), problem.joints
    # Columns (R, n, h, size), known torques and currents (R, n, h), as square roots.
    factors = np.array([problem.factors(k) for k in range(records)])
    system = _system(problem, factors, turn, known)
    rows = enumerate(np.moveaxis(factors[..., :-1], -1, 1))
    wide, fixed = zip(*(system.spread(k, columns) for k, columns in rows), strict=True)
    data = np.moveaxis(np.array(wide), 1, -1), np.array(fixed), factors[..., -1]
    blocks = np.array([item.blocks for item in problem.problems])
    scale = np.linalg.norm(data[2], axis=2) / np.sqrt(blocks)[:, None]
    if start is None:
        # The homogeneous linear problem, currents among the columns: noise there would make gains
        # too small, so of each joint's current what the model can give with a gain of its own.
        columns, fixed, current = data
        shown = np.empty_like(current)
        for j in range(joints):
            own = np.concatenate([columns[:, j], fixed[:, j, :, None]], axis=2)
            flat = own.reshape(-1, own.shape[2])
            shown[:, j] = own @ np.linalg.lstsq(flat, current[:, j].ravel())[0]
        start = _solved_with_gains(shown, -columns, fixed, scale)[0][:joints]
    gain = start
    values = np.zeros(system.size)
    noise = scale
    for _ in range(ITERATIONS):
        _check_scale(gain, start)
        values = _values(data, gain, noise)
        predicted = (data[0] @ values + data[1]) / gain[:, None]
        residual = data[2] - predicted
        # One noise a joint: what all records get wrong alike then cancels.
        used = (system.size + joints) / joints
        total = np.square(residual).sum(axis=(0, 2)) / max(blocks.sum() - used, 1.0)
        noise = np.tile(np.maximum(np.sqrt(total), 1e-9 * scale.max()), (records, 1))
        # A Gauss-Newton step in log gain and parameters.
        slopes = data[0] / gain[:, None, None]
        step, root = _solved_with_gains(-predicted, slopes, residual, noise)
        # Half a logarithm at most: far from the answer the linear model is no guide.
        step = step * min(1.0, 0.5 / max(float(np.abs(step[:joints]).max()), 1e-300))
        gain = gain * np.exp(step[:joints])
        if np.abs(step[:joints]).max() < CONVERGED:
            break
    else:
        raise core.JobError("the drive gains do not converge", value=gain.tolist())
    covariance = _covariance(system, gain, values, noise, root)
    share = np.sqrt(np.diag(covariance)[:joints])
    names, lost = problem.problems[0].base.model.robot.joint_names, share > LARGEST_STD
    return GainsFromPayload(
        gain=np.where(lost, np.nan, gain),
        std=gain * share,
        payload=_payload(system, values),
        warnings=tuple(
            _lost(names[j], f"its standard deviation would be {100 * share[j]:.0f} %")
            for j in np.flatnonzero(lost)
        ),
    )


def _system(
    problem: SharedProblem, factors: core.Array, turn: core.Array, known: core.Array
) -> WeighedSystem:
    """Of factors (R, n, h, w) with the columns of `SharedProblem`."""
    own, common = len(problem.own), len(problem.common)
    by_joint = np.moveaxis(factors, 1, 0).reshape(problem.joints, -1, factors.shape[-1])
    carried = np.zeros((PAYLOAD, PAYLOAD))
    unknown = np.isnan(known)
    payload = by_joint[..., own + common : own + common + PAYLOAD] @ turn
    part = _shown(payload.reshape(-1, PAYLOAD)[:, unknown])
    carried[unknown, : part.shape[1]] = part
    return WeighedSystem(
        problem=problem,
        turn=turn,
        known=known,
        shown=tuple(_shown(rows[:, own : own + common]) for rows in by_joint),
        carried=carried[:, : part.shape[1]],
    )


def _shown(rows: core.Array) -> core.Array:
    """(k, s) combinations of k parameters that change what rows (r, k) of them give."""
    size = np.linalg.norm(rows, axis=0)
    size[size == 0] = 1.0
    _, values, turn = np.linalg.svd(rows / size, full_matrices=False)
    return (turn[values > RANK * values.max(initial=0.0)] / size).T


def _payload(system: WeighedSystem, values: core.Array) -> core.Array:
    """(10) the payload about the flange from what was found."""
    carried = system.carried
    # Those that lie in what is shown, rather than beside it.
    told = np.diag(carried @ np.linalg.pinv(carried)) > 1.0 - np.sqrt(RANK)
    found = np.where(told, carried @ values[len(values) - carried.shape[1] :], np.nan)
    return np.where(np.isnan(system.known), found, system.known)


def _check_scale(gain: core.Array, first: core.Array) -> None:
    """Refuse gains that run away: nothing holds them."""
    wrong = ~((first > 0) & (gain < RUNAWAY * first) & (gain > first / RUNAWAY))
    if wrong.any():
        raise core.JobError(
            "the payload does not set the scale of every joint's current",
            value=f"joints {', '.join(str(j + 1) for j in np.flatnonzero(wrong))}",
            next_step="Use a heavier payload off the last axis, or a motion that loads and "
            "accelerates every joint.",
        )


def _values(
    data: tuple[core.Array, core.Array, core.Array], gain: core.Array, noise: core.Array
) -> core.Array:
    """The best parameters for given gains."""
    columns, fixed, current = data
    rows = np.concatenate([columns, (current * gain[:, None] - fixed)[..., None]], axis=3)
    rows = rows / (noise * gain)[:, :, None, None]
    return least_squares.solve_rows(rows.reshape(-1, rows.shape[-1]), SINGULAR)[0]


def _solved_with_gains(
    own: core.Array, columns: core.Array, target: core.Array, noise: core.Array
) -> tuple[core.Array, core.Array]:
    """As `solve_rows`, of weighted rows with a column (R, n, h) of each joint before the others."""
    records, joints, height, size = columns.shape
    rows = np.zeros((records, joints, height, joints + size + 1))
    for j in range(joints):
        rows[:, j, :, j] = own[:, j]
    rows[..., joints:-1], rows[..., -1] = columns, target
    weighted = rows / noise[:, :, None, None]
    return least_squares.solve_rows(weighted.reshape(-1, joints + size + 1), SINGULAR)


def _covariance(
    system: WeighedSystem, gain: core.Array, values: core.Array, noise: core.Array, root: core.Array
) -> core.Array:
    """Of log gains and parameters, see `shared_sandwich`."""
    problem, joints = system.problem, len(gain)
    inverse = core.inverse_upper(root)

    def scored(k: int) -> tuple[core.Array, core.Array]:
        blocks = problem.problems[k].blocks
        scores, residual = np.zeros((len(root), blocks)), np.empty((joints, blocks))
        for part, columns, current in problem.chunks(k):
            wide, fixed = system.spread(k, columns)
            predicted = (np.tensordot(values, wide, axes=1) + fixed) / gain[:, None]
            residual[:, part] = current - predicted
            weighted = residual[:, part] / np.square(noise[k])[:, None]
            scores[:joints, part] = -predicted * weighted
            scaled = weighted / gain[:, None]
            scores[joints:, part] = np.einsum("rjt,jt->rt", wide, scaled, optimize=True)
        return scores, residual

    return shared_sandwich(problem, inverse, scored, lambda rows, together: 1.0)
