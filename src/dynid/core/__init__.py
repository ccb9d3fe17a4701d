"""Errors, arrays, findings, provenance, optional dependencies, workers.

What needs NumPy or other processes is loaded when it is first used: `dynid --help` does without.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from dynid.core.errors import DynidError as DynidError
from dynid.core.errors import InputError as InputError
from dynid.core.errors import JobError as JobError
from dynid.core.errors import MissingExtraError as MissingExtraError
from dynid.core.errors import RecordError as RecordError
from dynid.core.errors import RobotError as RobotError
from dynid.core.errors import UnclearRecordError as UnclearRecordError
from dynid.core.errors import check_word as check_word
from dynid.core.errors import checked as checked
from dynid.core.errors import in_python as in_python
from dynid.core.errors import in_words as in_words
from dynid.core.errors import like_named as like_named
from dynid.core.errors import printable as printable
from dynid.core.errors import require as require
from dynid.core.files import Provenance as Provenance
from dynid.core.files import content_hash as content_hash
from dynid.core.files import dynid_version as dynid_version
from dynid.core.files import file_behind as file_behind
from dynid.core.files import file_hash as file_hash
from dynid.core.files import free_name as free_name
from dynid.core.files import in_one_piece as in_one_piece
from dynid.core.files import make_folder as make_folder
from dynid.core.files import provenance as provenance
from dynid.core.files import require_absent as require_absent
from dynid.core.files import write_json as write_json
from dynid.core.files import write_text as write_text
from dynid.core.findings import CODES as CODES
from dynid.core.findings import KINDS as KINDS
from dynid.core.findings import SEVERITIES as SEVERITIES
from dynid.core.findings import Finding as Finding
from dynid.core.findings import Progress as Progress
from dynid.core.findings import finding_from_json as finding_from_json
from dynid.core.findings import silent as silent
from dynid.core.findings import told as told

if TYPE_CHECKING:
    from dynid.core.arrays import SMALLEST as SMALLEST
    from dynid.core.arrays import Array as Array
    from dynid.core.arrays import Indices as Indices
    from dynid.core.arrays import Mask as Mask
    from dynid.core.arrays import MotionBounds as MotionBounds
    from dynid.core.arrays import Value as Value
    from dynid.core.arrays import freeze as freeze
    from dynid.core.arrays import frozen as frozen
    from dynid.core.arrays import inverse_upper as inverse_upper
    from dynid.core.arrays import one_thread as one_thread
    from dynid.core.arrays import read_arrays as read_arrays
    from dynid.core.arrays import read_only as read_only
    from dynid.core.arrays import scipy_part as scipy_part
    from dynid.core.arrays import solve_upper as solve_upper
    from dynid.core.arrays import upper_triangle as upper_triangle
    from dynid.core.arrays import write_arrays as write_arrays
    from dynid.core.json_fields import JsonFields as JsonFields
    from dynid.core.json_fields import load_object as load_object
    from dynid.core.json_fields import parse_json as parse_json
    from dynid.core.json_fields import plain as plain
    from dynid.core.json_fields import table as table
    from dynid.core.kernels import compiled as compiled
    from dynid.core.kernels import place_compiled as place_compiled
    from dynid.core.parallel import WorkerLost as WorkerLost
    from dynid.core.parallel import Workers as Workers
    from dynid.core.parallel import each as each
    from dynid.core.parallel import result_of as result_of
    from dynid.core.parallel import told_to_stop as told_to_stop
    from dynid.core.parallel import workers as workers

_LATER = {
    "arrays": (
        "Array Indices Mask MotionBounds SMALLEST Value freeze frozen inverse_upper one_thread "
        "read_arrays read_only scipy_part solve_upper upper_triangle write_arrays"
    ),
    "json_fields": "JsonFields load_object parse_json plain table",
    "kernels": "compiled place_compiled",
    "parallel": "WorkerLost Workers each result_of told_to_stop workers",
}
"""Module to the names of it that are loaded when they are first used."""


def __getattr__(name: str) -> Any:
    for module, names in _LATER.items():
        if name in names.split():
            globals()[name] = getattr(import_module(f"dynid.core.{module}"), name)
            return globals()[name]
    raise AttributeError(f"module 'dynid.core' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *" ".join(_LATER.values()).split()})
