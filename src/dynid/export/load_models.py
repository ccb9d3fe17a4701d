"""Torques of URDF and MJCF files, by the programs that load them."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import JobError
from dynid.export.verification import States


def urdf_torque(path: Path, gravity: float, states: States) -> tuple[Array | None, str]:
    """(N, n) torques of a URDF file by pinocchio, and its name; None if it is not installed.

    Args:
        path: The file.
        gravity: Strength of gravity [m/s^2], which URDF does not hold.
        states: Where.

    Raises:
        JobError: Pinocchio cannot read the file.
    """
    try:
        pin: Any = importlib.import_module("pinocchio")
    except ImportError:
        return None, "pinocchio is not installed (pip install pin)"
    try:
        model = pin.buildModelFromUrdf(str(path))
    except (ValueError, RuntimeError) as error:
        raise JobError("pinocchio cannot read the file", where=str(path), value=error) from error
    model.gravity.linear = np.array([0.0, 0.0, -gravity])
    data = model.createData()
    rigid = np.array(
        [
            pin.rnea(model, data, *state)
            for state in zip(states.q, states.dq, states.ddq, strict=True)
        ]
    )
    rubbing = model.damping * states.dq + model.upperDryFrictionLimit * np.sign(states.dq)
    return rigid + rubbing, f"pinocchio {pin.__version__}"


def mjcf_torque(path: Path, states: States) -> tuple[Array | None, str]:
    """(N, n) torques of an MJCF file by MuJoCo, and its name; None if it is not installed.

    MuJoCo softens dry friction into a constraint; here the loss it read acts against the speed.

    Args:
        path: The file.
        states: Where.

    Raises:
        JobError: MuJoCo cannot read the file.
    """
    try:
        mujoco: Any = importlib.import_module("mujoco")
    except ImportError:
        return None, "MuJoCo is not installed (pip install 'dynid[sim]')"
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise JobError("MuJoCo cannot read the file", where=str(path), value=error) from error
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(model)
    torque = np.empty(states.q.shape)
    for k, (q, dq, ddq) in enumerate(zip(states.q, states.dq, states.ddq, strict=True)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
        mujoco.mj_inverse(model, data)
        torque[k] = data.qfrc_inverse
    torque += model.dof_frictionloss * np.sign(states.dq)
    return torque, f"MuJoCo {mujoco.__version__}"
