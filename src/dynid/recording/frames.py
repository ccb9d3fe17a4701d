"""Tables of others with typed cells: Parquet, Arrow (Feather), workbooks of spreadsheets."""

from __future__ import annotations

import importlib
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core import Array, RecordError, require
from dynid.recording.budget import Budget
from dynid.recording.clocks import stamps_of
from dynid.recording.columns import assign
from dynid.recording.table import RawTable, ReadOptions

_MAX_ITEMS = 200
_FEWEST_ROWS = 3
_AS_CSV = "Save the sheet as CSV."


def read_frame(files: list[Path], options: ReadOptions, budget: Budget) -> RawTable:
    """Read a Parquet or Arrow table that dynid did not write.

    Columns of lists count as one column an item: `position[0]`, `position[1]`, ...

    Args:
        files: The one file.
        options: Columns say quantity to columns; None to go by the names.
        budget: Bounds what is read.

    Raises:
        RecordError: Damaged, or without the columns.
    """
    path = files[0]
    where = path.name
    try:
        table = _load(path, budget)
        named = [item for name in table.column_names for item in _columns(name, table.column(name))]
    except RecordError:
        raise
    # pyarrow raises many kinds on damaged bytes (ArrowInvalid, OSError, UnicodeError, ...).
    except Exception as error:
        text = " ".join(str(error).split())[:200] or type(error).__name__
        raise RecordError("the table is damaged", where=where, value=text) from error
    if not named:
        raise RecordError("there are no columns of numbers", where=where)
    names = [name for name, _ in named]
    values = [value for _, value in named]
    found = assign(names, options.columns, len(names), where, options.joints)
    stamps = stamps_of(found.clocks, lambda k: values[k])
    return RawTable(
        source=where,
        format="parquet",
        rows=np.arange(1, len(values[0]) + 1, dtype=np.int64),
        row_word="row",
        signals=found.signals(lambda k: values[k]),
        t=stamps.t,
        time_scale=stamps.scale,
        t0=stamps.t0,
        labels={name: tuple(names[k] for k in cols) for name, cols in found.columns.items()},
        columns=dict(found.columns),
        clock_columns=found.clocks[0].columns if found.clocks else (),
        said=found.said,
        joint_names=found.joint_names,
        notices=found.notices,
        notes=(*found.notes, *filter(None, (stamps.note,))),
    )


def _load(path: Path, budget: Budget) -> Any:
    with path.open("rb") as stream:
        arrow = stream.read(6) == b"ARROW1"
    if arrow:
        return importlib.import_module("pyarrow.feather").read_table(path, memory_map=False)
    parquet = importlib.import_module("pyarrow.parquet")
    facts = parquet.read_metadata(path)
    budget.require_values(facts.num_rows, facts.num_columns, where=path.name)
    return parquet.read_table(path, use_threads=False)


def _columns(name: str, column: Any) -> list[tuple[str, Array]]:
    """Name and numbers of a column, or of each item of its lists; nothing for text."""
    types = importlib.import_module("pyarrow.types")
    kind = column.type
    if types.is_timestamp(kind):
        # Seconds as float64 are exact to a quarter of a microsecond.
        ticks = column.cast("int64", safe=False).to_numpy(zero_copy_only=False)
        scale = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[kind.unit]
        return [(f"{name} [s]", np.asarray(ticks, dtype=np.float64) * scale)]
    if types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind):
        if not (types.is_floating(kind.value_type) or types.is_integer(kind.value_type)):
            return []
        rows: list[Any] = column.to_pylist()
        width = max((len(row) for row in rows if row is not None), default=0)
        if not 0 < width <= _MAX_ITEMS:
            return []
        values = np.full((len(rows), width), np.nan)
        for k, row in enumerate(rows):
            if row is not None and len(row) == width:
                values[k] = [np.nan if item is None else item for item in row]
        return [(f"{name}[{k}]", values[:, k]) for k in range(width)]
    if types.is_floating(kind) or types.is_integer(kind) or types.is_boolean(kind):
        return [(name, np.asarray(column.to_numpy(zero_copy_only=False), dtype=np.float64))]
    return []


def write_sheet(path: Path, target: Path) -> None:
    """Write the only sheet of numbers of a workbook with tabs between cells, a line a row.

    Args:
        path: The workbook (`.xlsx`, `.xls`, `.ods`).
        target: The text file.

    Raises:
        RecordError: Damaged, or none or several sheets of numbers.
        MissingExtraError: Without the `excel` extra.
    """
    library = require("python_calamine", "excel")
    try:
        book = library.CalamineWorkbook.from_path(str(path))
        names: list[str] = book.sheet_names
        sheets = [book.get_sheet_by_name(name) for name in names]
        full = [sheet for sheet in sheets if _has_numbers(sheet)]
        if len(full) != 1:
            raise RecordError(
                f"the workbook has {len(full) or 'no'} sheets of numbers",
                where=path.name,
                value=names[:20],
                next_step=_AS_CSV,
            )
        with target.open("w", encoding="utf-8") as sink:
            for row in full[0].iter_rows():
                sink.write("\t".join(map(_cell, row)).rstrip("\t") + "\n")
    except (library.CalamineError, OSError, ValueError) as error:
        raise RecordError(
            "the workbook is damaged", where=path.name, value=str(error)[:200], next_step=_AS_CSV
        ) from error


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
    if isinstance(value, (datetime, date, time)):
        return value.isoformat(sep=" ") if isinstance(value, datetime) else value.isoformat()
    if isinstance(value, timedelta):
        return repr(value.total_seconds())
    # `#DIV/0!` is no value.
    return "" if str(value).startswith("#") else " ".join(str(value).split())
