"""MATLAB files of version 5 to 7: the arrays of numbers in them, nested structs too.

Written here because SciPy's reader crashes the interpreter on some damaged files (1 of 600 random
mutations): every size is checked against the bytes there are.
"""

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dynid.core import Array, RecordError
from dynid.recording.content import Budget, all_bytes
from dynid.recording.table import RawTable, ReadOptions, plain
from dynid.recording.variables import table_of

HEADER = 128
"""Bytes before the first variable; the last two tell the byte order."""
_MATRIX, _COMPRESSED = 14, 15
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8",
          13: "u8"}  # fmt: skip
_CELL, _STRUCT, _OBJECT, _OPAQUE = 1, 2, 3, 17
_NUMERIC = range(6, 16)
_MAX_DEPTH = 12
_MAX_ELEMENTS = 200
_MAX_VARIABLES = 5000
_MAX_INFLATED = 1 << 30


class MatlabError(ValueError):
    """A variable whose bytes make no sense."""


@dataclass(slots=True)
class Contents:
    """What a file holds."""

    arrays: dict[str, Array] = field(default_factory=dict[str, Array])
    """Path (`rec.act_pos`, `run(2).q`) to array of one or two axes."""
    damaged: list[str] = field(default_factory=list[str])
    """What is wrong with each variable that could not be read."""
    objects: int = 0
    """Variables of MATLAB's own classes (timeseries, table), which only MATLAB can read."""
    cut: bool = False
    """The file ends in the middle of a variable."""


def _byte_order(data: bytes) -> str | None:
    """`<` or `>` for a MATLAB 5 file, None for anything else."""
    return {b"IM": "<", b"MI": ">"}.get(data[126:128])


def _parse_matlab(data: bytes, order: str) -> Contents:
    """Read all arrays of numbers; variables that make no sense are left out and named."""
    contents = Contents()
    offset = HEADER
    while offset + 8 <= len(data) and len(contents.arrays) < _MAX_VARIABLES:
        kind, size = struct.unpack_from(order + "II", data, offset)
        start, offset = offset + 8, offset + 8 + size
        if offset > len(data):
            contents.cut = True
            break
        try:
            body = data[start:offset]
            if kind == _COMPRESSED:
                kind, body = _inflate(body, order)
            if kind != _MATRIX:
                raise MatlabError(f"unknown element {kind} at byte {start - 8}")
            _matrix(body, order, None, contents, 0)
        except (MatlabError, struct.error) as error:
            contents.damaged.append(str(error))
    return contents


def _inflate(body: bytes, order: str) -> tuple[int, bytes]:
    decompressor = zlib.decompressobj()
    try:
        data = decompressor.decompress(body, _MAX_INFLATED)
    except zlib.error as error:
        raise MatlabError("damaged compression") from error
    # Only at its end is the checksum of the stream compared.
    if not decompressor.eof:
        raise MatlabError("compressed data are cut off")
    kind, size = struct.unpack_from(order + "II", data)
    if size > len(data) - 8:
        raise MatlabError("a variable is larger than its bytes")
    return kind, data[8 : 8 + size]


def _elements(body: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Type and bytes of each element within a matrix."""
    offset = 0
    while offset + 8 <= len(body):
        kind, size = struct.unpack_from(order + "II", body, offset)
        if kind >> 16:
            # Up to four bytes stand in the tag itself.
            size, kind = kind >> 16, kind & 0xFFFF
            if size > 4:
                raise MatlabError("damaged tag")
            yield kind, body[offset + 4 : offset + 4 + size]
            offset += 8
            continue
        if offset + 8 + size > len(body):
            raise MatlabError("an element is larger than its variable")
        yield kind, body[offset + 8 : offset + 8 + size]
        offset += 8 + size + (-size) % 8


def _matrix(body: bytes, order: str, path: str | None, into: Contents, depth: int) -> None:
    """Collect a variable under `path`, or under its own name."""
    if not body or depth > _MAX_DEPTH or len(into.arrays) >= _MAX_VARIABLES:
        return
    parts = _elements(body, order)
    _, flags = _next(parts)
    (kind,) = struct.unpack_from(order + "I", flags)
    kind &= 0xFF
    into.objects += kind == _OPAQUE
    if kind not in _NUMERIC and kind not in (_CELL, _STRUCT, _OBJECT):
        # Text, sparse matrices, functions and tables hold no recording.
        return
    _, raw = _next(parts)
    dimensions = struct.unpack(f"{order}{len(raw) // 4}i", raw[: len(raw) // 4 * 4])
    _, name = _next(parts)
    path = _plain(name) if path is None else path
    if min(dimensions, default=0) < 0 or not 2 <= len(dimensions) <= 32:
        raise MatlabError(f"{path} has impossible dimensions")
    count = math.prod(dimensions)
    if kind in _NUMERIC:
        # Simulink writes vectors over time as (n, 1, N).
        shape = dimensions if len(dimensions) == 2 else tuple(k for k in dimensions if k != 1)
        if len(shape) <= 2:
            into.arrays[path] = _numbers(parts, order, path, shape, count)
        return
    if kind == _CELL:
        _cells(parts, order, path, count, into, depth)
        return
    if kind == _OBJECT:
        _next(parts)
    _, width = _next(parts)
    (width,) = struct.unpack_from(order + "i", width)
    _, names = _next(parts)
    if not 0 < width <= 256:
        raise MatlabError(f"{path} has impossible field names")
    fields = [_plain(names[k : k + width]) for k in range(0, len(names), width)]
    for element in range(min(count, _MAX_ELEMENTS)):
        stem = path if count == 1 else f"{path}({element + 1})"
        for item in fields:
            inner, content = _next(parts)
            if inner != _MATRIX:
                raise MatlabError(f"{stem}.{item} is no array")
            _matrix(content, order, f"{stem}.{item}", into, depth + 1)


def _cells(
    parts: Iterator[tuple[int, bytes]],
    order: str,
    path: str,
    count: int,
    into: Contents,
    depth: int,
) -> None:
    """Collect what the cells hold; vectors as long as each other are the columns of a matrix."""
    own = Contents()
    for element in range(min(count, _MAX_ELEMENTS)):
        _matrix(_next(parts)[1], order, f"{path}({element + 1})", own, depth + 1)
    columns = list(own.arrays.values())
    alike = len(columns) == count > 1 and {x.shape for x in columns} == {columns[0].shape}
    if alike and columns[0].ndim == 1 and columns[0].size > count:
        into.arrays[path] = np.column_stack(columns)
        return
    into.arrays.update(own.arrays)
    into.objects += own.objects


def _numbers(
    parts: Iterator[tuple[int, bytes]], order: str, path: str, shape: tuple[int, ...], count: int
) -> Array:
    kind, raw = _next(parts)
    if kind not in _TYPES:
        raise MatlabError(f"{path} holds an unknown type of number")
    stored = np.dtype(order + _TYPES[kind])
    if len(raw) != count * stored.itemsize:
        raise MatlabError(f"{path} does not fill its dimensions")
    # Damaged bytes may be signalling NaNs, whose conversion numpy would warn of.
    with np.errstate(all="ignore"):
        values = np.frombuffer(raw, dtype=stored).astype(np.float64)
    # MATLAB has no vectors: a matrix of one row or column is one.
    return values if len(shape) < 2 or 1 in shape else values.reshape(shape, order="F")


def _next(parts: Iterator[tuple[int, bytes]]) -> tuple[int, bytes]:
    found = next(parts, None)
    if found is None:
        raise MatlabError("a variable ends too early")
    return found


def _plain(raw: bytes) -> str:
    return plain(raw.split(b"\0")[0].decode("ascii", errors="replace"), 80)


_MAX_BYTES = 4 << 30
_PLAIN = "Save plain arrays in MATLAB: t = ts.Time; q = ts.Data; save(file, 't', 'q', '-v7')."
_SAVE = "Save it again in MATLAB with: save(file, '-v7')."


def read_mat(files: list[Path], options: ReadOptions, budget: Budget) -> RawTable:
    """Read a MATLAB file of version 5 to 7; see `Reader`."""
    path = files[0]
    data = all_bytes(path, _MAX_BYTES)
    order = _byte_order(data)
    if order is None:
        raise RecordError(
            "this is no MATLAB file of version 5 to 7", where=path.name, next_step=_SAVE
        )
    contents = _parse_matlab(data, order)
    harm = "; ".join(contents.damaged[:3]) or ("it is cut off" if contents.cut else "")
    if not contents.arrays or (contents.objects and set(contents.arrays) == {""}):
        raise RecordError(
            "there are no arrays of numbers",
            where=path.name,
            value=harm or None,
            next_step=_PLAIN if contents.objects else _SAVE,
        )
    contents.arrays.pop("", None)
    try:
        table = table_of(contents.arrays, options, where=path.name, format="mat")
    except RecordError as error:
        if not harm and not contents.objects:
            raise
        what, value, step = "the MATLAB file is damaged", f"{harm}; {error}", _SAVE
        if not harm:
            objects = f"{contents.objects} variables are timeseries or tables"
            what, value = f"{error.what}; {objects}, which only MATLAB can read", error.value
            step = _PLAIN
        raise RecordError(what, where=path.name, value=value, next_step=step) from error
    if contents.cut:
        table = table.report("truncated_file", f"{path.name} is cut off: what precedes is taken")
    if contents.damaged:
        table = table.report("corrupt_rows", f"{path.name}: damaged variables left out: {harm}")
    return table
