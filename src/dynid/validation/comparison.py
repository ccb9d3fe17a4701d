"""Two estimates of one robot: what moved between them, and by how many sigmas.

And a prediction error split by cause: an offset, friction, a share of the model's gravity and a
share of its inertial torques.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any

import numpy as np

from dynid import core, identification, regressor
from dynid.robot import PARAMETERS, RobotModel
from dynid.signals import Samples

OF_COMPARISON = ("other_motion", "other_shape", "same_record")
"""Findings that a comparison tells of itself; in an estimate they are of its validation."""
CAUSES = ("offset", "gravity", "friction", "inertia")
CORRELATION_S = 0.2
"""Residuals this long are taken as one when a deviation is given."""
_SLOWEST = 0.005
"""Speed below which a joint rests, however slow it was when it was identified [rad/s or m/s]."""
_UNSEEN = 0.5
"""Of what a friction parameter may change by: one that is no surer was not seen."""
_SMOOTH = 0.02
"""Smoothing velocity of the Coulomb shape, share of the joint's usual top speed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TransferReport(core.Value):
    """A prediction error split by cause."""

    rms: core.Array
    """(4, n) RMS of what each of `CAUSES` explains alone of the joint's error [N.m or N]."""
    share: core.Array
    """(2, n) of the model's gravity and of its inertial torque that is missing; NaN where a joint
    has none, or none that differs enough from an offset or friction in this record."""
    rest: core.Array
    """(n) RMS of what none explains [N.m or N]."""

    def to_json(self) -> dict[str, Any]:
        """A JSON object: one list a cause, one number a joint."""
        causes = dict(zip(CAUSES, self.rms, strict=True))
        shares = dict(zip(("gravity_share", "inertia_share"), self.share, strict=True))
        return core.plain({**causes, **shares, "rest": self.rest})


def transfer_report(
    estimate: identification.Estimate, samples: Samples, error: core.Array
) -> TransferReport:
    """Split a prediction error by cause.

    The error (N, n) is measured minus predicted torques of the record's used rows [N.m or N].
    """
    model, n = estimate.model, samples.joints
    inertial = [k < 10 * n or name.startswith("Im") for k, name in enumerate(model.names)]
    parameters = np.where(inertial, estimate.standard_parameters(), 0.0)
    rest = np.zeros_like(samples.q)
    gravity = model.inverse_dynamics(samples.q, rest, rest, parameters)
    moving = model.inverse_dynamics(samples.q, samples.dq, samples.ddq, parameters) - gravity
    rows, fast = samples.rows, np.percentile(np.abs(samples.dq), 98, axis=0)
    blocks = max(len(error) / (CORRELATION_S * samples.rate_hz), 1.0)
    rms, share, left = np.zeros((len(CAUSES), n)), np.full((2, n), np.nan), np.zeros(n)
    for j in range(n):
        dq = samples.dq[rows, j]
        columns = (
            np.ones_like(dq),
            gravity[rows, j],
            np.tanh(dq / max(_SMOOTH * fast[j], 1e-9)),
            dq,
            moving[rows, j],
        )
        values, parts = _fit(columns, error[:, j], blocks)
        left[j] = np.sqrt(np.square(error[:, j] - sum(parts)).mean())
        share[:, j] = values[1], values[4]
        causes = (parts[0], parts[1], parts[2] + parts[3], parts[4])
        rms[:, j] = np.sqrt(np.square(causes).mean(axis=1))
    return TransferReport(rms=rms, share=share, rest=left)


def _fit(
    columns: tuple[core.Array, ...], error: core.Array, blocks: float
) -> tuple[core.Array, list[core.Array]]:
    """Factors of columns, and their parts of an error with so many independent values.

    NaN for a column too like those before it: its part would be less certain than the error.
    """
    stack = np.column_stack([*columns, error])
    size = np.linalg.norm(stack, axis=0)
    apart = np.abs(np.diag(core.upper_triangle(stack / np.maximum(size, 1e-300))))
    seen = (apart > max(apart[-1] / np.sqrt(blocks), 1e-6)) & (size > 1e-9 * size[:-1].max())
    seen[-1], values = False, np.full(stack.shape[1] - 1, np.nan)
    values[seen[:-1]] = np.linalg.pinv(stack[:, seen] / size[seen]) @ error / size[seen]
    return values, [np.nan_to_num(v) * column for v, column in zip(values, columns, strict=True)]


def refit_friction(estimate: identification.Estimate, samples: Samples) -> identification.Estimate:
    """The same inertias with the friction of another record.

    Each friction parameter may be another by as much as it is, or as the largest of its kind is by
    a tenth (standard deviation): what the record does not show stays what it was, and is told.

    Args:
        estimate: The estimate; inertial parameters and motor inertias stay as they are.
        samples: The record that friction is taken from.

    Raises:
        InputError: The estimate has no friction.
    """
    model, chosen = estimate.model, list(identification.friction_parameters(estimate))
    if not chosen:
        raise core.InputError("the estimate has no friction", where="--refit")
    independent, rows = list(estimate.independent), samples.rows
    columns, torque = identification.recorded_rows(
        model, samples, rows, independent, identification.motion_state(model, samples)
    )
    # At rest, friction is whatever holds the joint.
    slowest = np.maximum(_SMOOTH * estimate.motion.speed, _SLOWEST)
    moves = slowest[:, None] < np.abs(samples.dq[rows]).T
    columns, torque = (x * moves / estimate.noise[:, None] for x in (columns, torque))
    left = torque - np.tensordot(estimate.values, columns, axes=1)
    design = columns[chosen].reshape(len(chosen), -1)
    square = design @ design.T
    rest = (
        left.ravel() - (np.linalg.pinv(square, hermitian=True) @ (design @ left.ravel())) @ design
    )
    freedom = max(int(moves.sum()) / (CORRELATION_S * samples.rate_hz) - len(chosen), 1.0)
    noise = max(float(rest @ rest) / freedom, np.finfo(float).tiny)
    spread = _may_change(estimate, chosen)
    # In units of what may change, so that neither is lost in the rounding of the other.
    scaled = square * np.outer(spread, spread) / noise + np.eye(len(chosen))
    inverse = np.linalg.inv(scaled) * np.outer(spread, spread)
    found = estimate.values[chosen] + inverse @ (design @ left.ravel()) / noise
    values, covariance = np.array(estimate.values), np.array(estimate.covariance)
    values[chosen] = found
    covariance[chosen, :] = covariance[:, chosen] = 0.0
    covariance[np.ix_(chosen, chosen)] = inverse
    standard = estimate.standard
    if standard is not None:
        places = [estimate.independent[k] for k in chosen]
        whole, std = np.array(standard.values), np.array(standard.std)
        whole[places], std[places] = found, np.sqrt(np.diag(covariance)[chosen])
        standard = replace(standard, values=whole, std=std)
    unseen = [
        estimate.names[k]
        for k, before, after in zip(chosen, spread, np.sqrt(np.diag(inverse)), strict=True)
        if after > _UNSEEN * before
    ]
    told = estimate.warnings
    if unseen:
        message = f"the record hardly shows {', '.join(unseen)}: they stay near what they were"
        told = (*told, core.Finding("low_excitation", message))
    return replace(estimate, values=values, covariance=covariance, standard=standard, warnings=told)


def _may_change(estimate: identification.Estimate, chosen: list[int]) -> core.Array:
    """(f) by how much each friction parameter may be another on another day, SI units."""
    size = np.maximum(np.abs(estimate.values), estimate.std)
    slides = estimate.model.robot.prismatic
    # Newtons are no newton metres.
    kinds = [
        (estimate.names[k].rstrip("0123456789"), slides[estimate.model.columns[column].joint])
        for k, column in enumerate(estimate.independent)
    ]
    largest: dict[tuple[str, bool], float] = {}
    for k in chosen:
        largest[kinds[k]] = max(largest.get(kinds[k], 0.0), float(size[k]))
    return np.array([max(size[k], 0.1 * largest[kinds[k]], 1e-9) for k in chosen])


_SAME_PLACE = 1e-9
_SAME_GRAVITY = 1e-6
_STANDS = 0.05
"""Range below which a joint does not move [rad or m]."""
_SAME_RANGE = 0.2
"""Of the range of a joint, by which the ends of one motion recorded twice may differ."""
_SAME_GAIN = 1e-9


def refuse_strangers(a: identification.Estimate, b: identification.Estimate) -> None:
    """Refuse two estimates whose parameters do not mean the same.

    Raises:
        InputError: Different robots, mountings, frames, terms or base sets; one message names
            all that differs.
    """
    reasons: list[str] = []
    step = "Identify both recordings with the same --robot"
    one, other = a.model.robot, b.model.robot
    if not _same_chain(one, other):
        names = (f"{robot.name}, {robot.joints} joints" for robot in (one, other))
        reasons.append(f"robots ({' and '.join(names)})")
    elif not np.allclose(one.gravity, other.gravity, atol=_SAME_GRAVITY, rtol=0):
        reasons.append(f"mountings ({one.mount} and {other.mount})")
    if a.model.frames != b.model.frames:
        reasons.append(f"frames ({a.model.frames} and {b.model.frames})")
    terms = [estimate.model.friction.describe() for estimate in (a, b)]
    if terms[0] != terms[1]:
        if not reasons:
            step += f" and with --terms {_all_terms(a, b)}"
        reasons.append(f"terms ({terms[0]} and {terms[1]})")
    # Of one model, the same columns stand for the same combinations.
    if not reasons and a.independent != b.independent:
        only = ", ".join(sorted({*a.names} ^ {*b.names}))
        reasons.append(f"base sets ({len(a.values)} and {len(b.values)} parameters: {only})")
        # Which friction parameters can be told apart depends on the shapes that were chosen.
        step += " and with --preset paper, whose shapes are not chosen from the recording"
    if reasons:
        raise core.InputError(
            f"the estimates differ in {' and in '.join(reasons)}", next_step=f"{step}."
        )


def _all_terms(*estimates: identification.Estimate) -> str:
    """The terms of all estimates, each for the joints that any has it for."""
    joints: dict[str, set[int]] = {}
    count = max(estimate.model.robot.joints for estimate in estimates)
    for estimate in estimates:
        for term, own in estimate.model.friction.terms:
            joints.setdefault(term, set()).update(range(count) if own is None else own)
    terms = ((t, None if len(own) == count else tuple(sorted(own))) for t, own in joints.items())
    return regressor.FrictionTerms(terms=tuple(terms)).describe()


def comparison_warnings(
    a: identification.Estimate, b: identification.Estimate
) -> Iterator[core.Finding]:
    """What may mislead in a comparison that is allowed."""
    gains = [estimate.model.robot.drives.gain for estimate in (a, b)]
    if not np.allclose(*gains, rtol=_SAME_GAIN, atol=0, equal_nan=True):
        message = "the drive gains differ; parameters from currents are scaled by them"
        yield core.Finding("unit_suspect", message)
    if _same_rows(a, b):
        message = "both are of one recording: their deviations are not independent"
        made = [estimate.provenance for estimate in (a, b)]
        if made[0].settings.get(REFIT) != made[1].settings.get(REFIT):
            message += ", and what moved is friction, which was refitted to another one"
        elif used_rows(a) == used_rows(b) and made[0].settings != made[1].settings:
            message += ", and what moved did so by the settings"
        yield core.Finding("same_record", message)
    else:
        yield from _other_motion(a, b)
    one, other = (_shapes(estimate.model) for estimate in (a, b))
    if apart := [name for name in one if one[name] != other[name]]:
        message = (
            f"the friction has other shapes ({', '.join(apart)}), which its parameters go with: "
            "identify both with --preset paper to compare friction"
        )
        yield core.Finding("other_shape", message)
    own = [{notice.kind: notice.severity for notice in one.warnings} for one in (a, b)]
    for kind in sorted({*own[0], *own[1]} - {*OF_COMPARISON}):
        names = [name for name, told in zip(("first", "second"), own, strict=True) if kind in told]
        of = "both estimates" if len(names) > 1 else f"the {names[0]} estimate"
        worst = max((told.get(kind, "info") for told in own), key=core.SEVERITIES.index)
        yield core.Finding(kind, f"a finding of {of}", severity=worst)


REFIT = "refit"
"""Key of an estimate's settings: the rows that its friction was refitted to."""


def used_rows(estimate: identification.Estimate) -> list[tuple[str, float, float]]:
    """Recordings that an estimate was made from, by identity, each with its window [s]."""
    made, used = estimate.provenance, estimate.settings
    stop = np.inf if used.stop_s is None else used.stop_s
    found = [(name, used.start_s or 0.0, stop) for name in made.inputs.values()]
    if refit := made.settings.get(REFIT):
        found.append((refit["record"], refit["start_s"], refit["stop_s"]))
    return found


def _same_rows(a: identification.Estimate, b: identification.Estimate) -> bool:
    """Whether both are of one recording, and of the same part of it."""
    return any(
        one == other and max(start, since) < min(stop, until)
        for one, start, stop in used_rows(a)
        for other, since, until in used_rows(b)
    )


def _shapes(model: regressor.InverseDynamicModel) -> dict[str, Any]:
    """What the parameters of friction multiply, beside the terms themselves."""
    friction, n = model.friction, model.robot.joints
    steps = {column.joint for column in model.columns if column.name.startswith(("Fc", "Fs"))}
    width = np.broadcast_to(np.asarray(friction.width, dtype=np.float64), (n,))
    built_up = np.broadcast_to(friction.presliding or (0.0,), (n,))
    has_peak = any(column.name.startswith("Fs") for column in model.columns)
    return {
        "widths of the Coulomb step": [float(width[j]) for j in sorted(steps)],
        "Stribeck velocity": friction.stribeck_velocity if has_peak else None,
        "presliding": built_up.tolist(),
        "waves of gears": [ripple.to_json() for ripple in friction.ripples],
        "loads of gears": None if friction.load is None else list(friction.load.parameters),
    }


def _other_motion(a: identification.Estimate, b: identification.Estimate) -> Iterator[core.Finding]:
    """Whether the joints moved through different ranges, so that errors of the model differ, too.

    On a real UR5, two motions of one arm differ by 11 standard deviations, repetitions by one.
    """
    ends = [np.stack([one.motion.lower, one.motion.upper]) for one in (a, b)]
    span = np.maximum(*(np.ptp(pair, axis=0) for pair in ends))
    span = np.maximum(span, _STANDS)
    apart = np.abs(ends[0] - ends[1]).max(axis=0) > _SAME_RANGE * span
    names, joints = a.model.robot.joint_names, tuple(map(int, np.flatnonzero(apart)))
    if joints:
        message = (
            f"the motions differ (range of {', '.join(names[j] for j in joints)}): what the model "
            "leaves out may move parameters by more than their deviations. To see what moved, "
            "record both with one design"
        )
        yield core.Finding("other_motion", message, joints=joints, severity="warning")


def _same_chain(one: RobotModel, other: RobotModel) -> bool:
    """Kinematics and motors decide, not names: a URDF of an arm may be called otherwise."""
    return (
        one.joint_types == other.joint_types
        and core.plain(one.drives.coupling) == core.plain(other.drives.coupling)
        and np.allclose(one.placements, other.placements, atol=_SAME_PLACE, rtol=0)
        and np.allclose(one.axes, other.axes, atol=_SAME_PLACE, rtol=0)
    )


GROUPS = ("inertial", "coulomb", "viscous", "motor")
"""The paper's groups (Fig. 4): friction moves with temperature, the others must not."""
FALSE_ALARM = 0.01
"""Chance that a group in which nothing moved is said to have moved."""
_SYMBOLS = {
    **dict.fromkeys(PARAMETERS, "inertial"),
    **dict.fromkeys(("Fc", "Fca", "Fs", "Fl", "Fw", "Fcm"), "coulomb"),
    **dict.fromkeys(("Fv", "Fva", "Fr", "Fvm"), "viscous"),
    **dict.fromkeys(("Im", "Imm"), "motor"),
    "Fo": "offset",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterGroup:
    """Parameters of one kind, judged together."""

    name: str
    """One of `GROUPS`, or `offset` where the model has one."""
    members: tuple[int, ...]
    """Indices of its base parameters; empty if the model has none."""
    largest: int | None
    """The member with the largest |z|."""
    largest_z: float
    """Its |z|; 0 for a group without members."""
    limit_z: float
    """|z| above which the group has moved: `FALSE_ALARM` shared by its members (Sidak)."""
    median_change_percent: float
    """Of the members that both estimates know to better than 100 %; NaN if there are none."""

    @property
    def moved(self) -> bool:
        """Whether a member moved by more than chance explains."""
        return self.largest_z > self.limit_z


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterComparison(core.Value):
    """Base parameters of two estimates side by side (paper 3.2, Fig. 4)."""

    names: tuple[str, ...]
    """(r) names of the base parameters."""
    expressions: tuple[str, ...]
    """(r) their combinations of standard parameters."""
    units: tuple[str, ...]
    """(r) their units."""
    a: core.Array
    """(r) values of the first estimate."""
    b: core.Array
    """(r) values of the second."""
    z: core.Array
    """(r) (b - a) / sqrt(std_a^2 + std_b^2), with the deviations that allow for correlation."""
    change_percent: core.Array
    """(r) 100 (b - a) / |a|; NaN where a is zero."""
    groups: tuple[ParameterGroup, ...]
    """`GROUPS` in their order, and `offset` where the model has offsets."""
    warnings: tuple[core.Finding, ...] = ()
    """Why the comparison may mislead."""

    def to_json(self) -> dict[str, Any]:
        """The keys that `dynid compare --json` prints."""
        return {
            "parameters": core.table(
                name=self.names,
                unit=self.units,
                a=self.a,
                b=self.b,
                change_percent=self.change_percent,
                z=self.z,
            ),
            "groups": {
                group.name: {
                    "parameters": [self.names[k] for k in group.members],
                    "moved": group.moved,
                    "largest": None if group.largest is None else self.names[group.largest],
                    "largest_z": group.largest_z,
                    "limit_z": group.limit_z,
                    "median_change_percent": group.median_change_percent,
                }
                for group in self.groups
            },
            **core.told(self.warnings),
        }


def compare(a: identification.EstimateLike, b: identification.EstimateLike) -> ParameterComparison:
    """Compare two estimates parameter by parameter and group by group.

    The records are taken as independent. What a wrong model does to records of one motion alike
    cancels in the difference but not in the deviations: z-scores where nothing moved are then
    smaller than a standard normal's, false alarms rarer, and small changes are missed. Other
    motions are told as `other_motion`.

    Args:
        a: The first estimate or its file, such as the cold robot's.
        b: The second, such as the warm robot's.

    Raises:
        InputError: Estimates of different robots, mountings, frames, terms or base sets.
    """
    a, b = identification.open_estimate(a), identification.open_estimate(b)
    refuse_strangers(a, b)
    difference = b.values - a.values
    deviation = np.sqrt(np.square(a.std) + np.square(b.std))
    z = np.divide(difference, deviation, out=np.zeros_like(difference), where=deviation > 0)
    z[(deviation == 0) & (difference != 0)] = np.inf
    size = np.abs(a.values)
    change = np.full_like(size, np.nan)
    np.divide(100.0 * difference, size, out=change, where=size > 0)
    known = (a.relative_std_percent < 100.0) & (b.relative_std_percent < 100.0)
    kinds = [_SYMBOLS[name.rstrip("0123456789")] for name in a.names]
    words = (*GROUPS, "offset") if "offset" in kinds else GROUPS
    return ParameterComparison(
        names=a.names,
        expressions=a.expressions,
        units=a.units,
        a=a.values,
        b=b.values,
        z=core.read_only(z),
        change_percent=core.read_only(change),
        groups=tuple(
            _group(word, np.flatnonzero([kind == word for kind in kinds]), z, change, known)
            for word in words
        ),
        warnings=tuple(comparison_warnings(a, b)),
    )


def _group(
    word: str, members: core.Indices, z: core.Array, change: core.Array, known: core.Mask
) -> ParameterGroup:
    indices = tuple(int(k) for k in members)
    largest = max(indices, key=lambda k: abs(float(z[k])), default=None)
    changes = [float(change[k]) for k in indices if known[k]]
    share = 1.0 - (1.0 - FALSE_ALARM) ** (1.0 / max(len(indices), 1))
    limit = -NormalDist().inv_cdf(share / 2.0)
    return ParameterGroup(
        name=word,
        members=indices,
        largest=largest,
        largest_z=0.0 if largest is None else abs(float(z[largest])),
        limit_z=limit if indices else float("nan"),
        median_change_percent=float(np.median(changes)) if changes else float("nan"),
    )
