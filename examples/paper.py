"""The paper in forty lines: 52 base parameters, a design, two runs, cold against warm.

"Identification of a UR5 Collaborative Robot Dynamic Parameters", on the simulated UR5.
"""

import numpy as np

import dynid

robot = dynid.load_robot("ur5")
analysis = dynid.analyze(robot)
print(f"{analysis.base.rank} of {len(analysis.base.model.columns)} parameters show in the torques")

# The paper's criterion is the condition number of the observation matrix (153 there).
cond = dynid.DesignSettings(criterion="cond", limits="paper", starts=2, seed=1)
design = dynid.design(robot, cond)
print(f"condition number of the excitation trajectory: {design.condition_number:.0f}")

settings = dynid.IdentifySettings(preset="paper")
other = dynid.random_excitation(robot.limits, seed=7)
estimates = {}
for thermal in ("cold", "warm"):
    record = dynid.simulate_recording(robot, design.trajectory, periods=3, thermal=thermal, seed=1)
    result = dynid.identify(record, robot, settings)
    estimates[thermal] = result.estimate
    check = dynid.simulate_recording(robot, other, thermal=thermal, seed=2)
    metrics = dynid.validate(result.estimate, check).metrics
    error = float(np.max(metrics.normalized_error))
    print(f"{thermal}: e_N = {error:.4f} N.m over {metrics.samples} samples of another motion")

change = dynid.compare(estimates["cold"], estimates["warm"])
for group in change.groups:
    print(f"{group.name}: {group.median_change_percent:+.0f} % from cold to warm (median)")
