"""Drive gains from runs with and without a payload that was weighed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits  # pyright: ignore[reportMissingTypeStubs]

from dynid.core.arrays import Array, frozen
from dynid.core.errors import InputError
from dynid.core.notices import Notice
from dynid.identification.drive_gains import LARGEST_STD
from dynid.identification.drive_gains_payload import WeighedGains, weighed_gains
from dynid.identification.problem import IdentificationProblem
from dynid.identification.shared import SharedProblem
from dynid.recording.record import ExperimentRecord
from dynid.reduction.base import reduce_model
from dynid.regressor.model import InverseDynamicModel
from dynid.regressor.terms import FrictionTerms
from dynid.robot.inertia import frame_map, from_body
from dynid.robot.load import load_robot
from dynid.robot.model import RobotModel
from dynid.signals.process import process
from dynid.signals.samples import ProcessingSettings
from dynid.workflow.payload import WIDTH


@dataclass(frozen=True, slots=True, kw_only=True)
class GainsFromPayload:
    """Drive gains, and what could not be told."""

    gain: Array
    """(n) joint torque per motor current [N.m/A], NaN where the runs do not show it."""
    std: Array
    """(n) standard deviations [N.m/A], given for all."""
    found: WeighedGains
    """The fit behind them."""
    warnings: tuple[Notice, ...]


def identify_gains_from_payload(
    unloaded: ExperimentRecord | Sequence[ExperimentRecord],
    loaded: ExperimentRecord | Sequence[ExperimentRecord],
    robot: RobotModel | str | Path,
    *,
    mass: float,
    centre: ArrayLike | None = None,
    inertia: ArrayLike | None = None,
    friction: FrictionTerms | None = None,
    cutoff_hz: float | None = None,
) -> GainsFromPayload:
    """Drive gains from currents with and without a known payload.

    Best with one motion for both, fast and wide: joint 1 shows its gain by inertia alone.

    Args:
        unloaded: Recordings with currents, without the payload.
        loaded: Recordings with it.
        robot: The robot, or its name or file; its own drive gains are no
            more than a start.
        mass: Mass of the payload [kg].
        centre: (3) its centre of mass in the flange frame [m], if known.
        inertia: (3, 3) tensor about that centre, along the flange's axes [kg.m^2], if known.
        friction: Friction terms; the default is Coulomb, viscous and motor inertia.
        cutoff_hz: Low-pass cut-off of the motion [Hz]; None: from the first record's spectrum.

    Raises:
        InputError: Records without currents, a mass that is not positive, a tensor without a
            centre, or a robot with counterbalances.
        JobError: Motions or a payload that leave a gain open.
    """
    model = robot if isinstance(robot, RobotModel) else load_robot(robot)
    if model.counterbalances:
        # Their torque is known in N.m, and would have to be scaled with the unknown gains.
        raise InputError("drive gains of a robot with counterbalances", value=model.name)
    several = [[r] if isinstance(r, ExperimentRecord) else list(r) for r in (unloaded, loaded)]
    known = known_payload(mass, centre, inertia)
    plain = InverseDynamicModel(robot=model, friction=friction or FrictionTerms(width=WIDTH))
    base = reduce_model(plain)
    settings = ProcessingSettings(cutoff_hz=cutoff_hz, decimate=True)
    with threadpool_limits(limits=1, user_api="blas"):
        problems: list[IdentificationProblem] = []
        for record in (*several[0], *several[1]):
            samples = process(_as_currents(record), model, settings)
            settings = replace(settings, cutoff_hz=samples.cutoff_hz)
            problems.append(IdentificationProblem(base=base, samples=samples))
        flags = (False,) * len(several[0]) + (True,) * len(several[1])
        link = np.asarray(np.linalg.inv(model.parameter_frames[plain.frames][-1]), dtype=np.float64)
        own = model.drives.gain
        found = weighed_gains(
            SharedProblem(problems=tuple(problems), loaded=flags),
            frame_map(link @ model.flange),
            known,
            own if (own > 0).all() else None,
        )
    lost = found.std > LARGEST_STD * found.gain
    return GainsFromPayload(
        gain=np.where(lost, np.nan, found.gain),
        std=found.std,
        found=found,
        warnings=tuple(
            Notice(
                "low_excitation",
                f"no drive gain for {model.joint_names[j]}: its standard deviation would be "
                f"{100 * found.std[j] / found.gain[j]:.0f} %",
            )
            for j in np.flatnonzero(lost)
        ),
    )


def known_payload(mass: float, centre: ArrayLike | None, inertia: ArrayLike | None) -> Array:
    """(10) inertial parameters about the flange, NaN where unknown.

    Raises:
        InputError: A mass that is not positive, or a tensor without a centre.
    """
    if not (np.isfinite(mass) and mass > 0):
        raise InputError("the payload's mass must be positive", value=mass)
    known = np.full(10, np.nan)
    known[0] = mass
    if centre is None:
        if inertia is not None:
            raise InputError("a tensor about the centre of mass needs the centre of mass")
        return known
    known[1:4] = mass * frozen(centre, shape=(3,), name="centre of mass")
    return known if inertia is None else from_body(mass, centre, inertia)


def _as_currents(record: ExperimentRecord) -> ExperimentRecord:
    """The record with its currents read as torques: gains of one."""
    if "current" not in record.signals:
        raise InputError("drive gains need recorded currents", value=", ".join(record.signals))
    signals = {name: values for name, values in record.signals.items() if name != "effort"}
    ones = (1.0,) * record.joints
    return replace(record, signals=signals, metadata=replace(record.metadata, drive_gains=ones))
