"""What a feed-forward of identified torques gains: the torque that is left for the servo."""

import numpy as np

import dynid

robot = dynid.load_robot("ur5")
motions = [dynid.random_excitation(robot.limits, seed=seed) for seed in (1, 2)]
record, task = (dynid.simulate_recording(robot, m, seed=k) for k, m in enumerate(motions))
estimate = dynid.identify(record, robot).estimate

motion = motions[1].evaluate(task.t)
measured = task.signals["current"] * robot.drives.gain
presliding = estimate.model.friction_state(motion.q)
feed_forward = estimate.predict(motion.q, motion.dq, motion.ddq, presliding)
gravity = estimate.predict(motion.q, 0 * motion.dq, 0 * motion.ddq)
for name, given in (("nothing", 0 * measured), ("gravity", gravity), ("all", feed_forward)):
    left = np.sqrt(np.mean((measured - given) ** 2, axis=0))
    print(f"feed-forward of {name}: the servo still makes {np.round(left, 2)} N.m")
