"""Random arms with capsules, and states to judge them at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid.robot import Capsule, RobotModel, from_body, from_xyz_rpy
from dynid.robot.dh import robot_from_chain
from dynid.robot.model import JointLimits, SafetyLimits

Floats = NDArray[np.float64]


def random_arm(joints: int, seed: int, *, slides: bool = True) -> RobotModel:
    """An arm with everything known: limits, safety limits, inertias, two capsules a link."""
    random = np.random.default_rng(seed)
    placements = np.array(
        [
            from_xyz_rpy(random.uniform(-0.3, 0.3, 3).tolist(), random.uniform(-3, 3, 3).tolist())
            for _ in range(joints)
        ]
    )
    axes = random.standard_normal((joints, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    kinds = ["prismatic" if slides and k % 3 == 1 else "revolute" for k in range(joints)]
    arm = robot_from_chain(
        placements=placements,
        axes=axes,
        joint_types=kinds,
        flange=from_xyz_rpy([0.1, 0, 0], [0] * 3),
    )
    links = []
    for _ in range(joints):
        half = random.standard_normal((3, 3)) * 0.05
        links.append(from_body(random.uniform(0.5, 3), random.uniform(-0.2, 0.2, 3), half @ half.T))
    ones = np.ones(joints)
    return replace(
        arm,
        inertias=np.array(links),
        limits=JointLimits(
            lower=-2 * ones,
            upper=2 * ones,
            velocity=2 * ones,
            acceleration=5 * ones,
            torque=random.uniform(5, 20, joints),
        ),
        safety=SafetyLimits(
            tcp_speed=0.3, elbow_speed=0.2, momentum=0.8, power=8.0, elbow=max(1, joints // 2)
        ),
        capsules=tuple(
            Capsule(
                name=f"link {k} {side}",
                link=k,
                start=random.uniform(-0.15, 0.15, 3),
                end=random.uniform(-0.15, 0.15, 3),
                radius=random.uniform(0.02, 0.06),
            )
            for k in range(joints + 1)
            for side in range(2)
        ),
    )


def random_states(joints: int, samples: int, seed: int) -> tuple[Floats, Floats, Floats]:
    """Positions, velocities and accelerations (N, n) that break most limits now and then."""
    random = np.random.default_rng(seed)
    spread = (2.2, 2.2, 6.0)
    q, dq, ddq = (random.uniform(-s, s, (samples, joints)) for s in spread)
    return q, dq, ddq
