"""Time and memory of one identification, beside a loop over pinocchio's regressor.

Asked: a 30 s record at 125 Hz within 1 s of CPU (`paper`) and 20 s (`best`), caches warm; five
minutes at 500 Hz within 1 GB. The loop only evaluates the regressor of the same samples.

The arm has a UR5's published inertias, each a tenth off, and a UR5's friction: on torques of random
parameters, which no UR5 has, most of the time goes into the search for a fault.
"""

import sys
import time

import numpy as np
from shared.measuring import child

import dynid
from dynid.identification import inertial_prior
from dynid.recording import ExperimentRecord
from dynid.regressor import InverseDynamicModel

OFF = 0.1
COULOMB, VISCOUS = [7.7, 8.4, 8.3, 1.9, 1.8, 1.8], [10.8, 8.8, 5.5, 2.8, 1.9, 1.4]
MOTOR = [2.0, 2.2, 1.1, 0.3, 0.3, 0.3]
NOISE = np.array([2.0, 2.5, 1.5, 0.4, 0.4, 0.3])
ASKED_CPU_S = {"paper": 1.0, "best": 20.0}
ASKED_GB = 1.0


def recording(seconds: float, rate: float) -> ExperimentRecord:
    """A UR5 record that does not repeat, white noise on its torques."""
    robot = dynid.load_robot("ur5")
    generator = np.random.default_rng(0)
    series = dynid.random_excitation(robot.limits, seed=1, period_s=seconds, harmonics=15)
    motion = series.evaluate(np.arange(int(seconds * rate)) / rate)
    model = InverseDynamicModel(robot=robot)
    bodies = inertial_prior(robot, robot.default_frames).parameters.ravel()
    bodies = bodies * generator.normal(1.0, OFF, bodies.size)
    parameters = np.concatenate([bodies, COULOMB, VISCOUS, MOTOR])
    torque = model.inverse_dynamics(motion.q, motion.dq, motion.ddq, parameters)
    noisy = torque + NOISE * generator.normal(size=torque.shape)
    return ExperimentRecord(t=motion.t, signals={"q": motion.q, "effort": noisy})


def identify(record: ExperimentRecord, preset: str) -> float:
    """CPU time of an identification [s]."""
    start = time.process_time()
    dynid.identify([record], "ur5", dynid.IdentifySettings(preset=preset))
    return time.process_time() - start


def pinocchio_loop_s(record: ExperimentRecord) -> float:
    # Here, not above: the process that measures memory does not load it.
    from shared.pinocchio_arm import PinocchioArm

    arm, q = PinocchioArm(dynid.load_robot("ur5")), record.signals["q"]
    out = np.empty((len(q), 6, 60))
    start = time.process_time()
    arm.loop(q, q, q, out)
    return time.process_time() - start


def main() -> None:
    record = recording(30.0, 125.0)
    loop = pinocchio_loop_s(record)
    print(f"{record.samples} samples; loop over pinocchio's regressor: {loop * 1e3:.0f} ms of CPU")
    for preset, asked in ASKED_CPU_S.items():
        identify(record, preset)
        used = identify(record, preset)
        print(
            f"identify --preset {preset}: {used:.2f} s of CPU, {used / loop:.0f} loops; "
            f"asked: {asked:g} s"
        )
    for preset in ASKED_CPU_S:
        peak = child([__file__, "--memory", preset]).peak_mb / 1e3
        print(
            f"identify --preset {preset}, 5 minutes at 500 Hz: peak {peak:.2f} GB; "
            f"asked: {ASKED_GB:g} GB"
        )


if __name__ == "__main__":
    if "--memory" in sys.argv:
        identify(recording(300.0, 500.0), sys.argv[-1])
    else:
        main()
