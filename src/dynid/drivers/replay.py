"""A recording played again: the driver for tests of what comes after a run."""

from __future__ import annotations

import math
from dataclasses import replace
from threading import Event

import numpy as np

from dynid.core.errors import DynidError, InputError
from dynid.core.progress import Progress
from dynid.drivers.driver import Driver, Execution, Outcome, Recorder, Source
from dynid.drivers.watchdog import INTERRUPTED, Abort, Cycle, Watchdog
from dynid.recording.record import ExperimentRecord

_LIVE = ("robot_mode", "safety_mode", "runtime_state", "speed_scaling", "target_speed_fraction")


class ReplayDriver(Driver):
    """Hands out the samples of a recording, past the same watchdog as a robot's.

    Args:
        record: The recording; its samples stand for the set points in order, unless a channel
            `index` says otherwise, and its mode channels are looked at where it has them.
    """

    def __init__(self, record: ExperimentRecord) -> None:
        self.record = record

    @property
    def source(self) -> Source:
        """See `Driver.source`."""
        return Source(
            quantities=tuple(self.record.signals),
            channels=tuple(self.record.channels),
            format="replay",
            origin=f"replay of {self.record.metadata.origin or 'a recording'}",
        )

    def execute(
        self,
        execution: Execution,
        recorder: Recorder | None,
        *,
        cancel: Event | None = None,
        progress: Progress | None = None,
    ) -> Outcome:
        """See `Driver.execute`; the end of the recording counts as a lost connection."""
        record, joints = self.record, len(execution.limits.lower)
        if record.joints != joints:
            raise InputError("joints of the recording", value=record.joints, limit=joints)
        watchdog = Watchdog(execution.limits, execution.rate_hz, execution.total)
        samples, abort = 0, None
        for k in range(record.samples):
            cycle = self._cycle(k)
            abort = watchdog.see(cycle)
            try:
                if recorder is not None and cycle.index >= execution.first_recorded:
                    signals = {name: value[k] for name, value in record.signals.items()}
                    channels = {name: float(value[k]) for name, value in record.channels.items()}
                    recorder.append(float(record.t[k]), signals, channels)
                    samples += 1
            except DynidError as error:
                abort = abort or Abort("recording", str(error))
            if abort is None and cancel is not None and cancel.is_set():
                abort = INTERRUPTED
            if abort is not None or watchdog.finished:
                break
            if progress is not None:
                progress("replay", (k + 1) / execution.total)
        else:
            abort = Abort("connection", f"the recording ended after {record.samples} samples")
        return Outcome(
            samples=samples, periods=samples // execution.cycles, gaps=watchdog.gaps, abort=abort
        )

    def _cycle(self, k: int) -> Cycle:
        signals, channels = self.record.signals, self.record.channels
        q = signals["q"][k]
        cycle = Cycle(
            timestamp=float(self.record.t[k]),
            index=int(channels["index"][k]) if "index" in channels else k,
            q=q,
            qd=signals["qd"][k] if "qd" in signals else np.zeros_like(q),
            target_q=signals["target_q"][k] if "target_q" in signals else q,
        )
        seen = {name: float(channels[name][k]) for name in _LIVE if name in channels}
        seen = {name: value for name, value in seen.items() if math.isfinite(value)}
        if "target_speed_fraction" in seen:
            seen["speed_fraction"] = seen.pop("target_speed_fraction")
        whole = {name: int(seen[name]) for name in _LIVE[:3] if name in seen}
        parts = {name: value for name, value in seen.items() if name not in whole}
        return replace(cycle, **whole, **parts)
