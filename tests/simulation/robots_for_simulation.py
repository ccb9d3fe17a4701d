"""Robots for the tests of the simulation, and pinocchio's view of them."""

from dataclasses import fields

import numpy as np
import pinocchio as pin

from dynid.core import Array
from dynid.robot import Drives, JointLimits, RobotModel
from dynid.simulation import (
    GroundTruth,
    JointFriction,
    JointSensors,
    JointThermal,
    PlantState,
    SimulatedArm,
    point_masses,
)
from dynid.trajectory import JointMotion

A = (0.0, -0.425, -0.39225, 0.0, 0.0, 0.0)
D = (0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823)
ALPHA = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)
HOME = np.array([0.0, -1.4, 1.2, -1.3, -1.2, 0.3])


def turn(angle: float, axis: int) -> Array:
    matrix = np.eye(4)
    first, second = [k for k in range(3) if k != axis]
    sign = -1.0 if axis == 1 else 1.0
    matrix[first, first] = matrix[second, second] = np.cos(angle)
    matrix[second, first] = sign * np.sin(angle)
    matrix[first, second] = -sign * np.sin(angle)
    return matrix


def shift(x: float, y: float, z: float) -> Array:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def build_ur5(gravity: tuple[float, float, float] = (0.0, 0.0, -9.80665)) -> RobotModel:
    """Joint frame i stands at the end of DH frame i - 1; its z is the joint axis."""
    table = zip(A, D, ALPHA, strict=True)
    dh = [shift(0, 0, d) @ shift(a, 0, 0) @ turn(alpha, 0) for a, d, alpha in table]
    n = 6
    return RobotModel(
        name="ur5",
        joint_names=tuple(f"joint{k + 1}" for k in range(n)),
        joint_types=("revolute",) * n,
        placements=np.array([np.eye(4), *dh[:-1]]),
        axes=np.tile([0.0, 0.0, 1.0], (n, 1)),
        parameter_frames={"dh": np.array(dh), "urdf": np.tile(np.eye(4), (n, 1, 1))},
        default_frames="dh",
        gravity=np.array(gravity),
        limits=JointLimits(
            lower=np.full(n, -2 * np.pi),
            upper=np.full(n, 2 * np.pi),
            velocity=np.full(n, np.pi),
            acceleration=np.full(n, np.nan),
            torque=np.array([150.0, 150.0, 150.0, 28.0, 28.0, 28.0]),
        ),
        drives=Drives(
            gain=np.array([13.64, 13.75, 13.69, 9.67, 8.74, 9.02]), gear_ratio=np.full(n, 101.0)
        ),
        inertias=np.full((n, 10), np.nan),
    )


def build_chain(seed: int = 0, joints: int = 5) -> RobotModel:
    """A chain with crooked axes, joints that slide, and a crooked mounting."""
    generator = np.random.default_rng(seed)
    placements, axes, inertias = [], [], []
    for _ in range(joints):
        placement = turn(generator.normal(), 0) @ turn(generator.normal(), 1)
        placement[:3, 3] = 0.3 * generator.normal(size=3)
        axis = generator.normal(size=3)
        body = 0.1 * generator.normal(size=(4, 3)) + 0.05 * generator.normal(size=3)
        # Four point masses are a body that can exist; Steiner terms come with them.
        weights = generator.uniform(0.5, 2.0, size=4)
        second = np.einsum("k,ki,kj->ij", weights, body, body)
        tensor = np.trace(second) * np.eye(3) - second
        placements.append(placement)
        axes.append(axis / np.linalg.norm(axis))
        inertias.append(
            [
                weights.sum(),
                *(weights @ body),
                *np.diag(tensor),
                tensor[1, 2],
                tensor[0, 2],
                tensor[0, 1],
            ]
        )
    nan = np.full(joints, np.nan)
    return RobotModel(
        name="chain",
        joint_names=tuple(f"j{k}" for k in range(joints)),
        joint_types=tuple("prismatic" if k % 3 == 1 else "revolute" for k in range(joints)),
        placements=np.array(placements),
        axes=np.array(axes),
        parameter_frames={"urdf": np.tile(np.eye(4), (joints, 1, 1))},
        default_frames="urdf",
        gravity=np.array([1.0, -4.0, -8.0]),
        limits=JointLimits(
            lower=np.full(joints, -0.5),
            upper=np.full(joints, 0.5),
            velocity=np.ones(joints),
            acceleration=nan,
            torque=nan,
        ),
        drives=Drives(gain=nan, gear_ratio=nan),
        inertias=np.array(inertias),
    )


def ideal_friction(coulomb: Array, viscous: Array, width: float) -> JointFriction:
    """Fc tanh(dq / width) + Fv dq at any load and temperature."""
    zero, one = np.zeros(len(coulomb)), np.ones(len(coulomb))
    return JointFriction(
        coulomb=coulomb,
        viscous=viscous,
        breakaway=zero,
        stribeck_velocity=one,
        load_factor=zero,
        stiffness=one,
        damping=zero,
        viscous_decay=zero,
        coulomb_drift=zero,
        width=width,
    )


def constant_temperature(joints: int, temperature_degC: float = 24.0) -> JointThermal:
    """Joints that never warm up."""
    one = np.ones(joints)
    return JointThermal(
        resistance=one,
        capacity=np.inf * one,
        winding=0 * one,
        warm_degC=temperature_degC * one,
        ambient_degC=temperature_degC,
    )


def chosen_sensors(joints: int, **noise: float) -> JointSensors:
    """Sensors with white noise alone, of a standard deviation for some quantities."""
    names = [item.name for item in fields(JointSensors)]
    return JointSensors(
        **{name: np.full(joints, noise.get(name.removesuffix("_noise"), 0.0)) for name in names}
    )


def ideal_arm(
    robot: RobotModel, parameters: Array, width: float = 1e-3, sensors: JointSensors | None = None
) -> SimulatedArm:
    """An arm that obeys the identified model exactly: (n, 13) ten inertial ones, Fc, Fv, Im."""
    n, rows = robot.joints, np.asarray(parameters)
    truth = GroundTruth(
        inertials=rows[:, :10],
        motor_inertia=rows[:, 12],
        friction=ideal_friction(rows[:, 10], rows[:, 11], width),
        thermal=constant_temperature(n),
        sensors=sensors or chosen_sensors(n),
        gain=np.where(np.isnan(robot.drives.gain), 1.0, robot.drives.gain),
        label="ideal",
    )
    controller = point_masses(truth.inertials, 0.8 * rows[:, 10], 0.9 * rows[:, 11])
    return SimulatedArm(robot=robot, truth=truth, controller=controller)


def one_joint(
    friction: JointFriction, *, gravity: float = 0.0, thermal: JointThermal | None = None
) -> SimulatedArm:
    """A bar on one horizontal axis, one kilogram half a metre out."""
    one = np.ones(1)
    robot = RobotModel(
        name="bar",
        joint_names=("bar",),
        joint_types=("revolute",),
        placements=np.eye(4)[None],
        axes=np.array([[0.0, 0.0, 1.0]]),
        parameter_frames={"urdf": np.eye(4)[None]},
        default_frames="urdf",
        gravity=np.array([0.0, -gravity, 0.0]),
        limits=JointLimits(
            lower=[np.nan], upper=[np.nan], velocity=[2.0], acceleration=[np.nan], torque=[200.0]
        ),
        drives=Drives(gain=one, gear_ratio=one),
        inertias=np.array([[1.0, 0.5, 0, 0, 0.01, 0.26, 0.26, 0, 0, 0]]),
    )
    truth = GroundTruth(
        inertials=robot.inertias,
        motor_inertia=np.array([0.3]),
        friction=friction,
        thermal=thermal or constant_temperature(1),
        sensors=chosen_sensors(1),
        gain=one,
        label="test",
    )
    controller = point_masses(robot.inertias, np.zeros(1), np.zeros(1))
    return SimulatedArm(robot=robot, truth=truth, controller=controller)


def pinocchio_model(robot: RobotModel, parameters: Array) -> pin.Model:
    """The same arm in pinocchio, from the (n, 13) standard parameters: an independent oracle."""
    model, parent = pin.Model(), 0
    for i in range(robot.joints):
        kind = (
            pin.JointModelPrismaticUnaligned
            if robot.prismatic[i]
            else pin.JointModelRevoluteUnaligned
        )
        placement = pin.SE3(robot.placements[i])
        parent = model.addJoint(parent, kind(*robot.axes[i]), placement, robot.joint_names[i])
        m, mx, my, mz, xx, yy, zz, yz, xz, xy = parameters[i, :10]
        body = pin.Inertia.FromDynamicParameters(np.array([m, mx, my, mz, xx, xy, yy, xz, yz, zz]))
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    model.gravity.linear = robot.gravity
    model.armature = parameters[:, 12]
    return model


def regressor(model: pin.Model, motion: JointMotion | PlantState, width: float) -> Array:
    """(N n, n 13) pinocchio's inertial columns in our order, then tanh(dq / width), dq, ddq."""
    data, n, eye = model.createData(), model.nq, np.eye(model.nq)
    ours = [0, 1, 2, 3, 4, 6, 9, 8, 7, 5]
    rows = []
    for q, dq, ddq in zip(motion.q, motion.dq, motion.ddq, strict=True):
        inertial = pin.computeJointTorqueRegressor(model, data, q, dq, ddq).reshape(n, n, 10)
        own = np.stack([eye * np.tanh(dq / width), eye * dq, eye * ddq], axis=2)
        rows.append(np.concatenate([inertial[:, :, ours], own], axis=2).reshape(n, -1))
    return np.concatenate(rows)
