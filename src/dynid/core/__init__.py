"""The ground floor: errors, arrays, findings, provenance, optional dependencies, workers.

What needs NumPy or other processes is loaded when it is first used: `dynid --help` does without.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from dynid.core.errors import (
    DynidError,
    InputError,
    JobError,
    MissingExtraError,
    RecordError,
    RobotError,
    check_word,
    installed,
    like_named,
    printable,
    require,
)
from dynid.core.files import (
    Provenance,
    cannot_write,
    content_hash,
    dynid_version,
    file_behind,
    file_hash,
    in_one_piece,
    make_folder,
    provenance,
    require_absent,
    write_json,
    write_text,
)
from dynid.core.findings import CODES, KINDS, Finding, Progress, finding_from_json, silent, told

if TYPE_CHECKING:
    from dynid.core.arrays import (
        Array,
        Indices,
        Mask,
        freeze,
        frozen,
        inverse_upper,
        read_only,
        scipy_part,
        solve_upper,
        upper_triangle,
    )
    from dynid.core.json_fields import (
        JsonFields,
        load_object,
        parse_json,
        plain,
        provenance_from_json,
    )
    from dynid.core.parallel import WorkerLost, Workers, each, result_of, told_to_stop, workers

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
    "WorkerLost",
    "Workers",
    "cannot_write",
    "check_word",
    "content_hash",
    "dynid_version",
    "each",
    "file_behind",
    "file_hash",
    "finding_from_json",
    "freeze",
    "frozen",
    "in_one_piece",
    "installed",
    "inverse_upper",
    "like_named",
    "load_object",
    "make_folder",
    "parse_json",
    "plain",
    "printable",
    "provenance",
    "provenance_from_json",
    "read_only",
    "require",
    "require_absent",
    "result_of",
    "scipy_part",
    "silent",
    "solve_upper",
    "told",
    "told_to_stop",
    "upper_triangle",
    "workers",
    "write_json",
    "write_text",
]

_LATER = {
    "arrays": (
        "Array", "Indices", "Mask", "freeze", "frozen", "inverse_upper", "read_only", "scipy_part",
        "solve_upper", "upper_triangle",
    ),
    "json_fields": ("JsonFields", "load_object", "parse_json", "plain", "provenance_from_json"),
    "parallel": ("WorkerLost", "Workers", "each", "result_of", "told_to_stop", "workers"),
}  # fmt: skip


def __getattr__(name: str) -> Any:
    module = next((module for module, names in _LATER.items() if name in names), None)
    if module is None:
        raise AttributeError(f"module 'dynid.core' has no attribute {name!r}")
    value = getattr(import_module(f"dynid.core.{module}"), name)
    globals()[name] = value
    return value
