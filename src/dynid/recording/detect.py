"""What a file is: by its first bytes, then by its extension."""

from __future__ import annotations

from pathlib import Path

from dynid.core import RecordError
from dynid.recording.opening import first_bytes
from dynid.recording.parquet import is_own
from dynid.recording.segments import MARK
from dynid.recording.text.lines import looks_like_text
from dynid.recording.unpack import packing

FORMATS = (
    "ur-csv",
    "ur-rtde-csv",
    "csv",
    "rosbag",
    "mcap",
    "mat",
    "npz",
    "hdf5",
    "json",
    "parquet",
)
PACKED = "packed"
"""What `content_kind` calls a compressed file."""
_MARKS: tuple[tuple[bytes, str], ...] = (
    (b"PAR1", "parquet"),
    (MARK, "parquet"),
    (b"SQLite format 3\x00", "rosbag"),
    (b"\x89MCAP0\r\n", "mcap"),
    (b"MATLAB 5.0 MAT", "mat"),
    (b"MATLAB 7", "mat"),
    (b"\x93NUMPY", "npz"),
    (b"ARROW1", "arrow"),
    (b"#ROSBAG V2", "rosbag"),
)
_PICKLE = (
    "A pickle runs code when it is loaded, so dynid loads none. In the program that wrote it: "
    "DataFrame.to_parquet or to_csv, or numpy.savez(file, t=t, q=q, tau=tau)."
)
_OTHERS: tuple[tuple[bytes, str, str], ...] = (
    (b"#ROSBAG V", "a ROS 1 bag of before 2010", "Convert it with: rosbag fix FILE NEW"),
    (b"\xd0\xcf\x11\xe0", "an Excel sheet of before 2007", "Save it as .xlsx or CSV."),
    *((bytes([0x80, protocol]), "a Python pickle", _PICKLE) for protocol in range(2, 6)),
    (b"FEA1", "a Feather file of version 1", "Write it again: pyarrow.feather.write_feather."),
    (b"ORC", "an ORC table", "Save it as Parquet: pyarrow.parquet.write_table."),
    (b"\xff\xff\xff\xff", "an Arrow stream", "Save it as Parquet: pyarrow.parquet.write_table."),
)
_EXTENSIONS = {
    ".db3": "rosbag",
    ".mcap": "mcap",
    ".mat": "mat",
    ".npz": "npz",
    ".npy": "npz",
    ".parquet": "parquet",
    ".bag": "rosbag",
}


def content_kind(path: Path) -> str:
    """What a file holds: `csv` for any text, a binary format, or `packed`.

    A Parquet or Arrow table that is none of ours is `arrow`.

    Raises:
        RecordError: It cannot be read, or is none of the formats.
    """
    head = first_bytes(path, 1 << 16)
    if packing(path):
        return PACKED
    if b"\x89HDF" in (head[:4], head[512:516]):
        # MATLAB 7.3 puts 512 bytes of its own before.
        return "hdf5"
    for mark, kind in _MARKS:
        if head.startswith(mark):
            return "arrow" if kind == "parquet" and not is_own(path) else kind
    if head[124:128] in (b"\x00\x01IM", b"\x01\x00MI"):
        return "mat"
    for mark, what, hint in _OTHERS:
        if head.startswith(mark):
            raise RecordError(f"this is {what}", where=path.name, next_step=hint)
    if head.startswith(b"PK\x03\x04"):
        if b".npy" in head or path.suffix == ".npz":
            return "npz"
        raise RecordError(
            "this is a zip archive",
            where=path.name,
            next_step="Unpack it.",
        )
    if _is_binary_ur(head):
        raise RecordError(
            "this is a binary log of UR's record.py",
            where=path.name,
            next_step="Record again without --binary.",
        )
    if path.suffix.lower() in (".pkl", ".pickle"):
        # The oldest pickles have no mark of their own.
        raise RecordError("this is a Python pickle", where=path.name, next_step=_PICKLE)
    if looks_like_text(head):
        return "json" if _is_json(head) else "csv"
    by_name = _EXTENSIONS.get(path.suffix.lower())
    if by_name is not None:
        return by_name
    raise RecordError(
        "this is none of the formats that dynid reads",
        where=path.name,
        limit="UR logs, CSV, Excel, ROS bags, MCAP, MATLAB, HDF5, NumPy, JSON, Parquet",
    )


def _is_json(head: bytes) -> bool:
    """Whether a text begins as an object, or as a list of objects or of numbers."""
    start = head.lstrip(b"\xef\xbb\xbf \t\r\n")[:200]
    return start.startswith(b"{") or b"".join(start.split()).startswith((b"[{", b"[["))


def _is_binary_ur(head: bytes) -> bool:
    lines = head.split(b"\n", 2)
    return lines[0].startswith(b"timestamp ") and len(lines) > 1 and b"DOUBLE" in lines[1][:20]
