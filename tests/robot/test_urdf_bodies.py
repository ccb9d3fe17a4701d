import sys
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from robot_oracles import DATA, needs_models
from scipy.spatial import ConvexHull
from urdf_samples import load_urdf

from dynid.robot import Body, load_robot
from dynid.robot.body import around_points, around_triangles, beyond
from dynid.robot.urdf_bodies import with_collision_geometry

ROUNDING = 1e-9
ROUNDING_OF_ONE = 1e-16
"""Half a last digit of coordinates of 1 m [m]."""


def arm(tmp_path: Path, *shapes: str) -> tuple[Path, Any]:
    elements = "".join(
        f'<collision><origin xyz="0.1 0 0.2" rpy="0.3 0 1"/><geometry>{one}</geometry></collision>'
        for one in shapes
    )
    path = tmp_path / "arm.urdf"
    path.write_text(
        f'<robot name="arm"><link name="base"/><link name="one">{elements}</link>'
        '<link name="hand"><collision><geometry><sphere radius="0.05"/></geometry></collision>'
        '</link><joint name="j" type="revolute"><parent link="base"/><child link="one"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        '<joint name="f" type="fixed"><parent link="one"/><child link="hand"/>'
        '<origin xyz="0 0 0.5"/></joint></robot>'
    )
    return path, load_urdf(path)


def depth(points: np.ndarray, body: Body) -> np.ndarray:
    return beyond(points, body.points) - body.radius


def rotation() -> np.ndarray:
    z, x = 1.0, 0.3
    turn_z = np.array([[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]])
    turn_x = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
    return turn_z @ turn_x


@pytest.mark.parametrize("sides", [(0.1, 0.2, 0.6), (0.5, 0.4, 0.02)])
def test_boxes_are_judged_as_they_are(tmp_path: Path, sides: tuple[float, ...]) -> None:
    path, robot = arm(tmp_path, f'<box size="{sides[0]} {sides[1]} {sides[2]}"/>')
    found = with_collision_geometry(robot, path)
    signs = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T
    corners = signs * sides @ rotation().T + [0.1, 0, 0.2]
    gaps = np.linalg.norm(corners[:, None] - found.bodies[0].points, axis=2).min(axis=1)
    assert gaps.max() <= ROUNDING
    assert found.bodies[0].radius == 0


@pytest.mark.parametrize(("radius", "length"), [(0.05, 0.4), (0.2, 0.05)])
def test_cylinders_are_held_and_hardly_more(tmp_path: Path, radius: float, length: float) -> None:
    path, robot = arm(tmp_path, f'<cylinder radius="{radius}" length="{length}"/>')
    body = with_collision_geometry(robot, path).bodies[0]
    turn = np.linspace(0, 2 * np.pi, 50)
    rim = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.full(50, length / 2)])
    points = np.concatenate([rim, rim * [1, 1, -1]]) @ rotation().T + [0.1, 0, 0.2]
    assert depth(points, body).max() <= ROUNDING
    local = (body.points - [0.1, 0, 0.2]) @ rotation()
    assert np.hypot(local[:, 0], local[:, 1]).max() < 1.01 * radius


def test_fixed_links_carry_their_shapes(tmp_path: Path) -> None:
    path, robot = arm(tmp_path)
    (ball,) = with_collision_geometry(robot, path).bodies
    assert (ball.name, ball.link, ball.radius) == ("hand 1", 1, 0.05)
    np.testing.assert_allclose(ball.points[0], [0, 0, 0.5], atol=1e-12)


def test_what_is_seen_stands_for_collision_geometry_that_is_not_there(tmp_path: Path) -> None:
    path, _ = arm(tmp_path, '<box size="0.1 0.1 0.1"/>')
    text = path.read_text().replace("collision>", "visual>")
    path.write_text(text)
    bare = load_robot(path)
    assert [body.name for body in bare.bodies] == ["one 1", "hand 1"]
    assert any("visual geometry" in note and "one, hand" in note for note in bare.notes)
    # Of two links that are fixed to each other, one has collision geometry.
    text = text.replace("visual><geometry><sphere", "collision><geometry><sphere").replace(
        "</geometry></visual></link><joint", "</geometry></collision></link><joint"
    )
    path.write_text(text)
    mixed = load_robot(path)
    assert [body.name for body in mixed.bodies] == ["hand 1", "one 1"]
    assert any("visual geometry: one" in note for note in mixed.notes)
    path.write_text(text.replace('radius="0.05"', 'radius="1"'))
    held = load_robot(path)
    assert [body.name for body in held.bodies] == ["hand 1"]
    assert not any("visual geometry" in note for note in held.notes)


def test_what_cannot_be_read_is_noted(tmp_path: Path) -> None:
    path, robot = arm(tmp_path, '<mesh filename="none.stl"/>', '<capsule radius="1"/>')
    found = with_collision_geometry(robot, path)
    assert len(found.bodies) == 1
    assert any("none.stl was not found" in note for note in found.body_notes)
    assert any("no body for a capsule" in note for note in found.body_notes)


@pytest.mark.parametrize(
    "shape",
    [
        '<box size="0 1 1"/>',
        '<sphere radius="nan"/>',
        "<sphere/>",
        '<cylinder radius="-1" length="1"/>',
    ],
)
def test_broken_elements_are_noted_and_refuse_nothing(tmp_path: Path, shape: str) -> None:
    path, robot = arm(tmp_path, shape)
    found = with_collision_geometry(robot, path)
    assert [item.name for item in found.bodies] == ["hand 1"]
    (note,) = found.body_notes
    assert note.startswith("link one: collision 1 is not judged")


@pytest.mark.parametrize("content", [b"", b"solid x\nendsolid x\n", b"\x00" * 200])
def test_broken_meshes_are_noted(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "part.stl").write_bytes(content)
    path, robot = arm(tmp_path, '<mesh filename="part.stl"/>')
    found = with_collision_geometry(robot, path)
    assert len(found.bodies) == 1
    assert any("part.stl" in note for note in found.body_notes)


COLLADA = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="u" meter="{unit}"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh><source id="p">
<float_array id="pa" count="12">{corners}</float_array><technique_common>
<accessor source="#pa" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/>
<p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node><instance_geometry url="#g"/></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


@pytest.mark.parametrize("unit", [1.0, 0.001, 0.0254])
def test_a_collada_mesh_has_the_size_that_its_unit_says(tmp_path: Path, unit: float) -> None:
    corners = np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.2, 0], [0, 0, 0.1]])
    text = " ".join(map(repr, (corners / unit).ravel().tolist()))
    (tmp_path / "part.dae").write_text(COLLADA.format(unit=unit, corners=text))
    path, robot = arm(tmp_path, '<mesh filename="part.dae"/>')
    body, hand = with_collision_geometry(robot, path).bodies
    assert hand.name == "hand 1"
    assert depth(corners @ rotation().T + [0.1, 0, 0.2], body).max() <= ROUNDING
    assert body.radius + np.ptp(body.points, axis=0).max() < 0.4


@pytest.mark.parametrize("unit", ["inch", "0", "-1", "nan"])
def test_a_collada_unit_that_is_none_is_noted(tmp_path: Path, unit: str) -> None:
    (tmp_path / "part.dae").write_text(COLLADA.format(unit=unit, corners="0 " * 12))
    path, robot = arm(tmp_path, '<mesh filename="part.dae"/>')
    found = with_collision_geometry(robot, path)
    assert [body.name for body in found.bodies] == ["hand 1"]
    assert any("part.dae" in note for note in found.body_notes)


def test_all_materials_of_a_mesh_are_held(tmp_path: Path) -> None:
    one = np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.2, 0], [0, 0, 0.1]])
    corners = np.concatenate([one, one + np.array([0.5, 0.0, 0.0])])
    lines = [f"v {x} {y} {z}" for x, y, z in corners.tolist()]
    for material, first in (("red", 1), ("blue", 5)):
        lines.append(f"usemtl {material}")
        faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]) + first
        lines += [f"f {a} {b} {c}" for a, b, c in faces.tolist()]
    (tmp_path / "part.obj").write_text("\n".join(lines) + "\n")
    path, robot = arm(tmp_path, '<mesh filename="part.obj"/>')
    found = with_collision_geometry(robot, path)
    *bodies, hand = found.bodies
    placed = corners @ rotation().T + [0.1, 0, 0.2]
    assert hand.name == "hand 1"
    assert np.min([depth(placed, body) for body in bodies], axis=0).max() <= ROUNDING


def test_meshes_without_the_extra_are_noted_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "part.stl").write_bytes(b"solid")
    path, robot = arm(tmp_path, *['<mesh filename="part.stl"/>'] * 2)
    monkeypatch.setitem(sys.modules, "coal", None)
    (note,) = with_collision_geometry(robot, path).body_notes
    assert note == "meshes of one are not judged: pip install 'dynid[collision]' reads them"


def test_the_door_reads_them_unless_told_otherwise(tmp_path: Path) -> None:
    path, _ = arm(tmp_path)
    assert load_robot(path).bodies
    assert not load_robot(path, collision=False).bodies
    toml = tmp_path / "arm.toml"
    toml.write_text('urdf = "arm.urdf"\n')
    assert [item.name for item in load_robot(toml).bodies] == ["hand 1"]
    toml.write_text(
        'urdf = "arm.urdf"\n[[capsule]]\nname = "own"\nlink = "j"\n'
        "start = [0, 0, 0]\nend = [0, 0, 1]\nradius = 0.1\n"
    )
    assert [item.name for item in load_robot(toml).bodies] == ["own"]


def test_a_robot_file_adds_bodies_and_the_links_that_it_leaves_out_keep_those_of_the_urdf(
    tmp_path: Path,
) -> None:
    path, _ = arm(tmp_path, '<mesh filename="none.stl"/>')
    ground = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
    path.write_text(
        path.read_text().replace('<link name="base"/>', f'<link name="base">{ground}</link>')
    )
    toml = tmp_path / "arm.toml"
    toml.write_text(
        'urdf = "arm.urdf"\njoint_names = ["turn"]\n[[capsule]]\nname = "own"\nlink = "turn"\n'
        "start = [0, 0, 0]\nend = [0, 0, 1]\nradius = 0.1\n"
    )
    robot = load_robot(toml)
    assert [item.name for item in robot.bodies] == ["base 1", "own"]
    # The mesh that was not found is that of a link whose shape is given.
    assert not robot.body_notes


def test_a_tip_keeps_its_numbers(tmp_path: Path) -> None:
    arm(tmp_path)
    toml = tmp_path / "arm.toml"
    toml.write_text('urdf = "arm.urdf"\ntip = "one"\n')
    (ball,) = load_robot(toml).bodies
    assert ball.link == 1
    np.testing.assert_allclose(ball.points[0], [0, 0, 0.5], atol=1e-12)


@given(
    points=arrays(np.float64, (8, 3, 3), elements=st.floats(-1, 1)),
    stretch=arrays(np.float64, 3, elements=st.sampled_from([0.0, 1e-3, 0.1, 1.0])),
)
@settings(max_examples=15)
def test_every_triangle_is_in_one_body(points: np.ndarray, stretch: np.ndarray) -> None:
    faces = points * stretch
    found = around_triangles(faces)
    assert 1 <= len(found) <= 3
    far = np.array([beyond(faces.reshape(-1, 3), body) - radius for body, radius, _ in found])
    held = (far <= ROUNDING).reshape(len(found), -1, 3).all(axis=2)
    assert held.any(axis=0).all()


def test_a_mesh_whose_points_differ_by_rounding_alone_has_a_body() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        faces = rng.uniform(-1, 1, 3) + ROUNDING_OF_ONE * rng.normal(size=(8, 3, 3))
        assert around_triangles(faces)


def rod(start: np.ndarray, end: np.ndarray, radius: float) -> np.ndarray:
    """(32, 3, 3) the side of a round rod."""
    way = (end - start) / np.linalg.norm(end - start)
    across = np.linalg.svd(way[None])[2][1:]
    angle = np.linspace(0, 2 * np.pi, 17)
    ring = radius * (np.outer(np.cos(angle), across[0]) + np.outer(np.sin(angle), across[1]))
    low, high = start + ring, end + ring
    first = np.stack([low[:-1], low[1:], high[:-1]], axis=1)
    return np.concatenate([first, np.stack([low[1:], high[1:], high[:-1]], axis=1)])


def test_a_straight_part_gets_one_body_and_not_a_larger_one_than_it_needs() -> None:
    ends = np.array([[0.1, 0.2, -0.1], [0.5, -0.2, 0.4]])
    ((points, radius, _),) = around_triangles(rod(*ends, 0.05))
    turns = np.linspace(0, 2 * np.pi, 60)
    across = np.linalg.svd((ends[1] - ends[0])[None])[2][1:]
    ways = np.outer(np.cos(turns), across[0]) + np.outer(np.sin(turns), across[1])
    reach = ((points - ends[0]) @ ways.T).max(axis=0) + radius
    assert reach.min() > 0.049
    assert reach.max() < 0.062


def test_a_bent_part_is_cut_where_that_leaves_more_room() -> None:
    corner = np.array([0.5, 0.0, 0.0])
    arms = [rod(np.zeros(3), corner, 0.04), rod(corner, np.array([0.5, 0.5, 0.0]), 0.04)]
    found = around_triangles(np.concatenate(arms))
    assert len(found) > 1
    inside = np.array([[0.25, 0.25, 0.0]])
    assert all(beyond(inside, points)[0] > radius + 0.05 for points, radius, _ in found)


STL = """solid one
facet normal 0 0 1
outer loop
vertex 0 0 0
vertex 0.1 0 0
vertex 0 0.2 0
endloop
endfacet
endsolid one
"""


@pytest.mark.parametrize("where", ["beside", "above", "ament", "ros", "ros package", "given"])
def test_meshes_are_found_as_ros_finds_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    home = tmp_path / "ws" / "urdf"
    home.mkdir(parents=True)
    path, robot = arm(home, '<mesh filename="package://kit/meshes/part.stl"/>')
    there = {
        "beside": home / "meshes",
        "above": tmp_path / "ws" / "kit" / "meshes",
        "ament": tmp_path / "opt" / "share" / "kit" / "meshes",
        "ros": tmp_path / "src" / "kit" / "meshes",
        "ros package": tmp_path / "src" / "kit" / "meshes",
        "given": tmp_path / "own",
    }[where]
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path / 'none'}:{tmp_path / 'opt'}")
    roots = tmp_path / "src" / ("kit" if where == "ros package" else "")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(roots))
    found = with_collision_geometry(robot, path, mesh_dirs=[tmp_path / "own"])
    (note,) = found.body_notes
    for place in ("opt/share/kit/meshes/part.stl", "own/part.stl"):
        assert place in note
    there.mkdir(parents=True)
    (there / "part.stl").write_text(STL)
    found = with_collision_geometry(robot, path, mesh_dirs=[tmp_path / "own"])
    assert not found.body_notes
    assert len(found.bodies) == 2


@needs_models
def test_meshes_are_enclosed() -> None:
    path = DATA / "panda_description" / "urdf" / "panda.urdf"
    robot = load_robot(path)
    assert {item.link for item in robot.bodies} == set(range(8))
    assert not robot.body_notes
    model = pin.buildModelFromUrdf(str(path))
    geometry = pin.buildGeomFromUrdf(
        model, str(path), pin.GeometryType.COLLISION, package_dirs=[str(DATA.parent.parent)]
    )
    for item in geometry.geometryObjects:
        if not hasattr(item.geometry, "vertices"):
            continue
        corners = np.asarray(item.geometry.vertices())
        placed = corners @ item.placement.rotation.T + item.placement.translation
        own = [body for body in robot.bodies if body.link == min(item.parentJoint, 7)]
        corners = np.unique(placed, axis=0)
        assert np.min([depth(corners, body) for body in own], axis=0).max() <= ROUNDING


def test_meshes_that_are_not_there_are_one_note(tmp_path: Path) -> None:
    path, robot = arm(tmp_path, *(f'<mesh filename="{name}.stl"/>' for name in "abc"))
    (note,) = with_collision_geometry(robot, path).body_notes
    assert note.startswith("meshes of one are not judged: the mesh a.stl was not found")


@pytest.mark.parametrize("corner", [[1.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
def test_points_in_a_plane_have_a_surface(corner: list[float]) -> None:
    """Also without a radius: a robot file may hold a plate that is given by its corners."""
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], corner])
    vertices, faces = Body(name="plate", link=0, points=points, radius=0.0).surface()
    assert len(faces) > 3
    assert np.abs(vertices[:, 2]).max() < 1e-4
    assert np.allclose(np.ptp(vertices, axis=0)[:2], 1.0, atol=1e-4)


@pytest.mark.parametrize("corners", [8, 20])
def test_bodies_have_few_corners_and_a_radius_for_the_rest(corners: int) -> None:
    """Of a ball of 100 mm: SciPy's hull of the corners holds it but for the radius."""
    points = np.random.default_rng(0).normal(size=(300, 3))
    points *= 0.1 / np.linalg.norm(points, axis=1, keepdims=True)
    body, radius = around_points(points, corners=corners)
    assert len(body) == corners
    planes = ConvexHull(body).equations
    outside = (points @ planes[:, :3].T + planes[:, 3]).max()
    assert 0 < outside <= radius < 0.1
