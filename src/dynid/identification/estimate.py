"""The result of an identification, and its JSON file."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from dynid import core, regressor, signals
from dynid.identification.selection.assessment import Assessment, assessment_from_json
from dynid.identification.selection.unseen import MotionRange, unseen
from dynid.identification.statistics import relative_std_percent
from dynid.robot import robot_from_json, robot_to_json


@dataclass(frozen=True, slots=True, kw_only=True)
class StandardParameters(core.Value):
    """All standard parameters, of physically consistent bodies, each with where it comes from.

    Raises:
        InputError: Shapes that disagree.
    """

    values: core.Array
    """(p) standard parameters."""
    std: core.Array
    """(p) standard deviations from the data; those of the prior's words mean nothing."""
    prior_share: core.Array
    """(p) 0: the data's word alone, to 1: the prior's alone."""
    prior: core.Array
    """(p) the prior, CAD or completed; NaN where there is none."""
    origins: tuple[str, ...]
    """(p) `data` or `prior`."""

    def __post_init__(self) -> None:
        p = len(self.origins)
        core.freeze(self, values=(p,), std=(p,), prior_share=(p,))
        core.freeze(self, prior=(p,), finite=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class TorquePrediction(core.Value):
    """Predicted torques with their intervals."""

    torque: core.Array
    """(N, n) [N.m or N]."""
    half_width: core.Array
    """(N, n) half widths of the intervals [N.m or N]."""
    level: float
    """Share of measured torques that shall lie within."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate(core.Value):
    """Base parameters with their uncertainty.

    Raises:
        InputError: Shapes that disagree.
    """

    model: regressor.InverseDynamicModel
    """The model whose columns were fitted."""
    independent: tuple[int, ...]
    """(r) base columns of the model."""
    expressions: tuple[str, ...]
    """(r) each base parameter in standard parameters."""
    values: core.Array
    """(r) base parameters, units in `units`."""
    covariance: core.Array
    """(r, r) covariance that allows for correlated residuals (HAC)."""
    naive_std: core.Array
    """(r) standard deviations if the residuals were white."""
    noise: core.Array
    """(n) residual standard deviation of each joint [N.m or N]."""
    condition_number: float
    """Of W with first-come columns, unscaled, as the paper's."""
    scaled_condition_number: float
    """Of W with columns of unit norm, whatever the choice of base columns."""
    motion_condition_number: float
    """How much errors of torque can grow on other motions at its speeds, by the motion and the
    published inertias as strongly as the estimator takes them."""
    samples: int
    """N, samples that entered the fit."""
    estimator: str
    """Word of the estimator, such as `wls`."""
    preset: str
    """`paper` or `best`."""
    settings: signals.ProcessingSettings
    """How the record was processed; validation uses the same."""
    essential: tuple[int, ...]
    """Indices of the base parameters that the data determine."""
    motion: MotionRange
    """Range of the recorded motion."""
    choices: tuple[str, ...] = ()
    """What `--preset best` chose, in words."""
    warnings: tuple[core.Finding, ...] = ()
    """Findings of the identification."""
    provenance: core.Provenance
    """Inputs with their hashes, versions, time."""
    residual_autocorrelation: core.Array = field(default_factory=lambda: np.zeros(0))
    """(n) autocorrelation of the residuals at one sample."""
    standard: StandardParameters | None = None
    """Consistent standard parameters, from estimators that find them (`sdp`)."""
    assessment: Assessment | None = None
    """Left-out errors, rival models and torque intervals; None of shared inertias or temperatures,
    and in files of release 0.1."""

    def __post_init__(self) -> None:
        r, n = len(self.independent), self.model.robot.joints
        core.freeze(self, values=(r,), covariance=(r, r), naive_std=(r,), noise=(n,))
        if (given := len(self.expressions)) != r:
            raise core.InputError("one expression a parameter", value=given, limit=r)
        p = len(self.model.columns)
        if self.standard is not None and (given := len(self.standard.values)) != p:
            raise core.InputError("standard parameters do not fit the model", value=given, limit=p)
        if max(self.independent, default=0) >= p:
            raise core.InputError("base columns do not fit the model", value=max(self.independent))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the base parameters."""
        return tuple(self.model.names[i] for i in self.independent)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the base parameters."""
        return tuple(self.model.columns[i].unit for i in self.independent)

    @property
    def std(self) -> core.Array:
        """(r) standard deviations."""
        return core.read_only(np.sqrt(np.diag(self.covariance)))

    @property
    def relative_std_percent(self) -> core.Array:
        """(r) standard deviations as a share of the values [%]."""
        return relative_std_percent(self.values, self.std)

    @property
    def degrees_of_freedom(self) -> int:
        """Rows of W less parameters."""
        return self.samples * self.model.robot.joints - len(self.values)

    def standard_parameters(self) -> core.Array:
        """(p) standard parameters with these torques: consistent, or zero outside the base."""
        if self.standard is not None:
            return self.standard.values
        parameters = np.zeros(len(self.model.columns))
        parameters[list(self.independent)] = self.values
        return core.read_only(parameters)

    @overload
    def predict(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        state: ArrayLike | None = None,
        *,
        interval: None = None,
    ) -> core.Array: ...

    @overload
    def predict(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        state: ArrayLike | None = None,
        *,
        interval: float,
    ) -> TorquePrediction: ...

    def predict(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        state: ArrayLike | None = None,
        *,
        interval: float | None = None,
    ) -> core.Array | TorquePrediction:
        """Joint torques (N, n) [N.m or N], each argument (N, n); with intervals if asked for.

        Samples stand for themselves. For those of a motion, in the order of time, give the `state`
        (n, N) of presliding friction, `estimate.model.friction_state(q)`: without it slow motions
        err by several times as much (a UR5: 17 % of the torque for 4.6 %).

        Raises:
            InputError: Not numbers, or shapes that do not fit the robot or each other.
        """
        q, dq, ddq, state = self._given(q, dq, ddq, state)
        values = self.standard_parameters()
        torque = self.model.inverse_dynamics(q, dq, ddq, values, state)
        torque = core.read_only(torque - self.model.known_torque(q))
        if interval is None:
            return torque
        width = self.half_width(q, dq, ddq, state, level=interval)
        return TorquePrediction(torque=torque, half_width=width, level=interval)

    def _given(
        self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike, state: ArrayLike | None
    ) -> tuple[core.Array, core.Array, core.Array, core.Array | None]:
        q, dq, ddq = self.model.states(q, dq, ddq)
        if state is not None:
            robot = self.model.robot
            shape = (robot.joints + len(regressor.coupled_motors(robot)), len(q))
            state = core.frozen(state, shape=shape, name="state", finite=False)
        return q, dq, ddq, state

    def half_width(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        state: ArrayLike | None = None,
        *,
        level: float = 0.9,
    ) -> core.Array:
        """Half widths (N, n) of the intervals of torques measured on another day [N.m or N].

        The motion as for `predict`; the level is the share of torques within, 0.5 to 0.99.

        Raises:
            InputError: The estimate knows no intervals, a level outside 0.5 to 0.99, or as for
                `predict`.
        """
        q, dq, ddq, state = self._given(q, dq, ddq, state)
        if self.assessment is None:
            raise core.InputError(
                "estimates of shared inertias or temperatures, and files of release 0.1, have no "
                "torque intervals",
                next_step="Identify one recording, or all as one: dynid identify RECORD -o E.json",
            )
        interval, width = self.assessment.interval, np.empty(q.shape)
        parameters = dict(zip(self.names, self.values.tolist(), strict=True))
        never = unseen(self.model.robot, parameters, self.motion)
        for first in range(0, len(q), regressor.CHUNK):
            part = slice(first, first + regressor.CHUNK)
            now = None if state is None else state[:, part]
            stack = self.model.stack(q[part], dq[part], ddq[part], state=now)
            columns = stack[list(self.independent)]
            known, motion = (self.names, self.values, columns), (dq[part].T, ddq[part].T)
            width[part] = interval.half_width(*known, motion, never, level).T
        return core.read_only(width)

    def standard_table(self) -> list[dict[str, Any]] | None:
        """One JSON object a standard parameter, where the estimator finds them."""
        known = self.standard
        return known and core.table(
            name=self.model.names,
            value=known.values,
            unit=[column.unit for column in self.model.columns],
            **{"from": known.origins},
            prior_share=known.prior_share,
            std=known.std,
            prior=known.prior,
        )

    def parameter_table(self) -> list[dict[str, Any]]:
        """One JSON object a base parameter."""
        return core.table(
            name=self.names,
            value=self.values,
            unit=self.units,
            std=self.std,
            relative_std_percent=self.relative_std_percent,
            std_naive=self.naive_std,
            essential=[k in self.essential for k in range(len(self.values))],
            expression=self.expressions,
        )

    def summary(self) -> dict[str, Any]:
        """What both the file and the result of an identification state, as JSON has it."""
        return {
            "base_parameters": len(self.values),
            "standard_parameters": len(self.model.columns),
            **{name: getattr(self, name) for name in _STATED},
            "frames": self.model.frames,
            "friction": self.model.friction.to_json(),
            "parameters": self.parameter_table(),
            "settings": self.settings.to_json(),
            "choices": list(self.choices),
            **({} if self.standard is None else {"standard": self.standard_table()}),
            **({} if self.assessment is None else {"assessment": self.assessment.to_json()}),
        }


FORMAT = "dynid-estimate"
VERSION = 1


def _column(rows: list[dict[str, Any]], key: str) -> core.Array:
    """(r) numbers, NaN for null."""
    return np.array([row[key] for row in rows], dtype=np.float64)


_ARRAYS = ("covariance", "noise", "residual_autocorrelation")
_STATED = (
    "estimator", "preset", "condition_number", "scaled_condition_number",
    "motion_condition_number", "samples",
)  # fmt: skip
"""Fields that keep their own names."""
_MAKE = "Make one with: dynid identify RECORD -o ESTIMATE.json"


def estimate_to_json(estimate: Estimate) -> dict[str, Any]:
    """A JSON object from which the estimate can be read back."""
    return {
        "format": FORMAT,
        "version": VERSION,
        **estimate.summary(),
        **{name: core.plain(getattr(estimate, name)) for name in _ARRAYS},
        "degrees_of_freedom": estimate.degrees_of_freedom,
        "independent": list(estimate.independent),
        "motion": core.plain(estimate.motion),
        "warnings": [notice.to_json() for notice in estimate.warnings],
        "provenance": estimate.provenance.to_json(),
        "robot": robot_to_json(estimate.model.robot),
    }


def write_estimate(estimate: Estimate, path: Path | str) -> None:
    """Write an estimate as JSON.

    Raises:
        InputError: A place where no such file can be.
        JobError: The disk does not take it.
    """
    core.write_json(Path(path), estimate_to_json(estimate))


def read_estimate(path: Path | str) -> Estimate:
    """Read an estimate written by `write_estimate`.

    Raises:
        InputError: No such file, not an estimate, or damaged.
    """
    where = str(path)
    try:
        data = dict(core.load_object(path).values)
    except core.InputError as error:
        raise error.changed(where=where, next_step=error.next_step or _MAKE) from error
    if data.get("format") != FORMAT:
        found = data.get("kind") or data.get("format")
        raise core.InputError("not a dynid estimate", where=where, value=found, next_step=_MAKE)
    try:
        return _estimate(data)
    except core.InputError as error:
        raise core.InputError(str(error), where=where) from error
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        raise core.InputError(
            "the estimate is damaged", where=where, value=f"{type(error).__name__}: {error}"
        ) from error


def _estimate(data: dict[str, Any]) -> Estimate:
    if data["version"] != VERSION:
        raise core.InputError("unknown version of the file", value=data["version"], limit=VERSION)
    table: list[dict[str, Any]] = data["parameters"]
    return core.JsonFields(data).made(
        Estimate,
        model=regressor.InverseDynamicModel(
            robot=robot_from_json(data["robot"]),
            frames=str(data["frames"]),
            friction=regressor.terms_from_json(data["friction"]),
        ),
        expressions=tuple(str(row["expression"]) for row in table),
        values=_column(table, "value"),
        naive_std=_column(table, "std_naive"),
        essential=tuple(k for k, row in enumerate(table) if row["essential"]),
        warnings=tuple(core.finding_from_json(w) for w in data["warnings"]),
        standard=_standard(data.get("standard")),
        assessment=assessment_from_json(data["assessment"]) if "assessment" in data else None,
    )


def _standard(rows: list[dict[str, Any]] | None) -> StandardParameters | None:
    """Files of estimators without standard parameters, and older files, have none."""
    if rows is None:
        return None
    return StandardParameters(
        values=_column(rows, "value"),
        std=_column(rows, "std"),
        prior_share=_column(rows, "prior_share"),
        prior=_column(rows, "prior"),
        origins=tuple(str(row["from"]) for row in rows),
    )
