"""The identified model as a JSON object: every number with its name and unit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.export.model import ExportModel
from dynid.regressor.ripple import ripples_from_json
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
    "Fl": "1: a share of the load's torque",
    "Fw": "1: a share of the ripple, whose coefficients are N.m, N where the joint slides",
}
_FORMULAS = {
    "step": "tanh(dq / coulomb_width), the sign of dq where the width is 0",
    "Fc, Fv, Im, Fo": "step, dq, ddq, 1",
    "Fca, Fva": "|step|, |dq|",
    "Fs": "exp(-(dq / stribeck_velocity)^2) step",
    "Fr": "sign(dq) |dq|^(1/3)",
    "Fcm, Fvm, Imm": "as Fc, Fv, Im, with the speed of a coupled motor, turns_per_joint_turn times "
    "dq; on the joints through the same turns",
    "Fl": "|load| step; load: inverse dynamics of the links in `load`, less the torque of "
    "counterbalances",
    "Fw": "ripple; for each gear, wave and power k from 0 of s = dq / speed of the gear's joint, "
    "within -1 and 1: s^k cos(wave q), s^k sin(wave q), times the coefficients in this order",
}
"""What each term multiplies; the torque of a joint is the sum."""


def model_to_json(model: ExportModel) -> dict[str, Any]:
    """The object; `model_from_json` reads it back."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "units": _UNITS,
        "formulas": _FORMULAS,
        "origin": model.origin,
        "physical": model.physical,
        "worst": model.worst,
        "links": _links(model, model.inertials),
        "terms": {symbol: values.tolist() for symbol, values in model.terms.items()},
        "coulomb_width": model.width.tolist(),
        "stribeck_velocity": model.stribeck_velocity,
        "coupled_motors": [
            {"motor": motor + 1, "turns_per_joint_turn": share}
            for motor, share in zip(model.motors, model.shares.tolist(), strict=True)
        ],
        "load": None if model.load is None else _links(model, model.load),
        "ripples": [ripple.to_json() for ripple in model.ripples],
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
        # Files of before there was friction by load have neither key.
        load = data.get("load")
        motors: list[dict[str, Any]] = data["coupled_motors"]
        return ExportModel(
            robot=robot,
            inertials=_rows(data["links"]),
            terms={str(symbol): np.array(values) for symbol, values in data["terms"].items()},
            width=np.array(data["coulomb_width"]),
            stribeck_velocity=float(data["stribeck_velocity"]),
            shares=np.array([one["turns_per_joint_turn"] for one in motors]).reshape(
                -1, robot.joints
            ),
            motors=tuple(int(one["motor"]) - 1 for one in motors),
            load=None if load is None else _rows(load),
            ripples=ripples_from_json(data.get("ripples")),
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


def _links(model: ExportModel, rows: Array) -> list[dict[str, Any]]:
    return [
        {"joint": name, **dict(zip(PARAMETERS, row, strict=True))}
        for name, row in zip(model.robot.joint_names, rows.tolist(), strict=True)
    ]


def _rows(links: list[Mapping[str, Any]]) -> Array:
    return np.array([[float(link[name]) for name in PARAMETERS] for link in links])
