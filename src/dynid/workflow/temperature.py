"""Friction at any joint temperature, from recordings at several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.core.notices import Notice
from dynid.core.progress import Progress
from dynid.identification.estimate import Estimate
from dynid.identification.shared_estimates import base_order
from dynid.identification.temperature import LEAST_SPREAD_K, JointTemperatureLaw, fit_law
from dynid.recording.record import ExperimentRecord
from dynid.robot.model import RobotModel
from dynid.signals.resample import window
from dynid.workflow.identify_settings import IdentifySettings
from dynid.workflow.shared_inertias import SharedIdentification, identify_shared
from dynid.workflow.temperature_model import TemperatureModel


@dataclass(frozen=True, slots=True, kw_only=True)
class TemperatureIdentification:
    """Shared inertias, and friction as a function of joint temperature."""

    shared: SharedIdentification
    """The inertias, and the friction of each record."""
    laws: tuple[JointTemperatureLaw, ...]
    """One a joint."""
    temperature_degC: Array
    """(R, n) mean joint temperatures of the records [degC]."""
    warnings: tuple[Notice, ...]

    def estimate_at(self, temperature_degC: ArrayLike) -> Estimate:
        """The estimate for joint temperatures: it predicts, validates and exports as any other.

        Args:
            temperature_degC: One temperature, or (n) one a joint [degC].

        Raises:
            InputError: Another number of joints.
        """
        return self.model.estimate_at(temperature_degC)

    @property
    def model(self) -> TemperatureModel:
        """What `write_temperature` keeps of it."""
        problem, fit = self.shared.problem, self.shared.fit
        records, own = fit.solution.own.shape
        columns = joint_columns(self.shared)
        return TemperatureModel(
            estimate=self.shared.estimates[0],
            laws=self.laws,
            temperature_degC=self.temperature_degC,
            places=tuple(tuple(problem.own[c] for c in joint) for joint in columns),
            seen=tuple(
                tuple(k * own + c for k in range(records) for c in joint) for joint in columns
            ),
            order=tuple(base_order(problem, fit, 0)),
            covariance=fit.covariance,
            naive=fit.naive,
            warnings=self.warnings,
        )

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        names = self.shared.problem.problems[0].base.model.robot.joint_names
        return {
            "temperature_degC": self.temperature_degC.tolist(),
            "laws": [
                {
                    "joint": name,
                    "law": law.law,
                    "reference_degC": law.reference_degC,
                    "range_degC": list(law.range_degC),
                    "parameters": [
                        {
                            "name": symbol,
                            "value": float(law.reference[k]),
                            "std": float(np.sqrt(law.covariance[k, k])),
                            "fall_per_K": float(law.slope[k]),
                            "fall_std": float(np.sqrt(law.covariance[f + k, f + k])),
                        }
                        for f in (len(law.symbols),)
                        for k, symbol in enumerate(law.symbols)
                    ],
                }
                for name, law in zip(names, self.laws, strict=True)
            ],
            "warnings": [notice.to_json() for notice in self.warnings],
        }


def joint_columns(shared: SharedIdentification) -> list[list[int]]:
    """For each joint, which of a record's own parameters are its friction."""
    problem = shared.problem
    base = problem.problems[0].base
    joint = [base.model.columns[base.independent[k]].joint for k in problem.own]
    return [[c for c, of in enumerate(joint) if of == j] for j in range(problem.joints)]


def identify_temperature(
    records: Sequence[ExperimentRecord],
    robot: RobotModel | str | Path,
    settings: IdentifySettings | None = None,
    *,
    law: str = "auto",
    progress: Progress | None = None,
) -> TemperatureIdentification:
    """Friction as a function of temperature, from recordings with joint temperatures.

    Each record counts at its mean temperatures: record warm-ups in short pieces.

    Args:
        records: Recordings at two or more temperatures; three let the data choose the law.
        robot: The robot, or its name or file.
        settings: As for `identify_shared`.
        law: Of viscous friction: `exponential`, `linear`, or `auto` for what fits better.
        progress: Told what is being done and how far it is (0 to 1).

    Raises:
        InputError: Fewer than two records, no temperatures in them, an unknown law, or what
            `identify_shared` refuses.
        JobError: A singular problem.
    """
    if len(records) < 2:
        raise InputError("a temperature law needs two records or more", value=len(records))
    without = [k + 1 for k, record in enumerate(records) if "temperature" not in record.signals]
    if without:
        raise InputError(
            "recordings without joint temperatures",
            value=f"records {without}",
            next_step="Record with dynid run, or import with --columns ...,temperature=A:B.",
        )
    settings = settings or IdentifySettings()
    mean = np.array([_mean_temperature(record, settings) for record in records])
    shared = identify_shared(records, robot, settings, progress=progress)
    names, own = shared.own, shared.fit.solution.own
    laws: list[JointTemperatureLaw] = []
    for j, columns in enumerate(joint_columns(shared)):
        places = [k * own.shape[1] + c for k in range(len(own)) for c in columns]
        laws.append(
            fit_law(
                own[:, columns],
                shared.fit.covariance[np.ix_(places, places)],
                mean[:, j],
                [names[c].rstrip("0123456789") for c in columns],
                law=law,
            )
        )
    return TemperatureIdentification(
        shared=shared, laws=tuple(laws), temperature_degC=mean, warnings=_findings(laws)
    )


def _mean_temperature(record: ExperimentRecord, settings: IdentifySettings) -> Array:
    part = window(record.t, settings.start_s, settings.stop_s)
    return record.signals["temperature"][part].mean(axis=0)


def _findings(laws: Sequence[JointTemperatureLaw]) -> tuple[Notice, ...]:
    flat = [str(j + 1) for j, law in enumerate(laws) if law.law == "constant"]
    if not flat:
        return ()
    return (
        Notice(
            "low_excitation",
            f"the temperatures of joints {', '.join(flat)} differ by less than "
            f"{LEAST_SPREAD_K:g} K between the records: their friction is taken as constant",
        ),
    )
