"""Predict the torques of another record and measure the error.

And whether it was made with another payload than the record that was identified from.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np

from dynid import identification, recording, reduction, regressor, signals
from dynid.core import Array, DynidError, Finding, Mask, Value, plain, read_only, told
from dynid.robot import RobotModel, builtin_names, joint_poses, load_robot
from dynid.validation.comparison import TransferReport, transfer_report, used_rows
from dynid.validation.error_metrics import Metrics, metrics

MOVING_SPEED = 0.02
"""A joint moves above this speed [rad/s or m/s]; below it friction hides the torque."""
MOVING_SHARE = 0.1
"""Or above this share of its velocity limit, where that is less: a lift makes 0.01 m/s."""

LEFT = 0.2
"""Share of the squared error that a payload has to leave at most."""
CERTAIN = 7.0
"""Mass over its standard deviation, from leaving stretches out."""
STRETCHES = 6
RIDGE = 1e-6
POINT = 4
"""Mass and first moments: a load as small as a point leaves less room for other faults."""
FARTHEST_M, FARTHEST = 0.6, 0.5
"""Of its centre from the last joint's frame, or this share of the distances of all joints."""


def another_payload(
    estimate: identification.Estimate, samples: signals.Samples, error: Array
) -> Iterator[Finding]:
    """Whether another mass at the last link explains the errors.

    The error (N, n) is measured minus predicted torques of the record's used rows [N.m or N], of
    which a payload has to explain nearly all.
    """
    model, used = estimate.model, np.arange(samples.count)[samples.rows]
    wanted = list(range(10 * model.robot.joints))[-10:]
    weighted = error.T / estimate.noise[:, None]
    square, cross = np.zeros((STRETCHES, 10, 10)), np.zeros((STRETCHES, 10))
    # Columns of an hour would not fit into memory.
    for k, stretch in enumerate(np.array_split(used, STRETCHES)):
        for first in range(0, len(stretch), regressor.CHUNK):
            part = stretch[first : first + regressor.CHUNK]
            rows = slice(int(part[0]), int(part[-1]) + 1)
            columns, _ = identification.recorded_rows(model, samples, rows, wanted, None)
            columns /= estimate.noise[:, None]
            square[k] += np.einsum("rjt,sjt->rs", columns, columns)
            cross[k] += np.einsum("rjt,jt->r", columns, weighted[:, part - used[0]])
    scale = np.sqrt(np.maximum(np.diag(square.sum(axis=0)), 1e-300))
    square, cross = square / scale / scale[:, None], cross / scale

    def fitted(chosen: list[int], size: int) -> Array:
        matrix = square[chosen].sum(axis=0)[:size, :size] + RIDGE * np.eye(size)
        inverse: Array = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
        return inverse @ cross[chosen].sum(axis=0)[:size]

    everything = list(range(STRETCHES))
    point = fitted(everything, POINT)
    matrix, vector = square.sum(axis=0)[:POINT, :POINT], cross.sum(axis=0)[:POINT]
    before = float(np.square(weighted).sum())
    if before + float(point @ matrix @ point - 2 * point @ vector) > LEFT * before:
        return
    lever = float(np.linalg.norm(point[1:] / scale[1:POINT])) * scale[0]
    # Its inertia counts for the mass: a load far from the joint's frame has much of it.
    masses = [fitted([k for k in everything if k != out], 10)[0] for out in everything]
    spread = float(np.sqrt((STRETCHES - 1) * np.var(masses)) / scale[0])
    mass = float(fitted(everything, 10)[0] / scale[0])
    apart = np.linalg.norm(model.robot.placements[:, :3, 3], axis=1).sum()
    farthest = max(FARTHEST_M, FARTHEST * float(apart))
    if abs(mass) >= CERTAIN * spread and lever <= farthest * abs(point[0]):
        yield Finding(
            "payload",
            f"the predicted record carries {abs(mass):.3g} +- {spread:.2g} kg "
            f"{'more' if mass > 0 else 'less'} at the last link than the identification's",
            joints=(model.robot.joints - 1,),
            value=mass,
            std=spread,
            unit="kg",
            next_step="predict what is carried, or find it with dynid payload",
        )


EXTRAPOLATION = 1.15
"""A record may exceed the identification's speeds, accelerations and ranges of motion by this
factor before it is said."""
OVERLAP_S = 0.1
INTERVAL = 0.9
"""Level of the torque intervals whose coverage is told."""
REST_SHARE = 0.2
"""More joint samples at rest than this are worth a warning."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ValidationResult(Value):
    """Prediction against measurement on one record."""

    t: Array
    """(N) time from the start of the window [s]."""
    dq: Array
    """(N, n) velocities [rad/s or m/s]."""
    moves: Mask
    """(N, n) whether the joint moves."""
    measured: Array
    """(N, n) measured joint torques, not filtered [N.m or N]."""
    predicted: Array
    """(N, n) predicted joint torques [N.m or N]."""
    metrics: Metrics
    """Errors of all samples, by joint."""
    moving: Metrics
    """Only samples where the joint moves."""
    at_rest: Metrics
    """Only samples where the joint stands."""
    residual_autocorrelation: Array
    """(n) of the error at one sample."""
    warnings: tuple[Finding, ...]
    """Findings of the comparison."""
    transfer: TransferReport | None = None
    """The error split by cause, where another record was predicted."""
    covered: Array | None = None
    """(n) share of its torques within their intervals of `INTERVAL`, where another record was
    predicted by an estimate that knows intervals."""

    def to_json(self) -> dict[str, Any]:
        """METRICS, the same under `moving` and `at_rest`, and the warnings."""
        covered = {"level": INTERVAL, "covered": plain(self.covered)}
        return {
            **self.metrics.to_json(),
            "moving": self.moving.to_json(),
            "at_rest": self.at_rest.to_json(),
            "residual_autocorrelation": [float(x) for x in self.residual_autocorrelation],
            **told(self.warnings),
            **({} if self.transfer is None else {"transfer": self.transfer.to_json()}),
            **({} if self.covered is None else {"interval": covered}),
        }


def validate(
    estimate: identification.EstimateLike,
    record: recording.RecordLike,
    *,
    start_s: float | None = None,
    stop_s: float | None = None,
) -> ValidationResult:
    """Compare predicted and measured torques, processed as the identification record was.

    Torques are compared as they were recorded, at the record's own stamps. The cut-off is raised
    where this record's motion asks for more: one that suits slow sines would smear the starts and
    stops of way points. A window that was identified from, and a record of another robot, are
    said in the warnings.

    Args:
        estimate: The estimate or its file; its settings are used, its delays as they are.
        record: The record to predict, or its file in any format that is read without options.
        start_s: Start of the window, from the record's start [s].
        stop_s: End of the window [s].

    Raises:
        InputError: The record does not fit the robot, or the window is empty.
    """
    estimate = identification.open_estimate(estimate)
    robot = estimate.model.robot
    (record,) = recording.checked_records([recording.open_record(record, robot)])
    settings = _settings(estimate, record, start_s, stop_s)
    uniform = signals.uniform_signals(record, robot, settings)
    own = max(settings.cutoff_hz or 0.0, signals.default_cutoff(uniform.q, uniform.rate_hz))
    settings = replace(settings, cutoff_hz=own)
    samples = signals.samples_at_stamps(record, robot, settings)
    result = validate_samples(estimate, samples)
    error = result.measured - result.predicted
    found = (
        *another_payload(estimate, samples, error),
        *_seen_before(estimate, record, start_s, stop_s),
        *record_findings(robot, record),
        *result.warnings,
    )
    split = transfer_report(estimate, samples, error)
    covered = None
    if estimate.assessment is not None:
        state = identification.motion_state(estimate.model, samples)
        width = estimate.half_width(samples.q, samples.dq, samples.ddq, state, level=INTERVAL)
        covered = read_only((np.abs(error) <= width[samples.rows]).mean(axis=0))
    return replace(result, warnings=found, transfer=split, covered=covered)


def reproduce(
    estimate: identification.Estimate, record: recording.ExperimentRecord
) -> ValidationResult:
    """As `validate`, for the window that was identified from: the training errors."""
    start_s, stop_s = estimate.settings.start_s, estimate.settings.stop_s
    return validate_samples(estimate, samples_of(estimate, record, start_s=start_s, stop_s=stop_s))


def samples_of(
    estimate: identification.Estimate,
    record: recording.ExperimentRecord,
    *,
    start_s: float | None = None,
    stop_s: float | None = None,
) -> signals.Samples:
    """A record's samples at its own stamps, processed as an estimate's were, nothing averaged."""
    settings = _settings(estimate, record, start_s, stop_s)
    return signals.samples_at_stamps(record, estimate.model.robot, settings)


def _settings(
    estimate: identification.Estimate,
    record: recording.ExperimentRecord,
    start_s: float | None,
    stop_s: float | None,
) -> signals.ProcessingSettings:
    settings = replace(
        estimate.settings, start_s=start_s, stop_s=stop_s, decimate=False, period_s=None
    )
    if "qd" not in record.signals:
        settings = replace(settings, velocity="position")
    robot = estimate.model.robot
    if settings.torque_filter and not signals.was_smoothed(
        signals.uniform_signals(record, robot, settings)
    ):
        # This record shows what the other had lost.
        settings = replace(settings, torque_filter=None)
    return settings


def _seen_before(
    estimate: identification.Estimate,
    record: recording.ExperimentRecord,
    start_s: float | None,
    stop_s: float | None,
) -> Iterator[Finding]:
    own, end = recording.identity(record), record.duration_s if stop_s is None else stop_s
    common = [
        (max(start_s or 0.0, start), min(end, stop, record.duration_s))
        for name, start, stop in used_rows(estimate)
        if name == own
    ]
    first, last = max(common, key=lambda window: window[1] - window[0], default=(0.0, 0.0))
    if last - first >= OVERLAP_S:
        yield Finding(
            "same_record",
            f"{first:.1f} to {last:.1f} s of the validation window are part of the record that was "
            "identified from: the error is not that of another motion",
        )


def record_findings(robot: RobotModel, *records: recording.AnyRecording) -> tuple[Finding, ...]:
    """What recordings tell of themselves, once each: another robot; what was found in reading."""
    found = [(*_another_robot(robot, one.metadata), *one.problems) for one in records]
    return tuple(dict.fromkeys(chain.from_iterable(found)))


def _another_robot(robot: RobotModel, record: recording.RecordMetadata) -> Iterator[Finding]:
    """Whether a record says that it is of another type of robot.

    Names of built-in robots tell; of others the distances of their axes, where the robot can be
    read.
    """
    if record.robot is None or record.robot == robot.name:
        return
    if not {record.robot, robot.name} <= set(builtin_names()):
        try:
            theirs = _axes_apart(load_robot(record.robot, collision=False))
        except DynidError:
            return
        ours = _axes_apart(robot)
        if len(ours) == len(theirs) and np.allclose(ours, theirs, rtol=0.0, atol=SAME_TYPE_M):
            return
    yield Finding("another_robot", f"the record is of robot {record.robot}, not of {robot.name}")


PARALLEL = 0.01
"""Sine of the angle between axes that are taken as parallel."""
SAME_TYPE_M = 0.01
"""Calibration moves the axes of two robots of a type by less."""


def _axes_apart(robot: RobotModel) -> Array:
    """(n - 1) distances of successive joint axes, in any pose [m]; slides have no place: 0."""
    poses = joint_poses(robot, np.zeros(robot.joints))
    axes = np.einsum("kij,kj->ki", poses[:, :3, :3], robot.axes)
    way, normal = np.diff(poses[:, :3, 3], axis=0), np.cross(axes[:-1], axes[1:])
    size: Array = np.linalg.norm(normal, axis=1)
    apart: Array = np.abs((way * normal).sum(axis=1)) / np.maximum(size, PARALLEL)
    beside: Array = np.linalg.norm(np.cross(way, axes[:-1]), axis=1)
    apart = np.where(size < PARALLEL, beside, apart)
    slides = np.array(robot.prismatic)
    apart[slides[1:] | slides[:-1]] = 0.0
    return apart


def validate_samples(
    estimate: identification.Estimate, samples: signals.Samples
) -> ValidationResult:
    """Compare predicted and measured torques of samples; see `validate`."""
    state = identification.motion_state(estimate.model, samples)
    model = estimate.predict(samples.q, samples.dq, samples.ddq, state)
    rows = samples.rows
    predicted: Array = samples.as_recorded(model.T).T
    if samples.late_s is not None:
        own, predicted = predicted, np.empty_like(predicted)
        for j, late in enumerate(samples.late_s.T):
            predicted[:, j] = np.interp(samples.t + late, samples.t, own[:, j])
    predicted = read_only(predicted[rows])
    measured, dq = samples.tau[rows], samples.dq[rows]
    limits, slides = estimate.model.robot.limits, estimate.model.robot.prismatic
    moving = np.abs(dq) > np.fmin(MOVING_SPEED, MOVING_SHARE * limits.velocity)
    moving.setflags(write=False)
    return ValidationResult(
        t=samples.t[rows],
        dq=dq,
        moves=moving,
        measured=measured,
        predicted=predicted,
        metrics=metrics(measured, predicted, prismatic=slides),
        moving=metrics(measured, predicted, moving, slides),
        at_rest=metrics(measured, predicted, ~moving, slides),
        residual_autocorrelation=identification.autocorrelation((measured - predicted).T, 1),
        warnings=(*_extrapolated(estimate, samples), *_at_rest(estimate, moving)),
    )


def _extrapolated(estimate: identification.Estimate, samples: signals.Samples) -> Iterator[Finding]:
    known, model = estimate.motion, estimate.model
    names = model.robot.joint_names
    units = ["m" if slides else "rad" for slides in model.robot.prismatic]
    found: list[str] = []
    for values, limit, what, per in (
        (samples.dq, known.speed, "speed", "/s"),
        (samples.ddq, known.acceleration, "acceleration", "/s^2"),
    ):
        reached = np.percentile(np.abs(values), 99.5, axis=0)
        for j in np.flatnonzero(reached > EXTRAPOLATION * limit):
            text = f"{names[j]} {what} {reached[j]:.2g} against {limit[j]:.2g} {units[j]}{per}"
            found.append(text)
    margin = (EXTRAPOLATION - 1) * (known.upper - known.lower)
    low, high = np.percentile(samples.q, [0.25, 99.75], axis=0)
    q, dq, ddq = reduction.random_states(model.robot, 3, 0)
    w = model.observation_matrix(q, dq, ddq)
    for j in np.flatnonzero((low < known.lower - margin) | (high > known.upper + margin)):
        # Where a joint stands says nothing if it turns about gravity and nothing carries it.
        moved = q.copy()
        moved[:, j] += 0.5
        change = model.observation_matrix(moved, dq, ddq) - w
        if np.abs(change).max() > SAME_TORQUE * np.abs(w).max():
            found.append(
                f"{names[j]} position {low[j]:.2g} to {high[j]:.2g} against "
                f"{known.lower[j]:.2g} to {known.upper[j]:.2g} {units[j]}"
            )
    if found:
        text = "this record exceeds the range of the identification: " + "; ".join(found[:4])
        yield Finding("other_motion", text)


SAME_TORQUE = 1e-9
"""Of the largest: columns that differ by less are the same."""


def _at_rest(estimate: identification.Estimate, moving: Mask) -> Iterator[Finding]:
    share = 1 - moving.mean(axis=0)
    worst = int(np.argmax(share))
    if share.mean() > REST_SHARE:
        yield Finding(
            "at_rest",
            f"{100 * share.mean():.0f} % of the joint samples are at rest (most: "
            f"{estimate.model.robot.joint_names[worst]}, {100 * share[worst]:.0f} %): friction "
            "makes the torque ambiguous there: use the metrics of moving samples",
        )


POSES, PLACES = 40, 41
"""Of the other joints, and of the joint that an uncertainty is given over."""
MOST_POSES = 0.9
"""Share of the poses whose intervals are no wider."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseUncertainty:
    """How wide torque intervals of a joint are over its position."""

    position: Array
    """(K) positions of the joint [rad or m]."""
    anywhere: Array
    """(K) half widths of 90 % intervals, the other joints within their limits [N.m or N]."""
    near: Array
    """(K) the same, the other joints within the ranges of the recording."""


def uncertainty_over_poses(estimate: identification.Estimate) -> tuple[PoseUncertainty, ...]:
    """Where a model is not to be used, joint by joint, before any second recording exists.

    Half widths that nine of ten random poses of the other joints do not exceed, at half of the
    recorded speeds and without acceleration. Joints without limits stand within a turn.

    Raises:
        InputError: The estimate knows no intervals.
    """
    robot, seen = estimate.model.robot, estimate.motion
    far = np.maximum(np.abs(seen.lower), np.abs(seen.upper))
    reach: Array = np.where(robot.prismatic, far, np.pi)
    lower: Array = np.fmin(np.fmax(robot.limits.lower, -reach), seen.lower)
    upper: Array = np.fmax(np.fmin(robot.limits.upper, reach), seen.upper)
    share = np.random.default_rng(0).random((POSES, robot.joints))
    found: list[PoseUncertainty] = []
    for j in range(robot.joints):
        own: Array = np.linspace(float(lower[j]), float(upper[j]), PLACES)
        widths: list[Array] = []
        for low, high in ((lower, upper), (seen.lower, seen.upper)):
            q = np.repeat(low + share * (high - low), PLACES, axis=0)
            q[:, j] = np.tile(own, POSES)
            half = estimate.half_width(q, np.broadcast_to(seen.speed / 2, q.shape), 0 * q)
            widths.append(np.quantile(half[:, j].reshape(POSES, PLACES), MOST_POSES, axis=0))
        found.append(PoseUncertainty(position=own, anywhere=widths[0], near=widths[1]))
    return tuple(found)
