"""Values as the page takes them: JSON, numbers in rows as base64 of single precision.

Text from files and robots is made printable here; the page writes it as text, never as markup.
"""

import base64
import math
import tempfile
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from dynid import export, figures, identification, recording, report, workflow
from dynid.constraints import DISTANCES, HALF_SPACE, RATIOS, Worst, prior_dynamics
from dynid.core import Array, Indices, InputError, plain, printable
from dynid.robot import RobotModel
from dynid.signals import measured_torque
from dynid.studio import jobs, scene_editing
from dynid.studio.session import Session
from dynid.studio.solids import LinkMesh, arm_meshes, reach, shaded, shape_mesh

MOST_SAMPLES = 4000
"""Of a curve."""
RATE_HZ = 60.0
"""Of a designed motion as the page plays it."""
KINDS = {
    "position": ("Position", "rad"),
    "velocity": ("Velocity", "rad/s"),
    "acceleration": ("Acceleration", "rad/s^2"),
    "torque": ("Torque", "N.m"),
    "tcp_speed": ("Tool speed", "m/s"),
    "elbow_speed": ("Elbow speed", "m/s"),
    "momentum": ("Momentum", "kg.m/s"),
    "power": ("Power", "W"),
    "self_collision": ("Between bodies", "mm"),
    "environment": ("To the scene", "mm"),
}
"""What each limit is called, and the unit of its values."""
RECORDED = {
    "effort": ("Torque", "N.m"),
    "q": ("Position", "rad"),
    "qd": ("Velocity", "rad/s"),
    "current": ("Current", "A"),
    "temperature": ("Temperature", "°C"),
}
"""What is drawn of a recording."""
TAIL_S = 10.0
TAIL_POINTS = 400
"""What the page draws of a run."""
_ALMOST = 0.05
"""Share of a limit below which what is left of it is shown as little."""


def encoded(values: Array | Indices) -> str:
    """Numbers, row by row, as base64 of little-endian single precision."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode("ascii")


def robot(
    model: RobotModel, meshes: tuple[LinkMesh, ...], carried: tuple[LinkMesh, ...] = ()
) -> dict[str, Any]:
    """The arm: how it moves, and what it and what it carries look like."""
    low, high = model.limits.lower, model.limits.upper
    # Of what is drawn of joints without limits.
    widest = np.where(model.prismatic, 2.0, 2 * np.pi)
    return {
        "name": printable(model.name),
        "joints": list(figures.joint_labels(model.joint_names)),
        "prismatic": [bool(slides) for slides in model.prismatic],
        "lower": np.where(np.isfinite(low), low, -widest).tolist(),
        "upper": np.where(np.isfinite(high), high, widest).tolist(),
        "placements": model.placements.reshape(model.joints, 16).tolist(),
        "axes": model.axes.tolist(),
        "tool": (model.flange[:3, :3] @ model.tool.tcp + model.flange[:3, 3]).tolist(),
        "gravity": model.gravity.tolist(),
        "standing": model.mount == "floor",
        "reach": reach(model),
        "meshes": [_mesh(item) for item in (*meshes, *carried)],
        "bodies": [_mesh(item) for item in (*arm_meshes(model), *carried)],
    }


def _mesh(item: LinkMesh) -> dict[str, Any]:
    return {
        "name": printable(item.name),
        "link": item.link,
        "corners": encoded(shaded(item.vertices, item.faces, smooth=item.smooth)),
    }


def scene_shapes(editor: scene_editing.SceneEditor) -> dict[str, Any]:
    """The shapes of the scene, where they are and how large."""
    shapes: list[dict[str, Any]] = []
    for number, item in editor.items.items():
        shape, held = editor.shape(number), editor.pose(number)
        vertices, faces = shape_mesh(shape)
        shapes.append(
            {
                "number": number,
                "kind": item["type"],
                "label": printable(editor.label(number), 40),
                "position": np.round(held[:3, 3], 4).tolist(),
                "rpy_deg": np.round(np.degrees(export.roll_pitch_yaw(held[:3, :3])), 2).tolist(),
                "sizes": editor.sizes(number),
                "pose": shape.pose.reshape(16).tolist(),
                "endless": shape.kind == HALF_SPACE,
                "corners": encoded(shaded(vertices, faces, smooth=False)),
            }
        )
    return {"changes": editor.changes, "shapes": shapes}


def instant_facts(
    worst: Mapping[str, Worst], near: Sequence[scene_editing.Near], sliding: Collection[str] = ()
) -> dict[str, Any]:
    """Limits and nearest bodies at one instant; `sliding` joints by name."""
    return {
        "margins": margins(worst, sliding),
        "near": [
            {
                "names": printable(item.names),
                "distance_mm": 1000 * item.distance,
                "too_near": item.distance < item.clearance,
                "start": item.start.tolist(),
                "end": item.end.tolist(),
            }
            for item in near
        ],
    }


def sliding_joints(model: RobotModel) -> frozenset[str]:
    """The names of the joints whose numbers are in metres and newtons."""
    pairs = zip(model.joint_names, model.prismatic, strict=True)
    return frozenset(name for name, slides in pairs if slides)


def margins(worst: Mapping[str, Worst], sliding: Collection[str] = ()) -> list[dict[str, Any]]:
    """Every limit that is judged in one form: which share of it is used.

    The share of a distance is what it needs over what it keeps. Limits of `sliding` joints have
    their units.
    """
    rows: list[dict[str, Any]] = []
    for kind in (*RATIOS, *DISTANCES):
        item = worst.get(kind)
        if item is None or math.isnan(item.margin):
            continue
        name, unit = KINDS[kind]
        used, scale, limit = 1.0 - item.margin, 1.0, abs(item.limit)
        # The bound over the whole motion, as the share is; that of a position counts from the
        # middle of its range.
        value = abs(item.value) if kind == "position" else used * limit
        if item.distance:
            # A distance below zero is how deep bodies are in each other.
            scale, value = 1000.0, item.margin
            used = item.limit / item.margin if item.margin > 0 else 9.99
        allowed = 1.0 if item.distance else 1.0 - item.required
        level = "bad" if item.room < -1e-9 else "warn" if used > allowed - _ALMOST else "good"
        rows.append(
            {
                "kind": kind,
                "name": name,
                "unit": figures.joint_unit(unit, [item.what in sliding]),
                "what": printable(item.what.replace("_joint", "").replace("_", " "), 44),
                "used": min(used, 9.99),
                "allowed": allowed,
                "value": plain(float(scale * value)),
                "limit": plain(float(scale * limit)),
                "distance": item.distance,
                "level": level,
            }
        )
    return rows


def verdict(session: Session) -> dict[str, Any] | None:
    """The verdict on the whole motion that is shown; None where there is none."""
    found = session.verdict
    if session.motion.trajectory is None or found.motion != session.motion.name:
        return None
    made = found.certificate
    if made is None:
        return {"level": "bad", "words": found.error, "margins": [], "notes": []}
    words = "Every limit holds over the whole motion" if made.feasible else made.headline
    level = "good" if made.feasible else "warn" if made.holds else "bad"
    if session.stale:
        words, level = f"{words}, as the scene was before", "warn"
    return {
        "level": level,
        "words": printable(words, 300),
        "margins": margins(made.worst, sliding_joints(session.robot)),
        "unjudged": [printable(f"{one.message}. {one.next_step}", 300) for one in made.unjudged],
        "notes": [printable(note, 300) for note in made.assumed],
    }


def curves(session: Session, name: str) -> dict[str, Any]:
    """A motion over time: positions to play, and groups of curves to draw."""
    item = session.motion_named(name)
    if item.record is not None:
        return _recorded(item.record, session.robot)
    if item.trajectory is None:
        raise InputError("a pose has no curves", value=name)
    count = int(np.clip(item.duration * RATE_HZ, 200, MOST_SAMPLES)) + 1
    t = np.linspace(0.0, item.duration, count)
    motion = item.trajectory.evaluate(t)
    q, dq, ddq = motion.q, motion.dq, motion.ddq
    shown = {"position": q, "velocity": dq, "acceleration": ddq}
    torque = _expected(session.robot, q, dq, ddq)
    if torque is not None:
        shown = {"torque": torque, **shown}
    groups = [_group(kind, session.robot, "expected", values) for kind, values in shown.items()]
    return {"duration": item.duration, "t": encoded(t), "q": encoded(q), "groups": groups}


def _expected(model: RobotModel, q: Array, dq: Array, ddq: Array) -> Array | None:
    """Torques (N, n) of the prior that limits are judged with; None where there is none."""
    prior = prior_dynamics(model)
    if prior is None:
        return None
    return prior.torque(q, dq, ddq) + prior.coulomb * np.tanh(dq / 0.02)


def _recorded(record: recording.ExperimentRecord, model: RobotModel) -> dict[str, Any]:
    signals = _signals(record, model)
    names = [name for name in RECORDED if name in signals]
    t, q, *rows = thinned(record.t - record.t[0], signals["q"], *(signals[name] for name in names))
    groups = [_group(name, model, "measured", x) for name, x in zip(names, rows, strict=True)]
    return {"duration": float(t[-1]), "t": encoded(t), "q": encoded(q), "groups": groups}


def _signals(record: recording.ExperimentRecord, model: RobotModel) -> dict[str, Array]:
    """What was measured, and torques from currents where the drives' gains are known."""
    found = dict(record.signals)
    with suppress(InputError):
        found["effort"] = measured_torque(record, model)
    return found


def tail_facts(record: recording.ExperimentRecord, model: RobotModel) -> dict[str, Any]:
    """The last seconds of a run, thinned to what a small plot can show, the newest sample kept."""
    t: Array = record.t - record.t[0]
    signals = _signals(record, model)
    first = int(np.searchsorted(t, float(t[-1]) - TAIL_S))
    step = max(1, -(-(len(t) - first) // TAIL_POINTS))
    chosen = np.arange(len(t) - 1, first - 1, -step)[::-1]
    return {
        "samples": record.samples,
        "t": encoded(t[chosen]),
        "q": encoded(signals["q"][chosen]),
        "groups": {
            RECORDED[name][0]: encoded(signals[name][chosen])
            for name in RECORDED
            if name in signals
        },
    }


def thinned(t: Array, *rows: Array) -> tuple[Array, ...]:
    """Every k-th sample, so that a page can hold them, and the last one."""
    step = max(1, -(-len(t) // MOST_SAMPLES))
    chosen = np.unique(np.append(np.arange(0, len(t), step), len(t) - 1))
    return tuple(values[chosen] for values in (t, *rows))


def _group(kind: str, model: RobotModel, name: str, values: Array) -> dict[str, Any]:
    """A plot with a curve for each joint."""
    title, unit = (KINDS | RECORDED)[kind]
    shown = figures.joint_unit(unit, model.prismatic)
    return {"title": title, "unit": shown, "series": [_series(name, values)]}


def _series(name: str, values: Array) -> dict[str, Any]:
    return {"name": name, "values": encoded(values)}


PARAMETERS = 60
"""Most parameters of an estimate that are listed."""


def judged_estimates(folder: Path, output: Path | None) -> list[dict[str, Any]]:
    """Evaluate the estimates of a folder, the newest first; the report is written if asked for."""
    with tempfile.TemporaryDirectory(prefix="dynid-studio-") as scratch:
        _, contents = workflow.report(folder, output or Path(scratch) / "report.html")
    newest = sorted(contents.estimates, key=lambda item: -_made(folder / item.name))
    return [_facts(item) for item in newest]


def _facts(item: report.ReportedEstimate) -> dict[str, Any]:
    estimate = item.estimate
    robot = estimate.model.robot
    found: dict[str, Any] = {
        "name": printable(item.name, 120),
        "level": jobs.LEVELS[item.level],
        "headline": printable(item.headline, 300),
        "warnings": [printable(warning.message, 300) for warning in item.warnings[:6]],
        "parameters": [
            {
                "name": printable(estimate.names[k]),
                "expression": printable(estimate.expressions[k], 160),
                "unit": figures.units(estimate.units[k]),
                "value": plain(float(estimate.values[k])),
                "interval": plain(float(identification.CONFIDENCE * estimate.std[k])),
            }
            for k in estimate.essential[:PARAMETERS]
        ],
        "record": "",
    }
    shown = item.shown
    if shown is None:
        return found
    own = item.validation is None
    found["record"] = printable(item.training_name if own else item.validation_name, 120)
    error = np.sqrt(np.mean((shown.measured - shown.predicted) ** 2, axis=0))
    size = np.sqrt(np.mean(shown.measured**2, axis=0))
    found["joints"] = [
        {
            "name": name,
            "error": plain(float(error[j])),
            "torque": plain(float(size[j])),
            "unit": figures.joint_unit("N.m", robot.prismatic[j : j + 1]),
        }
        for j, name in enumerate(figures.joint_labels(robot.joint_names))
    ]
    found["basis"] = "the recording it was made from" if own else "another recording"
    start = estimate.settings.start_s if own else None
    t, measured, predicted = thinned(shown.t + (start or 0.0), shown.measured, shown.predicted)
    group = _group("effort", robot, "measured", measured)
    group["series"].append(_series("predicted", predicted))
    found["prediction"] = group | {"t": encoded(t)}
    return found


def _made(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0
