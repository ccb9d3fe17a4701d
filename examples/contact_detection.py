"""A push on the arm, seen by the momentum observer of an identified model."""

import numpy as np

import dynid

robot = dynid.load_robot("ur5")
motions = [dynid.random_excitation(robot.limits, seed=seed) for seed in (1, 2, 3)]
first, free, pushed = (dynid.simulate_recording(robot, m, seed=k) for k, m in enumerate(motions))
result = dynid.identify(first, robot)
observer = dynid.MomentumObserver(estimate=result.estimate, bandwidth=20.0)
gain = robot.drives.gain


def residuals(record: dynid.ExperimentRecord, push: float = 0.0) -> np.ndarray:
    """External torques; a push of 0.3 s on the third joint at 4 s."""
    torque = record.signals["current"] * gain
    torque[(record.t > 4.0) & (record.t < 4.3), 2] -= push
    return observer.residuals(record.t, record.signals["q"], record.signals["qd"], torque)


quiet = residuals(free)
limits = dynid.contact_thresholds([quiet], [free.signals["qd"]], rate_hz=125.0, bandwidth=20.0)
for push in (0.0, 10.0):
    found = residuals(pushed, push)
    alarms = limits.contacts(found, pushed.signals["qd"])
    when = pushed.t[alarms.any(axis=1)]
    seen = f"first at {when[0]:.2f} s" if len(when) else "none"
    print(f"push of {push:g} N.m: {seen}")
