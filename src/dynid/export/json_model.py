"""The identified model as a JSON object: every number with its name and unit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from dynid.core.errors import InputError
from dynid.export.model import ExportModel
from dynid.robot.inertia import PARAMETERS
from dynid.robot.serial import robot_from_json, robot_to_json

FORMAT = "dynid-model"
VERSION = 1
_UNITS = {
    "m": "kg",
    "mx, my, mz": "kg.m",
    "J": "kg.m^2, about the joint frame",
    "Fc, Fo, Fca, Fs, Fcm": "N.m, N where the joint slides",
    "Fv, Fva, Fvm": "N.m.s/rad, N.s/m where the joint slides",
    "Fr": "N.m.(s/rad)^(1/3), N.(s/m)^(1/3) where the joint slides",
    "Im, Imm": "kg.m^2, kg where the joint slides",
}


def model_to_json(model: ExportModel) -> dict[str, Any]:
    """The object; `model_from_json` reads it back."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "units": _UNITS,
        "origin": model.origin,
        "physical": model.physical,
        "worst": model.worst,
        "links": [
            {"joint": name, **dict(zip(PARAMETERS, row, strict=True))}
            for name, row in zip(model.robot.joint_names, model.inertials.tolist(), strict=True)
        ],
        "terms": {symbol: values.tolist() for symbol, values in model.terms.items()},
        "coulomb_width": model.width.tolist(),
        "stribeck_velocity": model.stribeck_velocity,
        "coupled_motors": [
            {"motor": motor + 1, "turns_per_joint_turn": share}
            for motor, share in zip(model.motors, model.shares.tolist(), strict=True)
        ],
        "robot": robot_to_json(model.robot),
    }


def model_from_json(data: Mapping[str, Any]) -> ExportModel:
    """The model of an object that `model_to_json` made.

    Raises:
        InputError: Not such an object, or a damaged one.
    """
    if data.get("format") != FORMAT or data.get("version") != VERSION:
        raise InputError(
            "not a dynid model",
            value=(data.get("format"), data.get("version")),
            limit=(FORMAT, VERSION),
        )
    try:
        robot = robot_from_json(data["robot"])
        motors: list[dict[str, Any]] = data["coupled_motors"]
        return ExportModel(
            robot=robot,
            inertials=np.array(
                [[float(link[name]) for name in PARAMETERS] for link in data["links"]]
            ),
            terms={str(symbol): np.array(values) for symbol, values in data["terms"].items()},
            width=np.array(data["coulomb_width"]),
            stribeck_velocity=float(data["stribeck_velocity"]),
            shares=np.array([one["turns_per_joint_turn"] for one in motors]).reshape(
                -1, robot.joints
            ),
            motors=tuple(int(one["motor"]) - 1 for one in motors),
            physical=bool(data["physical"]),
            worst=str(data["worst"]),
            origin=str(data["origin"]),
        )
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            "the model is damaged", value=f"{type(error).__name__}: {error}"
        ) from error
