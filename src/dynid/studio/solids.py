"""Triangles of the arm's bodies, of the shapes of a scene, and of the meshes of a URDF."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dynid.constraints import HALF_SPACE, MotionConstraints, Shape, body_of, surrounded
from dynid.core import Array, DynidError, Indices
from dynid.robot import Body, RobotModel, box_points, hull_faces, urdf_shapes

STICK = 0.035
"""Radius of the arm's bodies where none are known, as a share of its reach."""
PLANE = 3.0
"""Side of what is drawn of a floor or a wall [m]."""
_THIN = 0.004


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkMesh:
    """A body that moves with a link."""

    name: str
    link: int
    """0 for the base, i for what joint i moves."""
    vertices: Array
    """(V, 3) in the joint frame of the link [m]."""
    faces: Indices
    """(F, 3)"""
    smooth: bool = False
    """Whether its triangles stand for a round surface."""


def arm_meshes(robot: RobotModel) -> tuple[LinkMesh, ...]:
    """The robot's bodies; thin ones from joint to joint where it has none."""
    return tuple(
        LinkMesh(name=body.name, link=body.link, vertices=vertices, faces=faces)
        for body in robot.bodies or _sticks(robot)
        for vertices, faces in [body.surface()]
    )


def carried_meshes(constraints: MotionConstraints) -> tuple[LinkMesh, ...]:
    """What the flange carries, as it is judged: the scene's payload, and rods of the tool."""
    robot = constraints.robot
    scene = surrounded(constraints.settings, robot).scene
    return tuple(
        LinkMesh(name=shape.name, link=robot.joints, vertices=vertices, faces=faces)
        for shape in (scene.payload if scene else ())
        for vertices, faces in [body_of(shape, robot.joints, robot.flange).surface()]
    )


def arm_skins(robot: RobotModel) -> tuple[LinkMesh, ...]:
    """The robot's bodies as round as the meshes that they were fitted to; for the eye only."""
    found: list[LinkMesh] = []
    for mesh, body in zip(arm_meshes(robot), robot.bodies or _sticks(robot), strict=True):
        if len(body.points) > 3:
            # The rounded rim of a body is narrower than what a round link needs to look round.
            points, faces = hull_faces(body.points)
            grown = np.array(points)
            normal = corner_normals(points, faces, crease=math.pi)
            grown[faces.ravel()] += body.radius * normal
            mesh = replace(mesh, vertices=grown, faces=faces)
        found.append(replace(mesh, smooth=True))
    return tuple(found)


CREASE = math.radians(40.0)
"""Faces that meet at a larger angle keep their edge."""
ROUND_CREASE = math.radians(62.0)
"""The same where triangles stand for a round surface."""
_NOTHING = 1e-9
"""Twice the area of triangles that are not drawn: hulls have some [m^2]."""


def shaded(vertices: Array, faces: Indices, *, smooth: bool) -> Array:
    """Corners of triangles (V, 3) [m], (F, 3) for drawing: (3 F, 6) place [m] and unit normal.

    Smooth ones stand for a round surface.
    """
    first, second, third = vertices[faces].transpose(1, 0, 2)
    faces = faces[np.linalg.norm(np.cross(second - first, third - first), axis=1) > _NOTHING]
    normals = corner_normals(vertices, faces, crease=ROUND_CREASE if smooth else CREASE)
    return np.hstack([vertices[faces.ravel()], normals])


def corner_normals(vertices: Array, faces: Indices, *, crease: float) -> Array:
    """(3 F, 3) unit normals: at each corner the mean of the faces around that meet smoothly.

    Vertices (V, 3) at one place count as one; smooth is below the angle `crease` [rad].
    """
    first, second, third = vertices[faces].transpose(1, 0, 2)
    wide = np.cross(second - first, third - first)
    unit: Array = wide / (np.linalg.norm(wide, axis=1, keepdims=True) + 1e-30)
    _, welded = np.unique(np.round(vertices, 6), axis=0, return_inverse=True)
    # Numbered without gaps: vertices of no face have no corners.
    _, place = np.unique(welded.ravel()[faces.ravel()], return_inverse=True)
    order = np.argsort(place, kind="stable")
    _, start, count = np.unique(place[order], return_index=True, return_counts=True)
    many = count[place]
    own = np.repeat(np.arange(len(place)), many)
    step = np.arange(len(own)) - np.repeat(np.cumsum(many) - many, many)
    other = order[start[place][own] + step] // 3
    meets = np.einsum("px,px->p", unit[own // 3], unit[other]) >= math.cos(crease) - 1e-9
    total = np.zeros((len(place), 3))
    np.add.at(total, own, meets[:, None] * wide[other])
    size = np.linalg.norm(total, axis=1, keepdims=True)
    found: Array = np.where(size > 0, total / (size + 1e-30), np.repeat(unit, 3, axis=0))
    return found


def reach(robot: RobotModel) -> float:
    """Length of the arm along its joint frames at q = 0 [m]."""
    steps = [*robot.placements[:, :3, 3], robot.flange[:3, 3]]
    return float(sum(np.linalg.norm(step) for step in steps)) or 1.0


def _sticks(robot: RobotModel) -> tuple[Body, ...]:
    radius = STICK * reach(robot)
    ends = [*robot.placements[:, :3, 3], robot.flange[:3, 3]]
    return tuple(
        Body(
            name=f"link {k}",
            link=k,
            points=np.array([np.zeros(3), end]),
            radius=radius * (1.0 - 0.5 * k / len(ends)),
        )
        for k, end in enumerate(ends)
    )


def shape_mesh(shape: Shape) -> tuple[Array, Indices]:
    """(V, 3) vertices [m] and (F, 3) faces of a shape in its frame; a half-space is a plate."""
    if shape.kind == HALF_SPACE:
        half = np.array([PLANE / 2, PLANE / 2, _THIN / 2])
        points = box_points(half) - np.array([0.0, 0.0, _THIN / 2])
        return Body(name=shape.name, link=0, points=points, radius=0.0).surface()
    return body_of(replace(shape, pose=np.eye(4))).surface()


def robot_meshes(robot: RobotModel, notes: list[str]) -> tuple[LinkMesh, ...]:
    """What to draw of a robot: a URDF's `visual` elements where they can be read, else its bodies.

    The notes get what cannot be drawn.
    """
    if robot.urdf:
        try:
            found = tuple(_visual_meshes(robot, notes))
        except DynidError as error:
            # The file was good enough for a robot; what is only to be looked at may be broken.
            notes.append(f"not drawn: {error}")
            found = ()
        if found:
            return found
    return arm_skins(robot)


def _visual_meshes(robot: RobotModel, notes: list[str]) -> Iterator[LinkMesh]:
    """The `visual` elements of a URDF, in the joint frames of the robot's links."""
    for item in urdf_shapes(robot, Path(robot.urdf), "visual"):
        try:
            vertices, faces = item.surface()
        except DynidError as error:
            notes.append(f"not drawn: {item.where}: {error}")
            continue
        yield LinkMesh(name=item.name, link=item.link, vertices=vertices, faces=faces)
