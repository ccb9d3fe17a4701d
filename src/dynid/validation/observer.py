"""External torques from the generalised momentum, without accelerations or force sensors."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from numbers import Real

import numpy as np
from numpy.typing import ArrayLike

from dynid import recording, signals
from dynid.core import Array, InputError, Mask, Value, freeze, frozen, read_only, scipy_part
from dynid.identification import Estimate, EstimateLike, open_estimate
from dynid.regressor import FrictionTerms, InverseDynamicModel, torque_adjoint

BANDWIDTH = 50.0
"""Of the residual [1/s]: a step of torque is seen to 92 % after 50 ms."""
SPEEDS = (0.0, 0.05, 0.1, 0.2, 0.5)
"""Speeds at which thresholds change [rad/s or m/s]."""
RATE_HZ = 125.0
MEMORY = 3.0
"""Time constants of the residual after which it has settled."""
QUANTILE = 0.9999
MARGIN = 2.0
"""Thresholds over the quantile: what ten minutes bring that one record did not."""
_LEAST_SAMPLES = 100
_LEAST_NOISE = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactThresholds(Value):
    """Residuals beyond which a joint is touched, learned from free motion.

    Near standstill stiction and the reversal of friction hide several N.m that a moving joint
    shows at once, so the thresholds depend on the speed.

    Raises:
        InputError: Shapes that disagree.
    """

    speeds: Array
    """(b) speeds from which each row holds, the first one 0 [rad/s or m/s]."""
    limits: Array
    """(b, n) thresholds, never rising with the speed [N.m or N]."""
    samples: int
    """N, samples of free motion they come from."""
    memory: int = round(MEMORY * RATE_HZ / BANDWIDTH)
    """Samples of which the slowest speed decides: the residual lags behind by so many."""

    def __post_init__(self) -> None:
        freeze(self, speeds=(None,))
        freeze(self, limits=(len(self.speeds), None))

    def contacts(self, residual: ArrayLike, dq: ArrayLike) -> Mask:
        """(N, n) whether a joint is touched, for residuals and velocities (N, n) in a row.

        Raises:
            InputError: Shapes that do not fit the robot or each other.
        """
        joints = self.limits.shape[1]
        size = np.abs(frozen(residual, shape=(None, joints), name="residual", finite=False))
        speed = recent_speed(frozen(dq, shape=size.shape, name="dq", finite=False), self.memory)
        row = np.searchsorted(self.speeds, speed, side="right") - 1
        return size > self.limits[row, np.arange(joints)]


@dataclass(frozen=True, slots=True, kw_only=True)
class MomentumObserver:
    """Residual r = K (p(t) - p(0) - integral of tau - friction - g + C' dq + r), p = M dq.

    The external joint torque, low-passed with bandwidth K (De Luca and Mattone 2005). C' dq is
    the derivative of the kinetic energy by q.

    Raises:
        InputError: A bandwidth that is not positive, or no estimate (see `open_estimate`).
    """

    estimate: Estimate
    """The model; its friction is part of the expected torque."""
    bandwidth: float
    """K [1/s]"""

    def __init__(self, *, estimate: EstimateLike, bandwidth: float = BANDWIDTH) -> None:
        if not (isinstance(bandwidth, Real) and math.isfinite(bandwidth) and bandwidth > 0):
            raise InputError("the observer's bandwidth must be positive", value=bandwidth)
        object.__setattr__(self, "estimate", open_estimate(estimate))
        object.__setattr__(self, "bandwidth", bandwidth)

    def momentum(self, q: ArrayLike, dq: ArrayLike) -> tuple[Array, Array]:
        """Momentum p and C' dq, each (N, n), at q and dq (N, n).

        Raises:
            InputError: Shapes that do not fit the robot or each other.
        """
        rigid, parameters = _rigid(self.estimate)
        q, dq, _ = rigid.states(q, dq, dq)
        still = np.zeros_like(q)
        weight = rigid.inverse_dynamics(q, still, still, parameters)
        own = rigid.inverse_dynamics(q, still, dq, parameters) - weight
        # The derivative of dq' M dq by q, less that of dq' g, which comes along with it.
        pushed, *_ = torque_adjoint(rigid, q, still, dq, parameters, dq)
        resting, *_ = torque_adjoint(rigid, q, still, still, parameters, dq)
        return own, (pushed - resting) / 2.0

    def residuals(self, t: ArrayLike, q: ArrayLike, dq: ArrayLike, torque: ArrayLike) -> Array:
        """External joint torques (N, n) [N.m or N], zero at the first sample.

        Args:
            t: (N) increasing times [s].
            q: (N, n) positions [rad or m].
            dq: (N, n) velocities.
            torque: (N, n) motor torques, joint side [N.m or N].

        Raises:
            InputError: Shapes that disagree, numbers that are not finite, times that do not
                increase.
        """
        times = frozen(t, shape=(None,), name="t")
        shape = (len(times), self.estimate.model.robot.joints)
        place, speed, effort = (
            frozen(x, shape=shape, name=name)
            for x, name in ((q, "q"), (dq, "dq"), (torque, "torque"))
        )
        steps = np.diff(times)
        if len(times) < 2 or (steps <= 0).any():
            raise InputError("the times of an observer must increase", value=len(times))
        own, slope = self.momentum(place, speed)
        still = np.zeros(shape)
        rigid, parameters = _rigid(self.estimate)
        coriolis = rigid.inverse_dynamics(place, speed, still, parameters)
        coriolis = coriolis - rigid.inverse_dynamics(place, still, still, parameters)
        # Everything but acceleration, less Coriolis torques: gravity and friction.
        drag = self.estimate.predict(place, speed, still) - coriolis
        push = effort - drag + slope
        residual, integral = np.zeros(shape), np.zeros(shape[1])
        for k, step in enumerate(steps, start=1):
            integral = integral + step * (push[k] + push[k - 1]) / 2.0
            gap = own[k] - own[0] - integral
            residual[k] = self.bandwidth * gap / (1.0 + self.bandwidth * step)
            integral = integral + step * residual[k]
        return read_only(residual)

    def of_record(self, record: recording.RecordLike) -> tuple[Array, Array]:
        """Residuals and velocities, each (N, n), of a recording as it would be seen live.

        Nothing is filtered. Without recorded velocities they are differences of the positions
        before and after, which makes the residual noisy.

        Args:
            record: The recording or its file.

        Raises:
            InputError: The recording does not fit the robot, or has no torque.
        """
        robot = self.estimate.model.robot
        record = recording.open_record(record, robot)
        torque = signals.measured_torque(record, robot)
        q = record.signals["q"]
        dq = record.signals.get("qd")
        if dq is None:
            dq = np.gradient(q, record.t, axis=0)
        return self.residuals(record.t, q, dq, torque), np.asarray(dq)


def contact_thresholds(
    residuals: Sequence[Array],
    velocities: Sequence[Array],
    *,
    rate_hz: float = RATE_HZ,
    bandwidth: float = BANDWIDTH,
    noise: ArrayLike = 0.0,
    quantile: float = QUANTILE,
    margin: float = MARGIN,
) -> ContactThresholds:
    """Thresholds from the residuals of free motion that was not identified from.

    Args:
        residuals: One (N, n) a recording, from `MomentumObserver`.
        velocities: One (N, n) a recording.
        rate_hz: Of the samples.
        bandwidth: Of the residuals [1/s].
        noise: (n) `Estimate.noise` [N.m or N]: no threshold is below three of it, however well
            this motion was predicted.
        quantile: Of the residuals' size that must stay below, before the margin.
        margin: Factor on it.

    Raises:
        InputError: Too few samples, shapes that disagree, a quantile outside (0, 1), a margin
            below 1, a rate or a bandwidth that is not positive.
    """
    if not (0.0 < quantile < 1.0 and margin >= 1.0):
        raise InputError("quantile in (0, 1) and margin of at least 1", value=(quantile, margin))
    if not (0.0 < rate_hz < math.inf and 0.0 < bandwidth < math.inf):
        raise InputError("rate and bandwidth must be positive", value=(rate_hz, bandwidth))
    memory = max(1, round(MEMORY * rate_hz / bandwidth))
    known = [frozen(one, shape=(None, None), name="residuals") for one in residuals]
    moved = [frozen(one, shape=(None, None), name="velocities") for one in velocities]
    joints = {one.shape[1] for one in known}
    if len(joints) != 1 or [one.shape for one in known] != [one.shape for one in moved]:
        value = [one.shape for one in known], [one.shape for one in moved]
        raise InputError("residuals and velocities of the same samples and joints", value=value)
    size, speed = np.abs(np.vstack(known)), np.vstack([recent_speed(one, memory) for one in moved])
    least = frozen(noise, shape=() if np.ndim(noise) == 0 else tuple(joints), name="noise")
    if len(size) < _LEAST_SAMPLES:
        raise InputError("samples of free motion", value=len(size), limit=_LEAST_SAMPLES)
    limits = np.empty((len(SPEEDS), size.shape[1]))
    for joint in range(size.shape[1]):
        for row, (slowest, fastest) in enumerate(pairwise((*SPEEDS, np.inf))):
            slower = speed[:, joint] < fastest
            # A speed that hardly came up is judged by all that is not faster, or by all.
            tried = slower & (speed[:, joint] >= slowest), slower, np.ones_like(slower)
            chosen = next(some for some in tried if np.count_nonzero(some) >= _LEAST_SAMPLES)
            limits[row, joint] = margin * np.quantile(size[chosen, joint], quantile)
    limits = np.maximum(limits, _LEAST_NOISE * least)
    falling = np.maximum.accumulate(limits[::-1])[::-1]
    return ContactThresholds(
        speeds=np.array(SPEEDS), limits=falling, samples=len(size), memory=memory
    )


def recent_speed(dq: Array, memory: int) -> Array:
    """(N, n) the slowest speed of each joint in the last `memory` samples, for dq (N, n).

    The residual lags: for a while after a reversal it still shows the friction there.
    """
    lowest = scipy_part("ndimage").minimum_filter1d
    # The window ends with the sample.
    slowest: Array = lowest(np.abs(dq), memory, axis=0, mode="nearest", origin=(memory - 1) // 2)
    return slowest


def _rigid(estimate: Estimate) -> tuple[InverseDynamicModel, Array]:
    """The links and motors alone, and their parameters."""
    model = estimate.model
    rigid = InverseDynamicModel(
        robot=model.robot,
        frames=model.frames,
        friction=FrictionTerms(terms=(("im", None),), width=1.0),
    )
    known = dict(zip(model.names, estimate.standard_parameters(), strict=True))
    kept = np.array(
        [0.0 if name.startswith(("Fcm", "Fvm")) else known.get(name, 0.0) for name in rigid.names]
    )
    return rigid, kept
