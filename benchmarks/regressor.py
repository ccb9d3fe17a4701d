"""Throughput of the regressor, beside a Python loop over pinocchio's.

Both fill the inertial columns of a UR5 for the same 1248 samples on one thread; the rounds
alternate, so that both meet the same load of the machine, and the fastest round counts. The
asked figure is six times pinocchio's throughput. Needs pinocchio: pip install 'dynid[dev]'.
"""

from __future__ import annotations

import sys

import numpy as np
from shared.measuring import fastest
from shared.pinocchio_arm import PinocchioArm

from dynid.regressor import InverseDynamicModel
from dynid.regressor.inertial import inertial_columns
from dynid.robot import load_robot

SAMPLES, ROUNDS, ASKED = 1248, 60, 6.0
SAME_COLUMNS = 1e-9
"""The two regressors must agree, to this share of the largest number."""


def main() -> int:
    """Print the table; 1 if the asked figure is missed."""
    model = InverseDynamicModel(robot=load_robot("ur5"))
    constants, n = model.constants, model.robot.joints
    theirs = PinocchioArm(model.robot, model.frames)
    q, dq, ddq = np.random.default_rng(0).uniform(-3, 3, (3, SAMPLES, n))
    by_joint = model.motion(q, dq, ddq)
    loop_out = np.empty((SAMPLES, n, 10 * n))
    columns_out = np.zeros((10 * n, n, SAMPLES))
    stack_out = np.zeros((len(model.columns), n, SAMPLES))
    reference = "pinocchio, loop over computeJointTorqueRegressor, 60 columns"
    asked = "dynid, inertial_columns, 60 columns"
    times = fastest(
        {
            reference: lambda: theirs.loop(q, dq, ddq, loop_out),
            asked: lambda: inertial_columns(constants, by_joint, columns_out),
            "dynid, stack, 78 columns": lambda: model.stack(q, dq, ddq, out=stack_out),
            "dynid, stack, 78 columns, memory new each time": lambda: model.stack(q, dq, ddq),
        },
        ROUNDS,
    )
    truth = theirs.rows(q, dq, ddq)[:, :, : 10 * n]
    if np.abs(columns_out.transpose(2, 1, 0) - truth).max() > SAME_COLUMNS * np.abs(truth).max():
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
