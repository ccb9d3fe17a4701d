"""Friction as a function of joint temperature: cold, in between and warm."""

import numpy as np

import dynid

robot = dynid.load_robot("ur5")
motion = dynid.random_excitation(robot.limits, seed=4)
records = [
    dynid.simulate_recording(robot, motion, thermal=temperature, seed=k)
    for k, temperature in enumerate((20.0, 30.0, 40.0))
]
found = dynid.identify_temperature(records, robot)
cold, warm = found.estimate_at(20.0), found.estimate_at(40.0)
viscous = [k for k, name in enumerate(cold.names) if name.startswith("Fv")]
for k in viscous:
    change = 100 * (warm.values[k] / cold.values[k] - 1)
    print(f"{cold.names[k]}: {cold.values[k]:.2f} at 20 degC, {change:+.0f} % at 40 degC")

other = dynid.random_excitation(robot.limits, seed=5)
record = dynid.simulate_recording(robot, other, thermal=35.0, seed=9)
for temperature in (20.0, 35.0):
    error = dynid.validate(found.estimate_at(temperature), record).metrics.rmse
    print(f"recorded at 35 degC, model at {temperature:g}: {np.linalg.norm(error):.2f} N.m")
