"""MATLAB files up to version 7, with nested structs by their paths (`rec.act_pos`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from dynid.core import RecordError
from dynid.recording.matlab import byte_order, parse_matlab
from dynid.recording.opening import all_bytes
from dynid.recording.table import RawTable
from dynid.recording.variables import table_of

_MAX_BYTES = 4 << 30
_PLAIN = "Save plain arrays in MATLAB: t = ts.Time; q = ts.Data; save(file, 't', 'q', '-v7')."
_SAVE = "Save it again in MATLAB with: save(file, '-v7')."


def read_mat(
    path: Path,
    *,
    columns: str | Mapping[str, str] | None = None,
    joints: int | None = None,
    names: Sequence[str] = (),
) -> RawTable:
    """Read a MATLAB file of version 5 to 7.

    Args:
        path: The file.
        columns: Quantity to variable path, as in `q=rec.act_pos,t=rec.time`; None to go by
            the names.
        joints: Number of joints, if known.
        names: The robot's joint names, if known.

    Raises:
        RecordError: Another version, damaged, or without the variables.
    """
    data = all_bytes(path, _MAX_BYTES)
    order = byte_order(data)
    if order is None:
        raise RecordError(
            "this is no MATLAB file of version 5 to 7", where=path.name, next_step=_SAVE
        )
    contents = parse_matlab(data, order)
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
        table = table_of(
            contents.arrays, columns, joints=joints, where=path.name, format="mat", names=names
        )
    except RecordError as error:
        if contents.objects and not harm:
            raise RecordError(
                f"{error.what}; {contents.objects} variables are timeseries or tables, which only "
                "MATLAB can read",
                where=path.name,
                value=error.value,
                next_step=_PLAIN,
            ) from error
        if not harm:
            raise
        raise RecordError(
            "the MATLAB file is damaged", where=path.name, value=f"{harm}; {error}", next_step=_SAVE
        ) from error
    if contents.cut:
        table = table.report("truncated_file", f"{path.name} is cut off: what precedes is taken")
    if contents.damaged:
        table = table.report("corrupt_rows", f"{path.name}: damaged variables left out: {harm}")
    return table
