"""Whether two recordings are of the same run."""

from __future__ import annotations

import hashlib

from dynid.recording.record import ExperimentRecord


def identity(record: ExperimentRecord) -> str:
    """The hash of the file a record was read from, or of its times, positions and torques."""
    if record.metadata.input_hash:
        return record.metadata.input_hash
    digest = hashlib.sha256(record.t.tobytes())
    # Simulated arms repeat a motion to the last bit; what they carry shows in the torques.
    for name in ("q", "effort", "current"):
        if name in record.signals:
            digest.update(record.signals[name].tobytes())
    return digest.hexdigest()
