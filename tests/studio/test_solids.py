from __future__ import annotations

import math

import numpy as np
import pytest

from dynid.constraints import BOX, CYLINDER, HALF_SPACE, SPHERE, Shape
from dynid.robot import Body, joint_poses, load_robot
from dynid.robot.body import beyond
from dynid.studio.solids import arm_meshes, arm_skins, reach, robot_meshes, shaded, shape_mesh

ON_SURFACE = 1e-6
"""Distances to a hull are found to this, and the hull that is drawn is joggled."""
NEAR = 0.012
"""How far what is drawn round bulges beyond a body [m]."""
FACETED = 0.08
"""A body drawn with flat faces holds a little less than a round one."""


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Of a closed surface; negative where it is seen from inside."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


@pytest.mark.parametrize("end", [[0.3, -0.2, 0.5], [0.1, 0.2, 0.3], [0.1, 0.2, -0.4]])
def test_a_body_is_drawn_on_its_surface_and_seen_from_outside(end: list[float]) -> None:
    start, stop, radius = np.array([0.1, 0.2, 0.3]), np.array(end), 0.07
    points = np.array([start, stop])
    vertices, faces = Body(name="x", link=0, points=points, radius=radius).surface()
    far = beyond(vertices, points)
    assert far.max() <= radius + ON_SURFACE
    assert far.min() >= (1 - FACETED) * radius
    length = float(np.linalg.norm(stop - start))
    true = math.pi * radius**2 * (length + 4 / 3 * radius)
    assert (1 - FACETED) * true < volume(vertices, faces) < true


def test_shapes_have_their_sizes() -> None:
    def made(kind: int, *size: float) -> float:
        shape = Shape(name="x", kind=kind, pose=np.eye(4), size=np.array(size))
        return volume(*shape_mesh(shape))

    assert made(BOX, 0.1, 0.2, 0.3) == pytest.approx(0.2 * 0.4 * 0.6)
    assert made(CYLINDER, 0.1, 0.2, 0) == pytest.approx(math.pi * 0.01 * 0.4, rel=0.03)
    assert made(SPHERE, 0.1, 0, 0) == pytest.approx(4 / 3 * math.pi * 1e-3, rel=FACETED)
    plate, _ = shape_mesh(Shape(name="x", kind=HALF_SPACE, pose=np.eye(4), size=np.zeros(3)))
    assert plate[:, 2].max() == 0.0


@pytest.mark.parametrize("name", ["ur3", "ur5", "ur10", "ur3e", "ur5e", "ur10e", "ur16e"])
def test_every_built_in_arm_has_a_body_for_every_link(name: str) -> None:
    robot = load_robot(name)
    meshes = arm_meshes(robot)
    assert {mesh.link for mesh in meshes} >= set(range(1, robot.joints))
    assert all(np.isfinite(mesh.vertices).all() for mesh in meshes)
    assert 0.5 < reach(robot) < 2.5


def test_what_is_drawn_round_stays_near_the_bodies_and_is_seen_from_outside() -> None:
    robot = load_robot("ur5")
    for skin, body in zip(arm_skins(robot), robot.bodies, strict=True):
        corners = shaded(skin.vertices, skin.faces, smooth=skin.smooth)
        far = beyond(corners[:, :3], body.points) - body.radius
        assert far.max() < NEAR
        np.testing.assert_allclose(np.linalg.norm(corners[:, 3:], axis=1), 1.0, rtol=1e-6)
        triangles = corners.reshape(-1, 3, 6)
        first, second, third = triangles[..., :3].transpose(1, 0, 2)
        turned = np.einsum("fx,fx->f", np.cross(second - first, third - first),
                           triangles[..., 3:].mean(axis=1))  # fmt: skip
        assert (turned >= 0).all()


def test_a_sphere_of_flat_faces_is_shaded_like_a_round_one() -> None:
    body = Body(name="ball", link=0, points=np.zeros((1, 3)), radius=0.1)
    corners = shaded(*body.surface(), smooth=True)
    size = np.linalg.norm(corners[:, :3], axis=1)
    assert 0.095 < size.min() <= size.max() < 0.104
    cosine = np.einsum("kx,kx->k", corners[:, :3] / size[:, None], corners[:, 3:])
    assert cosine.min() > math.cos(math.radians(6))


URDF = """<robot name="two"><link name="base"/><link name="arm"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><origin xyz="0 0 0.1" rpy="0 0 0"/><geometry>{geometry}</geometry></visual></link>
<joint name="j" type="revolute"><parent link="base"/><child link="arm"/>
<origin xyz="0 0 0.5"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/>
</joint></robot>"""
STL = """solid one
facet normal 0 0 1
outer loop
vertex 0 0 0
vertex 100 0 0
vertex 0 200 0
endloop
endfacet
endsolid one
"""


def test_visual_meshes_stand_where_the_urdf_says(tmp_path) -> None:
    (tmp_path / "part.stl").write_text(STL)
    path = tmp_path / "two.urdf"
    geometry = '<mesh filename="package://two/part.stl" scale="0.001 0.001 0.001"/>'
    path.write_text(URDF.format(geometry=geometry))
    notes: list[str] = []
    robot = load_robot(path)
    (mesh,) = robot_meshes(robot, notes)
    assert (mesh.link, notes) == (1, [])
    pose = joint_poses(robot, np.zeros(1))[0]
    drawn = mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
    expected = {(0.0, 0.0, 0.6), (0.1, 0.0, 0.6), (0.0, 0.2, 0.6)}
    assert {tuple(np.round(row, 9) + 0.0) for row in drawn} == expected
    # Also where a robot file only names the URDF.
    (tmp_path / "two.toml").write_text('urdf = "two.urdf"\ntip = "arm"\n')
    (again,) = robot_meshes(load_robot(tmp_path / "two.toml"), notes)
    np.testing.assert_array_equal(again.vertices, mesh.vertices)


def test_broken_meshes_are_said_and_bodies_drawn(tmp_path) -> None:
    (tmp_path / "bad.stl").write_bytes(b"solid <script>\x00" + bytes(200))
    path = tmp_path / "two.urdf"
    for name in ("bad.stl", "none.dae", "package://x/../../etc/none"):
        geometry = f'<mesh filename="{name}"/>'
        path.write_text(URDF.format(geometry=geometry))
        notes: list[str] = []
        robot = load_robot(path)
        meshes = robot_meshes(robot, notes)
        assert len(notes) == 1
        assert len(meshes) == len(arm_meshes(robot)) > 0


def test_vertices_that_no_face_uses_shade_nothing() -> None:
    """Meshes of visual geometry have such: the page showed no arm at all."""
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    plain = shaded(square, faces, smooth=True)
    # In the order of `numpy.unique` they come before, among and after the others.
    more = np.vstack([square, [[-1.0, 0, 0], [0.5, 0, 0], [9, 9, 9]]])
    np.testing.assert_array_equal(shaded(more, faces, smooth=True), plain)
