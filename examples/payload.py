"""Mass, centre and tensor of a gripper, from one motion without it and with it."""

import dynid
from dynid.robot import with_tool

robot = dynid.load_robot("ur5")
# The simulated arm carries what the robot's tool says: 1.5 kg, 60 mm before the flange.
gripper = with_tool(robot, payload=(1.5, 0.01, 0.0, 0.06))
motion = dynid.random_excitation(robot.limits, seed=3)
unloaded = dynid.simulate_recording(robot, motion, periods=2, seed=1)
loaded = dynid.simulate_recording(gripper, motion, periods=2, seed=2)

payload = dynid.identify_payload(unloaded, loaded, robot)
print(f"mass {payload.mass:.3f} kg (true 1.5), centre {payload.centre} m (true 0.01 0 0.06)")
