"""Robot files: TOML with kinematics, mounting, limits, drives and collision bodies."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core import Array, RobotError
from dynid.robot import body, kinematics, library, tables, urdf, urdf_bodies
from dynid.robot.model import FRAMES, Counterbalance, Drives, RobotModel, SafetyLimits, Tool
from dynid.robot.tables import TomlTable
from dynid.robot.transforms import from_body, from_xyz_rpy, inverse, move, translation

_SIDES = ("joint", "motor")
_BODY_FRAMES = ("dh", "mdh", "urdf", "joint")
_LIMITS = ("lower", "upper", "velocity", "acceleration", "torque")
_CYLINDER = ("outer", "inner", "rest_length", "offset", "piston_area", "gas_work", "gas_volume")
_SAFETY = ("tcp_speed", "elbow_speed", "momentum", "power", "payload")
_STRONGEST = 30.0


def _read_mount(table: TomlTable, _: RobotModel) -> dict[str, Any]:
    """A kind, or gravity in the base frame."""
    if ("kind" in table) == ("gravity" in table):
        raise RobotError("give either kind or gravity")
    if "kind" in table:
        kind = table.text("kind")
        return {"mount": kind, "gravity": kinematics.mount_gravity(kind)}
    gravity = table.numbers("gravity", 3)
    if float(np.linalg.norm(gravity)) > _STRONGEST:
        raise RobotError(
            "gravity is too strong", value=gravity.tolist(), limit=f"{_STRONGEST} m/s^2"
        )
    return {"mount": "file", "gravity": gravity}


def _read_limits(table: TomlTable, robot: RobotModel) -> dict[str, Any]:
    """What the table leaves out stays as it was."""
    n = robot.joints
    given = {key: table.numbers(key, n, unknown=True) for key in _LIMITS if key in table}
    return {"limits": replace(robot.limits, **given)}


def _read_safety(table: TomlTable, robot: RobotModel) -> dict[str, Any]:
    """`elbow` is the joint at whose `urdf` frame the elbow is."""
    found: dict[str, Any] = {key: table.number(key) for key in _SAFETY if key in table}
    if "elbow" in table:
        found["elbow"] = 1 + robot.joint_names.index(table.text("elbow", robot.joint_names))
    elif "elbow_speed" in table:
        raise RobotError("'elbow_speed' needs 'elbow', the name of a joint")
    return {"safety": SafetyLimits(**found)}


def _read_tool(table: TomlTable, _: RobotModel) -> dict[str, Any]:
    """What the flange carries, in its frame."""
    found: dict[str, Any] = {key: table.numbers(key, 3) for key in ("tcp", "com") if key in table}
    found |= {key: table.number(key) for key in ("mass", "radius") if key in table}
    return {"tool": Tool(**found)}


def _read_drives(table: TomlTable, robot: RobotModel) -> dict[str, Any]:
    n = robot.joints
    found: dict[str, Any] = {
        key: table.numbers(key, n, unknown=True) if key in table else np.full(n, np.nan)
        for key in ("gain", "gear_ratio")
    }
    if "coupling" in table:
        found["coupling"] = table.rows("coupling", n, n)
    if "offset" in table:
        found["offset"] = table.numbers("offset", n)
    for key in ("position_side", "torque_side"):
        if key in table:
            found[key] = table.text(key, _SIDES)
    if "offset" in found and found.get("position_side") != "motor":
        raise RobotError(
            "'offset' is that of motor positions, and the recordings give the joints'",
            next_step='Write position_side = "motor", or correct the zeros of the joints (theta of '
            "a DH table).",
        )
    return {"drives": Drives(**found)}


def _read_inertias(table: TomlTable, robot: RobotModel) -> dict[str, Any]:
    """Masses, centres of mass and tensors in frames of one convention.

    What the table leaves out, or gives as nan, stays as the URDF has it.
    """
    n, frames = robot.joints, _frames(table, robot)
    mass = table.numbers("mass", n, unknown=True)
    com = table.rows("com", n, 3, unknown=True) if "com" in table else np.full((n, 3), np.nan)
    six = table.rows("tensor", n, 6, unknown=True) if "tensor" in table else np.full((n, 6), np.nan)
    found: list[Array] = []
    for k in range(n):
        given = np.array([mass[k], *com[k], *six[k]])
        held = _mass_centre_tensor(robot.inertias[k], inverse(frames[k]))
        given = np.where(np.isnan(given), held, given)
        found.append(_body(float(given[0]), given[1:4], given[4:], frames[k]))
    return {"inertias": np.array(found)}


def _mass_centre_tensor(row: Array, frame: Array) -> Array:
    """(10) mass, centre of mass and central tensor in a frame, as far as they are known."""
    mass = float(row[0])
    if not mass > 0 or np.isnan(row[:4]).any():
        return np.array([mass if mass > 0 else np.nan, *[np.nan] * 9])
    row = move(row, frame)
    centre = row[1:4] / mass
    return np.concatenate([[mass], centre, move(row, translation(*-centre))[4:]])


def _read_counterbalances(rows: list[TomlTable], robot: RobotModel) -> dict[str, Any]:
    names = robot.joint_names
    found = [
        Counterbalance(
            joint=names.index(table.text("joint", names)),
            **{key: table.number(key) for key in _CYLINDER},
        )
        for table in rows
    ]
    return {"counterbalances": tuple(found)}


def _read_bodies(
    rows: list[TomlTable], robot: RobotModel, *, capsules: bool = False
) -> dict[str, Any]:
    """`link` is `base` or the joint that moves the link; a capsule goes from `start` to `end`."""
    found: list[body.Body] = []
    links = ("base", *robot.joint_names)
    for k, table in enumerate(rows):
        link = links.index(table.text("link", links))
        placed = _frames(table, robot)[link - 1] if link else np.eye(4)
        sized = table
        if capsules:
            points = np.array([table.numbers(key, 3) for key in ("start", "end")])
        else:
            shape = _shape(table)
            points = shape.rows("points", None, 3)
            sized = table if "radius" in table else shape
        found.append(
            body.Body(
                name=table.text("name") if "name" in table else f"{links[link]} {k + 1}",
                link=link,
                points=points @ placed[:3, :3].T + placed[:3, 3],
                radius=sized.number("radius") if "radius" in sized else 0.0,
            )
        )
    return {"bodies": (*robot.bodies, *found)}


def _shape(table: TomlTable) -> TomlTable:
    """The row with the points of a body: itself, or that of a built-in arm which it names."""
    if not isinstance(table.raw("points"), str):
        return table
    arm, name = table.text("points", builtin_names()), table.text("name")
    for row in _bodies_of(arm):
        if row.text("name") == name:
            if row.raw("frames") != table.raw("frames"):
                text = "'frames' must be those in which the points are given"
                raise RobotError(text, where=table.where, limit=row.raw("frames"))
            return row
    raise RobotError(f"{arm} has no body of this name", where=table.where, value=name)


@cache
def _bodies_of(arm: str) -> list[TomlTable]:
    return tables.array_of_tables(
        tables.parse_toml(builtin_file(arm))["body"], f"body of {arm}", "", _READERS["body"][0]
    )


def _read_collision(table: TomlTable, robot: RobotModel) -> dict[str, Any]:
    """A note on the bodies; what release 0.1 did not check is read and ignored."""
    notes = (*robot.body_notes, *((table.text("note"),) if "note" in table else ()))
    told = ["'apart' and 'overlap' of the table 'collision' count no more: bodies are judged"]
    trusted = "apart" in table or "overlap" in table
    return {"body_notes": notes, "notes": (*robot.notes, *(told if trusted else []))}


def _frames(table: TomlTable, robot: RobotModel) -> Array:
    name = table.text("frames", _BODY_FRAMES) if "frames" in table else "joint"
    if name == "joint":
        return np.tile(np.eye(4), (robot.joints, 1, 1))
    return robot.parameter_frames[name]


def _body(mass: float, com: Array, six: Array, frame: Array) -> Array:
    """The ten parameters in the joint frame, as far as they are known."""
    if mass < 0:
        raise RobotError("negative mass", value=mass)
    xx, yy, zz, yz, xz, xy = six.tolist()
    central = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if np.isnan(mass) or np.isnan(com).any():
        return np.array([mass, *[np.nan] * 9])
    return move(from_body(mass, com, central), frame)


def builtin_names() -> list[str]:
    """The names of the built-in robots, sorted."""
    files = resources.files(library).iterdir()
    return sorted(file.name[:-5] for file in files if file.name.endswith(".toml"))


def builtin_file(name: str) -> bytes:
    """The robot file of a built-in robot."""
    return (resources.files(library) / f"{name}.toml").read_bytes()


MAX_BYTES = 1_000_000
"""The largest robot file that is read."""

_TOP = (
    "name", "joint_names", "frames", "urdf", "tip", "locked", "dh", "joint", "base", "flange",
    "urdf_frames", "mount", "limits", "safety", "tool", "drives", "inertia", "counterbalance",
    "body", "capsule", "collision",
)  # fmt: skip
_TYPES = ("revolute", "prismatic")
_BODY = ("name", "link", "frames", "radius")
_READERS: dict[str, tuple[tuple[str, ...], Callable[..., dict[str, Any]]]] = {
    "mount": (("kind", "gravity"), _read_mount),
    "limits": (_LIMITS, _read_limits),
    "safety": ((*_SAFETY, "elbow"), _read_safety),
    "tool": (("tcp", "mass", "com", "radius"), _read_tool),
    "drives": (
        ("gain", "gear_ratio", "coupling", "offset", "position_side", "torque_side"),
        _read_drives,
    ),
    "inertia": (("frames", "mass", "com", "tensor"), _read_inertias),
    "counterbalance": (("joint", *_CYLINDER), _read_counterbalances),
    "body": ((*_BODY, "points"), _read_bodies),
    "capsule": ((*_BODY, "start", "end"), partial(_read_bodies, capsules=True)),
    "collision": (("note", "apart", "overlap", "overlap_by"), _read_collision),
}
"""Table to its keys, and what makes fields of the robot of it, or of its rows if `_SEVERAL`."""
_SEVERAL = ("counterbalance", "body", "capsule")


def robot_from_toml(
    data: bytes, path: Path, *, collision: bool = False, mesh_dirs: Sequence[Path] = ()
) -> RobotModel:
    """A robot from the bytes of a robot file.

    Its path names the robot if it has no name, and is where a relative `urdf` path starts. With
    `collision` a URDF's geometry is read of the links of which no bodies are given, its meshes from
    further folders too.

    Raises:
        RobotError: Anything that is not a sound robot file; names table and key.
    """
    with tables.located(tables.shown_path(path)):
        top = TomlTable(tables.parse_toml(data), "", "", _TOP)
        robot = _kinematics(top, path)
        if collision and robot.urdf:
            held = _links_with_bodies(top, robot)
            robot = urdf_bodies.with_collision_geometry(
                robot, Path(robot.urdf), mesh_dirs=mesh_dirs, apart_from=held
            )
        if "joint_names" in top:
            names = top.texts("joint_names", robot.joints)
            robot = replace(robot, joint_names=names, urdf="")
        sources = [robot.source] if robot.source else []
        for name, (keys, read) in _READERS.items():
            if name in top:
                with tables.located(name):
                    values = top.raw(name)
                    if name in _SEVERAL:
                        given = rows = tables.array_of_tables(values, name, "", keys)
                    else:
                        given = TomlTable(values, "", "", keys)
                        rows = [given]
                    found = read(given, robot)
                robot = replace(robot, **found)
                sources += [text for row in rows for text in row.sources(name)]
        if "name" in top:
            robot = replace(robot, name=top.text("name"))
        if "frames" in top:
            robot = replace(robot, default_frames=top.text("frames", FRAMES))
        robot = replace(robot, source="; ".join(top.sources("") + sources))
        return robot


def _links_with_bodies(top: TomlTable, robot: RobotModel) -> set[int]:
    """Links (0 the base) whose collision bodies are those of the robot file."""
    renamed = "joint_names" in top
    names = top.texts("joint_names", robot.joints) if renamed else robot.joint_names
    links, found = ("base", *names), set[int]()
    for name in ("body", "capsule"):
        if name in top:
            with tables.located(name):
                rows = tables.array_of_tables(top.raw(name), name, "", _READERS[name][0])
                found |= {links.index(row.text("link", links)) for row in rows}
    return found


def _kinematics(top: TomlTable, path: Path) -> RobotModel:
    kinds = [key for key in ("urdf", "dh", "joint") if key in top]
    if len(kinds) != 1:
        raise RobotError(
            "the kinematics come from exactly one of urdf, [dh] and [[joint]]",
            value=" and ".join(kinds) or "none",
        )
    misplaced = ("base", "flange", "urdf_frames") if kinds == ["urdf"] else ("tip", "locked")
    for key in misplaced:
        if key in top:
            raise RobotError(f"'{key}' does not go with {kinds[0]}")
    if kinds == ["urdf"]:
        robot = _from_urdf(top, path)
    else:
        robot = _from_dh(top, path) if kinds == ["dh"] else _from_joints(top, path)
    if "urdf_frames" in top:
        table = TomlTable(top.raw("urdf_frames"), "urdf_frames", "", ("xyz", "rpy"))
        xyz, rpy = (table.rows(key, robot.joints, 3) for key in ("xyz", "rpy"))
        placed = [from_xyz_rpy(a, b) for a, b in zip(xyz.tolist(), rpy.tolist(), strict=True)]
        frames = {**robot.parameter_frames, "urdf": np.array(placed)}
        sources = [robot.source, *table.sources("urdf_frames")]
        robot = replace(robot, parameter_frames=frames, source="; ".join(filter(None, sources)))
    return robot


def _from_urdf(top: TomlTable, path: Path) -> RobotModel:
    file = path.parent / top.text("urdf")
    if not tables.is_there(file):
        raise RobotError(
            "no such URDF file; the path starts where the robot file is",
            where="urdf",
            value=top.text("urdf"),
            next_step=f"Looked in {tables.shown_path(path.parent.absolute())}",
        )
    tip = top.text("tip") if "tip" in top else None
    locked = tables.locked_joints(top.raw("locked")) if "locked" in top else None
    return urdf.robot_from_urdf(
        tables.read_limited(file, urdf.MAX_BYTES),
        where=tables.shown_path(file),
        file=file,
        tip=tip,
        locked=locked,
    )


def _from_dh(top: TomlTable, path: Path) -> RobotModel:
    keys = ("convention", "a", "d", "alpha", "theta", "joint_types", "sign")
    table = TomlTable(top.raw("dh"), "dh", "", keys)
    a = table.numbers("a")
    n = len(a)
    robot = kinematics.robot_from_dh(
        a=a,
        d=table.numbers("d", n),
        alpha=table.angles("alpha", n),
        theta=table.angles("theta", n) if "theta" in table else None,
        convention=table.text("convention", kinematics.CONVENTIONS),
        joint_types=table.texts("joint_types", n) if "joint_types" in table else None,
        sign=table.numbers("sign", n) if "sign" in table else None,
        base=_pose(top, "base"),
        flange=_pose(top, "flange"),
        name=path.stem,
    )
    return replace(robot, source="; ".join(table.sources("dh")))


def _from_joints(top: TomlTable, path: Path) -> RobotModel:
    rows = tables.array_of_tables(
        top.raw("joint"), "joint", "", ("name", "type", "xyz", "rpy", "axis")
    )
    placements = np.array([_row_pose(row) for row in rows])
    base = _pose(top, "base")
    if rows and base is not None:
        placements[0] = base @ placements[0]
    robot = kinematics.robot_from_chain(
        placements=placements,
        axes=np.array([_axis(row) for row in rows]),
        joint_names=[row.text("name") for row in rows],
        joint_types=[row.text("type", _TYPES) if "type" in row else _TYPES[0] for row in rows],
        flange=_pose(top, "flange"),
        name=path.stem,
    )
    sources = [text for row in rows for text in row.sources("joint")]
    return replace(robot, source="; ".join(sources))


def _pose(top: TomlTable, key: str) -> Array | None:
    if key not in top:
        return None
    return _row_pose(TomlTable(top.raw(key), key, "", ("xyz", "rpy")))


def _row_pose(row: TomlTable) -> Array:
    zero = np.zeros(3)
    xyz = row.numbers("xyz", 3) if "xyz" in row else zero
    rpy = row.angles("rpy", 3) if "rpy" in row else zero
    return from_xyz_rpy(xyz.tolist(), rpy.tolist())


def _axis(row: TomlTable) -> Array:
    if "axis" not in row:
        return np.array([0.0, 0.0, 1.0])
    axis = row.numbers("axis", 3)
    length = float(np.linalg.norm(axis))
    if not length > 1e-6:
        raise RobotError("the axis has no length", where=row.where, value=axis.tolist())
    return axis / length
