"""MuJoCo models of a robot."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.core.optional import require
from dynid.robot.model import RobotModel
from dynid.simulation.inertia import link_body


def mujoco_model(robot: RobotModel, inertials: Array, armature: Array, step: float) -> Any:
    """A compiled MuJoCo model: the chain alone, without contacts, limits or damping.

    Body i is joint frame i, so `qpos`, `qvel` and `qfrc_*` have the robot's joints in order.

    Args:
        robot: Kinematics and mounting.
        inertials: (n, 10) the ten parameters of each link about its joint frame.
        armature: (n) rotor inertias, joint side [kg.m^2].
        step: Time step [s].

    Returns:
        A `mujoco.MjModel`; integrator `implicitfast`.

    Raises:
        InputError: An inertia that no rigid body has.
        MissingExtraError: MuJoCo is not installed.
    """
    mujoco = require("mujoco", "sim")
    spec = mujoco.MjSpec()
    spec.modelname = "arm"
    spec.option.timestep = step
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.gravity = robot.gravity
    disable = mujoco.mjtDisableBit
    # A reset in the middle of a run would look like data; the plant watches for divergence.
    spec.option.disableflags |= (
        disable.mjDSBL_CONSTRAINT | disable.mjDSBL_CONTACT | disable.mjDSBL_AUTORESET
    )
    body = spec.worldbody
    for i in range(robot.joints):
        mass, com, tensor = link_body(inertials[i])
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, robot.placements[i, :3, :3].ravel())
        body = body.add_body(name=f"link{i + 1}", pos=robot.placements[i, :3, 3], quat=quaternion)
        body.mass, body.ipos, body.explicitinertial = mass, com, True
        body.fullinertia = tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        joint = body.add_joint(name=f"joint{i + 1}", axis=robot.axes[i])
        slides = robot.prismatic[i]
        joint.type = mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE
        joint.armature = armature[i]
    try:
        return spec.compile()
    except ValueError as error:
        raise InputError(
            "MuJoCo refuses the robot's inertias", where=robot.name, value=str(error)
        ) from error
