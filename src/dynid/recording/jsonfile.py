"""JSON files: arrays by name, or one object a row (JSON lines too)."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from dynid.core import Array, RecordError
from dynid.recording.opening import all_bytes
from dynid.recording.table import RawTable
from dynid.recording.variables import numbers_of, table_of

_MAX_BYTES = 1 << 30
_MAX_DEPTH = 12


def read_json(
    path: Path,
    *,
    columns: str | Mapping[str, str] | None = None,
    joints: int | None = None,
    names: Sequence[str] = (),
) -> RawTable:
    """Read arrays of numbers from a JSON file.

    Args:
        path: The file: an object of arrays (nested objects give paths, `state.q`), or a list of
            objects or a line for each sample.
        columns: Quantity to path; None to go by the names.
        joints: Number of joints, if known.
        names: The robot's joint names, if known.

    Raises:
        RecordError: Damaged, too large, or without the arrays.
    """
    data = all_bytes(path, _MAX_BYTES)
    try:
        content = _parse(data.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise RecordError("the JSON file is damaged", where=path.name, value=str(error)) from error
    variables: dict[str, Array] = {}
    _collect(content, "", variables, 0)
    if not variables:
        raise RecordError("there are no arrays of numbers", where=path.name)
    return table_of(variables, columns, joints=joints, where=path.name, format="json", names=names)


def _parse(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        lines = [line for line in text.splitlines() if line.strip()]
        if len(lines) < 2:
            raise
        return [json.loads(line) for line in lines]


def _collect(item: Any, path: str, into: dict[str, Array], depth: int) -> None:
    if depth > _MAX_DEPTH:
        return
    if isinstance(item, dict):
        for name, value in _by_columns(cast("dict[str, Any]", item)).items():
            _collect(value, f"{path}.{name}" if path else str(name), into, depth + 1)
    elif isinstance(item, list):
        rows = cast("list[Any]", item)
        if rows and all(isinstance(row, dict) for row in rows):
            # One object a row: each field becomes an array, as far as all rows have it.
            first = cast("dict[str, Any]", rows[0])
            for name in first:
                if all(name in row for row in rows):
                    inner = f"{path}.{name}" if path else str(name)
                    _collect([row[name] for row in rows], inner, into, depth + 1)
            return
        try:
            array = numbers_of(np.array(rows))
        except (ValueError, OverflowError):
            return
        if array is not None and array.size:
            into[path or "array"] = array


def _by_columns(item: dict[str, Any]) -> dict[str, Any]:
    """An object as it is, or a pandas table as one list a column.

    `DataFrame.to_json` writes objects of rows by their numbers, or `columns` beside `data`.
    """
    names, rows = item.get("columns"), item.get("data")
    if isinstance(names, list) and isinstance(rows, list):
        listed, table = cast("list[Any]", names), cast("list[Any]", rows)
        width = len(listed)
        if table and all(
            isinstance(row, list) and len(cast("list[Any]", row)) == width for row in table
        ):
            return {str(name): [row[k] for row in table] for k, name in enumerate(listed)}
    found: dict[str, Any] = {}
    for name, value in item.items():
        inner = cast("dict[str, Any]", value) if isinstance(value, dict) else {}
        counted = bool(inner) and list(inner) == [str(k) for k in range(len(inner))]
        found[name] = list(inner.values()) if counted else value
    return found
