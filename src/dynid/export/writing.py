"""One identified model to one file, and the proof that the file gives its torques."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import InputError, JobError
from dynid.core.files import cannot_write, file_behind
from dynid.export import mjcf, urdf
from dynid.export.c_code import c_code, c_prefix
from dynid.export.json_model import model_from_json, model_to_json
from dynid.export.load_code import c_torque, python_torque
from dynid.export.load_models import mjcf_torque, urdf_torque
from dynid.export.model import ExportModel, completed_model
from dynid.export.nearest_friction import NearestFriction, nearest_friction
from dynid.export.python_code import python_code
from dynid.export.robot_xml import left_out, stand_in_words
from dynid.export.verification import States, Verification, our_torque, random_motion
from dynid.identification.estimate import Estimate

FORMATS = ("urdf", "mjcf", "json", "c", "python")
SUFFIXES = {"urdf": ".urdf", "mjcf": ".xml", "json": ".json", "c": ".h", "python": ".py"}
_HELD = {"urdf": urdf.HELD, "mjcf": mjcf.HELD}
_TOLERANCE = {"mjcf": 1e-6}
_EXACT = 1e-9
"""Difference that rounding may make [N.m or N], for torques up to a few hundred."""
_LARGE = 100.0
"""Torques above this may differ in proportion [N.m or N]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedFile:
    """What was written."""

    path: Path
    """The file."""
    model: ExportModel
    """What it holds."""
    verified: Verification
    """What another program made of it."""
    left_out: tuple[str, ...]
    """What the identified model has and the file has no place for, in words."""
    friction: NearestFriction | None = None
    """Coulomb and viscous friction of a file that has a place for no other."""


def write_model(estimate: Estimate, to: str, path: str | Path, note: str = "") -> ExportedFile:
    """Write a model, have another program load it, and compare torques on random states.

    The file appears only after it has passed. Where no other program is at hand it is written
    all the same, and `verified` says so.

    Args:
        estimate: What was identified.
        to: One of `FORMATS`.
        path: File to write.
        note: Where the model comes from, for the file's head.

    Raises:
        InputError: An unknown format, or a place where no such file can be.
        JobError: A model that the format cannot hold, torques that differ, or a disk that does
            not take the file.
    """
    if to not in FORMATS:
        raise InputError("unknown format", where="--to", value=to, limit=", ".join(FORMATS))
    path = Path(path)
    place = file_behind(path)
    model, completed = completed_model(estimate)
    states = random_motion(model.joints, model.robot.prismatic)
    held = _HELD.get(to)
    friction = None if held is None else nearest_friction(estimate, completed, model)
    ours = our_torque(estimate, completed, states, held, friction)
    model = model if friction is None else friction.put_into(model)
    remarks = [note, f"Standard parameters: {model.origin}.", *stand_in_words(friction)]
    text = _text(model, to, "\n".join(remarks).strip())
    # Names the process, ends as the format wants it: loaders look at the suffix.
    part = place.with_name(f".{path.stem}.{os.getpid()}{SUFFIXES[to]}")
    try:
        part.write_text(text, encoding="utf-8")
        theirs, loader = _torque(model, to, part, states)
        verified = _compared(to, ours, theirs, loader)
        if verified.max_torque_difference is not None and not verified.passed:
            raise JobError(
                "the file's torques differ from ours",
                where=str(path),
                value=verified.max_torque_difference,
                limit=verified.tolerance,
            )
        part.replace(place)
    except OSError as error:
        raise cannot_write(path, error) from error
    finally:
        part.unlink(missing_ok=True)
    missing = () if held is None else left_out(model, held)
    return ExportedFile(
        path=path, model=model, verified=verified, left_out=missing, friction=friction
    )


def _text(model: ExportModel, to: str, note: str) -> str:
    match to:
        case "urdf":
            return urdf.urdf_text(model, note)
        case "mjcf":
            return mjcf.mjcf_text(model, note)
        case "c":
            return c_code(model, note)
        case "python":
            return python_code(model, note)
        case _:
            data = {**model_to_json(model), "note": note}
            return json.dumps(data, indent=1, allow_nan=False) + "\n"


def _torque(model: ExportModel, to: str, path: Path, states: States) -> tuple[Array | None, str]:
    match to:
        case "urdf":
            return urdf_torque(path, float(np.linalg.norm(model.robot.gravity)), states)
        case "mjcf":
            return mjcf_torque(path, states)
        case "c":
            return c_torque(path, c_prefix(model.robot.name), states)
        case "python":
            return python_torque(path, states)
        case _:
            # Read back from the file, and evaluated by code that has only the file's numbers.
            read = model_from_json(json.loads(path.read_text(encoding="utf-8")))
            code = path.with_suffix(".py")
            try:
                code.write_text(python_code(read), encoding="utf-8")
                return python_torque(code, states)
            finally:
                code.unlink(missing_ok=True)


def _compared(to: str, ours: Array, theirs: Array | None, loader: str) -> Verification:
    scale = max(1.0, float(np.abs(ours).max()) / _LARGE)
    tolerance = _TOLERANCE.get(to, _EXACT) * scale
    if theirs is None:
        return Verification(max_torque_difference=None, tolerance=tolerance, loaded_with=loader)
    if theirs.shape != ours.shape:
        raise JobError("the file has other joints", value=theirs.shape, limit=ours.shape)
    worst = float(np.abs(theirs - ours).max())
    return Verification(max_torque_difference=worst, tolerance=tolerance, loaded_with=loader)
