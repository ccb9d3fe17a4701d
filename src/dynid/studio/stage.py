"""The arm, the scene and the nearest bodies in 3D."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from dynid.constraints import HALF_SPACE
from dynid.core import Array, Indices
from dynid.export import quaternion
from dynid.studio.live import Instant, Near
from dynid.studio.scene_editing import SceneEditor, pose_of
from dynid.studio.solids import LinkMesh, reach, shape_mesh
from dynid.studio.text import plain

if TYPE_CHECKING:
    import viser

    from dynid.robot import RobotModel

_ARM = ((86, 98, 112), (0, 114, 178))
"""Colours of every other link."""
_SCENE, _CHOSEN = (190, 160, 110), (230, 159, 0)
_NEAREST, _TOO_NEAR = (230, 159, 0), (213, 94, 0)
_UPRIGHT = 0.75
"""Width over height below which a window is a telephone's."""
_SKIN = 1.02
_WAY_RADIUS = 0.004
"""Of the rod that is drawn between the nearest bodies [m]."""
_KINDS = ("self_collision", "environment")
Moved = Callable[[int, Array, bool], None]
"""Told which shape was dragged, where it is (4, 4), and whether it was let go."""


class Stage:
    """What the page shows in 3D.

    Nodes are named by number: names from files could break the tree of names.

    Args:
        server: The page.
        robot: The arm.
        meshes: Its bodies.
    """

    def __init__(
        self, server: viser.ViserServer, robot: RobotModel, meshes: tuple[LinkMesh, ...]
    ) -> None:
        self._server, self._scene = server, server.scene
        size = reach(robot)
        down = robot.gravity / (float(np.linalg.norm(robot.gravity)) or 1.0)
        up = -down if down.any() else np.array([0.0, 0.0, 1.0])
        self._scene.set_up_direction((float(up[0]), float(up[1]), float(up[2])))
        eye = size * np.array([1.1, -1.1, 0.8])
        server.initial_camera.position = (float(eye[0]), float(eye[1]), float(eye[2]))
        server.initial_camera.look_at = (0.0, 0.0, 0.3 * size)
        # Shadows cost most of the time of a machine that draws in software.
        self._scene.configure_default_lights(cast_shadow=False)
        server.on_client_connect(lambda client: _raise(client, size))
        self._scene.add_grid("/grid", width=4 * size, height=4 * size, cell_size=0.1)
        self._links = [
            self._scene.add_frame(f"/arm/{k}", show_axes=False) for k in range(robot.joints + 1)
        ]
        for link in sorted({mesh.link for mesh in meshes}):
            self._add(f"/arm/{link}/body", _joined(meshes, link), _ARM[link % 2])
        self._meshes = meshes
        self._painted: dict[int, tuple[int, int, int]] = {}
        self._paints: list[viser.MeshHandle] = []
        self._ways = {
            kind: self._scene.add_cylinder(
                f"/near/{kind}", _WAY_RADIUS, 1.0, _NEAREST, cast_shadow=False, visible=False
            )
            for kind in _KINDS
        }
        self._labels = {
            kind: self._scene.add_label(f"/labels/{kind}", "", visible=False) for kind in _KINDS
        }
        self._shapes: dict[int, viser.MeshHandle] = {}
        self._gizmo: viser.TransformControlsHandle | None = None
        self._held: int | None = None

    @property
    def link_positions(self) -> Array:
        """(n + 1, 3) where the links are drawn [m]."""
        return np.array([link.position for link in self._links], dtype=np.float64)

    def show(self, now: Instant) -> None:
        """Move the arm, and draw the ways between the nearest bodies."""
        with self._server.atomic():
            for link, pose in zip(self._links[1:], now.poses, strict=True):
                link.position = _three(pose[:3, 3])
                link.wxyz = _four(quaternion(pose[:3, :3]))
            shown = {item.kind: item for item in now.near}
            for kind in _KINDS:
                self._show_way(kind, shown.get(kind))
            self._paint(now.near)

    def _show_way(self, kind: str, item: Near | None) -> None:
        way, label = self._ways[kind], self._labels[kind]
        way.visible = label.visible = item is not None
        if item is None:
            return
        along = item.end - item.start
        length = float(np.linalg.norm(along))
        way.color = _colour_of(item)
        way.scale = (1.0, 1.0, max(length, 1e-6))
        way.position = _three((item.start + item.end) / 2)
        way.wxyz = _from_z(along / length) if length > 0 else (1.0, 0.0, 0.0, 0.0)
        label.position = _three((item.start + item.end) / 2)
        label.text = f"{1000 * item.distance:.0f} mm: {plain(item.names)}"

    def _paint(self, near: tuple[Near, ...]) -> None:
        """Give the nearest bodies a skin of another colour."""
        wanted = {
            k: _colour_of(item)
            for item in near
            for k, mesh in enumerate(self._meshes)
            if item.names.startswith(f"{mesh.name} - ") or item.names.endswith(f" - {mesh.name}")
        }
        if wanted == self._painted:
            return
        for handle in self._paints:
            handle.remove()
        self._painted = wanted
        self._paints = [
            self._add(f"/arm/{self._meshes[k].link}/near{k}", _skin(self._meshes[k]), colour)
            for k, colour in wanted.items()
        ]

    def _add(
        self, name: str, triangles: tuple[Array, Indices], colour: tuple[int, int, int]
    ) -> viser.MeshHandle:
        return self._scene.add_mesh_simple(
            name,
            vertices=triangles[0].astype(np.float32),
            faces=triangles[1].astype(np.uint32),
            color=colour,
        )

    def draw_scene(self, editor: SceneEditor, chosen: int | None) -> None:
        """Draw all shapes anew, the chosen one in another colour."""
        for handle in self._shapes.values():
            handle.remove()
        self._shapes = {}
        for number in editor.items:
            shape = editor.shape(number)
            vertices, faces = shape_mesh(shape)
            self._shapes[number] = self._scene.add_mesh_simple(
                f"/scene/{number}",
                vertices=vertices.astype(np.float32),
                faces=faces.astype(np.uint32),
                color=_CHOSEN if number == chosen else _SCENE,
                opacity=0.35 if shape.kind == HALF_SPACE else 0.8,
                flat_shading=True,
                side="double",
                wxyz=_four(quaternion(shape.pose[:3, :3])),
                position=_three(shape.pose[:3, 3]),
            )

    def move_shape(self, editor: SceneEditor, number: int) -> None:
        """Put one shape where the editor has it, as while it is dragged."""
        handle = self._shapes.get(number)
        if handle is not None:
            pose = editor.shape(number).pose
            handle.wxyz = _four(quaternion(pose[:3, :3]))
            handle.position = _three(pose[:3, 3])

    def hold(self, editor: SceneEditor, number: int | None, moved: Moved) -> None:
        """Give one shape handles to drag it by; None for no shape."""
        if self._gizmo is not None:
            self._gizmo.remove()
        self._gizmo, self._held = None, number
        if number is None:
            return
        kind, pose = editor.items[number]["type"], editor.pose(number)
        gizmo = self._scene.add_transform_controls(
            "/gizmo",
            scale=0.25,
            disable_rotations=kind in ("floor", "sphere"),
            active_axes=(kind != "floor", kind != "floor", True),
            disable_sliders=kind == "floor",
            position=_three(pose[:3, 3]),
            wxyz=_four(quaternion(pose[:3, :3])),
            depth_test=False,
        )
        self._gizmo = gizmo

        # On the event loop: in a pool of threads the last place could arrive before the one
        # before it.
        async def dragged(event: viser.TransformControlsEvent) -> None:
            moved(number, pose_of(gizmo.position, gizmo.wxyz), event.phase == "end")

        gizmo.on_update(dragged)


def _joined(meshes: tuple[LinkMesh, ...], link: int) -> tuple[Array, Indices]:
    """All bodies of a link as one: browsers draw few large meshes faster than many small ones."""
    own = [mesh for mesh in meshes if mesh.link == link]
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in own)])
    faces = [mesh.faces + start for mesh, start in zip(own, starts[:-1], strict=True)]
    return np.concatenate([mesh.vertices for mesh in own]), np.concatenate(faces)


def _skin(mesh: LinkMesh) -> tuple[Array, Indices]:
    """The body, a little larger, so that it is seen outside itself."""
    middle = mesh.vertices.mean(axis=0)
    return middle + _SKIN * (mesh.vertices - middle), mesh.faces


def _raise(client: viser.ClientHandle, size: float) -> None:
    """Look lower in an upright window: the panel covers the lower part of it."""
    if client.camera.aspect < _UPRIGHT:
        client.camera.look_at = (0.0, 0.0, -0.55 * size)


def _colour_of(item: Near) -> tuple[int, int, int]:
    return _TOO_NEAR if item.distance < item.clearance else _NEAREST


def _from_z(way: Array) -> tuple[float, float, float, float]:
    """The shortest turn of the z axis to a direction (3) of length 1, as w, x, y, z."""
    if way[2] < -1.0 + 1e-12:
        return 0.0, 1.0, 0.0, 0.0
    turn = np.array([1.0 + way[2], -way[1], way[0], 0.0])
    return _four(turn / np.linalg.norm(turn))


def _three(values: Array) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


def _four(values: Array) -> tuple[float, float, float, float]:
    return float(values[0]), float(values[1]), float(values[2]), float(values[3])
