"""MATLAB files of version 5 to 7: the arrays of numbers in them, nested structs too.

SciPy reads them, variable by variable, so that a damaged or cut one costs no other. On some damaged
files (1 of 600 random mutations) it ends the interpreter: that is the reading process of its own,
which the caller sees as one error.
"""

import importlib
import struct
import warnings
import zlib
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core import Array, RecordError, printable
from dynid.recording.content import Budget, all_bytes, refused
from dynid.recording.table import RawTable, ReadOptions
from dynid.recording.variables import numbers_of, table_of

_HEADER = 128
"""Bytes before the first variable; the last two tell the byte order."""
_MATRIX, _COMPRESSED = 14, 15
_MAX_DEPTH = 12
_MAX_ELEMENTS = 200
_MAX_VARIABLES = 5000
_MAX_INFLATED = 1 << 30


@dataclass(slots=True)
class _Contents:
    """What a file holds."""

    arrays: dict[str, Array] = field(default_factory=dict[str, Array])
    """Path (`rec.act_pos`, `run(2).q`) to array of one or two axes."""
    damaged: list[str] = field(default_factory=list[str])
    """What is wrong with each variable that could not be read."""
    objects: int = 0
    """Variables of MATLAB's own classes (timeseries, table), which only MATLAB can read."""
    cut: bool = False
    """The file ends in the middle of a variable."""


def _parse(data: bytes, order: str) -> _Contents:
    """Read all arrays of numbers; variables that make no sense are left out and named."""
    contents = _Contents()
    offset = _HEADER
    while offset + 8 <= len(data) and len(contents.arrays) < _MAX_VARIABLES:
        kind, size = struct.unpack_from(order + "II", data, offset)
        start, offset = offset, offset + 8 + size
        if offset > len(data):
            contents.cut = True
            break
        try:
            with refused(f"the variable at byte {start} is damaged"):
                element = data[start:offset]
                if kind == _COMPRESSED:
                    element = _inflated(element[8:])
                    kind, size = struct.unpack_from(order + "II", element)
                    element = element[: 8 + size]
                if kind != _MATRIX or size > len(element) - 8:
                    raise ValueError("no array, or one that is larger than its bytes")
                for name, value in _read(data[:_HEADER] + element).items():
                    _collect(value, printable(name, 80), contents, 0)
        except RecordError as error:
            contents.damaged.append(f"{error.what} ({error.value})")
    return contents


def _inflated(packed: bytes) -> bytes:
    decompressor = zlib.decompressobj()
    data = decompressor.decompress(packed, _MAX_INFLATED)
    # Only at its end is the checksum of the stream compared.
    if not decompressor.eof:
        raise ValueError("compressed data are cut off")
    return data


def _read(file: bytes) -> dict[str, Any]:
    """The variable of a file that has one; text, sparse matrices and functions are left out."""
    library: Any = importlib.import_module("scipy.io.matlab")
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        # So it says that a variable cannot be read.
        warnings.simplefilter("error", library.MatReadWarning)
        found: dict[str, Any] = library.loadmat(BytesIO(file))
    return {
        name: value
        for name, value in found.items()
        if isinstance(value, np.ndarray) and not name.startswith("__")
    }


def _collect(value: Any, path: str, into: _Contents, depth: int) -> None:
    """Collect the arrays of numbers in a variable under its path."""
    if depth > _MAX_DEPTH or len(into.arrays) >= _MAX_VARIABLES:
        return
    if type(value).__name__ in ("MatlabOpaque", "MatlabFunction"):
        into.objects += type(value).__name__ == "MatlabOpaque"
    elif fields := value.dtype.names:
        for number, element in enumerate(value.ravel(order="F")[:_MAX_ELEMENTS], 1):
            stem = path if value.size == 1 else f"{path}({number})"
            for name in fields:
                _collect(element[name], f"{stem}.{printable(name, 80)}", into, depth + 1)
    elif value.dtype == object:
        own = _Contents()
        for number, element in enumerate(value.ravel(order="F")[:_MAX_ELEMENTS], 1):
            _collect(element, f"{path}({number})", own, depth + 1)
        columns = list(own.arrays.values())
        # Vectors as long as each other are the columns of a matrix.
        alike = len(columns) == value.size > 1 and len({x.shape for x in columns}) == 1
        if alike and columns[0].ndim == 1 and columns[0].size > value.size:
            own.arrays = {path: np.column_stack(columns)}
        into.arrays.update(own.arrays)
        into.objects += own.objects
    else:
        array = numbers_of(value.real if value.dtype.kind == "c" else value)
        if array is not None:
            into.arrays[path] = array


_MAX_BYTES = 4 << 30
_PLAIN = "Save plain arrays in MATLAB: t = ts.Time; q = ts.Data; save(file, 't', 'q', '-v7')."
_SAVE = "Save it again in MATLAB with: save(file, '-v7')."


def read_mat(files: list[Path], options: ReadOptions, budget: Budget) -> RawTable:
    """Read a MATLAB file of version 5 to 7; see `Reader`."""
    path = files[0]
    data = all_bytes(path, _MAX_BYTES)
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None:
        raise RecordError("this is no MATLAB file of version 5 to 7", next_step=_SAVE)
    contents = _parse(data, order)
    harm = "; ".join(contents.damaged[:3]) or ("it is cut off" if contents.cut else "")
    if not contents.arrays:
        raise RecordError(
            "there are no arrays of numbers",
            value=harm or None,
            next_step=_PLAIN if contents.objects else _SAVE,
        )
    try:
        table = table_of(contents.arrays, options)
    except RecordError as error:
        if not harm and not contents.objects:
            raise
        what, value, step = "the MATLAB file is damaged", f"{harm}; {error}", _SAVE
        if not harm:
            objects = f"{contents.objects} variables are timeseries or tables"
            what, value = f"{error.what}; {objects}, which only MATLAB can read", error.value
            step = f"{error.next_step or ''} {_PLAIN}".lstrip()
        raise RecordError(what, value=value, next_step=step) from error
    if contents.cut:
        table = table.report("truncated_file", f"{path.name} is cut off: what precedes is taken")
    if contents.damaged:
        table = table.report("corrupt_rows", f"{path.name}: damaged variables left out: {harm}")
    return table
