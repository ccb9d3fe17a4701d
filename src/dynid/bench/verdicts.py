"""The scoreboard of verdicts: false alarms, faults named, on arms that share no code with dynid.

A case is a clean recording, or one with a planted fault.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dynid.bench.plants import ARMS, MOTIONS, RANDOM, Motion, Plant, arm, motion, plant
from dynid.core import Array, DynidError, Finding, Progress, silent
from dynid.recording import ExperimentRecord
from dynid.robot import RobotModel, joints_by_kind

SIZES = {"small": 1 / 3, "medium": 1.0, "large": 3.0}
FAULTS = {
    "gain": 0.2,
    "gains": 0.2,
    "delay": 0.016,
    "joint_delay": 0.016,
    "clock": 0.03,
    "encoder_zero": np.radians(4.0),
    "tilt": 1.0,
    "payload": 0.7,
    "length": 0.01,
    "ripple": 0.03,
    "flexibility": 1 / 4000.0,
    "friction_drift": 0.3,
    "spring": 0.05,
    "contact": 20.0,
}
"""Medium sizes: share of the torque (one joint, all), s, s, share of the time, rad, deg, kg, m,
share of the rated torque, rad/(N.m), share of the friction, share of the rated torque, N."""
DISCRETE = (
    "quarter_turn",
    "reversed",
    "exchanged",
    "exchanged_torques",
    "saturated",
    "gravity_compensated",
    "friction_compensated",
    "commanded",
)
"""Faults that are there or not: they count as large."""
CONTACT_S = 0.3
FELT, DIRECTIONS = 3.0, 20
"""Standard deviations of noise that a contact reaches on a joint; directions that are tried."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """What is recorded, and what is wrong with it."""

    arm: str
    motion: str
    rate_hz: float
    duration_s: float
    seed: int
    fault: str | None = None
    """A key of `FAULTS` or one of `DISCRETE`; None for a clean recording."""
    size: str = "medium"

    @property
    def label(self) -> str:
        """A short name."""
        what = "clean" if self.fault is None else f"{self.fault}/{self.size}"
        return f"{what} {self.arm} {self.motion} {self.rate_hz:g} Hz {self.duration_s:g} s"


@dataclass(frozen=True, slots=True, kw_only=True)
class Recorded:
    """The recordings of a case, and what is true of them."""

    robot: RobotModel
    """The robot as it is told to the identification."""
    record: ExperimentRecord
    validation: ExperimentRecord
    """Another motion with the same fault, without a contact."""
    clean: Array
    """(N, n) true joint torques of the validation motion, those of faults of the arm among them,
    without noise and faults of the recording [N.m or N]."""
    joint: int | None
    """The joint of the fault."""
    times_s: tuple[float, ...] = ()
    """When contacts began."""


def cases(seed: int, clean: int, each: int, random_arms: bool = False) -> Iterator[Case]:
    """So many clean cases, then as many of `each` fault, over the sizes together.

    Of the six arms of `ARMS`, or each of an arm of its own.
    """
    draw = np.random.default_rng(seed)

    def one(fault: str | None, size: str) -> Case:
        rate = float(draw.choice([100, 125, 125, 250, 500, 1000]))
        return Case(
            arm=f"{RANDOM}{draw.integers(1 << 20)}" if random_arms else str(draw.choice(ARMS)),
            motion=str(draw.choice(MOTIONS, p=[0.5, 0.3, 0.2])),
            rate_hz=rate,
            duration_s=float(draw.choice([10, 20, 20, 30, 60, 120])) if rate <= 125 else 15.0,
            seed=int(draw.integers(1 << 30)),
            fault=fault,
            size=size,
        )

    for _ in range(clean):
        yield one(None, "medium")
    for k in range(each):
        size = tuple(SIZES)[k % len(SIZES)]
        for fault in FAULTS:
            yield one(fault, size)
        if k % len(SIZES) == 2:
            for fault in DISCRETE:
                yield one(fault, "large")


def recorded(case: Case) -> Recorded:
    """Make the recordings of a case."""
    draw = np.random.default_rng(case.seed)
    told = arm(case.arm)
    n = told.joints
    turning = [j for j in range(n) if not told.prismatic[j]]
    shown = turning
    if case.fault in ("encoder_zero", "quarter_turn"):
        # The first axis of most arms is vertical: no torque tells where it counts from.
        shown = shown[1:]
    if case.fault in ("encoder_zero", "quarter_turn", "flexibility"):
        # A zero of the last joint is the same as another last link; little torque bends its gear.
        shown = [j for j in shown if j < n - 1]
    joint = int(draw.choice(shown))
    size = FAULTS.get(case.fault or "", 0.0) * SIZES[case.size]
    built = told
    if case.fault == "tilt":
        way = draw.uniform(0, 2 * np.pi)
        lean = np.radians(size)
        down = np.array([np.sin(lean) * np.cos(way), np.sin(lean) * np.sin(way), -np.cos(lean)])
        built = replace(told, gravity=float(np.linalg.norm(told.gravity)) * down)
    elif case.fault == "length":
        # Along the first axis an arm may begin anywhere.
        across = [np.linalg.norm(np.cross(told.placements[1, :3, 3], told.axes[0]))]
        lengths = across + [np.linalg.norm(x) for x in told.placements[2:, :3, 3]]
        joint = int(draw.choice([j for j, x in enumerate(lengths, start=1) if x > 0.05]))
        placements = told.placements.copy()
        arrow = placements[joint, :3, 3]
        placements[joint, :3, 3] += size * arrow / np.linalg.norm(arrow)
        built = replace(told, placements=placements)
    real = plant(built, case.seed)
    if case.fault == "payload":
        real = real.with_payload(size, built.flange[:3, 3] + draw.uniform(-0.05, 0.08, 3))
    partner = int(draw.choice([j for j in turning if j != joint]))
    parts: list[ExperimentRecord] = []
    clean = np.zeros(0)
    times: tuple[float, ...] = ()
    signed: float | None = None
    for k in range(2):
        length = case.duration_s if k == 0 else min(case.duration_s, 20.0)
        path = motion(told, case.motion, case.seed + k, case.rate_hz, length)
        if k == 0 and case.fault == "contact":
            times = (float(draw.uniform(0.15, 0.85)) * length,)
        record, clean, signed = _record(
            real, path, case, size, joint, partner, draw, times if k == 0 else (), signed
        )
        parts.append(record)
    return Recorded(
        robot=told, record=parts[0], validation=parts[1], clean=clean, joint=joint, times_s=times
    )


def _record(
    real: Plant,
    path: Motion,
    case: Case,
    size: float,
    joint: int,
    partner: int,
    draw: np.random.Generator,
    times: tuple[float, ...],
    signed: float | None,
) -> tuple[ExperimentRecord, Array, float]:
    """What is written of a motion, its true torques, and the size with its sign.

    Springs and ripples are torques of the arm: true ones. Signs are drawn where `signed` is
    None; another motion of the same arm has the same.
    """
    robot, fault = real.robot, case.fault
    limit = np.where(np.isfinite(robot.limits.torque), robot.limits.torque, 50.0)
    t, q = path.t, path.q
    rigid = real.torque(q, path.dq, path.ddq)
    pushed = rigid.copy()
    for start in times:
        rows = (t >= start) & (t < start + CONTACT_S)
        for _ in range(DIRECTIONS):
            way = draw.normal(size=3)
            force = np.tile(size * way / np.linalg.norm(way), (int(rows.sum()), 1))
            pushed[rows] = real.torque(q[rows], path.dq[rows], path.ddq[rows], force)
            felt = np.abs((pushed - rigid)[rows].mean(axis=0))
            if (felt > FELT * real.torque_noise).any():
                break
    seen, dq = q.copy(), path.dq
    if fault == "flexibility":
        # Motors turn before the gear that bends: their inertia and friction follow them.
        bend = np.zeros_like(q)
        bend[:, joint] = size * (rigid - real.armature * path.ddq)[:, joint]
        seen, dq = q + bend, dq + np.gradient(bend, t, axis=0)
        pushed = rigid = rigid + real.armature * np.gradient(dq - path.dq, t, axis=0)
    friction = real.friction(dq, rigid, float(t[1] - t[0]))
    if fault == "spring":
        friction[:, joint] += size * limit[joint] * np.sin(1.3 * q[:, joint] + 0.5)
    elif fault == "ripple":
        friction[:, joint] += size * limit[joint] * np.sin(2 * 40 * q[:, joint] + 1.0)
    clean = rigid + friction
    if fault == "friction_drift":
        friction = friction * (1 - size * (t / t[-1])[:, None])
    tau = pushed + friction
    if fault == "gravity_compensated":
        tau -= real.torque(q, np.zeros_like(q), np.zeros_like(q))
    elif fault == "friction_compensated":
        tau -= 0.85 * (real.coulomb * np.tanh(path.dq / 0.02) + real.viscous * path.dq)
    elif fault == "commanded":
        tau = real.torque(q, path.dq, path.ddq) - real.armature * path.ddq
    if fault in ("gain", "gains"):
        if signed is None:
            signed = size if draw.random() < 0.5 else 1 / (1 + size) - 1
        tau[:, joint if fault == "gain" else slice(None)] *= 1 + signed
    elif fault in ("delay", "joint_delay"):
        for j in range(robot.joints) if fault == "delay" else (joint,):
            tau[:, j] = np.interp(t - size, t, tau[:, j])
    if fault != "commanded":
        tau = tau + real.torque_noise * draw.normal(size=tau.shape)
    if fault == "saturated":
        top = 0.5 * np.abs(tau[:, joint]).max()
        tau[:, joint] = np.clip(tau[:, joint], -top, top)
    dq = dq + 1e-3 * draw.normal(size=dq.shape)
    step = real.position_step
    seen = step * np.round((seen + 0.5 * step * draw.normal(size=q.shape)) / step)
    if fault in ("encoder_zero", "quarter_turn"):
        if signed is None:
            zero = fault == "encoder_zero"
            signed = float(
                size * draw.choice([-1, 1]) if zero else np.pi / 2 * draw.choice([-1, 1, 2])
            )
        seen[:, joint] += signed
    elif fault == "reversed":
        tau[:, joint] *= -1
    order = np.arange(robot.joints)
    order[joint], order[partner] = partner, joint
    if fault == "exchanged":
        seen, dq, tau = seen[:, order], dq[:, order], tau[:, order]
    elif fault == "exchanged_torques":
        tau = tau[:, order]
    stamps = t * (1 + size) if fault == "clock" else t
    record = ExperimentRecord(t=stamps, signals={"q": seen, "qd": dq, "effort": tau})
    return record, clean, size if signed is None else signed


GOOD = 5.0
"""[%] true error on another motion up to which a clean recording gave a good model."""
NAMED = 2
"""Explanations that a result may name: those of equal torque count as one answer."""
NEAR_S = 0.5
"""A contact is found where one is named this near to it."""
SAME = {
    "gain": ("drive_gain",),
    "gains": ("gain_all",),
    "delay": ("delay", "clock_offset"),
    "joint_delay": ("delay",),
    "clock": ("clock_scale",),
    "tilt": ("mounting",),
    "length": ("link_length",),
    "quarter_turn": ("encoder_zero",),
    "exchanged_torques": ("exchanged_torques", "exchanged"),
}
"""Fault to the kinds of finding that name it, where they are called otherwise."""
COLUMNS = ("fault", "size", "cases", "named", "found", "usable", "misled")
ANYWHERE = frozenset(
    {"gains", "delay", "clock", "tilt", "payload", "friction_drift", "contact", *DISCRETE[5:]}
)
"""Faults of no single joint."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """What an identification said of a case."""

    findings: tuple[Finding, ...]
    level: str
    t: ArrayLike
    """(N) times of the validation motion [s]."""
    predicted: ArrayLike
    """(N, n) torques predicted then [N.m or N]."""


Judge = Callable[[Recorded], Judged]
"""Identifies a case's recording, validates it, and says what was found."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One case and its outcome."""

    case: Case
    level: str
    kinds: tuple[str, ...]
    """Findings above information, strongest first."""
    named: bool
    """The planted fault is among the first `NAMED` findings, at its joint or time."""
    error_percent: float
    """True error on the validation motion."""
    cpu_s: float


def run_verdicts(
    judge: Judge, chosen: Iterable[Case], progress: Progress = silent
) -> tuple[Row, ...]:
    """Judge the chosen cases one after the other; `progress` is told which is under way."""
    every = list(chosen)
    rows: list[Row] = []
    for k, case in enumerate(every):
        progress(case.label, k / len(every))
        made = recorded(case)
        start = process_time()
        try:
            judged = judge(made)
        except DynidError:
            rows.append(
                Row(case=case, level="refused", kinds=(), named=False, error_percent=np.nan,
                    cpu_s=process_time() - start)
            )  # fmt: skip
            continue
        kinds = SAME.get(case.fault or "", (case.fault,))
        told = [f for f in judged.findings if f.severity != "info" or f.kind in kinds]
        rows.append(
            Row(
                case=case,
                level=judged.level,
                kinds=tuple(f.kind for f in told),
                named=_named(case, made, told),
                error_percent=_error_percent(made, judged),
                cpu_s=process_time() - start,
            )
        )
    return tuple(rows)


def _named(case: Case, made: Recorded, told: Sequence[Finding]) -> bool:
    if case.fault is None:
        return not told
    kinds = SAME.get(case.fault, (case.fault,))
    faults = [f for f in told if f.kind not in ("at_rest", "low_excitation", "ill_conditioned")]
    for finding in faults[:NAMED]:
        if finding.kind not in kinds:
            continue
        if case.fault == "contact":
            near = [abs((finding.value or 0.0) - t) < NEAR_S for t in made.times_s]
            if any(near):
                return True
        elif case.fault in ANYWHERE or made.joint in finding.joints:
            return True
    return False


def _error_percent(made: Recorded, judged: Judged) -> float:
    """Error against the true torques, at the times that were predicted.

    Of an arm that turns and slides, of the kind of joints that errs more.
    """
    t = made.validation.t
    times, torque = np.asarray(judged.t), np.asarray(judged.predicted)
    columns: list[Array] = [made.clean[:, j] for j in range(made.clean.shape[1])]
    true: Array = np.column_stack([np.interp(times, t - t[0], column) for column in columns])
    shares = [
        float(np.linalg.norm((torque - true)[:, joints]) / np.linalg.norm(true[:, joints]))
        for joints in joints_by_kind(made.robot.prismatic).values()
    ]
    return 100 * max(shares)


def summarise(rows: Sequence[Row]) -> dict[str, Any]:
    """False alarms by kind, and the share of each fault and size that is named."""
    clean = [r for r in rows if r.case.fault is None]
    good = [r for r in clean if r.error_percent <= GOOD]
    doubted = [r for r in good if r.level != "usable"]
    planted: list[dict[str, Any]] = []
    for fault in (*FAULTS, *DISCRETE):
        for size in SIZES:
            cells = [r for r in rows if r.case.fault == fault and r.case.size == size]
            if cells:
                errors = [r.error_percent for r in cells if r.level == "usable"]
                told = sum(r.named for r in cells), sum(bool(r.kinds) for r in cells)
                misled = sum(error > GOOD for error in errors)
                row = (fault, size, len(cells), *told, len(errors), misled)
                planted.append(dict(zip(COLUMNS, row, strict=True)))
    return {
        "clean": len(clean),
        "good": len(good),
        "doubted": len(doubted),
        "refused": sum(r.level == "refused" for r in rows),
        "false_alarms": dict(Counter(kind for r in clean for kind in set(r.kinds)).most_common()),
        "faults": planted,
        "cpu_s_median": float(np.median([r.cpu_s for r in rows])) if rows else 0.0,
    }


def rates(told: dict[str, Any]) -> dict[str, float]:
    """Right cause by size, in per cent."""
    out: dict[str, float] = {}
    for size in SIZES:
        cells = [row for row in told["faults"] if row["size"] == size]
        count = sum(row["cases"] for row in cells)
        if count:
            out[size] = 100 * sum(row["named"] for row in cells) / count
    return out


def markdown(told: dict[str, Any], title: str) -> str:
    """A summary as a section of a page."""
    lines = [
        f"## {title}",
        "",
        f"{told['clean']} clean recordings; of {told['good']} the true error is below {GOOD:g} %,",
        f"and {told['doubted']} of these are not called usable.",
        *([f"Refused recordings: {told['refused']}."] if told["refused"] else []),
        f"Median CPU of a case {told['cpu_s_median']:.1f} s.",
        "",
        "Findings on clean recordings: "
        + (", ".join(f"{kind} {count}" for kind, count in told["false_alarms"].items()) or "none")
        + ".",
        "",
    ]
    if not told["faults"]:
        return "\n".join(lines)
    lines += [
        "Right cause: " + ", ".join(f"{k} {v:.0f} %" for k, v in rates(told).items()) + ".",
        "",
        "| fault | size | cases | named | anything found | still called usable |"
        f" and off by more than {GOOD:g} % |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += ["| " + " | ".join(str(row[key]) for key in COLUMNS) + " |" for row in told["faults"]]
    return "\n".join([*lines, ""])
