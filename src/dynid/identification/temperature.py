"""Friction as a function of joint temperature, and estimates for any temperatures.

Viscous friction falls with temperature, Fv(T) = Fv exp(-b (T - T0)) or Fv (1 - b (T - T0));
Coulomb friction changes little, Fc(T) = Fc (1 - c (T - T0)). What else a joint has stays as it
is. The laws are fitted joint by joint, by generalised least squares, to the friction of each
record with its covariance; b is the only parameter that is not linear.

Temperature laws stand in an estimate's file as one more object, `temperature`: whatever reads
estimates reads it, as the estimate in the middle of the records' temperatures.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from dynid import core
from dynid.identification import shared
from dynid.identification.estimate import Estimate, estimate_to_json, read_estimate

LAWS = ("exponential", "linear")
LEAST_SPREAD_K = 3.0
"""Temperatures of a joint that differ by less tell nothing of its law [K]."""
VARIES = {"Fv": "law", "Fc": "linear"}
"""Which friction parameters change with temperature, and how."""
ITERATIONS = 50
CONVERGED = 1e-10


@dataclass(frozen=True, slots=True, kw_only=True)
class JointTemperatureLaw(core.Value):
    """The friction of one joint at any temperature.

    Raises:
        InputError: Shapes that disagree.
    """

    symbols: tuple[str, ...]
    """(f) its friction parameters, e.g. `Fc`, `Fv`."""
    law: str
    """`exponential`, `linear`, or `constant` where temperatures hardly differed."""
    reference: core.Array
    """(f) values at the reference temperature."""
    slope: core.Array
    """(f) relative change per degree there, positive for a fall [1/K]."""
    covariance: core.Array
    """(2 f, 2 f) of `reference`, then `slope`; zero where a slope is fixed at zero."""
    gain: core.Array
    """(2 f, R f) how both move with the records' own parameters, record by record."""
    reference_degC: float
    """The reference temperature [degC]."""
    range_degC: tuple[float, float]
    """Lowest and highest temperature of the records [degC]."""
    chi_squared: float
    """Weighted residual sum of the fit."""

    def __post_init__(self) -> None:
        f = len(self.symbols)
        core.freeze(self, "laws:", reference=(f,), slope=(f,), covariance=(2 * f, 2 * f))
        core.freeze(self, "laws:", gain=(2 * f, None))

    def at(self, temperature_degC: float) -> tuple[core.Array, core.Array]:
        """Friction parameters (f) at a temperature [degC].

        And their derivative (f, 2 f) by `reference` and `slope`.
        """
        rise = temperature_degC - self.reference_degC
        return _evaluate(self.law, self.symbols, self.reference, self.slope, rise)


def fit_law(
    values: core.Array,
    covariance: core.Array,
    temperature_degC: core.Array,
    symbols: Sequence[str],
    *,
    law: str = "auto",
) -> JointTemperatureLaw:
    """Fit the laws of one joint.

    Args:
        values: (R, f) its friction parameters in each record.
        covariance: (R f, R f) their covariance, record by record.
        temperature_degC: (R) its temperature in each record [degC].
        symbols: (f) names of the parameters without the joint, e.g. `Fc`, `Fv`.
        law: `exponential`, `linear`, or `auto` for the one that fits better.

    Raises:
        InputError: An unknown law.
        JobError: A singular covariance, or an exponential law that does not converge.
    """
    if law not in (*LAWS, "auto"):
        raise core.InputError("unknown law", value=law, limit=(*LAWS, "auto"))
    if np.ptp(temperature_degC) < LEAST_SPREAD_K:
        return _fit(values, covariance, temperature_degC, tuple(symbols), "constant")
    if law != "auto":
        return _fit(values, covariance, temperature_degC, tuple(symbols), law)
    linear = _fit(values, covariance, temperature_degC, tuple(symbols), "linear")
    # Through two values both laws go.
    if len(values) == 2:
        return linear
    try:
        curved = _fit(values, covariance, temperature_degC, tuple(symbols), "exponential")
    except core.JobError:
        # Values that are noise have both signs, which no exponential has.
        return linear
    return min(curved, linear, key=lambda one: one.chi_squared)


@np.errstate(over="ignore")
def _fit(
    values: core.Array,
    covariance: core.Array,
    temperature: core.Array,
    symbols: tuple[str, ...],
    law: str,
) -> JointTemperatureLaw:
    """Gauss-Newton in reference values and slopes, from the linear law's answer."""
    records, count = values.shape
    reference_degC = float(temperature.mean())
    rises = (temperature - reference_degC).tolist()
    varying = [k for k, s in enumerate(symbols) if law != "constant" and s in VARIES]
    free = [*range(count), *(count + k for k in varying)]
    scale = np.sqrt(np.diag(covariance))
    try:
        root = np.linalg.cholesky(covariance / np.outer(scale, scale))
    except np.linalg.LinAlgError:
        raise core.JobError(
            "the friction of one record follows from that of another",
            value=f"{records} records",
            next_step="Use recordings of separate runs: copies have the same noise.",
        ) from None
    white = np.asarray(np.linalg.inv(root), dtype=np.float64) / scale
    reference, slope = values.mean(axis=0), np.zeros(count)
    inner = np.zeros((len(free), records * count))
    for _ in range(ITERATIONS):
        found = [_evaluate(law, symbols, reference, slope, rise) for rise in rises]
        predicted, turn = np.array([v for v, _ in found]), np.vstack([s[:, free] for _, s in found])
        if not np.isfinite(turn).all():
            raise _diverged(values, law)
        inner = np.linalg.pinv(white @ turn) @ white
        step = np.zeros(2 * count)
        step[free] = inner @ (values - predicted).ravel()
        reference, slope = reference + step[:count], slope + step[count:]
        # By what it moves the law: a step of the slopes alone is one as well.
        moved = np.linalg.norm(white @ turn @ step[free])
        if moved <= CONVERGED * np.linalg.norm(white @ values.ravel()):
            break
    else:
        raise _diverged(values, law)
    gain = np.zeros((2 * count, records * count))
    gain[free] = inner
    predicted = np.array([_evaluate(law, symbols, reference, slope, rise)[0] for rise in rises])
    return JointTemperatureLaw(
        symbols=symbols,
        law=law,
        reference=reference,
        slope=slope,
        covariance=gain @ covariance @ gain.T,
        gain=gain,
        reference_degC=reference_degC,
        range_degC=(float(temperature.min()), float(temperature.max())),
        chi_squared=float(np.square(white @ (values - predicted).ravel()).sum()),
    )


def _diverged(values: core.Array, law: str) -> core.JobError:
    return core.JobError(
        "the temperature law does not converge",
        value=f"{law}, friction {values.round(3).tolist()}",
        next_step="Fit a linear law: friction of both signs falls by no exponential.",
    )


def _evaluate(
    law: str, symbols: tuple[str, ...], reference: core.Array, slope: core.Array, rise: float
) -> tuple[core.Array, core.Array]:
    """Values (f) at a rise of temperature, and their slopes (f, 2 f) by reference and slope."""
    curved = np.array([law == "exponential" and VARIES.get(s) == "law" for s in symbols])
    decay = np.exp(-slope * rise)
    factor = np.where(curved, decay, 1.0 - slope * rise)
    change = -rise * np.where(curved, decay, 1.0)
    return reference * factor, np.hstack([np.diag(factor), np.diag(reference * change)])


BEYOND_K = 2.0
"""How far outside the records' temperatures a friction may be asked for without a word [K]."""
CHOICE = "friction at "
"""How the choice of temperatures begins, among an estimate's choices."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TemperatureModel(core.Value):
    """What is needed to give an estimate for any temperatures; `write_temperature` keeps it.

    Raises:
        InputError: Shapes that disagree.
    """

    estimate: Estimate
    """One estimate with the shared inertias; its friction is of no account."""
    laws: tuple[JointTemperatureLaw, ...]
    """One a joint."""
    temperature_degC: core.Array
    """(R, n) mean joint temperatures of the records [degC]."""
    covariance: core.Array
    """(P, P) of every record's own parameters in turn, then of the inertias; see `SharedFit`."""
    naive: core.Array
    """(P, P) the same as if residuals were not correlated in time."""
    warnings: tuple[core.Finding, ...] = ()
    """Findings of the identification."""

    def __post_init__(self) -> None:
        known, records = self.estimate, len(self.temperature_degC)
        size = len(known.values) + (records - 1) * len(shared.friction_parameters(known))
        core.freeze(self, temperature_degC=(None, known.model.robot.joints))
        core.freeze(self, covariance=(size, size), naive=(size, size))
        wanted = [(2 * len(own), records * len(own)) for own in shared.friction_places(known)]
        shapes = [law.gain.shape for law in self.laws]
        if shapes != wanted:
            raise core.InputError("laws do not fit the friction", value=shapes, limit=wanted)

    @property
    def reference_degC(self) -> core.Array:
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
        wanted = core.frozen(temperature_degC, shape=None, name="temperature")
        if wanted.shape not in ((), (joints,)):
            said, limit = "needs one temperature, or one a joint", f"{joints} joints"
            raise core.InputError(said, value=temperature_degC, limit=limit)
        wanted = np.broadcast_to(wanted, (joints,))
        known, records = self.estimate, len(self.temperature_degC)
        own = np.array(shared.friction_parameters(known), dtype=np.intp)
        values, places = known.values.copy(), shared.friction_places(known)
        turn = np.eye(len(self.covariance))[shared.base_order(known, records)]
        turn[own] = 0.0
        for degC, law, c in zip(wanted.tolist(), self.laws, places, strict=True):
            values[own[c]], sensitivity = law.at(degC)
            turn[np.ix_(own[c], shared.friction_order(known, records, c))] = sensitivity @ law.gain
        covariance, naive = (turn @ c @ turn.T for c in (self.covariance, self.naive))
        choices = [choice for choice in known.choices if not choice.startswith(CHOICE)]
        return replace(
            known,
            values=values,
            covariance=covariance,
            naive_std=np.sqrt(np.maximum(np.diag(naive), 0.0)),
            choices=(*choices, f"{CHOICE}{' '.join(f'{x:.3g}' for x in wanted)} degC"),
            warnings=tuple(_beyond(self.laws, wanted.tolist())),
        )


def _beyond(laws: Sequence[JointTemperatureLaw], wanted: Sequence[float]) -> Iterator[core.Finding]:
    """A word about temperatures [degC] that the records did not have; nothing if they had."""
    far = [
        f"joint {j + 1} at {degC:.3g} degC (records: {law.range_degC[0]:.3g} to "
        f"{law.range_degC[1]:.3g})"
        for j, (degC, law) in enumerate(zip(wanted, laws, strict=True))
        if not law.range_degC[0] - BEYOND_K <= degC <= law.range_degC[1] + BEYOND_K
    ]
    if far:
        yield core.Finding("extrapolated", f"temperatures beyond the records: {', '.join(far)}")


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
    names = ("temperature_degC", "covariance", "naive", "laws")
    laws = {name: core.plain(getattr(found, name)) for name in names}
    laws["warnings"] = [notice.to_json() for notice in found.warnings]
    core.write_json(Path(path), {**estimate_to_json(middle), KEY: laws})


def read_temperature(path: str | Path) -> TemperatureModel:
    """Read the JSON file that `write_temperature` wrote.

    Raises:
        InputError: No such file, not an estimate, one without temperature laws, or damaged.
    """
    estimate = read_estimate(path)
    fields = core.load_object(path)
    if KEY not in fields.values:
        raise core.InputError(_NO_LAWS, where=str(path), next_step=_MAKE)
    try:
        laws = fields.object(KEY)
        return laws.made(
            TemperatureModel,
            estimate=estimate,
            laws=tuple(map(_law, laws.objects("laws"))),
            warnings=tuple(core.finding_from_json(one.values) for one in laws.objects("warnings")),
        )
    except core.InputError as error:
        raise core.InputError(error.what, where=str(path), value=error.value) from error


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
        raise core.InputError("not an estimate or its file", value=type(estimate).__name__)
    if at_degC is not None:
        raise core.InputError(_NO_LAWS, next_step=_MAKE)
    return estimate


def _law(fields: core.JsonFields) -> JointTemperatureLaw:
    # A joint without friction has empty matrices.
    names = () if fields.get("symbols") else ("covariance", "gain")
    return fields.made(JointTemperatureLaw, **dict.fromkeys(names, np.zeros((0, 0))))
