"""An estimate for any joint temperatures, and its file; an estimate from whatever holds one.

Temperature laws stand in an estimate's file as one more object, `temperature`: whatever reads
estimates reads it, as the estimate in the middle of the records' temperatures.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import (
    Array,
    Finding,
    InputError,
    JsonFields,
    finding_from_json,
    freeze,
    frozen,
    load_object,
    plain,
    write_json,
)
from dynid.identification.estimate import Estimate, estimate_to_json, read_estimate
from dynid.identification.temperature import JointTemperatureLaw

BEYOND_K = 2.0
"""How far outside the records' temperatures a friction may be asked for without a word [K]."""
CHOICE = "friction at "
"""How the choice of temperatures begins, among an estimate's choices."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TemperatureModel:
    """What is needed to give an estimate for any temperatures; `write_temperature` keeps it.

    Raises:
        InputError: Shapes that disagree.
    """

    estimate: Estimate
    """One estimate with the shared inertias; its friction is of no account."""
    laws: tuple[JointTemperatureLaw, ...]
    """One a joint."""
    temperature_degC: Array
    """(R, n) mean joint temperatures of the records [degC]."""
    places: tuple[tuple[int, ...], ...]
    """For each joint, which base parameters are its friction, in its law's order."""
    seen: tuple[tuple[int, ...], ...]
    """For each joint, where the records' friction stands in the covariance, record by record."""
    order: tuple[int, ...]
    """(r) where the base parameters stand in the covariance."""
    covariance: Array
    """(P, P) of the inertias and of every record's own parameters."""
    naive: Array
    """(P, P) the same as if residuals were not correlated in time."""
    warnings: tuple[Finding, ...] = ()
    """Findings of the identification."""

    def __post_init__(self) -> None:
        joints, size = self.estimate.model.robot.joints, len(self.covariance)
        freeze(self, temperature_degC=(None, joints), covariance=(size, size), naive=(size, size))
        if len(self.laws) != joints:
            raise InputError("laws: needs one a joint", value=len(self.laws), limit=joints)
        shapes = [(len(law.symbols), law.gain.shape[1]) for law in self.laws]
        if shapes != [(len(p), len(s)) for p, s in zip(self.places, self.seen, strict=True)]:
            raise InputError("laws: their shapes disagree with places and seen", value=shapes)
        if len(self.order) != len(self.estimate.values):
            raise InputError("order: needs one place a parameter", value=len(self.order))

    @property
    def reference_degC(self) -> Array:
        """(n) temperatures in the middle of the records [degC]."""
        return np.array([law.reference_degC for law in self.laws])

    def estimate_at(self, temperature_degC: ArrayLike) -> Estimate:
        """The estimate for joint temperatures: it predicts, validates and exports as any other.

        Args:
            temperature_degC: One temperature, or (n) one a joint [degC].

        Raises:
            InputError: Another number of joints, or temperatures that are no numbers.
        """
        joints = len(self.laws)
        wanted = np.asarray(temperature_degC, dtype=np.float64)
        if wanted.shape not in ((), (joints,)) or not np.isfinite(wanted).all():
            said, limit = "needs one temperature, or one a joint", f"{joints} joints"
            raise InputError(said, value=temperature_degC, limit=limit)
        wanted = np.broadcast_to(wanted, (joints,))
        known = self.estimate
        values, turn = known.values.copy(), np.zeros((len(self.order), len(self.covariance)))
        turn[np.arange(len(self.order)), self.order] = 1.0
        for degC, law, places, seen in zip(
            wanted.tolist(), self.laws, self.places, self.seen, strict=True
        ):
            values[list(places)], sensitivity = law.at(degC)
            turn[list(places)] = 0.0
            turn[np.ix_(places, seen)] = sensitivity @ law.gain
        covariance, naive = (turn @ c @ turn.T for c in (self.covariance, self.naive))
        choices = [choice for choice in known.choices if not choice.startswith(CHOICE)]
        return replace(
            known,
            values=values,
            covariance=covariance,
            naive_std=np.sqrt(np.maximum(np.diag(naive), 0.0)),
            choices=(*choices, f"{CHOICE}{' '.join(f'{x:.3g}' for x in wanted)} degC"),
            warnings=_beyond(self.laws, wanted.tolist()),
        )


def _beyond(laws: Sequence[JointTemperatureLaw], wanted: Sequence[float]) -> tuple[Finding, ...]:
    """A word about temperatures [degC] that the records did not have; nothing if they had."""
    far = [
        f"joint {j + 1} at {degC:.3g} degC (records: {law.range_degC[0]:.3g} to "
        f"{law.range_degC[1]:.3g})"
        for j, (degC, law) in enumerate(zip(wanted, laws, strict=True))
        if not law.range_degC[0] - BEYOND_K <= degC <= law.range_degC[1] + BEYOND_K
    ]
    if not far:
        return ()
    return (Finding("extrapolated", f"temperatures beyond the records: {', '.join(far)}"),)


KEY = "temperature"
_NO_LAWS = "an estimate without temperature laws"
_MAKE = "Make one in Python: dynid.identify_temperature, dynid.write_temperature."


def write_temperature(found: TemperatureModel, path: str | Path) -> None:
    """Write what `identify_temperature` found; it appears whole or not at all.

    Args:
        found: The laws, and the inertias that go with them.
        path: The JSON file. `read_estimate`, `dynid validate`, `export`, `report` and `compare`
            take it as the estimate in the middle of the records' temperatures.

    Raises:
        InputError: A place where no such file can be.
        JobError: The disk does not take it.
    """
    middle = found.estimate_at(found.reference_degC)
    write_json(Path(path), {**estimate_to_json(middle), KEY: _to_json(found)})


def read_temperature(path: str | Path) -> TemperatureModel:
    """Read the JSON file that `write_temperature` wrote.

    Raises:
        InputError: No such file, not an estimate, one without temperature laws, or damaged.
    """
    estimate = read_estimate(path)
    fields = load_object(path)
    if KEY not in fields.values:
        raise InputError(_NO_LAWS, where=str(path), next_step=_MAKE)
    try:
        return _model(estimate, fields.object(KEY))
    except InputError as error:
        raise InputError(error.what, where=str(path), value=error.value) from error


EstimateLike = Estimate | TemperatureModel | str | Path
"""An estimate or its file; or one with temperature laws, in the middle of their temperatures."""


def open_estimate(estimate: EstimateLike, at_degC: float | None = None) -> Estimate:
    """The estimate in memory or in a file.

    Args:
        estimate: The estimate, what `identify_temperature` found, or the file of either.
        at_degC: Temperature of all joints, where there are temperature laws [degC]; None for the
            middle of the records' temperatures.

    Raises:
        InputError: As `read_estimate`; no estimate; or a temperature of one without laws.
    """
    if isinstance(estimate, str | Path):
        estimate = read_estimate(estimate) if at_degC is None else read_temperature(estimate)
    if isinstance(estimate, TemperatureModel):
        return estimate.estimate_at(estimate.reference_degC if at_degC is None else at_degC)
    if not isinstance(estimate, Estimate):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError("not an estimate or its file", value=type(estimate).__name__)
    if at_degC is not None:
        raise InputError(_NO_LAWS, next_step=_MAKE)
    return estimate


def _to_json(model: TemperatureModel) -> dict[str, Any]:
    laws = zip(model.laws, model.places, model.seen, strict=True)
    names = ("temperature_degC", "order", "covariance", "naive")
    return {
        **{name: plain(getattr(model, name)) for name in names},
        "laws": [plain(law) | {"places": list(p), "seen": list(s)} for law, p, s in laws],
        "warnings": [notice.to_json() for notice in model.warnings],
    }


def _model(estimate: Estimate, fields: JsonFields) -> TemperatureModel:
    laws, covariance = fields.objects("laws"), fields.matrix("covariance")
    places = tuple(_indices(one, "places", len(estimate.values)) for one in laws)
    seen = tuple(_indices(one, "seen", len(covariance)) for one in laws)
    return TemperatureModel(
        estimate=estimate,
        laws=tuple(_law(one, len(s)) for one, s in zip(laws, seen, strict=True)),
        temperature_degC=fields.matrix("temperature_degC"),
        places=places,
        seen=seen,
        order=_indices(fields, "order", len(covariance)),
        covariance=covariance,
        naive=fields.matrix("naive"),
        warnings=tuple(finding_from_json(one.values) for one in fields.objects("warnings")),
    )


def _law(fields: JsonFields, seen: int) -> JointTemperatureLaw:
    lowest, highest = frozen(fields.vector("range_degC"), shape=(2,), name="laws: range_degC")
    found = fields.get("symbols")
    symbols = tuple(map(str, cast("list[object]", found))) if isinstance(found, list) else ()
    return JointTemperatureLaw(
        symbols=symbols,
        law=fields.text("law"),
        reference=fields.vector("reference"),
        slope=fields.vector("slope"),
        # A joint without friction has empty matrices.
        covariance=fields.matrix("covariance") if symbols else np.zeros((0, 0)),
        gain=fields.matrix("gain") if symbols else np.zeros((0, seen)),
        reference_degC=fields.number("reference_degC"),
        range_degC=(float(lowest), float(highest)),
        chi_squared=fields.number("chi_squared"),
    )


def _indices(fields: JsonFields, name: str, size: int) -> tuple[int, ...]:
    found = fields.vector(name)
    if not ((found >= 0) & (found < size) & (found % 1 == 0)).all():
        said = f"{name} does not agree with the parameters and their covariance"
        raise InputError(said, value=found.tolist(), limit=f"indices below {size}")
    return tuple(int(index) for index in found)
