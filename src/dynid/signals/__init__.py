"""From a recording to samples: uniform time, filters, derivatives, periods, torques."""

from dynid.signals.filters import (
    NYQUIST_SHARE,
    ORDERS,
    TorqueFilter,
    default_cutoff,
    derivative,
    low_pass,
    motion_bandwidth,
    torque_end,
    was_smoothed,
)
from dynid.signals.parts import LongSignals, StreamGrid, rows_of, survey
from dynid.signals.process import delayed, process, samples_at_stamps, samples_from, uniform_signals
from dynid.signals.resample import UniformSignals, find_period, fold_periods, window
from dynid.signals.samples import ProcessingSettings, Samples, joined, measured_torque

__all__ = [
    "NYQUIST_SHARE",
    "ORDERS",
    "LongSignals",
    "ProcessingSettings",
    "Samples",
    "StreamGrid",
    "TorqueFilter",
    "UniformSignals",
    "default_cutoff",
    "delayed",
    "derivative",
    "find_period",
    "fold_periods",
    "joined",
    "low_pass",
    "measured_torque",
    "motion_bandwidth",
    "process",
    "rows_of",
    "samples_at_stamps",
    "samples_from",
    "survey",
    "torque_end",
    "uniform_signals",
    "was_smoothed",
    "window",
]
