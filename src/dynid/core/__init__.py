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
from dynid.core.findings import (
    KINDS,
    Finding,
    Progress,
    finding_from_json,
    silent,
    told,
)
from dynid.core.json_fields import JsonFields, load_object

__all__ = [
    "KINDS",
    "Array",
    "DynidError",
    "Finding",
    "Indices",
    "InputError",
    "JobError",
    "JsonFields",
    "Mask",
    "MissingExtraError",
    "Progress",
    "Provenance",
    "RecordError",
    "RobotError",
    "cannot_write",
    "file_behind",
    "file_hash",
    "finding_from_json",
    "frozen",
    "installed",
    "inverse_upper",
    "load_object",
    "provenance",
    "read_only",
    "require",
    "silent",
    "solve_upper",
    "told",
    "upper_triangle",
    "write_json",
    "write_text",
]
