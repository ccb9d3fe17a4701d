"""Friction at any joint temperature, from recordings at several."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynid import identification
from dynid.core import Finding, InputError, Progress, table, told
from dynid.recording import RecordLike, checked_records, open_several
from dynid.robot import RobotLike, load_robot
from dynid.settings import IdentifySettings
from dynid.signals import window
from dynid.validation import record_findings
from dynid.workflow.shared_inertias import SharedIdentification, identify_shared


@dataclass(frozen=True, slots=True, kw_only=True)
class TemperatureIdentification(identification.TemperatureModel):
    """Shared inertias, and friction as a function of joint temperature."""

    shared: SharedIdentification
    """The inertias, and the friction of each record."""

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        names = self.shared.problem.problems[0].base.model.robot.joint_names
        laws: list[dict[str, Any]] = []
        for name, law in zip(names, self.laws, strict=True):
            std, fall_std = np.sqrt(np.diag(law.covariance)).reshape(2, -1)
            laws.append(
                {
                    "joint": name,
                    "law": law.law,
                    "reference_degC": law.reference_degC,
                    "range_degC": list(law.range_degC),
                    "parameters": table(
                        name=law.symbols,
                        value=law.reference,
                        std=std,
                        fall_per_K=law.slope,
                        fall_std=fall_std,
                    ),
                }
            )
        return {
            "temperature_degC": self.temperature_degC.tolist(),
            "laws": laws,
            **told(self.warnings),
        }


def identify_temperature(
    records: RecordLike | Sequence[RecordLike],
    robot: RobotLike,
    settings: IdentifySettings | None = None,
    *,
    law: str = "auto",
    progress: Progress | None = None,
) -> TemperatureIdentification:
    """Friction as a function of temperature, from recordings with joint temperatures.

    Each record counts at its mean temperatures: record warm-ups in short pieces.

    Args:
        records: Recordings at two or more temperatures, or their files; three let the data choose
            the law.
        robot: The robot, or its name or file.
        settings: As for `identify_shared`.
        law: Of viscous friction: `exponential`, `linear`, or `auto` for what fits better.
        progress: Told what is being done and how far it is (0 to 1).

    Raises:
        InputError: Fewer than two records, no temperatures in them, an unknown law, or what
            `identify_shared` refuses.
        JobError: A singular problem.
    """
    robot = load_robot(robot, collision=False)
    several = open_several(records, robot)
    without = [k + 1 for k, record in enumerate(several) if "temperature" not in record.signals]
    if without:
        raise InputError(
            "recordings without joint temperatures",
            value=f"records {without}",
            next_step="Record with dynid run, or import with --columns ...,temperature=A:B.",
        )
    several = checked_records(several)
    if len(several) < 2:
        raise InputError("a temperature law needs two records or more", value=len(several))
    settings = settings or IdentifySettings()
    parts = [window(record.t, settings.start_s, settings.stop_s) for record in several]
    warm = [record.signals["temperature"] for record in several]
    mean = np.array([one[part].mean(axis=0) for one, part in zip(warm, parts, strict=True)])
    shared = identify_shared(several, robot, settings, progress=progress)
    problem, solved = shared.problem, shared.fit
    names, own = shared.own, solved.solution.own
    base, laws = problem.problems[0].base, list[identification.JointTemperatureLaw]()
    for joint, degC in zip(identification.friction_places(base), mean.T, strict=True):
        places = identification.friction_order(base, len(own), joint)
        covariance = solved.covariance[np.ix_(places, places)]
        symbols = [names[c].rstrip("0123456789") for c in joint]
        laws.append(identification.fit_law(own[:, joint], covariance, degC, symbols, law=law))
    return TemperatureIdentification(
        shared=shared,
        # Load friction has the inertias that each recording shows: those of the coldest.
        estimate=shared.estimates[int(np.argmin(mean.sum(axis=1)))],
        laws=tuple(laws),
        temperature_degC=mean,
        covariance=solved.covariance,
        naive=solved.naive,
        warnings=(*_findings(laws), *record_findings(robot, *several)),
    )


def _findings(laws: Sequence[identification.JointTemperatureLaw]) -> Iterator[Finding]:
    flat = [str(j + 1) for j, law in enumerate(laws) if law.law == "constant"]
    if flat:
        yield Finding(
            "low_excitation",
            f"the temperatures of joints {', '.join(flat)} differ by less than "
            f"{identification.LEAST_SPREAD_K:g} K between the records: their friction is taken "
            "as constant",
        )
