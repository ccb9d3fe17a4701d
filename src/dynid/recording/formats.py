"""What a file is: by its first bytes; and what is packed in it."""

import re
import tempfile
import zipfile
from collections.abc import Generator, Sequence
from contextlib import contextmanager, suppress
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import IO, Any

from dynid.core import RecordError, require
from dynid.recording import content, dialect, store

_MARKS = {b"\x1f\x8b": "gzip", b"BZh": "bzip2", b"\xfd7zXZ\x00": "xz", b"\x28\xb5\x2f\xfd": "zstd"}
_COMPRESSED = (".gz", ".bz2", ".xz", ".zst", ".zstd", ".zip")
_SHEETS = (".xlsx", ".xlsm", ".xls", ".ods")
_BLOCK = 1 << 20


def recording_name(path: str | Path) -> str:
    """The name of a recording's file without its endings: `log` for `log.csv.gz`."""
    path = Path(path)
    return Path(path.stem).stem if path.suffix.lower() in _COMPRESSED else path.stem


def _packing(path: Path) -> str:
    """How a file is packed: gzip, bzip2, xz, zstd, zip or workbook; empty for not at all."""
    head = content.first_bytes(path, 1 << 12)
    for mark, kind in _MARKS.items():
        if head.startswith(mark):
            return kind
    if path.suffix.lower() in _SHEETS or head.startswith(b"\xd0\xcf\x11\xe0"):
        return "workbook" if head.startswith((b"PK", b"\xd0\xcf")) else ""
    if not head.startswith(b"PK\x03\x04") or b".npy" in head[:200]:
        return ""
    with suppress(zipfile.BadZipFile, OSError, ValueError), zipfile.ZipFile(path) as archive:
        if {"xl/workbook.xml", "content.xml"} & set(archive.namelist()):
            return "workbook"
    return "zip" if path.suffix.lower() == ".zip" else ""


@contextmanager
def unpacked(files: Sequence[Path], budget: content.Budget) -> Generator[list[Path]]:
    """The files, each compressed one in place of which its content stands for a while.

    Raises:
        RecordError: Damaged, too large, or a zip archive of several files.
        MissingExtraError: zstd without its package.
    """
    kinds = ["" if file.is_dir() else _packing(file) for file in files]
    if not any(kinds):
        yield list(files)
        return
    with tempfile.TemporaryDirectory(prefix="dynid-") as folder:
        room = budget.require_space(folder)
        plain = list(files)
        for number, (file, kind) in enumerate(zip(files, kinds, strict=True)):
            if kind:
                # Messages name the file that the user gave.
                plain[number] = Path(folder) / str(number) / file.name
                plain[number].parent.mkdir()
                _unpack(file, kind, plain[number], room)
        yield plain


def _unpack(file: Path, kind: str, target: Path, room: int) -> None:
    if kind == "workbook":
        _write_sheet(file, target)
        return
    step = "Copy it again, or unpack what is left of it and import that."
    with (
        content.refused(f"the {kind} file is damaged", step),
        _opened(file, kind) as source,
        target.open("wb") as sink,
    ):
        written = 0
        while block := source.read(_BLOCK):
            written += len(block)
            if written > room:
                raise RecordError(
                    "the file is too large when unpacked",
                    where=file.name,
                    limit=f"{room >> 20} MB for a file of this size, or what the disk has free",
                    next_step="Unpack it, and import what is inside.",
                )
            sink.write(block)
        if written == 0:
            raise RecordError("the compressed file is empty")


_FEWEST_ROWS = 3
_AS_CSV = "Save the sheet as CSV."


def _write_sheet(path: Path, target: Path) -> None:
    """Write the only sheet of numbers of a workbook as text, with tabs between cells.

    Raises:
        RecordError: Damaged, or none or several sheets of numbers.
        MissingExtraError: Without the `excel` extra.
    """
    library = require("python_calamine", "excel")
    with content.refused("the workbook is damaged", _AS_CSV):
        book = library.CalamineWorkbook.from_path(str(path))
        names: list[str] = book.sheet_names
        full = [sheet for sheet in map(book.get_sheet_by_name, names) if _has_numbers(sheet)]
        if len(full) != 1:
            what = f"the workbook has {len(full) or 'no'} sheets of numbers"
            raise RecordError(what, value=names[:20], next_step=_AS_CSV)
        with target.open("w", encoding="utf-8") as sink:
            for row in full[0].iter_rows():
                sink.write("\t".join(map(_cell, row)).rstrip("\t") + "\n")


def _has_numbers(sheet: Any) -> bool:
    """Whether at least some rows are mostly numbers."""
    found = 0
    for row in sheet.iter_rows():
        numbers = sum(isinstance(cell, (int, float)) for cell in row)
        found += numbers > 1 and 2 * numbers > sum(cell != "" for cell in row)
        if found >= _FEWEST_ROWS:
            return True
    return False


def _cell(value: Any) -> str:
    if isinstance(value, (datetime, time)):
        return value.isoformat()
    if isinstance(value, date):
        # Midnight is no less a stamp than those after it.
        return f"{value}T00:00:00"
    if isinstance(value, timedelta):
        return repr(value.total_seconds())
    text = " ".join(str(value).split())
    # `#DIV/0!` is no value; `#t` is a name.
    return "" if re.fullmatch(r"#[A-Z/0_]+[!?]|#N/A|#GETTING_DATA", text) else text


_ENCRYPTED = 1
"""Flag of a member of a zip archive."""


def _opened(file: Path, kind: str) -> IO[bytes]:
    if kind == "zstd":
        return content.zstd_module().open(file, "rb")
    if kind != "zip":
        return require({"gzip": "gzip", "bzip2": "bz2", "xz": "lzma"}[kind]).open(file)
    archive = zipfile.ZipFile(file)
    # macOS adds a folder of its own notes on each file.
    files = [item for item in archive.infolist() if not item.is_dir()]
    members = [item for item in files if "__MACOSX/" not in item.filename]
    step = f"Unpack it first: unzip {file.name}"
    if len(members) != 1:
        raise RecordError(
            "the zip archive holds several files",
            where=file.name,
            value=[item.filename for item in members][:10],
            next_step=step,
        )
    if members[0].flag_bits & _ENCRYPTED:
        raise RecordError("the zip archive has a password", where=file.name, next_step=step)
    return archive.open(members[0])


FORMATS = (
    *("ur-csv", "ur-rtde-csv", "csv"),
    *("rosbag", "mcap", "mat", "npz", "hdf5", "json", "parquet"),
)
PACKED = "packed"
"""What `content_kind` calls a compressed file."""
_DETECT_MARKS: tuple[tuple[bytes, str], ...] = (
    (b"PAR1", "parquet"),
    (store.MARK, "parquet"),
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
    *((bytes([0x80, protocol]), "a Python pickle", _PICKLE) for protocol in range(2, 6)),
    (b"ORC", "an ORC table", "Save it as Parquet: pyarrow.parquet.write_table."),
    (b"\xff\xff\xff\xff", "an Arrow stream", "Save it as Parquet: pyarrow.parquet.write_table."),
)
_UR_BINARY = re.compile(rb"timestamp [^\n]*\n[^\n]{0,14}DOUBLE")


def content_kind(path: Path) -> str:
    """What a file holds: `csv` for any text, a binary format, or `packed`.

    A Parquet or Arrow table that is none of ours is `arrow`.

    Raises:
        RecordError: It cannot be read, or is none of the formats.
    """
    head = content.first_bytes(path, 1 << 16)
    if _packing(path):
        return PACKED
    if b"\x89HDF" in (head[:4], head[512:516]):
        # MATLAB 7.3 puts 512 bytes of its own before.
        return "hdf5"
    for mark, kind in _DETECT_MARKS:
        if head.startswith(mark):
            return "arrow" if kind == "parquet" and not store.is_own(path) else kind
    if head[124:128] in (b"\x00\x01IM", b"\x01\x00MI"):
        return "mat"
    for mark, what, hint in _OTHERS:
        if head.startswith(mark):
            raise RecordError(f"this is {what}", where=path.name, next_step=hint)
    if head.startswith(b"PK\x03\x04"):
        if b".npy" in head or path.suffix == ".npz":
            return "npz"
        raise RecordError("this is a zip archive", where=path.name, next_step="Unpack it.")
    if _UR_BINARY.match(head):
        step = "Record again without --binary."
        raise RecordError("this is a binary log of UR's record.py", where=path.name, next_step=step)
    if path.suffix.lower() in (".pkl", ".pickle"):
        # The oldest pickles have no mark of their own.
        raise RecordError("this is a Python pickle", where=path.name, next_step=_PICKLE)
    if dialect.looks_like_text(head):
        start = b"".join(head.removeprefix(b"\xef\xbb\xbf")[:200].split())
        return "json" if start.startswith((b"{", b"[{", b"[[")) else "csv"
    raise RecordError(
        "this is none of the formats that dynid reads, or its beginning is damaged",
        where=path.name,
        limit="UR logs, CSV, Excel, ROS bags, MCAP, MATLAB, HDF5, NumPy, JSON, Parquet",
    )
