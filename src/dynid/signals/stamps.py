"""Samples where the record has them: nothing is judged on values that were interpolated."""

from __future__ import annotations

import numpy as np

from dynid.core.arrays import Array
from dynid.recording.record import ExperimentRecord
from dynid.robot.model import RobotModel
from dynid.signals.process import samples_from, uniform_signals
from dynid.signals.resample import linear, window
from dynid.signals.samples import ProcessingSettings, Samples
from dynid.signals.torque import measured_torque

SAME_TIME = 1e-3
"""Share of a step by which a stamp may differ from its place on the grid."""


def samples_at_stamps(
    record: ExperimentRecord, robot: RobotModel, settings: ProcessingSettings
) -> Samples:
    """Motion from the uniform grid, torque as recorded, at the record's own stamps.

    A record that is uniform already gives the samples of `process`. For a jittered one the grid
    holds more points than were recorded, and their torques are averages of neighbours: both
    would flatter a prediction error.

    Raises:
        InputError: See `process`.
    """
    signals = uniform_signals(record, robot, settings)
    samples = samples_from(signals, settings)
    part = window(record.t, settings.start_s, settings.stop_s)
    stamps = record.t[part]
    step = 1.0 / signals.rate_hz
    if len(stamps) == len(signals.t) and np.abs(stamps - signals.t).max() < SAME_TIME * step:
        return samples
    t: Array = stamps - float(stamps[0])
    torque = measured_torque(record, robot)[part]
    after = np.clip(np.searchsorted(samples.t, t), 1, samples.count - 1)
    inside = (t >= samples.t[0]) & (t <= samples.t[-1])
    # Between kept grid points that are no neighbours lies a gap.
    inside &= samples.t[after] - samples.t[after - 1] < 1.5 * step
    kept = t[inside]
    tau = np.empty((len(kept), robot.joints))
    for j, delay in enumerate(settings.delays_s or (0.0,) * robot.joints):
        tau[:, j] = np.interp(kept + delay, t, torque[:, j])
    return Samples(
        t=kept,
        q=linear(samples.t, samples.q, kept),
        dq=linear(samples.t, samples.dq, kept),
        ddq=linear(samples.t, samples.ddq, kept),
        tau=tau,
        rate_hz=samples.rate_hz,
        cutoff_hz=samples.cutoff_hz,
        torque_filter=samples.torque_filter,
    )
