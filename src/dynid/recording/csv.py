"""Text tables: UR `record.py` and ur_rtde logs, any CSV, several files of one run.

Files of one run stand side by side row by row, or each has a clock of its own.
"""

import re
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations, islice
from pathlib import Path

import numpy as np

from dynid.core import Finding, Mask, RecordError, UnclearRecordError
from dynid.recording.cells import example_columns, split
from dynid.recording.columns import assign
from dynid.recording.content import Budget
from dynid.recording.dialect import Dialect, line_blocks, sniff
from dynid.recording.grid import Grid, read_grid
from dynid.recording.names import OTHER, TARGET, TARGET_OF, parse_name, plainly, quantity_of
from dynid.recording.table import RawTable, ReadOptions, at_times, rises, rows_with

_FARTHEST = 1.5
"""Steps between two rows of a file, across which it is still read between them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """One file's part of the pasted table."""

    dialect: Dialect
    first: int
    """The number of its first column among those of all files."""
    width: int
    """Columns that it contributes."""
    numbers: Grid | None = None
    """Read already, for a file of one number a line."""

    def own(self, columns: Iterable[int]) -> list[int]:
        """Those of some columns that are this file's, by its own count."""
        return [k - self.first for k in columns if self.first <= k < self.first + self.width]

    def read(self, columns: list[int], soft: Iterable[int]) -> Grid:
        """Read columns, by its own count; unreadable cells of `soft` ones are only missing."""
        if self.numbers is None:
            return read_grid(self.dialect, columns, frozenset(soft))
        return replace(
            self.numbers,
            values=self.numbers.values.reshape(-1, self.width)[:, columns],
            rows=self.numbers.rows[:: self.width],
            reported=rows_with(self.numbers.reported.reshape(-1, self.width)),
        )


def lay_side_by_side(dialects: list[Dialect], joints: int | None = None) -> list[Sheet]:
    """How many columns each file contributes; the number of joints may be known.

    A file of one number a line that is k times as long as the shortest file is taken row by
    row as k columns. Where all are as long as each other, and are not as many as the joints,
    a row has one number a joint.

    Raises:
        RecordError: A length that is no multiple.
    """
    if len(dialects) == 1:
        return [Sheet(dialect=dialects[0], first=0, width=dialects[0].width)]
    # A table with several columns has as many rows as it has lines: it sets the length too.
    wanted = dialects if any(d.width == 1 for d in dialects) else []
    grids = [read_grid(dialect, [0]) for dialect in wanted]
    lengths = [len(grid.rows) for grid in grids]
    shortest = min(lengths, default=0)
    if joints and all(d.width == 1 for d in dialects) and len(dialects) % joints:
        even = len(set(lengths)) == 1 and lengths[0] % joints == 0
        shortest = lengths[0] // joints if even else shortest
    sheets: list[Sheet] = []
    first = 0
    for k, dialect in enumerate(dialects):
        width, numbers = dialect.width, grids[k] if dialect.width == 1 else None
        if numbers is not None:
            width, rest = divmod(len(numbers.rows), shortest)
            if rest:
                raise RecordError(
                    f"{dialect.path.name} has {len(numbers.rows)} numbers, which is no multiple "
                    f"of the {shortest} rows of the shortest file",
                    next_step="A number is missing in one of the files; give complete files.",
                )
        sheets.append(Sheet(dialect=dialect, first=first, width=width, numbers=numbers))
        first += width
    return sheets


def paste(sheets: list[Sheet], wanted: list[int], soft: frozenset[int]) -> Grid:
    """Read columns, counted across files and ascending, row by row; `soft` as in `read_grid`.

    Raises:
        RecordError: Files of different lengths, where it is not clear which rows are missing.
    """
    grids = [sheet.read(local, sheet.own(soft)) for sheet in sheets if (local := sheet.own(wanted))]
    lengths = [len(grid.values) for grid in grids]
    shortest = min(lengths)
    notices = [notice for grid in grids for notice in grid.notices]
    if max(lengths) > shortest:
        broken = sum(grid.broken for grid in grids)
        if broken or max(lengths) > 1.2 * shortest:
            step = "Give files that were recorded together, without broken lines."
            what = "the files do not have the same number of rows"
            raise RecordError(what, value=lengths, next_step=step)
        notices.append(
            Finding(
                "truncated_file",
                f"the files have {' and '.join(map(str, lengths))} rows; cut to {shortest}, taking "
                "the missing ones to be the last",
            )
        )
    return Grid(
        values=np.concatenate([grid.values[:shortest] for grid in grids], axis=1),
        rows=grids[0].rows[:shortest],
        reported=rows_with(np.column_stack([grid.reported[:shortest] for grid in grids])),
        notices=tuple(notices),
    )


def own_clocks(sheets: list[Sheet], names: Sequence[str] | None) -> tuple[int, ...]:
    """The column of time of each file, where several files all have one.

    Without a header it is the first column, where that rises as a clock does.

    Returns:
        Column numbers within each file; none where a file has no clock.
    """
    found: list[int] = []
    for sheet in sheets:
        own = names[sheet.first : sheet.first + sheet.width] if names is not None else ()
        if sheet.numbers is not None or sheet.width < 2 or len(sheets) < 2:
            return ()
        clocks = [k for k, name in enumerate(own) if parse_name(name).quantity == "t"]
        if names is None:
            column = read_grid(sheet.dialect, [0]).values[:, 0]
            clocks = [0] if rises(column[np.isfinite(column)]) else []
        if not clocks:
            return ()
        found.append(clocks[0])
    return tuple(found)


_LONGER = 100
"""Times the span of another file that none has whose unit of time is the same."""


def align(
    sheets: list[Sheet],
    clocks: tuple[int, ...],
    wanted: list[int],
    soft: frozenset[int],
    units: Sequence[float | None],
) -> Grid:
    """Read columns, counted across files and ascending, at the times of the first file.

    Each file has its column of time in `clocks`, and the seconds a unit of it in `units`, None
    where it does not say: then it is that of the others. Only the time that all files share is
    kept. Between its rows a file is read on straight lines; over its gaps it has no values.

    Raises:
        RecordError: Files of different times.
    """
    grids = [
        sheet.read([clock, *sheet.own(wanted)], {*sheet.own(soft)} - {clock})
        for sheet, clock in zip(sheets, clocks, strict=True)
    ]
    said = next((unit for unit in units if unit is not None), 1.0)
    of_first = [(unit or said) / (units[0] or said) for unit in units]
    times = [grid.values[:, 0] * unit for grid, unit in zip(grids, of_first, strict=True)]
    spans = [(float(np.nanmin(t)), float(np.nanmax(t))) for t in times]
    begin, end = max(low for low, _ in spans), min(high for _, high in spans)
    lengths = [high - low for low, high in spans]
    if begin >= end or max(lengths) > _LONGER * min(lengths):
        raise RecordError(
            "the time ranges of the files do not overlap"
            if begin >= end
            else "the files are of very different lengths, or their times in different units",
            value="; ".join(f"{low:.6g} to {high:.6g}" for low, high in spans),
            next_step="Give files that were recorded together, with the unit of time in each "
            "header, as in time [ms].",
        )
    t = grids[0].values[:, 0]
    inside: Mask = ~((t < begin) | (t > end))
    others = zip(times[1:], grids[1:], strict=True)
    parts = [at_times(t, own, grid.values[:, 1:], _FARTHEST) for own, grid in others]
    notices = [notice for grid in grids for notice in grid.notices]
    if max(abs(low - begin) for low, _ in spans) + max(abs(high - end) for _, high in spans) > 0:
        notices.append(
            Finding(
                "truncated_file",
                f"the files end at {min(high for _, high in spans):.6g} to "
                f"{max(high for _, high in spans):.6g}; only the time that all share is taken",
            )
        )
    return Grid(
        values=np.concatenate([grids[0].values[:, 1:], *parts], axis=1)[inside],
        rows=grids[0].rows[inside],
        reported=grids[0].reported[inside],
        notices=tuple(notices),
    )


def names_by_files(
    files: Sequence[Path], widths: Sequence[int], clocks: Sequence[int] = ()
) -> tuple[str, ...] | None:
    """Column names made of the files' names, as `positions[0]`; None where they do not say.

    Each file tells another quantity. Where files have a column of time each (`clocks`), those whose
    names say no quantity, or one that another says as well, are left out: their names are empty.
    """
    words = [quantity_word(file.stem) for file in files]
    quantities = [parse_name(word).quantity for word in words]
    told = [quantities.count(quantity) == 1 and quantity != "" for quantity in quantities]
    if not (any(told) if clocks else all(told)):
        return None
    names: list[str] = []
    for number, (word, width) in enumerate(zip(words, widths, strict=True)):
        count = width - bool(clocks)
        own = [word] if count == 1 else [f"{word}[{k}]" for k in range(count)]
        own = own if told[number] else [""] * count
        if clocks:
            own.insert(clocks[number], "time" if number == 0 else f"file{number}/time")
        names += own
    return tuple(names)


def are_one_run(files: Sequence[Path]) -> bool:
    """Whether files are the signals of one run: their names say positions and torques."""
    said = {parse_name(quantity_word(file.stem)).quantity for file in files}
    return "q" in said and bool(said & {"current", "effort"})


def quantity_word(stem: str) -> str:
    """The words of a file's stem that name a quantity; empty where none or several do."""
    words = [word for word in parse_name(stem.replace(".", "_")).base.split("_") if word]
    whole = "_".join(words)
    if quantity_of(whole):
        return whole
    if OTHER & set(words):
        return ""
    # A single letter beside other words is too little to tell by.
    found = [
        (j - i, text, meaning[0])
        for i, j in combinations(range(len(words) + 1), 2)
        for text in ("_".join(words[i:j]),)
        if len(text) > 1 and (meaning := quantity_of(text))
    ]
    best = {item for item in found if item[0] == max(found)[0]}
    if len({quantity for _, _, quantity in best}) != 1:
        return ""
    _, word, quantity = min(best)
    asked = TARGET & set(words) and quantity in TARGET_OF
    return f"desired_{word}" if asked and not word.startswith("desired") else word


_KEY = re.compile("(joint|axis|achse|axe)(_id|_index|_name|_number)?|signal")
"""The name of a column that says of which joint, or signal, a row is."""


def _widened(table: Dialect, folder: Path) -> Dialect:
    """A table of a row a joint (or signal) as a new file of a row a time, any other as it is.

    Raises:
        RecordError: There is not one row of each joint at most times.
    """
    names = table.names or ()
    keys = [k for k, name in enumerate(names) if _KEY.fullmatch(plainly(name))]
    clocks = [k for k, name in enumerate(names) if parse_name(name).quantity == "t"]
    if len(keys) != 1 or len(clocks) != 1:
        return table
    key, clock = keys[0], clocks[0]
    values = [k for k in range(table.width) if k not in (key, clock)]
    rows: dict[str, dict[str, str]] = {}
    labels: dict[str, int] = {}
    lines = chain.from_iterable(block for block, _ in line_blocks(table.path, table.encoding))
    for line in islice(lines, table.first_row, None):
        cells = split(table.row(line), table.delimiter)
        if len(cells) == table.width:
            label = cells[key].strip(" \"'")
            labels[label] = labels.get(label, 0) + 1
            rows.setdefault(cells[clock], {})[label] = "\t".join(cells[k] for k in values)
    found, given = sum(map(len, rows.values())), sum(labels.values())
    if found < given or 4 * found < len(rows) * len(labels):
        text = f"{names[clock]} does not say which rows of {names[key]} belong together"
        value = f"{given} rows of {len(labels)} at {len(rows)} times"
        raise RecordError(text, value=value, next_step="Write one row a time, a column a joint.")
    alone = len(values) == 1 and plainly(names[values[0]]) == "value"
    wide = [label if alone else f"{label}/{names[k]}" for label in labels for k in values]
    blank = "\t" * (len(values) - 1)
    cells = ([time, *(row.get(x, blank) for x in labels)] for time, row in rows.items())
    target = folder / table.path.name
    with target.open("w", encoding="utf-8") as file:
        file.writelines("\t".join(row) + "\n" for row in chain([[names[clock], *wide]], cells))
    return sniff(target, header=True, delimiter="\t")


_MAX_CHANNELS = 128
_MAX_CHANNEL_CELLS = 20_000_000


def read_csv(paths: list[Path], options: ReadOptions, budget: Budget) -> RawTable:
    """Read text tables, whose columns count across files side by side; see `Reader`.

    A file of one number a line that is k times as long as the shortest is read row by row as
    k columns. The format is `csv`, or `ur-csv` or `ur-rtde-csv`, which must have UR's header names;
    `auto` names it by the header.

    Raises:
        RecordError: No rows of numbers, columns that do not exist, or files whose rows do not
            belong together.
    """
    tables = [sniff(p, header=options.header, delimiter=options.delimiter) for p in paths]
    with tempfile.TemporaryDirectory(prefix="dynid-") as folder:
        if len(tables) == 1 and options.columns is None:
            budget.require_space(folder)
            tables = [_widened(tables[0], Path(folder))]
        return _read(tables, options)


def _read(tables: list[Dialect], options: ReadOptions) -> RawTable:
    joints, columns, format = options.joints, options.columns, options.format
    sheets = lay_side_by_side(tables, len(joints) or None)
    width = sum(sheet.width for sheet in sheets)
    names = _all_names(sheets)
    notes: tuple[str, ...] = tuple(
        f"{sheet.dialect.path.name}: one number a line, read row by row as {sheet.width} columns"
        for sheet in sheets
        if sheet.width > 1 and sheet.numbers is not None
    )
    clocks = own_clocks(sheets, names)
    if columns is None and len(sheets) > 1 and not _says_anything(names):
        files = [sheet.dialect.path for sheet in sheets]
        names = names_by_files(files, [sheet.width for sheet in sheets], clocks)
        if names is not None:
            unsaid = [file.name for file in files if not quantity_word(file.stem)]
            notes = (*notes, "the columns are named by their files")
            if unsaid:
                notes = (*notes, f"left out, as no quantities of joints: {', '.join(unsaid)}")
    if columns is None and names is None:
        raise _no_header(sheets, len(joints))
    found = assign(names, columns, width, joints)
    # What Universal Robots' RTDE recorders write.
    of_ur = {"timestamp", "actual_q_0"} <= set(names or ())
    if format == "auto":
        written = {" ": "ur-csv", ",": "ur-rtde-csv"}.get(sheets[0].dialect.delimiter, "csv")
        format = written if of_ur else "csv"
    elif format != "csv" and not of_ur:
        step = "Use --format csv, with --columns where needed."
        raise UnclearRecordError(f"the header is not that of a {format} file", next_step=step)
    times = {k for clock in found.clocks for k in clock.columns}
    main = {k for cols in found.columns.values() for k in cols}
    # The one clock there is must be sound on every row; of several, some may be empty.
    needed = main | times if len(found.clocks) == 1 else main
    extras = _channels(sheets, needed | times, names, width)
    wanted = sorted(needed | times | set(extras))
    soft = frozenset(wanted) - needed
    if clocks:
        notes = (*notes, "the files are aligned by their own times")
        ours = [sheet.first + clock for sheet, clock in zip(sheets, clocks, strict=True)]
        units = [parse_name(names[k]).time_scale if names else None for k in ours]
        pasted = align(sheets, clocks, wanted, soft, units)
    else:
        pasted = paste(sheets, wanted, soft)
    values = pasted.values
    position = {column: k for k, column in enumerate(wanted)}
    moments = sheets[0].dialect.stamps if len(sheets) == 1 else frozenset[int]()
    table = found.table(
        names,
        lambda k: values[:, position[k]],
        moments,
        # As `rostopic echo -p` writes them.
        beside=sheets[0].dialect.joint_names if len(sheets) == 1 else (),
        format=format,
        rows=pasted.rows,
        channels={name: values[:, position[k]] for k, name in extras.items()},
        reported=pasted.reported,
    )
    return replace(table, notices=(*table.notices, *pasted.notices), notes=(*notes, *table.notes))


def _says_anything(names: tuple[str, ...] | None) -> bool:
    """Whether some column's name is one of a quantity."""
    return names is not None and any(parse_name(name).meaning for name in names)


def _all_names(sheets: list[Sheet]) -> tuple[str, ...] | None:
    """Names of all columns; each file may have the time: that of the first is taken.

    Columns that every file has are told apart by the files' names, as of one file a joint.
    """
    each = [names for sheet in sheets if (names := sheet.dialect.names) is not None]
    if len(each) < len(sheets):
        return None
    shared = set(each[0]).intersection(*each[1:]) if len(each) > 1 else set[str]()
    if not _says_anything(tuple(shared)):
        shared.clear()
    found: list[str] = []
    for number, names in enumerate(each):
        for name in names:
            before = f"{sheets[number].dialect.path.stem}/" if name in shared else ""
            if parse_name(name).quantity == "t":
                before = f"file{number}/" if number > 0 and name in found else ""
            found.append(before + name)
    return tuple(found)


def _no_header(sheets: list[Sheet], joints: int) -> RecordError:
    for sheet in sheets:
        if sheet.dialect.header_cells:
            return UnclearRecordError(
                f"the header has {sheet.dialect.header_cells} names but the rows have "
                f"{sheet.dialect.width} cells",
                where=sheet.dialect.path.name,
                next_step="Repair the header, or name the columns by number with --columns.",
            )
    return UnclearRecordError(
        "there is no header that names the columns",
        value=f"{sum(sheet.width for sheet in sheets)} columns",
        next_step="Name them with --columns, for example "
        f"{example_columns(joints, velocity=True)} (currents [A]; torques are effort=).",
    )


def _channels(
    sheets: list[Sheet], taken: set[int], names: tuple[str, ...] | None, width: int
) -> dict[int, str]:
    """Columns kept as channels: numeric, named once, not mapped, and not too many."""
    if names is None or len(sheets) > 1:
        return {}
    numeric = sorted(sheets[0].dialect.numeric - taken)
    free = [k for k in numeric if names.count(names[k]) == 1]
    size = sheets[0].dialect.path.stat().st_size
    cells = size // max(6 * width, 1) * len(free)
    if len(free) > _MAX_CHANNELS or cells > _MAX_CHANNEL_CELLS:
        return {}
    return {k: names[k] for k in free if names[k]}
