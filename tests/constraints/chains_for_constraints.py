"""Random arms with collision bodies, states to judge them at, and coal's distances."""

from __future__ import annotations

from dataclasses import replace

import coal
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from dynid.robot import (
    Body,
    JointLimits,
    RobotModel,
    SafetyLimits,
    from_body,
    from_xyz_rpy,
    robot_from_chain,
)

Floats = NDArray[np.float64]
CYLINDER_WITHIN = 0.0087
"""A cylinder is judged as a prism around it: this share of its radius nearer."""


def random_arm(joints: int, seed: int, *, slides: bool = True) -> RobotModel:
    """An arm with everything known: limits, safety limits, inertias, two bodies a link."""
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
        bodies=tuple(
            Body(
                name=f"link {k} {side}",
                link=k,
                points=random.uniform(-0.15, 0.15, (2 + 6 * side, 3)),
                radius=random.uniform(0.02, 0.06) * (1 - side),
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


def coal_distance(a: object, at_a: np.ndarray, b: object, at_b: np.ndarray) -> float:
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.gjk_tolerance = request.epa_tolerance = 1e-12
    places = [coal.Transform3s(pose[:3, :3], pose[:3, 3]) for pose in (at_a, at_b)]
    return float(coal.distance(a, places[0], b, places[1], request, result))


def hull_in_coal(body: Body) -> coal.Convex:
    """The hull of a body's points; its radius is not counted."""
    points = np.array(body.points)
    if len(points) == 2:
        # A needle: coal knows no segments.
        across = np.linalg.svd((points[1] - points[0])[None])[2][1:]
        points = np.concatenate([points, points.mean(axis=0) + 1e-9 * across])
    corners, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for point in points:
        corners.append(point)
    hull = ConvexHull(points, qhull_options="QJ")
    for face, plane in zip(hull.simplices.tolist(), hull.equations, strict=True):
        i, j, k = face
        outward = np.cross(points[j] - points[i], points[k] - points[i]) @ plane[:3] > 0
        faces.append(coal.Triangle(i, j, k) if outward else coal.Triangle(i, k, j))
    return coal.Convex(corners, faces)
