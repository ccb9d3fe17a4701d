"""The ground floor: errors, arrays, findings, provenance, optional dependencies.

What needs NumPy is loaded when it is first used: `dynid --help` does without.
"""

from typing import TYPE_CHECKING, Any

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
    content_hash,
    dynid_version,
    file_behind,
    file_hash,
    provenance,
    write_json,
    write_text,
)
from dynid.core.findings import (
    CODES,
    KINDS,
    Finding,
    Progress,
    finding_from_json,
    silent,
    told,
)

if TYPE_CHECKING:
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
    from dynid.core.json_fields import JsonFields, load_object, parse_json

__all__ = [
    "CODES",
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
    "content_hash",
    "dynid_version",
    "file_behind",
    "file_hash",
    "finding_from_json",
    "frozen",
    "installed",
    "inverse_upper",
    "load_object",
    "parse_json",
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


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'dynid.core' has no attribute {name!r}")
    from dynid.core import arrays, json_fields

    value = getattr(arrays if hasattr(arrays, name) else json_fields, name)
    globals()[name] = value
    return value
