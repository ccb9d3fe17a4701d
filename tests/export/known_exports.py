"""Estimates of robots whose standard parameters are known, and pinocchio's model of them."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from dynid.core import Array, provenance
from dynid.identification import Estimate, MotionRange
from dynid.reduction import random_states, reduce_model
from dynid.regressor import (
    TERMS,
    FrictionTerms,
    Gear,
    InverseDynamicModel,
    LoadFriction,
    TorqueRipple,
    parse_terms,
)
from dynid.robot import Counterbalance, Drives, RobotModel, load_robot, robot_from_chain
from dynid.signals import ProcessingSettings

EVERY_TERM = parse_terms(",".join(TERMS), width=0.02)
# Steps so wide that random states tell the offset, the asymmetry and Stribeck friction apart.
WIDE_TERMS = parse_terms(",".join(TERMS), width=0.5, stribeck_velocity=1.0)
IN_PINOCCHIO = [0, 1, 2, 3, 4, 6, 9, 8, 7, 5]


class States(NamedTuple):
    """(N, n) each."""

    q: Array
    dq: Array
    ddq: Array


def random_motion(robot: RobotModel, samples: int = 200) -> States:
    return States(*random_states(robot, samples, 0))


def load_bodies(joints: int, seed: int = 0) -> tuple[Array, Array]:
    """Two sets of bodies (10 n), each possible, whose difference is not."""
    return some_bodies(seed + 50, joints).ravel(), some_bodies(seed + 90, joints).ravel()


def with_load(terms: FrictionTerms, joints: int, seed: int = 0) -> FrictionTerms:
    """Friction by load on all joints but the first; the load is that of no possible bodies."""
    more, less = load_bodies(joints, seed)
    named = tuple(range(1, joints))
    load = LoadFriction(joints=named, parameters=tuple((more - less).tolist()))
    return replace(terms, load=load)


def with_ripple(terms: FrictionTerms, joints: int, seed: int = 0) -> FrictionTerms:
    """Ripple of the first joint's gear, and of it and the last one's in the last joint."""
    random = np.random.default_rng(seed)
    first = Gear(joint=0, waves=(120.2, 240.4), speed=1.7, powers=3)
    last = Gear(joint=joints - 1, waves=(2.0,), speed=0.4, powers=1)
    of_the_first_joint, of_the_last = (
        TorqueRipple(
            joint=joint,
            gears=gears,
            coefficients=tuple(random.normal(size=sum(gear.size for gear in gears)).tolist()),
        )
        for joint, gears in ((0, (first,)), (joints - 1, (first, last)))
    )
    return replace(terms, ripples=(of_the_first_joint, of_the_last))


def some_bodies(seed: int, links: int) -> Array:
    """(n, 10) parameters of bodies made of point masses, about any frame."""
    random = np.random.default_rng(seed)
    rows = np.empty((links, 10))
    for row in rows:
        masses, places = random.uniform(0.2, 2, 5), random.uniform(-0.2, 0.2, (5, 3))
        second = np.einsum("k,ki,kj", masses, places, places)
        inertia = np.trace(second) * np.eye(3) - second
        row[0], row[1:4] = masses.sum(), masses @ places
        row[4:7] = np.diag(inertia)
        row[7:] = inertia[1, 2], inertia[0, 2], inertia[0, 1]
    return rows


def estimate_of(
    robot: RobotModel, parameters: Array, friction: FrictionTerms | None = None
) -> Estimate:
    """An estimate that has the base parameters of these standard ones."""
    base = reduce_model(InverseDynamicModel(robot=robot, friction=friction or FrictionTerms()))
    n = robot.joints
    return Estimate(
        model=base.model,
        independent=base.independent,
        expressions=base.expressions,
        values=base.from_standard(parameters),
        covariance=np.eye(base.rank),
        naive_std=np.ones(base.rank),
        noise=np.ones(n),
        condition_number=10.0,
        scaled_condition_number=5.0,
        motion_condition_number=5.0,
        samples=2000,
        estimator="wls",
        preset="best",
        settings=ProcessingSettings(cutoff_hz=10.0, decimate=True, velocity="measured"),
        essential=(),
        motion=MotionRange(
            lower=-np.ones(n), upper=np.ones(n), speed=np.ones(n), acceleration=np.ones(n)
        ),
        provenance=provenance(),
    )


def parameters_of(robot: RobotModel, seed: int = 0, friction: FrictionTerms | None = None) -> Array:
    """Possible standard parameters (p), friction and motor inertias positive."""
    model = InverseDynamicModel(robot=robot, friction=friction or FrictionTerms())
    rest = np.random.default_rng(seed).uniform(0.2, 2.0, len(model.columns) - 10 * robot.joints)
    return np.concatenate([some_bodies(seed, robot.joints).ravel(), rest])


def mixed_chain() -> RobotModel:
    """Turning and sliding joints, oblique axes, gravity from the side."""
    random = np.random.default_rng(5)
    turns = np.linalg.qr(random.normal(size=(4, 3, 3)))[0]
    placements = np.tile(np.eye(4), (4, 1, 1))
    placements[:, :3, :3] = turns * np.sign(np.linalg.det(turns))[:, None, None]
    placements[:, :3, 3] = random.uniform(-0.4, 0.4, (4, 3))
    axes = random.normal(size=(4, 3))
    chain = robot_from_chain(
        placements=placements,
        axes=axes / np.linalg.norm(axes, axis=1, keepdims=True),
        name='mixed <chain> & "co" */ 4',
        joint_types=["revolute", "prismatic", "revolute", "revolute"],
    )
    return replace(chain, gravity=np.array([3.0, -9.0, 1.5]))


def heavy_arm() -> RobotModel:
    """A UR5 on the wall whose wrist motors are coupled, with a cylinder at the shoulder."""
    robot = load_robot("ur5", mount="wall")
    coupling = np.diag([101.0, 101.0, 101.0, 80.0, 80.0, 50.0])
    coupling[5, 4] = -50.0
    spring = Counterbalance(
        joint=1,
        outer=0.6,
        inner=0.2,
        rest_length=0.4,
        offset=0.3,
        piston_area=2e-3,
        gas_work=9e3,
        gas_volume=2e-3,
    )
    drives = Drives(gain=robot.drives.gain, gear_ratio=robot.drives.gear_ratio, coupling=coupling)
    return replace(robot, drives=drives, counterbalances=(spring,))


def pinocchio_chain(robot: RobotModel, parameters: Array) -> pin.Model:
    """Pinocchio's model from the standard parameters, with nothing from the library's export."""
    model, parent = pin.Model(), 0
    frames = robot.parameter_frames[robot.default_frames]
    for k, row in enumerate(parameters[: 10 * robot.joints].reshape(-1, 10)):
        slides = robot.prismatic[k]
        kind = pin.JointModelPrismaticUnaligned if slides else pin.JointModelRevoluteUnaligned
        parent = model.addJoint(
            parent, kind(robot.axes[k]), pin.SE3(robot.placements[k]), robot.joint_names[k]
        )
        body = pin.Inertia.FromDynamicParameters(row[np.argsort(IN_PINOCCHIO)])
        model.appendBodyToJoint(parent, body, pin.SE3(frames[k]))
    model.gravity.linear = np.array(robot.gravity)
    return model
