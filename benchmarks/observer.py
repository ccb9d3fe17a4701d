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

RATE, SECONDS = 125.0, 10.0
CONTACT, ASKED_S = 15.0, 0.05
LEARN, FREE, CONTACTS = 12, 60, 36
SETTLED = 20
"""Samples after which the observer has forgotten its start."""

Touch = tuple[int, int, float]
"""Cycle, joint and torque of a contact that stays [N.m]."""


def run(
    arm: SimulatedArm, plant: SimulatedPlant, seed: int, touch: Touch | None
) -> tuple[Array, Array, Array, Array]:
    """Times, positions, measured velocities and torques of ten seconds of random motion.

    The plant's temperatures go on from where they are.
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
    observer = MomentumObserver(estimate=estimate)
    plant = SimulatedPlant(arm, rate_hz=RATE, thermal="warm")

    def observed(seed: int, touch: Touch | None = None) -> tuple[Array, Array]:
        one = run(arm, plant, seed, touch)
        return observer.residuals(*one), one[2]

    learned = [observed(100 + k) for k in range(LEARN)]
    residuals, speeds = ([part[SETTLED:] for part in parts] for parts in zip(*learned, strict=True))
    thresholds = contact_thresholds(residuals, speeds, noise=estimate.noise)
    free = [thresholds.contacts(*observed(20_000 + k))[SETTLED:] for k in range(FREE)]
    alarms = sum(bool(seen.any()) for seen in free)
    random, delays = np.random.default_rng(7), []
    for k in range(CONTACTS):
        touch = int(random.integers(200, 1100)), k % 6, CONTACT * (-1.0) ** (k // 6)
        seen = thresholds.contacts(*observed(30_000 + k, touch))[touch[0] :].any(axis=1)
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
