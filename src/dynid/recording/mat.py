"""MATLAB files up to version 7, with nested structs by their paths (`rec.act_pos`)."""

from __future__ import annotations

import importlib
import io
import struct
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import RecordError
from dynid.core.notices import Notice
from dynid.recording.table import RawTable
from dynid.recording.variables import numbers_of, table_of

_HEADER = 128
_MAX_DEPTH = 8
_MAX_VARIABLES = 5000


def read_mat(
    path: Path, *, columns: str | Mapping[str, str] | None = None, joints: int | None = None
) -> RawTable:
    """Read a MATLAB file of version 4 to 7.

    Args:
        path: The file.
        columns: Quantity to variable path, as in `q=rec.act_pos,t=rec.time`; None to go by
            the names.
        joints: Number of joints, if known.

    Raises:
        RecordError: Version 7.3, damaged, or without the variables.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise RecordError(
            "the file cannot be read", where=path.name, value=error.strerror
        ) from error
    if data[:10] == b"MATLAB 7.3" or data[512:516] == b"\x89HDF" or data[:4] == b"\x89HDF":
        raise RecordError(
            "this is a MATLAB 7.3 (HDF5) file",
            where=path.name,
            next_step="Save it again in MATLAB with: save(file, '-v7').",
        )
    whole, cut = _whole_elements(data)
    loadmat = importlib.import_module("scipy.io").loadmat
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            content: dict[str, Any] = loadmat(io.BytesIO(whole), simplify_cells=True)
    # scipy's parser raises whatever the damaged bytes lead it to; all of it means the same.
    except Exception as error:
        raise RecordError(
            "the MATLAB file is damaged",
            where=path.name,
            value=str(error) or type(error).__name__,
            next_step="Save it again with: save(file, '-v7').",
        ) from error
    variables: dict[str, Array] = {}
    for name, value in content.items():
        if not name.startswith("__"):
            _collect(name, value, variables, 0)
    if not variables:
        raise RecordError("there are no arrays of numbers", where=path.name, value=list(content))
    table = table_of(variables, columns, joints=joints, where=path.name, format="mat")
    notices = [Notice("truncated_file", f"{path.name} is cut off: what precedes is taken")] * cut
    notices += [Notice("corrupt_rows", f"{path.name}: {_line(w.message)}") for w in caught]
    for notice in notices:
        table = table.report(notice.code, notice.message)
    return table


def _whole_elements(data: bytes) -> tuple[bytes, bool]:
    """The file up to its last whole variable, and whether something is cut off."""
    mark = data[126:128]
    if len(data) < _HEADER + 8 or mark not in (b"IM", b"MI"):
        return data, False
    order = "<" if mark == b"IM" else ">"
    offset = _HEADER
    while offset + 8 <= len(data):
        (size,) = struct.unpack_from(order + "I", data, offset + 4)
        if offset + 8 + size > len(data):
            break
        offset += 8 + size
    # Nothing whole: let the parser name what is wrong.
    return (data, False) if offset == _HEADER else (data[:offset], offset < len(data))


def _collect(path: str, value: Any, into: dict[str, Array], depth: int) -> None:
    if depth > _MAX_DEPTH or len(into) >= _MAX_VARIABLES:
        return
    if isinstance(value, dict):
        for name, item in cast("dict[str, Any]", value).items():
            _collect(f"{path}.{name}", item, into, depth + 1)
        return
    if isinstance(value, (int, float, np.ndarray)):
        array = numbers_of(value)
        if array is not None:
            into[path] = array


def _line(message: object) -> str:
    return " ".join(str(message).split())[:200]
