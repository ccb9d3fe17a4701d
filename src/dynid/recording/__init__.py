"""What was measured and where it came from: the record, its file, and every foreign format."""

from dynid.recording.detect import content_kind
from dynid.recording.files import read_recording
from dynid.recording.identity import identity
from dynid.recording.parquet import read_record, write_record
from dynid.recording.record import ExperimentRecord, RecordMetadata
from dynid.recording.segments import partial_path, recover
from dynid.recording.writer import RecordWriter

__all__ = [
    "ExperimentRecord",
    "RecordMetadata",
    "RecordWriter",
    "content_kind",
    "identity",
    "partial_path",
    "read_record",
    "read_recording",
    "recover",
    "write_record",
]
