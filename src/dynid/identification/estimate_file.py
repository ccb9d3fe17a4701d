"""Estimates as JSON files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dynid.core.errors import InputError
from dynid.core.files import write_json
from dynid.core.notices import Notice
from dynid.core.provenance import Provenance
from dynid.identification.estimate import Estimate, MotionRange, StandardParameters
from dynid.regressor.model import InverseDynamicModel
from dynid.regressor.terms import terms_from_json
from dynid.robot.serial import robot_from_json, robot_to_json
from dynid.signals.samples import ProcessingSettings
from dynid.signals.torque_filter import TorqueFilter
from dynid.trajectory.json_fields import load_object

FORMAT = "dynid-estimate"
VERSION = 1
MAX_BYTES = 64 << 20


def estimate_to_json(estimate: Estimate) -> dict[str, Any]:
    """A JSON object from which the estimate can be read back."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "estimator": estimate.estimator,
        "preset": estimate.preset,
        "base_parameters": len(estimate.values),
        "standard_parameters": len(estimate.model.columns),
        "condition_number": estimate.condition_number,
        "scaled_condition_number": estimate.scaled_condition_number,
        "motion_condition_number": estimate.motion_condition_number,
        "samples": estimate.samples,
        "degrees_of_freedom": estimate.degrees_of_freedom,
        "frames": estimate.model.frames,
        "friction": estimate.model.friction.to_json(),
        "independent": list(estimate.independent),
        "parameters": estimate.parameter_table(),
        "covariance": estimate.covariance.tolist(),
        "noise": estimate.noise.tolist(),
        "residual_autocorrelation": estimate.residual_autocorrelation.tolist(),
        "motion": {
            "lower": estimate.motion.lower.tolist(),
            "upper": estimate.motion.upper.tolist(),
            "speed": estimate.motion.speed.tolist(),
            "acceleration": estimate.motion.acceleration.tolist(),
        },
        "settings": estimate.settings.to_json(),
        "choices": list(estimate.choices),
        "warnings": [notice.to_json() for notice in estimate.warnings],
        "provenance": estimate.provenance.to_json(),
        "robot": robot_to_json(estimate.model.robot),
        **_standard_to_json(estimate),
    }


def _standard_to_json(estimate: Estimate) -> dict[str, Any]:
    table = estimate.standard_table()
    return {} if table is None else {"standard": table}


def write_estimate(estimate: Estimate, path: Path | str) -> None:
    """Write an estimate as JSON.

    Raises:
        InputError: A place where no such file can be.
        JobError: The disk does not take it.
    """
    write_json(Path(path), estimate_to_json(estimate))


def read_estimate(path: Path | str) -> Estimate:
    """Read an estimate written by `write_estimate`.

    Raises:
        InputError: No such file, not an estimate, or damaged.
    """
    where = str(path)
    try:
        source = Path(path)
        if source.stat().st_size > MAX_BYTES:
            raise InputError("too large for an estimate", where=where, limit=f"{MAX_BYTES} bytes")
    except OSError as error:
        raise InputError(
            f"the file cannot be read: {error.strerror or error}", where=where
        ) from error
    except ValueError as error:
        raise InputError("this can be no file's name", where=where) from error
    data = dict(load_object(source).values)
    if data.get("format") != FORMAT:
        found = data.get("kind") or data.get("format")
        raise InputError(
            "not a dynid estimate",
            where=where,
            value=found,
            next_step="Make one with: dynid identify RECORD -o ESTIMATE.json",
        )
    try:
        return _estimate(data)
    except InputError as error:
        raise InputError(str(error), where=where) from error
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        raise InputError(
            "the estimate is damaged", where=where, value=f"{type(error).__name__}: {error}"
        ) from error


def _estimate(data: dict[str, Any]) -> Estimate:
    if data["version"] != VERSION:
        raise InputError("unknown version of the file", value=data["version"], limit=VERSION)
    settings = dict(data["settings"])
    if settings["delays_s"] is not None:
        settings["delays_s"] = tuple(float(d) for d in settings["delays_s"])
    if settings.get("torque_filter") is not None:
        settings["torque_filter"] = TorqueFilter(**settings["torque_filter"])
    table: list[dict[str, Any]] = data["parameters"]
    motion = data["motion"]
    made = data["provenance"]
    return Estimate(
        model=InverseDynamicModel(
            robot=robot_from_json(data["robot"]),
            frames=str(data["frames"]),
            friction=terms_from_json(data["friction"]),
        ),
        independent=tuple(int(i) for i in data["independent"]),
        expressions=tuple(str(row["expression"]) for row in table),
        values=np.array([row["value"] for row in table], dtype=np.float64),
        covariance=np.array(data["covariance"], dtype=np.float64),
        naive_std=np.array([row["std_naive"] for row in table], dtype=np.float64),
        noise=np.array(data["noise"], dtype=np.float64),
        condition_number=float(data["condition_number"]),
        scaled_condition_number=float(data["scaled_condition_number"]),
        motion_condition_number=float(data["motion_condition_number"]),
        samples=int(data["samples"]),
        estimator=str(data["estimator"]),
        preset=str(data["preset"]),
        settings=ProcessingSettings(**settings),
        essential=tuple(k for k, row in enumerate(table) if row["essential"]),
        motion=MotionRange(
            lower=np.array(motion["lower"], dtype=np.float64),
            upper=np.array(motion["upper"], dtype=np.float64),
            speed=np.array(motion["speed"], dtype=np.float64),
            acceleration=np.array(motion["acceleration"], dtype=np.float64),
        ),
        choices=tuple(str(text) for text in data["choices"]),
        warnings=tuple(Notice(str(w["code"]), str(w["message"])) for w in data["warnings"]),
        provenance=Provenance(
            created=str(made["created"]),
            versions=dict(made["versions"]),
            inputs=dict(made["inputs"]),
            settings=dict(made["settings"]),
            seed=made["seed"],
        ),
        residual_autocorrelation=np.array(data["residual_autocorrelation"], dtype=np.float64),
        standard=_standard(data.get("standard")),
    )


def _standard(rows: list[dict[str, Any]] | None) -> StandardParameters | None:
    """Files of estimators without standard parameters, and older files, have none."""
    if rows is None:
        return None
    return StandardParameters(
        values=np.array([row["value"] for row in rows], dtype=np.float64),
        std=np.array([row["std"] for row in rows], dtype=np.float64),
        prior_share=np.array([row["prior_share"] for row in rows], dtype=np.float64),
        prior=np.array(
            [np.nan if row["prior"] is None else row["prior"] for row in rows], dtype=np.float64
        ),
        origins=tuple(str(row["from"]) for row in rows),
    )
