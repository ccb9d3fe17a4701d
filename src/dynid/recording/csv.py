"""Text tables: UR `record.py` and ur_rtde logs, any CSV, several files side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from dynid.core.errors import RecordError
from dynid.recording.columns import parse_columns, select
from dynid.recording.headers import match_headers
from dynid.recording.naming import parse_name
from dynid.recording.table import RawTable
from dynid.recording.text.dialect import sniff
from dynid.recording.text.sheets import Sheet, lay_side_by_side, paste

_MAX_CHANNELS = 128
_MAX_CHANNEL_CELLS = 20_000_000


def read_csv(
    paths: Sequence[Path],
    *,
    columns: str | Mapping[str, str] | None = None,
    header: bool | None = None,
    delimiter: str | None = None,
    format: str = "auto",
) -> RawTable:
    """Read text tables; several files stand side by side and their columns count across them.

    A file of one number a line that is k times as long as the shortest is read row by row as
    k columns.

    Args:
        paths: The files.
        columns: Quantity to columns; None to go by the header.
        header: Whether there is a header line; None to find out.
        delimiter: One character; None to find out.
        format: `csv`, or `ur-csv` or `ur-rtde-csv`, which must have UR's header names; `auto`
            names it by the header.

    Raises:
        RecordError: No rows of numbers, columns that do not exist, or files whose rows do not
            belong together.
    """
    where = ", ".join(path.name for path in paths)
    sheets = lay_side_by_side([sniff(p, header=header, delimiter=delimiter) for p in paths])
    width = sum(sheet.width for sheet in sheets)
    names = _all_names(sheets)
    notes: tuple[str, ...] = tuple(
        f"{sheet.dialect.path.name}: one number a line, read row by row as {sheet.width} columns"
        for sheet in sheets
        if sheet.width > 1 and sheet.numbers is not None
    )
    joint_names: tuple[str, ...] = ()
    time_scale: float | None = None
    if columns is not None:
        spec = parse_columns(columns)
        mapping = {name: select(name, value, width, names) for name, value in spec.items()}
        degrees = frozenset(
            quantity
            for quantity, cols in mapping.items()
            if names and quantity != "t" and any(parse_name(names[k]).degrees for k in cols)
        )
        if names and "t" in mapping:
            time_scale = parse_name(names[mapping["t"][0]]).time_scale
    else:
        if names is None:
            raise _no_header(sheets, where)
        match = match_headers(names, where)
        mapping, degrees = dict(match.columns), match.in_degrees
        joint_names, time_scale = match.joint_names, match.time_scale
        notes = (*notes, *match.notes)
    if format == "auto":
        format = _format(names, sheets[0].dialect.delimiter)
    elif format != "csv" and not is_ur_header(names):
        raise RecordError(
            f"the header is not that of a {format} file",
            where=where,
            next_step="Use --format csv, with --columns where needed.",
        )
    extras = _channels(sheets, mapping, names, width)
    wanted = sorted({column for cols in mapping.values() for column in cols} | set(extras))
    pasted = paste(sheets, wanted, frozenset(extras), where)
    values = pasted.values
    position = {column: k for k, column in enumerate(wanted)}
    return RawTable(
        source=where,
        format=format,
        rows=pasted.rows,
        signals={
            name: values[:, [position[k] for k in cols]]
            for name, cols in mapping.items()
            if name != "t"
        },
        t=values[:, position[mapping["t"][0]]] if "t" in mapping else None,
        time_scale=time_scale,
        labels={
            name: tuple(names[k] if names else f"column {k}" for k in cols)
            for name, cols in mapping.items()
        },
        in_degrees=degrees,
        joint_names=joint_names,
        channels={name: values[:, position[k]] for k, name in extras.items()},
        reported=pasted.reported,
        notices=pasted.notices,
        notes=notes,
    )


def is_ur_header(names: Sequence[str] | None) -> bool:
    """Whether a header is one of Universal Robots' RTDE recorders."""
    return names is not None and {"timestamp", "actual_q_0"} <= set(names)


def _format(names: Sequence[str] | None, delimiter: str) -> str:
    if is_ur_header(names):
        return {" ": "ur-csv", ",": "ur-rtde-csv"}.get(delimiter, "csv")
    return "csv"


def _all_names(sheets: list[Sheet]) -> tuple[str, ...] | None:
    if any(sheet.dialect.names is None for sheet in sheets):
        return None
    return tuple(name for sheet in sheets for name in (sheet.dialect.names or ()))


def _no_header(sheets: list[Sheet], where: str) -> RecordError:
    for sheet in sheets:
        if sheet.dialect.header_cells:
            return RecordError(
                f"the header has {sheet.dialect.header_cells} names but the rows have "
                f"{sheet.dialect.width} cells",
                where=sheet.dialect.path.name,
                next_step="Repair the header, or name the columns by number with --columns.",
            )
    return RecordError(
        "there is no header that names the columns",
        where=where,
        next_step="Name them with --columns, for example t=0,q=1:7,qd=7:13,current=13:19.",
    )


def _channels(
    sheets: list[Sheet],
    mapping: Mapping[str, list[int]],
    names: tuple[str, ...] | None,
    width: int,
) -> dict[int, str]:
    """Columns kept as channels: numeric, named once, not mapped, and not too many."""
    taken = {column for cols in mapping.values() for column in cols}
    if names is None or len(sheets) > 1:
        return {}
    free = [
        k
        for k in range(width)
        if k not in taken and k in sheets[0].dialect.numeric and names.count(names[k]) == 1
    ]
    size = sheets[0].dialect.path.stat().st_size
    cells = size // max(6 * width, 1) * len(free)
    if len(free) > _MAX_CHANNELS or cells > _MAX_CHANNEL_CELLS:
        return {}
    return {k: names[k] for k in free if names[k]}
