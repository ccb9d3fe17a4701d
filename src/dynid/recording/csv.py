"""Text tables: UR `record.py` and ur_rtde logs, any CSV, several files of one run."""

from dataclasses import replace
from pathlib import Path

from dynid.core import RecordError
from dynid.recording.columns import assign
from dynid.recording.content import Budget
from dynid.recording.dialect import sniff
from dynid.recording.names import parse_name
from dynid.recording.sheets import (
    Sheet,
    align,
    lay_side_by_side,
    names_by_files,
    own_clocks,
    paste,
    quantity_word,
)
from dynid.recording.table import RawTable, ReadOptions

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
    joints, columns, format = options.joints, options.columns, options.format
    count = len(joints) or None
    sheets = lay_side_by_side(
        [sniff(p, header=options.header, delimiter=options.delimiter) for p in paths], count
    )
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
        raise _no_header(sheets)
    found = assign(names, columns, width, joints)
    # What Universal Robots' RTDE recorders write.
    of_ur = {"timestamp", "actual_q_0"} <= set(names or ())
    if format == "auto":
        written = {" ": "ur-csv", ",": "ur-rtde-csv"}.get(sheets[0].dialect.delimiter, "csv")
        format = written if of_ur else "csv"
    elif format != "csv" and not of_ur:
        raise RecordError(
            f"the header is not that of a {format} file",
            next_step="Use --format csv, with --columns where needed.",
        )
    times = {k for clock in found.clocks for k in clock.columns}
    main = {k for cols in found.columns.values() for k in cols}
    # The one clock there is must be sound on every row; of several, some may be empty.
    needed = main | times if len(found.clocks) == 1 else main
    extras = _channels(sheets, needed | times, names, width)
    wanted = sorted(needed | times | set(extras))
    soft = frozenset(wanted) - needed
    if clocks:
        notes = (*notes, "the files are aligned by their own times")
        pasted = align(sheets, clocks, wanted, soft)
    else:
        pasted = paste(sheets, wanted, soft)
    values = pasted.values
    position = {column: k for k, column in enumerate(wanted)}
    moments = sheets[0].dialect.stamps if len(sheets) == 1 else frozenset[int]()
    table = found.table(
        names,
        lambda k: values[:, position[k]],
        moments,
        format=format,
        rows=pasted.rows,
        channels={name: values[:, position[k]] for k, name in extras.items()},
        reported=pasted.reported,
    )
    return replace(
        table,
        joint_names=table.joint_names or _named_in_rows(sheets, len(found.columns["q"])),
        notices=(*table.notices, *pasted.notices),
        notes=(*notes, *table.notes),
    )


def _says_anything(names: tuple[str, ...] | None) -> bool:
    """Whether some column's name is one of a quantity."""
    return names is not None and any(parse_name(name).meaning for name in names)


def _named_in_rows(sheets: list[Sheet], joints: int) -> tuple[str, ...]:
    """Joint names that stand beside the values, as `rostopic echo -p` writes them."""
    names = sheets[0].dialect.joint_names if len(sheets) == 1 else ()
    return names if len(names) == joints and len(set(names)) == joints else ()


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
            if (parse_name(name).meaning or ("",))[0] == "t":
                before = f"file{number}/" if number > 0 and name in found else ""
            found.append(before + name)
    return tuple(found)


def _no_header(sheets: list[Sheet]) -> RecordError:
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
        value=f"{sum(sheet.width for sheet in sheets)} columns",
        next_step="Name them with --columns, for example t=0,q=1:7,qd=7:13,current=13:19.",
    )


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
