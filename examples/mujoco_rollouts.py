"""The identified model in MuJoCo: its torques along a motion, and its motion under torques."""

import tempfile
from pathlib import Path

import mujoco
import numpy as np

import dynid

robot = dynid.load_robot("ur5")
motions = [dynid.random_excitation(robot.limits, seed=seed) for seed in (1, 2)]
record, other = (dynid.simulate_recording(robot, m, seed=k) for k, m in enumerate(motions))
settings = dynid.IdentifySettings(estimator="sdp")
estimate = dynid.identify(record, robot, settings).estimate
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "ur5.xml"
    dynid.write_model(estimate, path, "mjcf")
    model = mujoco.MjModel.from_xml_path(str(path))
data = mujoco.MjData(model)

# Torques that MuJoCo needs along the motion, against those of the estimate.
t = np.linspace(0.0, other.t[-1], 200)
motion = motions[1].evaluate(t)
predicted = estimate.predict(motion.q, motion.dq, motion.ddq)
errors = []
for k in range(len(t)):
    data.qpos[:], data.qvel[:], data.qacc[:] = motion.q[k], motion.dq[k], motion.ddq[k]
    mujoco.mj_inverse(model, data)
    errors.append(data.qfrc_inverse - predicted[k])
moving = np.abs(motion.dq).min(axis=1) > 0.05
print(f"largest torque difference while all joints move: {np.abs(errors)[moving].max():.2g} N.m")

# The motion that MuJoCo makes of the estimate's torques, without a controller.
step, start = model.opt.timestep, 1.0
t = start + step * np.arange(int(0.2 / step) + 1)
motion = motions[1].evaluate(t)
torque = estimate.predict(motion.q, motion.dq, motion.ddq)
data.qpos[:], data.qvel[:] = motion.q[0], motion.dq[0]
for applied in torque[:-1]:
    data.qfrc_applied[:] = applied
    mujoco.mj_step(model, data)
gone = np.abs(motion.q[-1] - motion.q[0]).max()
print(f"rolled out for 0.2 s: {np.abs(data.qpos - motion.q[-1]).max():.2g} of {gone:.2g} rad off")
