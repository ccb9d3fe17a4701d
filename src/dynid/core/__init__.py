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
    free_name,
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
        read_arrays,
        read_only,
        scipy_part,
        solve_upper,
        upper_triangle,
        write_arrays,
    )
    from dynid.core.bounds import MotionBounds
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
    "MotionBounds",
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
    "free_name",
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
    "read_arrays",
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
    "write_arrays",
    "write_json",
    "write_text",
]

_LATER = ("arrays", "bounds", "json_fields", "parallel")


def __getattr__(name: str) -> Any:
    for module in _LATER if name in __all__ else ():
        found = vars(import_module(f"dynid.core.{module}"))
        if name in found:
            globals()[name] = found[name]
            return found[name]
    raise AttributeError(f"module 'dynid.core' has no attribute {name!r}")
