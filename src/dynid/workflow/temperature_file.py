"""Temperature laws as files: an estimate's file with one more object, `temperature`.

Whatever reads estimates reads it, as the estimate in the middle of the records' temperatures.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dynid.core.errors import InputError
from dynid.core.files import write_json
from dynid.core.notices import Notice
from dynid.identification.estimate import Estimate
from dynid.identification.estimate_file import estimate_to_json, read_estimate
from dynid.identification.temperature import JointTemperatureLaw
from dynid.trajectory.json_fields import JsonFields, load_object
from dynid.workflow.temperature import TemperatureIdentification
from dynid.workflow.temperature_model import TemperatureModel

KEY = "temperature"


def write_temperature(
    found: TemperatureIdentification | TemperatureModel, path: str | Path
) -> None:
    """Write what `identify_temperature` found; it appears whole or not at all.

    Args:
        found: The laws, and the inertias that go with them.
        path: The JSON file. `read_estimate`, `dynid validate`, `export`, `report` and `compare`
            take it as the estimate in the middle of the records' temperatures.

    Raises:
        InputError: A place where no such file can be.
        JobError: The disk does not take it.
    """
    model = found.model if isinstance(found, TemperatureIdentification) else found
    middle = model.estimate_at(model.reference_degC)
    write_json(Path(path), {**estimate_to_json(middle), KEY: _to_json(model)})


def read_temperature(path: str | Path) -> TemperatureModel:
    """Read what `write_temperature` wrote.

    Args:
        path: The JSON file.

    Raises:
        InputError: No such file, not an estimate, one without temperature laws, or damaged.
    """
    estimate = read_estimate(path)
    fields = load_object(path)
    if KEY not in fields.values:
        raise InputError(
            "an estimate without temperature laws",
            where=str(path),
            next_step="Make one in Python: dynid.identify_temperature, dynid.write_temperature.",
        )
    try:
        return _model(estimate, fields.object(KEY))
    except InputError as error:
        raise InputError(error.what, where=str(path), value=error.value) from error


def estimate_at(path: str | Path, temperature_degC: float | None) -> Estimate:
    """The estimate of a file, for one temperature of all joints where it is asked for [degC].

    Raises:
        InputError: As `read_estimate`, and as `read_temperature` where a temperature is given.
    """
    if temperature_degC is None:
        return read_estimate(path)
    return read_temperature(path).estimate_at(temperature_degC)


def _to_json(model: TemperatureModel) -> dict[str, Any]:
    return {
        "temperature_degC": model.temperature_degC.tolist(),
        "laws": [
            {
                "symbols": list(law.symbols),
                "law": law.law,
                "reference": law.reference.tolist(),
                "slope": law.slope.tolist(),
                "covariance": law.covariance.tolist(),
                "gain": law.gain.tolist(),
                "reference_degC": law.reference_degC,
                "range_degC": list(law.range_degC),
                "chi_squared": law.chi_squared,
                "places": list(places),
                "seen": list(seen),
            }
            for law, places, seen in zip(model.laws, model.places, model.seen, strict=True)
        ],
        "order": list(model.order),
        "covariance": model.covariance.tolist(),
        "naive": model.naive.tolist(),
        "warnings": [notice.to_json() for notice in model.warnings],
    }


def _model(estimate: Estimate, fields: JsonFields) -> TemperatureModel:
    laws = fields.objects("laws")
    covariance, naive = fields.matrix("covariance"), fields.matrix("naive")
    size, joints, rank = len(covariance), len(laws), len(estimate.values)
    _agree(covariance.shape == naive.shape == (size, size) and size >= rank, "covariance")
    order = _indices(fields, "order", size)
    _agree(joints == estimate.model.robot.joints, "laws")
    _agree(len(order) == rank, "order")
    places = tuple(_indices(one, "places", rank) for one in laws)
    seen = tuple(_indices(one, "seen", size) for one in laws)
    temperature = fields.matrix("temperature_degC")
    _agree(temperature.shape[1] == joints, "temperature_degC")
    return TemperatureModel(
        estimate=estimate,
        laws=tuple(_law(one, len(p), len(s)) for one, p, s in zip(laws, places, seen, strict=True)),
        temperature_degC=temperature,
        places=places,
        seen=seen,
        order=order,
        covariance=covariance,
        naive=naive,
        warnings=tuple(
            Notice(one.text("code"), one.text("message")) for one in fields.objects("warnings")
        ),
    )


def _law(fields: JsonFields, count: int, seen: int) -> JointTemperatureLaw:
    symbols, low_high = fields.get("symbols"), fields.vector("range_degC")
    _agree(isinstance(symbols, list) and len(low_high) == 2, "laws")
    law = JointTemperatureLaw(
        symbols=tuple(str(symbol) for symbol in fields.values["symbols"]),
        law=fields.text("law"),
        reference=fields.vector("reference"),
        slope=fields.vector("slope"),
        # A joint without friction has empty matrices.
        covariance=fields.matrix("covariance") if count else np.zeros((0, 0)),
        gain=fields.matrix("gain") if count else np.zeros((0, seen)),
        reference_degC=fields.number("reference_degC"),
        range_degC=(float(low_high[0]), float(low_high[1])),
        chi_squared=fields.number("chi_squared"),
    )
    _agree(len(law.symbols) == len(law.reference) == len(law.slope) == count, "laws")
    _agree(law.covariance.shape == (2 * count, 2 * count), "laws")
    _agree(law.gain.shape == (2 * count, seen), "laws")
    return law


def _indices(fields: JsonFields, name: str, size: int) -> tuple[int, ...]:
    found = fields.vector(name)
    _agree(bool(((found >= 0) & (found < size) & (found % 1 == 0)).all()), name)
    return tuple(int(index) for index in found)


def _agree(holds: bool, name: str) -> None:
    if not holds:
        raise InputError(f"the temperature laws are damaged: {name}")
