"""Whether two recordings are of the same run."""

from __future__ import annotations

import hashlib

from dynid.recording.record import ExperimentRecord


def identity(record: ExperimentRecord) -> str:
    """The hash of the file a record was read from, or of its times and positions."""
    if record.metadata.input_hash:
        return record.metadata.input_hash
    digest = hashlib.sha256(record.t.tobytes())
    digest.update(record.signals["q"].tobytes())
    return digest.hexdigest()
