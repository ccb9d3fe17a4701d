"""One identified model to one file, and the proof that the file gives its torques."""

import json
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dynid import core, reduction, regressor
from dynid.export import completion, robot_xml, verification
from dynid.export.generated_code import c_code, c_prefix, python_code
from dynid.export.model import (
    ExportModel,
    NearestFriction,
    completed_model,
    nearest_friction,
    recorded_range,
)
from dynid.export.robot_xml import left_out, own_urdf_text, stand_in_words
from dynid.identification import Estimate, EstimateLike, open_estimate
from dynid.robot import PARAMETERS, robot_from_json, robot_to_json

FORMAT = "dynid-model"
VERSION = 1
_UNITS = {
    "m": "kg",
    "mx, my, mz": "kg.m",
    "J": "kg.m^2, about the joint frame",
    "Fc, Fo, Fca, Fs, Fcm": "N.m, N where the joint slides",
    "Fv, Fva, Fvm": "N.m.s/rad, N.s/m where the joint slides",
    "Fr": "N.m.(s/rad)^(1/3), N.(s/m)^(1/3) where the joint slides",
    "Im, Imm": "kg.m^2, kg where the joint slides",
    "Fl": "1: a share of the load's torque",
    "Fw": "1: a share of the ripple, whose coefficients are N.m, N where the joint slides",
}
_FORMULAS = {
    "step": "tanh(dq / coulomb_width), the sign of dq where the width is 0",
    "Fc, Fv, Im, Fo": "step, dq, ddq, 1",
    "Fca, Fva": "|step|, |dq|",
    "Fs": "exp(-(dq / stribeck_velocity)^2) step",
    "Fr": "sign(dq) |dq|^(1/3)",
    "Fcm, Fvm, Imm": "as Fc, Fv, Im, with the speed of a coupled motor, turns_per_joint_turn times "
    "dq; on the joints through the same turns",
    "Fl": "|load| step; load: inverse dynamics of the links in `load`, less the torque of "
    "counterbalances",
    "Fw": "ripple; for each gear, wave and power k from 0 of s = dq / speed of the gear's joint, "
    "within -1 and 1: s^k cos(wave q), s^k sin(wave q), times the coefficients in this order",
}
"""What each term multiplies; the torque of a joint is the sum."""


def model_to_json(model: ExportModel) -> dict[str, Any]:
    """The object; `model_from_json` reads it back."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "units": _UNITS,
        "formulas": _FORMULAS,
        "origin": model.origin,
        "physical": model.physical,
        "worst": model.worst,
        "links": _links(model, model.inertials),
        "terms": {symbol: values.tolist() for symbol, values in model.terms.items()},
        "coulomb_width": model.width.tolist(),
        "stribeck_velocity": model.stribeck_velocity.tolist(),
        "coupled_motors": [
            {"motor": motor + 1, "turns_per_joint_turn": share}
            for motor, share in zip(model.motors, model.shares.tolist(), strict=True)
        ],
        "load": None if model.load is None else _links(model, model.load),
        "ripples": [ripple.to_json() for ripple in model.ripples],
        **({} if model.presliding is None else {"presliding": model.presliding.tolist()}),
        "robot": robot_to_json(model.robot),
    }


def model_from_json(data: Mapping[str, Any]) -> ExportModel:
    """The model of an object that `model_to_json` made."""
    robot, motors, load = robot_from_json(data["robot"]), data["coupled_motors"], data["load"]
    return core.JsonFields(data).made(
        ExportModel,
        robot=robot,
        inertials=_rows(data["links"]),
        width=np.array(data["coulomb_width"]),
        stribeck_velocity=np.broadcast_to(data["stribeck_velocity"], (robot.joints,)),
        shares=np.array([one["turns_per_joint_turn"] for one in motors]).reshape(-1, robot.joints),
        motors=tuple(one["motor"] - 1 for one in motors),
        load=None if load is None else _rows(load),
        ripples=regressor.ripples_from_json(core.JsonFields(data)),
    )


def _links(model: ExportModel, rows: core.Array) -> list[dict[str, Any]]:
    return [
        {"joint": name, **dict(zip(PARAMETERS, row, strict=True))}
        for name, row in zip(model.robot.joint_names, rows.tolist(), strict=True)
    ]


def _rows(links: list[Mapping[str, Any]]) -> core.Array:
    return np.array([[float(link[name]) for name in PARAMETERS] for link in links])


_EXACT = 1e-9
"""Difference that rounding may make [N.m or N], for torques up to a few hundred."""
_GRAVITY = 9.81
_ROUNDED = 1e-13
"""What rounding leaves of a moment of inertia that cancels [N.m per kg.m^2]."""
_NO_MASS = 1e-6
"""Links lighter than this have no centre of mass [kg]."""
_LARGE = 100.0
"""Torques above this may differ in proportion [N.m or N]."""


@dataclass(frozen=True, slots=True)
class FileFormat:
    """How a model becomes a file of one kind, and who reads it."""

    endings: tuple[str, ...]
    """What such files are called; the first is what loaders want."""
    text: Callable[[ExportModel, str], str]
    """From the model and where it comes from."""
    torque: Callable[[ExportModel, Path, verification.States], tuple[core.Array | None, str]]
    """What another program makes of the file, as `our_torque`, and its name; None without one."""
    held: tuple[str, ...] | None = None
    """Terms beside the inertias that it has a place for; None for all."""
    tolerance: float = _EXACT
    """[N.m or N]"""


def _json_text(model: ExportModel, note: str) -> str:
    data = {**model_to_json(model), "note": note}
    return json.dumps(data, indent=1, allow_nan=False) + "\n"


def _json_torque(
    _: ExportModel, path: Path, states: verification.States
) -> tuple[core.Array | None, str]:
    # Read back from the file, and evaluated by code that has only the file's numbers.
    read = model_from_json(json.loads(path.read_text(encoding="utf-8")))
    code = path.with_suffix(".py")
    try:
        code.write_text(python_code(read), encoding="utf-8")
        return verification.python_torque(code, states)
    finally:
        code.unlink(missing_ok=True)


_FORMATS = {
    "urdf": FileFormat(
        (".urdf", ".xml"),
        robot_xml.urdf_text,
        lambda model, path, states: verification.urdf_torque(
            path,
            states,
            np.array([0.0, 0.0, -np.linalg.norm(model.robot.gravity)]),
            robot_xml.joint_names(model.robot),
        ),
        robot_xml.URDF_HELD,
    ),
    "mjcf": FileFormat(
        (".xml", ".mjcf"),
        robot_xml.mjcf_text,
        lambda _, path, states: verification.mjcf_torque(path, states),
        robot_xml.MJCF_HELD,
        1e-6,
    ),
    "json": FileFormat((".json",), _json_text, _json_torque),
    "c": FileFormat(
        (".h", ".hpp", ".c"),
        c_code,
        lambda model, path, states: verification.c_torque(path, c_prefix(model.robot.name), states),
    ),
    "python": FileFormat(
        (".py",), python_code, lambda _, path, states: verification.python_torque(path, states)
    ),
}
FORMATS = tuple(_FORMATS)
"""The words of `--to`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedFile(core.Value):
    """What was written."""

    path: Path
    """The file."""
    to: str
    """Its format."""
    model: ExportModel
    """What it holds."""
    source: Path | None
    """The robot's own URDF of which the file is a copy; None for a file of its own."""
    verified: verification.Verification
    """What another program made of it."""
    left_out: tuple[str, ...]
    """What the identified model has and the file has no place for, in words."""
    left_out_rms: core.Array
    """(n) RMS of what that makes of the predicted torques, over states drawn from the recorded
    range, joints sliding [N.m or N]."""
    friction: NearestFriction | None = None
    """Coulomb and viscous friction of a file that has a place for no other."""
    warnings: tuple[core.Finding, ...] = ()
    """What must be known about it."""

    def to_json(self) -> dict[str, Any]:
        """The object that `dynid export --json` prints."""
        return {
            "file": str(self.path),
            "format": self.to,
            "copy_of": None if self.source is None else str(self.source),
            "verified": self.verified.to_json(),
            "physical": self.model.physical,
            "standard_parameters": self.model.origin,
            "left_out": list(self.left_out),
            "left_out_rms": self.left_out_rms.tolist(),
            **core.told(self.warnings),
        }


def check_suffix(to: str, output: Path) -> None:
    """Refuse a name that belongs to another format, such as C in `arm.urdf`.

    An ending that belongs to no format is left to the user.

    Raises:
        InputError: The name ends as those of another format do.
    """
    suffix, own = output.suffix.lower(), _FORMATS[to].endings if to in _FORMATS else ()
    if own and suffix not in own and any(suffix in kind.endings for kind in _FORMATS.values()):
        raise core.InputError(
            f"the name is of another format than {to}",
            where="-o",
            value=str(output),
            limit=", ".join(f"*{ending}" for ending in own),
        )


def write_model(
    estimate: EstimateLike, path: str | Path, to: str, *, urdf: str | Path | None = None
) -> ExportedFile:
    """Write a model, have another program load it, and compare torques on random states.

    The file appears only after it has passed. Where no other program is at hand it is written
    all the same, and `verified` says so. A robot that came from a URDF is written as a copy of that
    file, with its names, limits, visuals and meshes.

    Args:
        estimate: What was identified, or its file.
        path: File to write.
        to: One of `FORMATS`.
        urdf: The robot's own URDF, where it has moved; None for the path at which it was read. A
            file of its own is written where there is none.

    Raises:
        InputError: An unknown format, a URDF of another arm, or a place where no such file can be.
        JobError: A model that the format cannot hold, torques that differ, or a disk that does
            not take the file.
    """
    if str(path) in FORMATS and to not in FORMATS:
        # The order of release 0.1, for one release.
        old = "write_model(estimate, to, path) is now write_model(estimate, path, to)"
        warnings.warn(old, DeprecationWarning, stacklevel=3)
        path, to = to, str(path)
    estimate = open_estimate(estimate)
    if to not in FORMATS:
        raise core.InputError("unknown format", value=to, limit=", ".join(FORMATS))
    path = Path(path)
    model, completed = completed_model(estimate)
    kind = _FORMATS[to]
    if urdf is not None and to != "urdf":
        raise core.InputError(
            "only a URDF can be a copy of one", where="--urdf", value=to, limit="urdf"
        )
    # One that is asked for must be there.
    file = Path(urdf or model.robot.urdf)
    own = file if urdf is not None or (model.robot.urdf and file.is_file()) else None
    if own is not None and own.is_file() and path.exists() and own.samefile(path):
        raise core.InputError(
            "the model would overwrite the robot's own URDF, which recordings go by",
            where=str(path),
            next_step="Name another file.",
        )
    source = own if to == "urdf" else None
    if source is not None:
        kind = replace(kind, text=partial(own_urdf_text, source, path), torque=_copy_torque)
    states = reduction.random_states(model.robot, verification.STATES, seed=0)
    if kind.held is None and model.presliding is not None:
        # Half of them a few displacements apart: there, friction depends on those before.
        over = np.where(model.presliding > 0, model.presliding, 1.0)
        states[0][verification.STATES // 2 :] *= over
    friction = None if kind.held is None else nearest_friction(estimate, completed, model)
    ours = verification.our_torque(estimate, completed, states, kind.held, friction)
    model = model if friction is None else friction.put_into(model)
    made = estimate.provenance
    remarks = [
        f"dynid {made.versions.get('dynid', '')}, estimator {estimate.estimator}, "
        f"{estimate.samples} samples, identified {made.created}."
    ]
    remarks += [f"{note[:1].upper()}{note[1:]}." for note in model.robot.notes]
    if kind.held is not None and model.presliding is not None:
        said = "Its presliding needs the past: friction here is that of joints that slide."
        remarks.append(said)
    remarks += [f"Standard parameters: {model.origin}.", *stand_in_words(friction)]
    text = kind.text(model, "\n".join(remarks).strip())
    # The draft ends as the format wants it: loaders look at the suffix.
    with core.in_one_piece(path, kind.endings[0]) as part:
        part.write_text(text, encoding="utf-8")
        theirs, loader = kind.torque(model, part, states)
        verified = _compared(kind, ours, theirs, loader, completed.values[: 10 * model.joints])
        if verified.max_torque_difference is not None and not verified.passed:
            raise core.JobError(
                "the file's torques differ from ours",
                where=str(path),
                value=verified.max_torque_difference,
                limit=verified.tolerance,
            )
    missing = () if kind.held is None else left_out(model, kind.held)
    if friction is not None and friction.wide_step:
        missing = (*missing, "the width of the Coulomb step")
    gap = _gap(estimate, completed, kind.held, friction)
    return ExportedFile(
        path=path,
        to=to,
        model=model,
        source=source,
        verified=verified,
        left_out=missing,
        left_out_rms=gap,
        friction=friction,
        warnings=_warnings(to, model, (missing, gap), estimate),
    )


def _copy_torque(
    model: ExportModel, path: Path, states: verification.States
) -> tuple[core.Array | None, str]:
    robot = model.robot
    return verification.urdf_torque(path, states, robot.gravity, robot.joint_names, robot.locked)


def _gap(
    estimate: Estimate,
    completed: completion.Completion,
    held: tuple[str, ...] | None,
    friction: NearestFriction | None,
) -> core.Array:
    """(n) RMS difference of a file's torques and the predicted ones over the recorded range.

    Beside what the file has no place for: of a geometry off nominal, no bodies have exactly the
    torques of the base parameters.
    """
    states = recorded_range(estimate)
    ours = verification.our_torque(estimate, completed, states, held, friction)
    theirs = estimate.predict(*states)
    return core.read_only(np.sqrt(np.square(ours[:, : theirs.shape[1]] - theirs).mean(axis=0)))


AFTER_REVERSALS = "friction that builds up after reversals comes on top, up to twice Coulomb's"
"""What the RMS over single states does not hold: they have no past."""


def _warnings(
    to: str, model: ExportModel, missing: tuple[tuple[str, ...], core.Array], known: Estimate
) -> tuple[core.Finding, ...]:
    noise, (words, gap) = known.noise, missing
    found = [
        finding
        for finding in known.warnings
        if finding.code == "not_physical"
        or finding.kind == "extrapolated"
        or finding.severity == "error"
    ]
    if not model.physical:
        found.append(
            core.Finding(
                "not_physical",
                "no physically consistent links have the identified base parameters"
                f" ({model.worst}): torques are right, but single masses and inertias have no"
                " meaning, and simulators may refuse them; use --estimator sdp",
            )
        )
    over = np.flatnonzero(gap > noise)
    if len(over):
        joints = ", ".join(f"{gap[j]:.3g} (noise {noise[j]:.3g}) at joint {j + 1}" for j in over)
        what = "no bodies have exactly the torques of the estimate, whose geometry is off nominal"
        if words:
            what = f"{to} has no place for {', '.join(words)}"
        text = (
            f"{what}: over the recorded range, the file's torques miss the prediction by RMS of"
            f" {joints}, in N.m or N; c, python and json hold all terms"
        )
        if words and known.model.friction.presliding:
            text += f"; {AFTER_REVERSALS}"
        found.append(core.Finding("extrapolated", text, joints=tuple(map(int, over))))
    return tuple(found)


def simulator_obstacle(estimate: Estimate) -> str:
    """Why the model of an estimate cannot be written for a simulator; empty where it can.

    MuJoCo has the strictest rules: inertias, motor inertias and friction of every joint must be
    physically possible.
    """
    try:
        model, completed = completed_model(estimate)
        robot_xml.mjcf_text(nearest_friction(estimate, completed, model).put_into(model))
    except core.DynidError as error:
        return f"{error.what}. {error.next_step or ''}".rstrip(". ")
    return ""


def _compared(
    kind: FileFormat, ours: core.Array, theirs: core.Array | None, loader: str, bodies: core.Array
) -> verification.Verification:
    # Weights of impossible bodies cancel in the torques; their rounding errors do not. Nor do those
    # of tensors moved to distant centres of mass, m c^2.
    largest = max(float(np.abs(ours).max()), _GRAVITY * float(np.abs(bodies).max()))
    links = bodies.reshape(-1, 10)
    moved = np.square(links[:, 1:4]).sum(axis=1) / np.maximum(np.abs(links[:, 0]), _NO_MASS)
    tolerance = kind.tolerance * max(1.0, largest / _LARGE) + _ROUNDED * float(moved.max())
    if theirs is not None and theirs.shape != ours.shape:
        raise core.JobError("the file has other joints", value=theirs.shape, limit=ours.shape)
    worst = None if theirs is None else float(np.abs(theirs - ours).max())
    return verification.Verification(
        max_torque_difference=worst, tolerance=tolerance, loaded_with=loader
    )
