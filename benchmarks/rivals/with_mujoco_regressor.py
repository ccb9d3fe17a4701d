"""mujoco-sysid 0.2.1 (based-robotics): its regressor in the place of pinocchio's."""

import mujoco
import numpy as np
import plain_pinocchio
from mujoco_sysid.regressors import joint_torque_regressor


def regressor(model, q, dq, ddq):
    """(n, N, p) as `plain_pinocchio.regressor`."""
    data, n, one = mujoco.MjData(model), model.nv, np.ones_like(dq)
    W = np.zeros((n, len(q), 14 * n))
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], dq[k], ddq[k]
        mujoco.mj_inverse(model, data)
        mujoco.mj_rnePostConstraint(model, data)
        W[:, k, : 10 * n] = joint_torque_regressor(model, data)
    for c, column in enumerate((ddq, dq, np.tanh(dq / 0.01), one)):
        for j in range(n):
            W[j, :, (10 + c) * n + j] = column[:, j]
    return W


def run(urdf, gravity, q, tau, rate, q_test, rate_test):
    """The plain pipeline with this regressor."""
    spec = mujoco.MjSpec.from_file(urdf)
    spec.option.gravity = gravity
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    plain_pinocchio.regressor = regressor
    model = spec.compile()
    return plain_pinocchio.predict(
        model, *plain_pinocchio.identify(model, q, tau, rate), q_test, rate_test
    )
