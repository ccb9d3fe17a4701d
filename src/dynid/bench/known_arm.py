"""Recordings of a simulated UR5 that obeys the paper's model exactly, with chosen noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.core.arrays import Array
from dynid.identification.problem import IdentificationProblem
from dynid.recording.record import ExperimentRecord
from dynid.reduction.base import reduce_model
from dynid.regressor.model import InverseDynamicModel
from dynid.regressor.terms import FrictionTerms
from dynid.robot.load import load_robot
from dynid.signals.process import process
from dynid.signals.samples import ProcessingSettings
from dynid.simulation.library import simulated_arm
from dynid.simulation.run import SimulatedRun, simulate
from dynid.trajectory.random_excitation import random_excitation

WIDTH = 0.02
"""Of the arm's Coulomb step and of the model's [rad/s]: the model can be right."""
POSITION_NOISE = 2.5e-5
"""Standard deviation at noise 1 [rad]."""
TORQUE_NOISE = (2.0, 2.5, 1.5, 0.4, 0.4, 0.3)
"""Standard deviation at noise 1 [N.m]: residuals of real UR5 logs (methods.md)."""
VALIDATION_SEED = 1000
"""Trajectories of the validation runs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownArm:
    """A simulated arm's runs and its true parameters."""

    model: InverseDynamicModel
    parameters: Array
    """(p) true standard parameters."""
    run: SimulatedRun
    validation: SimulatedRun

    def problem(self, noise: float, cutoff_hz: float, seed: int) -> IdentificationProblem:
        """The identification problem of the run with noise added.

        Args:
            noise: Factor on `POSITION_NOISE` and `TORQUE_NOISE`.
            cutoff_hz: Low-pass of the motion [Hz].
            seed: Of the noise.
        """
        generator = np.random.default_rng(seed)
        truth = self.run.truth
        record = ExperimentRecord(
            t=self.run.t,
            signals={
                "q": truth.q + noise * POSITION_NOISE * generator.normal(size=truth.q.shape),
                "effort": truth.torque
                + noise * np.array(TORQUE_NOISE) * generator.normal(size=truth.q.shape),
            },
        )
        samples = process(record, self.model.robot, ProcessingSettings(cutoff_hz=cutoff_hz))
        return IdentificationProblem(base=reduce_model(self.model), samples=samples)


def known_arm(seed: int, *, rate_hz: float = 250.0, period_s: float = 10.0) -> KnownArm:
    """Simulate the UR5 on two random excitations; MuJoCo moves it, not our regressor.

    Args:
        seed: Of the trajectories.
        rate_hz: Samples a second.
        period_s: Length of each run [s].

    Raises:
        MissingExtraError: MuJoCo is not installed.
    """
    robot = load_robot("ur5")
    arm = simulated_arm(robot)
    zero = np.zeros(robot.joints)
    friction = replace(arm.truth.friction, width=WIDTH, viscous_decay=zero, coulomb_drift=zero)
    arm = replace(arm, truth=replace(arm.truth, friction=friction))
    table = arm.standard_parameters_in("dh")
    runs = [
        simulate(
            arm,
            random_excitation(robot.limits, seed=s, period=period_s, acceleration=5.5 * np.pi),
            rate_hz=rate_hz,
            seed=s,
        )
        for s in (seed, VALIDATION_SEED + seed)
    ]
    return KnownArm(
        model=InverseDynamicModel(robot=robot, frames="dh", friction=FrictionTerms(width=WIDTH)),
        parameters=np.concatenate([table[:, :10].ravel(), *table[:, 10:].T]),
        run=runs[0],
        validation=runs[1],
    )
