"""The ground floor: errors, arrays, notices, provenance, optional dependencies."""

from dynid.core.arrays import (
    Array,
    Indices,
    Mask,
    frozen,
    inverse_upper,
    read_only,
    solve_upper,
    upper_triangle,
)
from dynid.core.errors import (
    DynidError,
    InputError,
    JobError,
    MissingExtraError,
    RecordError,
    RobotError,
    installed,
    require,
)
from dynid.core.files import (
    Provenance,
    cannot_write,
    file_behind,
    file_hash,
    provenance,
    write_json,
    write_text,
)
from dynid.core.findings import Notice, Progress, silent
from dynid.core.json_fields import JsonFields, load_object

__all__ = [
    "Array",
    "DynidError",
    "Indices",
    "InputError",
    "JobError",
    "JsonFields",
    "Mask",
    "MissingExtraError",
    "Notice",
    "Progress",
    "Provenance",
    "RecordError",
    "RobotError",
    "cannot_write",
    "file_behind",
    "file_hash",
    "frozen",
    "installed",
    "inverse_upper",
    "load_object",
    "provenance",
    "read_only",
    "require",
    "silent",
    "solve_upper",
    "upper_triangle",
    "write_json",
    "write_text",
]
