"""Text files side by side: their columns count across them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core import Array, Finding, RecordError
from dynid.recording.table import Mask, Rows, rows_with
from dynid.recording.text.dialect import Dialect
from dynid.recording.text.grid import Grid, read_grid


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """One file's part of the pasted table."""

    dialect: Dialect
    width: int
    """Columns that it contributes."""
    numbers: Grid | None
    """Read already, for a file of one number a line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pasted:
    """Columns of all files, row by row."""

    values: Array
    """(N, k) the wanted columns."""
    rows: Rows
    """(N) line numbers of the first file, from 1."""
    reported: Mask
    """(N) rows that `notices` accounts for."""
    notices: tuple[Finding, ...]


def lay_side_by_side(dialects: list[Dialect], joints: int | None = None) -> list[Sheet]:
    """How many columns each file contributes.

    A file of one number a line that is k times as long as the shortest file is taken row by
    row as k columns. Where all are as long as each other, and are not as many as the joints,
    a row has one number a joint.

    Args:
        dialects: How each file is written.
        joints: Number of joints, if known.

    Raises:
        RecordError: A length that is no multiple.
    """
    if len(dialects) == 1:
        return [Sheet(dialect=dialects[0], width=dialects[0].width, numbers=None)]
    single = {k: read_grid(d, [0]) for k, d in enumerate(dialects) if d.width == 1}
    # A table with several columns has as many rows as it has lines: it sets the length too.
    lengths = [len(grid.rows) for grid in single.values()]
    lengths += [
        len(read_grid(d, [0]).rows) for k, d in enumerate(dialects) if single and k not in single
    ]
    shortest = min(lengths, default=0)
    if joints and len(single) == len(dialects) and len(dialects) % joints:
        even = len(set(lengths)) == 1 and lengths[0] % joints == 0
        shortest = lengths[0] // joints if even else shortest
    sheets: list[Sheet] = []
    for k, dialect in enumerate(dialects):
        if k not in single:
            sheets.append(Sheet(dialect=dialect, width=dialect.width, numbers=None))
            continue
        count, rest = divmod(len(single[k].rows), shortest)
        if rest:
            raise RecordError(
                f"{dialect.path.name} has {len(single[k].rows)} numbers, which is no multiple of "
                f"the {shortest} rows of the shortest file",
                next_step="A number is missing in one of the files; give complete files.",
            )
        sheets.append(Sheet(dialect=dialect, width=count, numbers=single[k]))
    return sheets


def paste(sheets: list[Sheet], wanted: list[int], soft: frozenset[int], where: str) -> Pasted:
    """Read columns, counted across files.

    Args:
        sheets: The files.
        wanted: Column numbers, ascending.
        soft: Those among them whose unreadable cells are only missing.
        where: The files, for messages.

    Raises:
        RecordError: Files of different lengths, where it is not clear which rows are missing.
    """
    parts: list[Array] = []
    grids: list[Grid] = []
    reported: list[Mask] = []
    start = 0
    for sheet in sheets:
        local = [k - start for k in wanted if start <= k < start + sheet.width]
        own_soft = frozenset(k - start for k in soft)
        start += sheet.width
        if not local:
            continue
        grid = sheet.numbers or read_grid(sheet.dialect, local, own_soft)
        grids.append(grid)
        if sheet.numbers is None:
            parts.append(grid.values)
            reported.append(grid.reported)
        else:
            parts.append(grid.values.reshape(-1, sheet.width)[:, local])
            reported.append(rows_with(grid.reported.reshape(-1, sheet.width)))
    lengths = [len(part) for part in parts]
    shortest = min(lengths)
    notices = [notice for grid in grids for notice in grid.notices]
    if max(lengths) > shortest:
        broken = sum(grid.broken for grid in grids)
        if broken or max(lengths) > 1.2 * shortest:
            raise RecordError(
                "the files do not have the same number of rows",
                where=where,
                value=lengths,
                next_step="Give files that were recorded together, without broken lines.",
            )
        notices.append(
            Finding(
                "truncated_file",
                f"the files have {' and '.join(map(str, lengths))} rows; cut to {shortest}, taking "
                "the missing ones to be the last",
            )
        )
    whole_lines = len(grids[0].rows) == len(parts[0])
    rows = grids[0].rows if whole_lines else np.arange(1, len(parts[0]) + 1, dtype=np.int64)
    return Pasted(
        values=np.concatenate([part[:shortest] for part in parts], axis=1),
        rows=rows[:shortest],
        reported=rows_with(np.column_stack([mask[:shortest] for mask in reported])),
        notices=tuple(notices),
    )
