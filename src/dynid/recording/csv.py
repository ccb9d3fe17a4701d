"""Text tables: UR `record.py` and ur_rtde logs, any CSV, several files of one run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dynid.core import Array, Finding, RecordError
from dynid.recording.budget import Budget
from dynid.recording.clocks import Clock, stamps_of
from dynid.recording.columns import assign, suggest_columns
from dynid.recording.dialect import Dialect, sniff
from dynid.recording.grid import Grid, read_grid
from dynid.recording.headers import NotRecognised
from dynid.recording.names import OTHER, RANK, TARGET, TARGET_OF, parse_name
from dynid.recording.table import Mask, RawTable, ReadOptions, Rows, rows_with


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


def names_by_files(files: Sequence[Path], widths: Sequence[int]) -> tuple[str, ...] | None:
    """Column names made of the files' names, where each tells another quantity.

    Args:
        files: The files, side by side.
        widths: Columns of each.

    Returns:
        Names such as `positions[0]`, or None where a file's name says nothing or two say the
        same.
    """
    words = [quantity_word(file.stem) for file in files]
    meanings = [parse_name(word).meaning for word in words if word]
    quantities = [meaning[0] for meaning in meanings if meaning]
    if len(quantities) < len(files) or len(set(quantities)) < len(quantities):
        return None
    return tuple(
        word if width == 1 else f"{word}[{k}]"
        for word, width in zip(words, widths, strict=True)
        for k in range(width)
    )


def quantity_word(stem: str) -> str:
    """The words of a file's name that name a quantity; empty where none or several do.

    Args:
        stem: The name without its extension.
    """
    words = [word for word in parse_name(stem.replace(".", "_")).base.split("_") if word]
    whole = "_".join(words)
    if whole in RANK:
        return whole
    if OTHER & set(words):
        return ""
    # A single letter beside other words is too little to tell by.
    found = [
        (j - i, "_".join(words[i:j]))
        for i in range(len(words))
        for j in range(i + 1, len(words) + 1)
        if "_".join(words[i:j]) in RANK and len("_".join(words[i:j])) > 1
    ]
    longest = max((length for length, _ in found), default=0)
    best = {text for length, text in found if length == longest}
    if len({RANK[text][0] for text in best}) != 1:
        return ""
    word = min(best)
    asked = TARGET & set(words) and RANK[word][0] in TARGET_OF
    return f"desired_{word}" if asked and not word.startswith("desired") else word


_MAX_CHANNELS = 128
_MAX_CHANNEL_CELLS = 20_000_000


def read_csv(paths: list[Path], options: ReadOptions, budget: Budget) -> RawTable:
    """Read text tables; several files stand side by side and their columns count across them.

    A file of one number a line that is k times as long as the shortest is read row by row as
    k columns.

    Args:
        paths: The files.
        options: What the user says: columns, header, delimiter, joints. Its format is `csv`, or
            `ur-csv` or `ur-rtde-csv`, which must have UR's header names; `auto` names it by the
            header.
        budget: Bounds what is read.

    Raises:
        RecordError: No rows of numbers, columns that do not exist, or files whose rows do not
            belong together.
    """
    joints, columns, format = options.joints, options.columns, options.format
    where = ", ".join(path.name for path in paths)
    sheets = lay_side_by_side(
        [sniff(p, header=options.header, delimiter=options.delimiter) for p in paths],
        len(joints) or None,
    )
    width = sum(sheet.width for sheet in sheets)
    names = _all_names(sheets)
    notes: tuple[str, ...] = tuple(
        f"{sheet.dialect.path.name}: one number a line, read row by row as {sheet.width} columns"
        for sheet in sheets
        if sheet.width > 1 and sheet.numbers is not None
    )
    if columns is None and len(sheets) > 1 and not _says_anything(names):
        files = [sheet.dialect.path for sheet in sheets]
        names = names_by_files(files, [sheet.width for sheet in sheets])
        if names is not None:
            notes = (*notes, "the columns are named by their files")
    if columns is None and names is None:
        raise _no_header(sheets, where, len(joints) or None)
    try:
        found = assign(names, columns, width, where, joints)
    except NotRecognised as error:
        hint = _by_numbers(sheets, len(joints) or None)
        raise RecordError(
            error.what, where=where, value=error.value, next_step=hint or error.next_step
        ) from error
    if format == "auto":
        format = _format(names, sheets[0].dialect.delimiter)
    elif format != "csv" and not is_ur_header(names):
        raise RecordError(
            f"the header is not that of a {format} file",
            where=where,
            next_step="Use --format csv, with --columns where needed.",
        )
    times = {k for clock in found.clocks for k in clock.columns}
    main = {k for cols in found.columns.values() for k in cols}
    # The one clock there is must be sound on every row; of several, some may be empty.
    needed = main | times if len(found.clocks) == 1 else main
    extras = _channels(sheets, needed | times, names, width)
    wanted = sorted(needed | times | set(extras))
    pasted = paste(sheets, wanted, frozenset(wanted) - needed, where)
    values = pasted.values
    position = {column: k for k, column in enumerate(wanted)}
    moments = sheets[0].dialect.stamps if len(sheets) == 1 else frozenset[int]()
    if len(sheets) > 1:
        _check_clocks(found.clocks, lambda k: values[:, position[k]], where)
    stamps = stamps_of(found.clocks, lambda k: values[:, position[k]], moments)
    return RawTable(
        source=where,
        format=format,
        rows=pasted.rows,
        signals=found.signals(lambda k: values[:, position[k]]),
        t=stamps.t,
        time_scale=stamps.scale,
        t0=stamps.t0,
        labels={
            name: tuple(names[k] if names else f"column {k}" for k in cols)
            for name, cols in found.columns.items()
        },
        columns=dict(found.columns),
        clock_columns=found.clocks[0].columns if found.clocks else (),
        said=found.said,
        joint_names=found.joint_names or _named_in_rows(sheets, len(found.columns["q"])),
        channels={name: values[:, position[k]] for k, name in extras.items()},
        reported=pasted.reported,
        notices=(*found.notices, *pasted.notices),
        notes=(*notes, *found.notes, *filter(None, (stamps.note,))),
    )


def _says_anything(names: tuple[str, ...] | None) -> bool:
    """Whether some column's name is one of a quantity."""
    return names is not None and any(parse_name(name).meaning for name in names)


def _named_in_rows(sheets: list[Sheet], joints: int) -> tuple[str, ...]:
    """Joint names that stand beside the values, as `rostopic echo -p` writes them."""
    names = sheets[0].dialect.joint_names if len(sheets) == 1 else ()
    return names if len(names) == joints and len(set(names)) == joints else ()


def is_ur_header(names: Sequence[str] | None) -> bool:
    """Whether a header is one of Universal Robots' RTDE recorders."""
    return names is not None and {"timestamp", "actual_q_0"} <= set(names)


def _format(names: Sequence[str] | None, delimiter: str) -> str:
    if is_ur_header(names):
        return {" ": "ur-csv", ",": "ur-rtde-csv"}.get(delimiter, "csv")
    return "csv"


def _all_names(sheets: list[Sheet]) -> tuple[str, ...] | None:
    """Names of all columns, with the units of a line of their own in brackets."""
    if any(sheet.dialect.names is None for sheet in sheets):
        return None
    found: list[str] = []
    for number, sheet in enumerate(sheets):
        names = sheet.dialect.names or ()
        for name, unit in zip(names, sheet.dialect.units or ("",) * len(names), strict=True):
            meaning = parse_name(name).meaning
            again = number > 0 and name in found and meaning is not None and meaning[0] == "t"
            # Each file may have the time: that of the first is taken.
            path = f"file{number}/" if again else ""
            found.append(f"{path}{name} [{unit}]" if unit.strip("- ") else f"{path}{name}")
    return tuple(found)


def _check_clocks(clocks: Sequence[Clock], column: Callable[[int], Array], where: str) -> None:
    """Refuse files side by side whose own times are not the same."""
    own = [clock for clock in clocks if len(clock.columns) == 1]
    times = [column(clock.columns[0]) for clock in own if clock.label.startswith("file")]
    if not own or not times:
        return
    first = column(own[0].columns[0])
    step = float(np.nanmedian(np.abs(np.diff(first))))
    for t in times:
        apart = float(np.nanmax(np.abs(t - first), initial=0.0))
        if not apart <= 0.5 * step:
            raise RecordError(
                "the times of the files are not the same",
                where=where,
                value=f"{apart:.4g} apart",
                limit=f"half a step, {0.5 * step:.4g}",
                next_step="Give files that were recorded together, row by row.",
            )


def _no_header(sheets: list[Sheet], where: str, joints: int | None) -> RecordError:
    for sheet in sheets:
        if sheet.dialect.header_cells:
            return RecordError(
                f"the header has {sheet.dialect.header_cells} names but the rows have "
                f"{sheet.dialect.width} cells",
                where=sheet.dialect.path.name,
                next_step="Repair the header, or name the columns by number with --columns.",
            )
    hint = ""
    if len(sheets) == 1:
        # One wide table: its numbers tell the clock, positions and velocities.
        values = read_grid(sheets[0].dialect, sorted(sheets[0].dialect.numeric)).values
        if values.shape[1] == sheets[0].width:
            hint = suggest_columns(values, joints)
    return RecordError(
        "there is no header that names the columns",
        where=where,
        value=f"{sum(sheet.width for sheet in sheets)} columns",
        next_step=hint or "Name them with --columns, for example t=0,q=1:7,qd=7:13,current=13:19.",
    )


def _by_numbers(sheets: list[Sheet], joints: int | None) -> str:
    """What the numbers of one wide table tell of its columns, as a next step; or nothing."""
    if len(sheets) > 1:
        return ""
    dialect = sheets[0].dialect
    numeric = sorted(dialect.numeric - dialect.stamps)
    values = np.full((0, dialect.width), np.nan)
    if len(numeric) > 1:
        grid = read_grid(dialect, numeric, frozenset(numeric))
        values = np.full((len(grid.values), dialect.width), np.nan)
        values[:, numeric] = grid.values
    return suggest_columns(values, joints)


def _channels(
    sheets: list[Sheet], taken: set[int], names: tuple[str, ...] | None, width: int
) -> dict[int, str]:
    """Columns kept as channels: numeric, named once, not mapped, and not too many."""
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
