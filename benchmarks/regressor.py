"""Throughput of the regressor, beside a Python loop over pinocchio's.

Both fill the inertial columns of a UR5 for the same 1248 samples on one thread; the rounds
alternate, so that both meet the same load of the machine, and the fastest round counts. The
asked figure is six times pinocchio's throughput. Needs pinocchio: pip install 'dynid[dev]'.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Collection

import numpy as np
import pinocchio as pin

from dynid.regressor import InverseDynamicModel
from dynid.regressor.inertial import inertial_columns
from dynid.robot import RobotModel, load_robot

SAMPLES = 1248
ROUNDS = 60
ASKED = 6.0
SAME_TORQUE = 1e-9
"""The two regressors must predict the same torques, to this share of the largest."""


def pinocchio_model(robot: RobotModel, frames: str) -> tuple[pin.Model, np.ndarray]:
    """The chain, with an ellipsoid of 1 kg for each link, and their parameters (10 n), ours."""
    model, parent = pin.Model(), 0
    body = pin.Inertia(1.0, np.array([0.02, 0.03, -0.05]), np.diag([0.02, 0.03, 0.015]))
    order = [0, 1, 2, 3, 4, 6, 9, 8, 7, 5]
    for k in range(robot.joints):
        joint = pin.JointModelRevoluteUnaligned(robot.axes[k])
        parent = model.addJoint(parent, joint, pin.SE3(robot.placements[k]), f"j{k}")
        model.appendBodyToJoint(parent, body, pin.SE3(robot.parameter_frames[frames][k]))
    model.gravity.linear = np.array(robot.gravity)
    return model, np.tile(np.array(body.toDynamicParameters())[order], robot.joints)


def fastest(
    works: dict[str, Callable[[], object]], rounds: int, rare: Collection[str] = ()
) -> dict[str, float]:
    """The shortest time of each [s]; the first round warms the caches, rare ones run every 8th."""
    times = dict.fromkeys(works, np.inf)
    for number in range(rounds + 1):
        for name, work in works.items():
            if name in rare and number % 8:
                continue
            start = time.perf_counter()
            work()
            if number:
                times[name] = min(times[name], time.perf_counter() - start)
    return times


def main() -> int:
    """Print the table; 1 if the asked figure is missed."""
    model = InverseDynamicModel(robot=load_robot("ur5"))
    robot, constants, n = model.robot, model.constants, model.robot.joints
    theirs, parameters = pinocchio_model(robot, model.frames)
    data = theirs.createData()
    random = np.random.default_rng(0)
    q, dq, ddq = random.uniform(-3, 3, (3, SAMPLES, n))
    by_joint = model.motion(q, dq, ddq)
    loop_out = np.empty((SAMPLES, n, 10 * n))
    columns_out = np.zeros((10 * n, n, SAMPLES))
    stack_out = np.zeros((len(model.columns), n, SAMPLES))

    def loop() -> None:
        for k in range(SAMPLES):
            loop_out[k] = pin.computeJointTorqueRegressor(theirs, data, q[k], dq[k], ddq[k])

    reference = "pinocchio, loop over computeJointTorqueRegressor, 60 columns"
    asked = "dynid, inertial_columns, 60 columns"
    times = fastest(
        {
            reference: loop,
            asked: lambda: inertial_columns(constants, by_joint, columns_out),
            "dynid, stack, 78 columns": lambda: model.stack(q, dq, ddq, out=stack_out),
            "dynid, stack, 78 columns, memory new each time": lambda: model.stack(q, dq, ddq),
        },
        ROUNDS,
    )
    ours = np.tensordot(parameters, columns_out, axes=1).T
    truth = np.array([pin.rnea(theirs, data, *state) for state in zip(q, dq, ddq, strict=True)])
    if np.abs(ours - truth).max() > SAME_TORQUE * np.abs(truth).max():
        print("the two regressors disagree", file=sys.stderr)
        return 1
    print(f"UR5, {SAMPLES} samples, one thread, fastest of {ROUNDS} rounds")
    print(f"{'':62}{'us/sample':>10}{'ratio':>7}")
    for name, seconds in times.items():
        print(f"{name:62}{1e6 * seconds / SAMPLES:10.3f}{times[reference] / seconds:7.2f}")
    ratio = times[reference] / times[asked]
    print(f"throughput {ratio:.1f} times that of the loop over pinocchio; asked: {ASKED:g}")
    return int(ratio < ASKED)


if __name__ == "__main__":
    sys.exit(main())
