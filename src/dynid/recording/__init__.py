"""Recordings: every format in, one checked and repaired value out, and the file that keeps it."""

from dynid.recording.opening import (
    AnyRecordLike,
    RecordLike,
    as_list,
    open_any,
    open_record,
    open_several,
    remembered_robot,
)
from dynid.recording.reading import read_record, read_recording
from dynid.recording.record import ExperimentRecord, RecordMetadata, identity
from dynid.recording.repair.pipeline import at_limit, checked_records
from dynid.recording.store import partial_path, recover, write_record
from dynid.recording.stored import (
    LONG,
    AnyRecording,
    StoredRecording,
    fingerprint,
    is_url,
    local_files,
    objects_below,
)
from dynid.recording.writer import RecordWriter

__all__ = [
    "LONG",
    "AnyRecordLike",
    "AnyRecording",
    "ExperimentRecord",
    "RecordLike",
    "RecordMetadata",
    "RecordWriter",
    "StoredRecording",
    "as_list",
    "at_limit",
    "checked_records",
    "fingerprint",
    "identity",
    "is_url",
    "local_files",
    "objects_below",
    "open_any",
    "open_record",
    "open_several",
    "partial_path",
    "read_record",
    "read_recording",
    "recover",
    "remembered_robot",
    "write_record",
]
