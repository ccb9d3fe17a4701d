"""Contacts found and false alarms of the momentum observer on the simulated UR5.

Identification, thresholds and ten minutes of free motion are separate motions of one warm arm.
Asked: a contact of 15 N.m on a joint is found within 50 ms, and free motion raises no alarm.
Needs MuJoCo: pip install 'dynid[sim]'.
"""

from __future__ import annotations

import sys

import numpy as np

import dynid
from dynid.core import Array
from dynid.simulation import SimulatedArm, SimulatedPlant, simulated_arm
from dynid.validation import MomentumObserver, contact_thresholds

RATE = 125.0
SECONDS = 10.0
CONTACT = 15.0
ASKED_S = 0.05
LEARN, FREE, CONTACTS = 12, 60, 36
SETTLED = 20
"""Samples after which the observer has forgotten its start."""

Run = tuple[Array, Array, Array, Array]


def run(
    arm: SimulatedArm, plant: SimulatedPlant, seed: int, touch: tuple[int, int, float] | None = None
) -> Run:
    """Times, positions, measured velocities and torques of ten seconds of random motion.

    Args:
        arm: The simulated arm.
        plant: Its physics; its temperatures go on from where they are.
        seed: Seed of the motion and the noise.
        touch: Cycle, joint and torque of a contact that stays [N.m].
    """
    t = np.arange(round(SECONDS * RATE)) / RATE
    motion = dynid.random_excitation(arm.robot.limits, seed=seed).evaluate(t)
    plant._joint[1] = 0.0
    plant.reset(motion.q[0])
    states = []
    for cycle, setpoint in enumerate(motion.q):
        if touch is not None and cycle == touch[0]:
            plant._joint[1, touch[1]] = touch[2]
        states.append(plant.tick(setpoint))
    random = np.random.default_rng(seed)
    q, dq, torque = (np.array([getattr(s, x) for s in states]) for x in ("q", "dq", "torque"))
    sensors, gain = arm.truth.sensors, arm.truth.gain
    speed = sensors.read("velocity", dq, random)
    return t, q, speed, sensors.read("current", torque / gain, random) * gain


def main() -> int:
    """Print the figures; 1 if an asked one is missed."""
    robot = dynid.load_robot("ur5")
    arm = simulated_arm(robot)
    motion = dynid.random_excitation(robot.limits, seed=1)
    record = dynid.simulate_recording(robot, motion, seed=1, periods=3, thermal="warm")
    settings = dynid.IdentifySettings(preset="paper")
    estimate = dynid.identify([record], robot, settings).estimate
    observer, plant = (
        MomentumObserver(estimate=estimate),
        SimulatedPlant(arm, rate_hz=RATE, thermal="warm"),
    )

    learned = [run(arm, plant, 100 + k) for k in range(LEARN)]
    thresholds = contact_thresholds(
        [observer.residuals(*one)[SETTLED:] for one in learned],
        [one[2][SETTLED:] for one in learned],
        noise=estimate.noise,
    )
    alarms = 0
    for k in range(FREE):
        one = run(arm, plant, 20_000 + k)
        seen = thresholds.contacts(observer.residuals(*one), one[2])[SETTLED:]
        alarms += int(seen.any())
    random, delays = np.random.default_rng(7), []
    for k in range(CONTACTS):
        first = int(random.integers(200, 1100))
        touch = first, k % 6, CONTACT * (-1.0) ** (k // 6)
        one = run(arm, plant, 30_000 + k, touch)
        seen = thresholds.contacts(observer.residuals(*one), one[2])[first:].any(axis=1)
        delays.append((int(np.argmax(seen)) + 1) / RATE if seen.any() else np.inf)
    minutes = FREE * SECONDS / 60
    print(f"thresholds near rest [N.m]:  {np.round(thresholds.limits[0], 1).tolist()}")
    print(f"thresholds when fast [N.m]:  {np.round(thresholds.limits[-1], 1).tolist()}")
    print(f"free motion: {alarms} of {FREE} motions with an alarm in {minutes:g} min; asked: 0")
    late = sum(delay > ASKED_S for delay in delays)
    print(
        f"{CONTACTS} contacts of {CONTACT:g} N.m, all joints, both ways: found after "
        f"{1e3 * np.median(delays):.0f} ms (median), {1e3 * max(delays):.0f} ms (worst); "
        f"{late} later than {1e3 * ASKED_S:.0f} ms; asked: 0"
    )
    return int(alarms > 0 or late > 0)


if __name__ == "__main__":
    sys.exit(main())
