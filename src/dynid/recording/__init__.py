"""Recordings: every format in, one checked and repaired value out, and the file that keeps it."""

from dynid.recording.columns import parse_columns
from dynid.recording.formats import content_kind
from dynid.recording.headers import match_headers
from dynid.recording.messages import MessageDecoder, MessageError
from dynid.recording.names import parse_name, says_degrees
from dynid.recording.reading import (
    AnyRecordLike,
    RecordLike,
    as_list,
    open_any,
    open_record,
    open_several,
    read_record,
    read_recording,
    remembered_robot,
)
from dynid.recording.record import JOINT_QUANTITIES, ExperimentRecord, RecordMetadata, identity
from dynid.recording.repair.pipeline import (
    RepairSettings,
    at_limit,
    check_channels,
    checked_records,
    repair,
)
from dynid.recording.store import partial_path, recover, write_record
from dynid.recording.stored import (
    LONG,
    AnyRecording,
    StoredRecording,
    fingerprint,
    is_url,
    local_files,
    objects_below,
    open_stored,
)
from dynid.recording.table import RawTable
from dynid.recording.units import factor_of
from dynid.recording.writer import RecordWriter

__all__ = [
    "JOINT_QUANTITIES",
    "LONG",
    "AnyRecordLike",
    "AnyRecording",
    "ExperimentRecord",
    "MessageDecoder",
    "MessageError",
    "RawTable",
    "RecordLike",
    "RecordMetadata",
    "RecordWriter",
    "RepairSettings",
    "StoredRecording",
    "as_list",
    "at_limit",
    "check_channels",
    "checked_records",
    "content_kind",
    "factor_of",
    "fingerprint",
    "identity",
    "is_url",
    "local_files",
    "match_headers",
    "objects_below",
    "open_any",
    "open_record",
    "open_several",
    "open_stored",
    "parse_columns",
    "parse_name",
    "partial_path",
    "read_record",
    "read_recording",
    "recover",
    "remembered_robot",
    "repair",
    "says_degrees",
    "write_record",
]
