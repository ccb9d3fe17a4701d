"""One recording as a linear problem on which rival explanations are fitted.

The reference model is deliberately rich: all inertial parameters about their published values,
motor inertia, and friction that builds up, falls with speed and grows with load. What it leaves is
not friction that was described too plainly, so an explanation has to bring more than that.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dynid import regressor
from dynid.core import Array, Mask, scipy_part
from dynid.robot import RobotModel
from dynid.signals import find_period

BLOCKS = 8
"""Contiguous parts of a record that are left out in turn."""
ROWS = 1600
"""Rows a joint; longer records are averaged, torques and columns alike."""
WIDTHS = (0.005, 0.06)
"""Smoothing velocities of the Coulomb columns, shares of the joint's usual top speed."""
QUICK, GRADUAL = (1e-3, 3e-4, 1e-4, 3e-5), 6e-3
"""Displacements over which two parts of friction build up, shares of the joint's travel. Of the
quicker part they are candidates: `presliding_of` picks one for each joint."""
WORTH_ANOTHER = 1.0
"""Drop of the left-out negative log likelihood for another than the first of them [nats]."""
SLOW = 0.2
"""Share of a joint's usual top speed below which it is slow."""
SWEEPS = 8
FRICTION_SPREAD = 2.0
"""Standard deviation of a friction torque over that of the joint's torque."""
NARROWEST = 1e-4
"""... after the recording, of a shape that it does not need: share of that before."""
FREEDOM = 20.0
"""Parameters that the published spread of inertias counts for beside those that are measured."""
ROUGHEST = 5.0
"""Most that their spread is wider."""
LEAST_ERROR = 1e-7
"""Square of the error that counts as none, share of that of the torque: rounding."""
NO_ERROR = 1e-12
"""... and of a torque of zero [(N.m)^2 or N^2]: weights of more lose the prior to rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """Motion and torque of one record on a uniform grid, as an explanation may change them."""

    robot: RobotModel
    t: Array
    """(N) [s]"""
    q: Array
    """(N, n) [rad or m]"""
    dq: Array
    """(N, n)"""
    ddq: Array
    """(N, n)"""
    tau: Array
    """(N, n) measured torques [N.m or N]."""
    block: int
    """Rows are averages over so many samples."""
    friction_q: Array
    """(N, n) positions that the state of friction follows, see `Samples` [rad or m]."""
    apart: Mask | None = None
    """(N, n) torques that do not belong to the motion: at a limit, in a contact. None for none."""
    presliding: Array | None = None
    """(n) displacement of the quicker part, share of travel; None for the first of `QUICK`."""

    @property
    def model(self) -> regressor.InverseDynamicModel:
        """Inertial, viscous and motor columns."""
        return regressor.InverseDynamicModel(
            robot=self.robot, friction=regressor.FrictionTerms(terms=(("fv", None), ("im", None)))
        )

    def average(self, values: Array) -> Array:
        """Means (..., T) over the blocks of values (..., N)."""
        rows = values.shape[-1] // self.block
        cut = values[..., : rows * self.block].reshape(-1, self.block)
        # A product: mean() over so few values takes five times as long.
        return (cut @ np.full(self.block, 1 / self.block)).reshape(*values.shape[:-1], rows)

    def measured(self, values: Array) -> Array:
        """Averaged values (..., n, T), zero where torques do not belong to the motion."""
        if self.apart is None:
            return values
        return values * (self.average(self.apart.T.astype(np.float64)) == 0.0)

    def without(self, rows: Mask) -> "Recording":
        """The recording with the torques of rows (N), or of joints in rows (N, n), apart too."""
        more = rows if rows.ndim > 1 else np.broadcast_to(rows[:, None], self.tau.shape)
        return replace(self, apart=more if self.apart is None else self.apart | more)

    def with_motion(self, change: Callable[[Array], Array]) -> "Recording":
        """The recording with positions, velocities and accelerations (N, n) changed alike."""
        names = ("q", "dq", "ddq", "friction_q")
        return replace(self, **{name: change(getattr(self, name)) for name in names})

    def fast(self) -> "Recording":
        """The recording without rows in which a joint is slow: no column has all friction there."""
        speed = np.abs(self.dq)
        return self.without(speed < SLOW * np.percentile(speed, 98, axis=0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """The rich model of a recording, its columns and priors."""

    recording: Recording
    columns: Array
    """(p, n, T) columns, averaged."""
    torque: Array
    """(n, T) measured torque, averaged, known torques added."""
    mean: Array
    """(p) prior mean."""
    precision: Array
    """(p, p) prior precision."""
    load: Array
    """(10 n) inertial parameters that the load of friction is taken from."""
    shapes: slice
    """The friction columns beside the viscous ones: how far they spread is measured."""
    period: int
    """Rows after which the motion repeats; 0 where it does not."""

    def left(self, values: Array) -> Array:
        """(n, T) torques that parameters (p) leave, zero where they do not belong to the motion."""
        error = self.torque - np.tensordot(values, self.columns, axes=1)
        return self.recording.measured(error)

    def predicted(self, values: Array) -> Array:
        """(N, n) torques of parameters (p), added columns interpolated, the others in full."""
        rec, first = self.recording, self.shapes.stop
        out = np.empty(rec.q.shape)
        for part, stack in _parts(rec, self.load):
            out[part] = np.tensordot(values[: len(stack)], stack, axes=1).T
        added = np.tensordot(values[first:], self.columns[first:], axes=1)
        middle = rec.average(rec.t)
        between: list[Array] = [np.interp(rec.t, middle, torque) for torque in added]
        return out + np.column_stack(between) - rec.model.known_torque(rec.q)


SHAPES, STEPPED = 8, 6
"""Friction columns of a joint or coupled motor beside the viscous one, and those of them that do
not grow with speed: they stand first."""
FOLLOW = (2, 4, 5)
"""Places of those with the quicker displacement."""
_FRICTION_KINDS, _PUSHES = (0, 2, 6, 7), 6
"""First places of those that turn round with the velocity, that do so over a distance, that push
one way (the one that may drive), that grow with speed, after which the viscous one counts."""


def _parts(rec: Recording, inertial: Array) -> Iterator[tuple[slice, Array]]:
    """Columns (p, n, T) of parts of a recording, nothing averaged."""
    model, n = rec.model, rec.robot.joints
    # Friction is that of each joint, and of each motor that several joints turn.
    turns = np.concatenate([np.eye(n), regressor.motor_turns(rec.robot)])
    joints, count = [*range(n), *regressor.coupled_motors(rec.robot)], len(turns)
    turned = turns @ rec.friction_q.T
    fast = np.maximum(np.percentile(np.abs(turns @ rec.dq.T), 98, axis=1), 1e-6)[:, None]
    travel = np.maximum(np.ptp(turned, axis=1), 1e-6)
    quick = np.full(n, QUICK[0]) if rec.presliding is None else rec.presliding
    states = [regressor.friction_state(turned, d * travel) for d in (quick[joints], GRADUAL)]
    step = max(1, regressor.CHUNK // rec.block) * rec.block
    for first in range(0, len(rec.t), step):
        part = slice(first, min(first + step, len(rec.t)))
        inner = model.stack(rec.q[part], rec.dq[part], rec.ddq[part])
        load = np.abs(np.tensordot(inertial, inner[: 10 * n], axes=1))[joints]
        dq = turns @ rec.dq[part].T
        speed = np.abs(dq) / fast
        near, far = (state[:, part] for state in states)
        slow = _falling(speed)
        shapes = (
            *(np.tanh(dq / (w * fast)) for w in WIDTHS),
            near, far, near * slow, load * near, np.ones_like(load), dq * speed,
        )  # fmt: skip
        stack = np.empty((len(inner) + SHAPES * count, n, dq.shape[1]))
        stack[: len(inner)] = inner
        for k, shape in enumerate(shapes):
            row = len(inner) + k * count
            stack[row : row + count] = turns[:, :, None] * shape[:, None]
        yield part, stack


def reference(
    recording: Recording,
    prior: tuple[Array, Array],
    inertial: Array | None = None,
    added: Sequence[tuple[Array, Array]] = (),
) -> Reference:
    """Columns of a recording.

    Args:
        recording: The recording.
        prior: From `link_prior`.
        inertial: (10 n) parameters that the load of friction is taken from; None for the prior's.
        added: Columns (m, n, T) of each explanation that was found before, averaged, and their
            standard deviations (m).
    """
    n = recording.robot.joints
    load = prior[0] if inertial is None else inertial
    columns = np.concatenate(
        [recording.average(stack) for _, stack in _parts(recording, load)], axis=-1
    )
    size = np.sqrt(np.square(recording.tau).mean(axis=0)) + 1e-9
    # A column belongs to the joint that it is largest in: motors that drive several have their own.
    strength = np.sqrt(np.square(columns[10 * n :]).mean(axis=2))
    own = FRICTION_SPREAD * size[strength.argmax(axis=1)] / (strength.sum(axis=1) + 1e-12)
    shapes = slice(len(recording.model.columns), len(columns))
    if added:
        columns = np.concatenate([columns, *(more for more, _ in added)])
        own = np.concatenate([own, *(spread for _, spread in added)])
    precision = np.zeros((len(columns), len(columns)))
    precision[: 10 * n, : 10 * n] = np.linalg.inv(prior[1])
    rest = np.arange(10 * n, len(columns))
    precision[rest, rest] = 1 / np.square(own)
    known = recording.model.known_torque(recording.q).T
    rate_hz = (len(recording.t) - 1) / (recording.t[-1] - recording.t[0])
    return Reference(
        recording=recording,
        columns=columns,
        torque=recording.average(recording.tau.T + known),
        mean=np.concatenate([prior[0], np.zeros(len(rest))]),
        precision=precision,
        load=load,
        shapes=shapes,
        period=round((find_period(recording.q, rate_hz) or 0.0) * rate_hz / recording.block),
    )


def _falling(speed: Array) -> Array:
    """How friction falls with speed, a share of the usual top speed (Stribeck)."""
    return np.exp(-np.square(speed / 0.05))


def presliding_of(ref: Reference, values: Array, counts: Array) -> Array:
    """(n) presliding displacement of each joint that explains most, share of its travel.

    Near reversals a displacement that is wrong leaves up to seven times the noise. Each of `QUICK`
    is tried on what a first fit leaves for the friction of a joint, and judged by blocks left out.

    Args:
        ref: A reference with any displacement.
        values: (p) its parameters.
        counts: (n) independent rows.
    """
    rec, n = ref.recording, ref.recording.robot.joints
    count = (ref.shapes.stop - ref.shapes.start) // SHAPES
    speed = np.abs(rec.dq.T) / np.maximum(np.percentile(np.abs(rec.dq), 98, axis=0), 1e-6)[:, None]
    slow = rec.average(_falling(speed))
    load = np.abs(np.tensordot(ref.load, ref.columns[: 10 * n], axes=1))
    travel = np.maximum(np.ptp(rec.q, axis=0), 1e-6)
    states = [rec.average(regressor.friction_state(rec.friction_q.T, d * travel)) for d in QUICK]
    error = ref.left(values)
    kept = rec.measured(np.ones_like(error))
    cuts = np.arange(1, BLOCKS) * error.shape[1] // BLOCKS
    costs = np.empty((len(QUICK), n))
    for j in range(n):
        own = [10 * n + j, *range(ref.shapes.start + j, ref.shapes.stop, count)]
        torque = error[j] + values[own] @ ref.columns[own, j]
        # A delay stands beside it: it may not be taken for another displacement.
        rest = [own[k] for k in range(len(own)) if k - 1 not in FOLLOW]
        beside = np.vstack([ref.columns[rest, j], np.gradient(ref.torque[j] - error[j])])
        for k, state in enumerate(states):
            shapes = state[j] * np.array([np.ones_like(slow[j]), slow[j], load[j]])
            rows = np.concatenate([beside, shapes])
            rows /= np.sqrt(np.square(rows).sum(axis=1, keepdims=True)) + 1e-300
            rows = kept[j] * np.vstack([rows, torque])
            parts = np.array([x @ x.T for x in np.split(rows, cuts, axis=1)])
            inner = parts.sum(axis=0) - parts
            ridge = 1e-6 * np.eye(len(rows) - 1)
            ways = np.ones((BLOCKS, len(rows)))
            ways[:, :-1] = -np.linalg.solve(inner[:, :-1, :-1] + ridge, inner[:, :-1, -1:])[..., 0]
            left = float(np.einsum("bi,bij,bj->", ways, parts, ways))
            costs[k, j] = 0.5 * counts[j] * np.log(max(left, 1e-300))
    # A real Panda that shows little of its friction had false faults with whichever fits best.
    costs[0] -= WORTH_ANOTHER
    return np.array(QUICK)[costs.argmin(axis=0)]


def undriven(columns: Array, powers: Array, torque: Array) -> float:
    """Squares of torques that friction leaves where each kind of it brakes, beyond the best fit.

    Large parts of kinds that are hardly told apart cancel each other: what each of them is tells
    nothing.

    Args:
        columns: (m, T) columns of friction, then others.
        powers: (SHAPES + 1) powers of those of friction over the mean speed, at parameters of one.
        torque: (T) torque that they explain [N.m or N].

    Returns:
        The sum over T [(N.m)^2 or N^2].
    """
    rows, lowest = columns.copy(), np.full(len(columns), -np.inf)
    for first, stop in pairwise((*_FRICTION_KINDS, len(powers))):
        if first != _PUSHES:
            # The power of a kind takes the place of its first column.
            rows[first] /= powers[first]
            rows[first + 1 : stop] -= powers[first + 1 : stop, None] * rows[first]
            lowest[first] = 0.0
    rows /= np.sqrt(np.square(rows).sum(axis=1, keepdims=True)) + 1e-300
    solve = scipy_part("optimize").lsq_linear
    # Its tolerances are those of numbers about one.
    size = max(float(np.linalg.norm(torque)), 1e-300)
    braking, free = (
        float(solve(rows.T, torque / size, bounds=(low, np.inf)).cost) for low in (lowest, -np.inf)
    )
    return 2 * size**2 * max(braking - free, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Fits:
    """Sums of products of a reference and of added columns, by block and joint."""

    sums: Array
    """(BLOCKS, n, P + 1, P + 1): columns, then torque."""
    rows: Array
    """(n) rows that count."""
    weights: Array
    """(n) 1 over noise variance times correlation length, from the reference alone."""
    counts: Array
    """(n) independent rows."""
    mean: Array
    """(p) prior mean."""
    precision: Array
    """(p, p) prior precision, for the spreads that the recording shows."""
    inertial: Array
    """(10 n, 10 n) prior precision of the inertial parameters, as published."""
    seen: Array
    """(n) parameters of each link that the recording tells more about than the prior."""
    widening: float
    """Square of the spread of inertias in `precision` over the published one."""
    own: int
    """p, columns of the reference."""

    def weighted(self) -> Array:
        """(BLOCKS, P + 1, P + 1) weighted sums over the joints."""
        # Not tensordot(), which copies all of them first.
        blocks, n, size, _ = self.sums.shape
        total: Array = np.matmul(self.weights, self.sums.reshape(blocks, n, -1))
        return total.reshape(blocks, size, size)

    def widened(self, values: Array) -> float:
        """Square of the spread of inertias over the published one, as parameters (p) show it.

        It is no narrower. The link that is furthest off may carry something: the others tell.
        """
        links = (values - self.mean)[: len(self.inertial)]
        away = (links * (self.inertial @ links)).reshape(-1, 10).sum(axis=1)
        others = np.arange(len(away)) != away.argmax()
        wide = (FREEDOM + away[others].sum()) / (FREEDOM + self.seen[others].sum())
        return float(np.clip(wide, 1.0, ROUGHEST**2))

    def penalty(self, values: Array) -> float:
        """How unlikely parameters (p) are before anything was measured [nats]."""
        away = values - self.mean
        spread = (FREEDOM + float(self.seen.sum())) * float(np.log(self.widening))
        return 0.5 * (float(away @ self.precision @ away) + spread)


def correlation_length(error: Array, period: int, *, within: bool = False) -> Array:
    """(n) rows that count as one, from the autocorrelation of errors (n, T).

    The longer of two: errors that drift are seldom new, and of errors that swing (gears that
    vibrate) their power is (Bartlett 1935), though their sum soon vanishes. Repetitions of a
    motion average the noise alone, not what the model leaves in each of them; `within` one of them
    that does not count.
    """
    count = error.shape[1]
    lags = max(1, min(count, 2 * period or count) // 4)
    # Zeros enough that no lag that is read wraps around.
    size = 1 << (count + lags).bit_length()
    spectra = np.fft.rfft(error - error.mean(axis=1, keepdims=True), size)
    products = np.fft.irfft(np.square(np.abs(spectra)))[:, :lags]
    alike = np.ones(len(error))
    if period:
        again = (error[:, period:] * error[:, :-period]).mean(axis=1)
        share = again / np.maximum(np.square(error).mean(axis=1), 1e-300)
        alike += (count / period - 1) * np.clip(share, 0.0, 1.0)
    out = np.ones(len(error))
    for j, auto in enumerate(products / np.maximum(products[:, :1], 1e-300)):
        stop = int(np.argmax(auto < 0.05)) or lags
        power = np.square(auto[1:]) - alike[j] / count
        out[j] = max(1.0, 1 + 2 * float(auto[1:stop].sum()), 1 + 2 * float(power.sum()))
    return out if within else out * alike


def sums_of(ref: Reference, *added: Array) -> Array:
    """(`BLOCKS`, n, P + 1, P + 1) sums of products of its columns and of added ones (m, n, T)."""
    everything = np.concatenate([ref.columns, *added, ref.torque[None]])
    everything = ref.recording.measured(everything)
    rows, n = everything.shape[-1], everything.shape[1]
    cuts = [k * rows // BLOCKS for k in range(BLOCKS + 1)]
    sums = np.empty((BLOCKS, n, len(everything), len(everything)))
    for k, (a, b) in enumerate(pairwise(cuts)):
        for j in range(n):
            part = everything[:, j, a:b]
            sums[k, j] = part @ part.T
    return sums


def fits(ref: Reference) -> tuple[Fits, Array]:
    """Sums of a reference, weighted by what it leaves, and (p) its parameters."""
    n = len(ref.torque)
    rows = np.maximum(ref.recording.measured(np.ones(ref.torque.shape)).sum(axis=1), 1.0)
    found = Fits(
        sums=sums_of(ref),
        rows=rows,
        weights=1 / np.maximum(np.square(ref.torque).mean(axis=1), NO_ERROR),
        counts=rows,
        mean=ref.mean,
        precision=ref.precision,
        inertial=ref.precision[: 10 * n, : 10 * n],
        seen=np.zeros(n),
        widening=1.0,
        own=len(ref.columns),
    )
    return settled(ref, found, SWEEPS)


def solution(matrix: Array, right: Array) -> Array:
    """What a positive definite matrix (p, p) takes to (p, m), whatever the units of its parameters.

    Each is scaled by its deviation (van der Sluis 1969): guessed links of a heavy arm are known to
    tons and its friction to 1e-4 N.m, which rounding does not keep apart otherwise.
    """
    scale = 1 / np.sqrt(np.diag(matrix))[:, None]
    inner = np.linalg.solve(matrix * scale * scale.T, right * scale)
    return np.asarray(scale * inner, dtype=np.float64)


def settled(ref: Reference, found: Fits, sweeps: int) -> tuple[Fits, Array]:
    """Sums weighted by what their reference leaves, and (p) its parameters.

    The spread of each friction shape is what the recording shows of it: each sweep takes a step of
    expectation and maximisation of the evidence (Tipping 2001). Shapes that it does not need cost
    nothing. So is the spread of the inertias (MacKay 1992): those of drawings are often rough.
    """
    p, shapes = found.own, np.arange(found.own)[ref.shapes]
    widest, links = ref.precision[shapes, shapes], len(found.inertial)
    values = np.zeros(p)
    least = LEAST_ERROR * np.square(ref.torque).mean(axis=1) + NO_ERROR
    sums = found.sums.sum(axis=0)
    for _ in range(sweeps):
        total: Array = np.asarray(np.tensordot(found.weights, sums, axes=1), np.float64)
        right = np.asarray(total[:p, -1] + found.precision @ found.mean, dtype=np.float64)
        # The inverse times `right` loses what the torques of a light arm tell.
        both = solution(total[:p, :p] + found.precision, np.column_stack([np.eye(p), right]))
        covariance, values = both[:, :-1], both[:, -1]
        error = ref.left(values)
        length = correlation_length(error, ref.period)
        variance = np.maximum(np.square(error).sum(axis=1) / found.rows, least)
        precision = found.precision.copy()
        held = np.sum(found.precision[:links, :links] * covariance[:links, :links], axis=1)
        found = replace(found, seen=np.maximum(10 - held.reshape(-1, 10).sum(axis=1), 0.0))
        wide = found.widened(values)
        precision[:links, :links] = found.inertial / wide
        square = np.square(values[shapes]) + covariance[shapes, shapes]
        precision[shapes, shapes] = widest / np.clip(square * widest, NARROWEST**2, 1.0)
        found = replace(
            found, weights=1 / (variance * length), counts=found.rows / length,
            precision=precision, widening=wide,
        )  # fmt: skip
    return found, values
