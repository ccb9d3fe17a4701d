"""Rival explanations of what the reference model leaves.

Near nothing every fault is linear: the derivative of the torques by its size is one more column.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from dynid.core import Array
from dynid.diagnosis.payloads import changes_of, loaded
from dynid.diagnosis.prior import of_the_last_link
from dynid.diagnosis.residual import BLOCKS, Recording, Reference
from dynid.regressor import InverseDynamicModel, motor_turns
from dynid.robot import RobotModel

Undo = Callable[[Recording, Array], Recording]
"""The recording without a fault of the sizes (m)."""

PAYLOAD, LEVER_M, RADIUS_M = 0.1, 0.1, 0.07
"""Mass that an arm is expected to carry, share of its own, how far from the flange, and how large
it is [m]."""
MOST_CARRIED = 5.0
"""... and how many times as much it may carry."""
LEAST_DELAY_S = 0.006
LEAST_ARM_M = 0.02
"""Shorter offsets between joints have no length that could be wrong."""
FARTHEST = 2
"""How many joints a motor may stand behind another joint with which it turns, as in wrists."""

COUPLED = frozenset({"coupled_friction", "coupled_torques", "coupled_motors"})
"""Kinds of a motor that turns with two joints: joint values; motor torques; motor positions too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Hypothesis:
    """One explanation."""

    kind: str
    """A kind of finding."""
    joints: tuple[int, ...]
    """Empty for the arm as a whole."""
    unit: str
    width: Array
    """(m) standard deviation of its sizes before anything was measured."""
    least: float
    """Size from which it matters."""
    columns: Array
    """(m, n, T) derivative of the torques by its sizes."""
    undo: Undo | None = None
    """None where its columns stay in the reference instead."""
    lowest: float = -np.inf
    """Sizes at or below it are not physical."""
    widest: float = 1.0
    """How far sizes may lie beyond their width without being pulled back."""
    changes_s: tuple[float, ...] = ()
    """When it begins and ends, from the record's start [s]."""
    told: int = 0
    """So many of these do not come back after a repetition of the motion."""

    @property
    def free(self) -> int:
        """Sizes that may be large by chance; of a payload, which is small, those of a point."""
        return 4 if self.kind == "payload" else len(self.width)

    def holding(self, sizes: Array) -> Array:
        """(m) the width that sizes (m) show, far from zero or not."""
        share = float(np.sqrt(np.square(sizes / self.width).mean()))
        return min(max(share, 1.0), self.widest) * self.width


class _Torques:
    """Rigid-body torques of a recording with the parameters that were found."""

    def __init__(self, ref: Reference, values: Array) -> None:
        self.rec, self.model = ref.recording, ref.recording.model
        self.joints = self.rec.robot.joints
        self.parameters = np.array(values[: len(self.model.columns)])
        first, turns = 10 * self.joints, motor_turns(self.rec.robot)
        # Of joints, then of coupled motors, whose Coulomb friction comes first.
        viscous = self.parameters[first : first + self.joints].copy()
        coupled = self.parameters[first + 2 * self.joints :].reshape(3, -1)
        turned = (self.rec.dq @ turns.T * coupled[1]) @ turns
        self.parameters[first : first + self.joints] = coupled[:2] = 0.0
        self.here = self.at()
        self.smooth = self.here + self.rec.dq * viscous + turned
        # What bends a gear: motors turn before it.
        self.beyond_gears = self.parameters.copy()
        self.beyond_gears[first + self.joints :] = 0.0
        self.links = self.at(parameters=self.beyond_gears)

    def at(
        self,
        dq_by: float = 1.0,
        by: Array | None = None,
        robot: RobotModel | None = None,
        parameters: Array | None = None,
    ) -> Array:
        """(N, n) with time scaled, the motion (3, N, n) shifted, or another robot."""
        rec = self.rec
        motion = [rec.q, dq_by * rec.dq, dq_by**2 * rec.ddq]
        if by is not None:
            motion = [x + step for x, step in zip(motion, by, strict=True)]
        model: InverseDynamicModel = replace(self.model, robot=robot) if robot else self.model
        values = self.parameters if parameters is None else parameters
        return model.inverse_dynamics(motion[0], motion[1], motion[2], values)

    def slope(self, step: float, torque: Array) -> Array:
        """(N, n) derivative from the torques of a small step."""
        return (torque - self.here) / step

    def columns(self, *torques: Array) -> Array:
        """(m, n, T) of torques (N, n)."""
        return self.rec.average(np.array([x.T for x in torques]))


def hypotheses(ref: Reference, values: Array) -> list[Hypothesis]:
    """All explanations that are linear near nothing.

    Args:
        ref: The reference.
        values: (p) its parameters.
    """
    torques = _Torques(ref, values)
    found = list(_of_the_arm(ref, values, torques))
    for j in range(torques.joints):
        found += _of_a_joint(torques, j)
    total = np.tensordot(values, ref.columns, axes=1)
    for m in range(1, torques.joints):
        for j in range(max(0, m - FARTHEST), m):
            found += _of_a_coupling(torques, total, j, m)
    return found


def _of_the_arm(ref: Reference, values: Array, torques: _Torques) -> Iterator[Hypothesis]:
    rec, n = torques.rec, torques.joints
    every, step = tuple(range(n)), float(rec.t[1] - rec.t[0])
    yield Hypothesis(
        kind="delay", joints=every, unit="s", width=np.array([0.05]), least=LEAST_DELAY_S,
        columns=torques.columns(-np.gradient(torques.smooth, step, axis=0)),
        undo=lambda r, x: replace(r, tau=_shifted(r, float(x[0]), every)),
    )  # fmt: skip
    # Where nothing is published, nothing tells gains and payloads from the links themselves.
    if rec.robot.published.any():
        yield Hypothesis(
            kind="gain_all", joints=(), unit="1", width=np.array([0.5]), least=0.1,
            columns=torques.columns(torques.here),
            undo=lambda r, x: replace(r, tau=r.tau / (1 + x[0])),
            lowest=-1.0,
        )  # fmt: skip
    yield Hypothesis(
        kind="clock_scale", joints=(), unit="1", width=np.array([0.1]), least=0.01,
        columns=torques.columns(torques.slope(1e-3, torques.at(dq_by=1.001))),
        undo=lambda r, x: replace(r, dq=r.dq * (1 + x[0]), ddq=r.ddq * (1 + x[0]) ** 2),
    )  # fmt: skip
    if np.any(rec.robot.gravity):
        leaning = [torques.at(robot=_tilted(rec.robot, 1e-3 * x)) for x in np.eye(2)]
        yield Hypothesis(
            kind="mounting", joints=(), unit="rad", width=np.full(2, 0.1), least=np.radians(0.5),
            columns=torques.columns(*(torques.slope(1e-3, x) for x in leaning)),
            undo=lambda r, x: replace(r, robot=_tilted(r.robot, x)),
        )  # fmt: skip
    yield from _payloads(ref, values)
    friction = ref.columns[10 * n :].copy()
    friction[n : 2 * n] = 0.0  # motor inertia
    total = np.tensordot(values[10 * n :], friction, axes=1)
    time = rec.average((rec.t - rec.t.mean()) / np.ptp(rec.t))
    yield Hypothesis(
        kind="friction_drift", joints=every, unit="1", width=np.full(n, 0.5), least=0.08,
        columns=np.eye(n)[:, :, None] * (total * time)[:, None, :],
    )  # fmt: skip


def _payloads(ref: Reference, values: Array) -> Iterator[Hypothesis]:
    """A body that is carried at the flange, and one that is in the rows in which it explains most.

    The columns are those of a point there, then of what its first and second moments differ by.
    """
    rec, last = ref.recording, ref.recording.robot.joints - 1
    of_last = of_the_last_link(rec.robot)
    body = np.tensordot(of_last, ref.columns[10 * last : 10 * last + 10], axes=1)
    carried = PAYLOAD * float(ref.mean[: 10 * last + 10 : 10].sum())
    width = carried * np.array([1.0, *[LEVER_M] * 3, *[RADIUS_M**2] * 6])
    if rec.robot.published[last]:
        yield Hypothesis(
            kind="payload", joints=(last,), unit="kg", width=width, least=0.05 * carried,
            columns=body, widest=MOST_CARRIED,
            # What is left of the last link has a mass.
            lowest=-max(float(values[10 * last]), 0.0),
        )  # fmt: skip
    rows = loaded(ref, values, body[:4], width[:4])
    changes, told = changes_of(rows, ref.period)
    # What is there or not for less than a block may be anything.
    if min(rows.sum(), (~rows).sum()) >= len(rows) // BLOCKS:
        yield Hypothesis(
            kind="payload_change", joints=(last,), unit="kg", width=width[:4],
            least=0.05 * carried, columns=body[:4] * rows, widest=MOST_CARRIED,
            changes_s=tuple(rec.t[changes * rec.block].tolist()), told=told,
        )  # fmt: skip


def _of_a_joint(torques: _Torques, j: int) -> Iterator[Hypothesis]:
    rec, here = torques.rec, torques.here
    step, own = float(rec.t[1] - rec.t[0]), np.arange(torques.joints) == j
    if torques.joints > 1:  # Those of a single joint are those of the arm.
        yield Hypothesis(
            kind="drive_gain", joints=(j,), unit="1", width=np.array([0.5]), least=0.05,
            columns=torques.columns(np.where(own, here, 0.0)),
            undo=lambda r, x: replace(r, tau=r.tau * np.where(own, 1 / (1 + x[0]), 1.0)),
            lowest=-1.0,
        )  # fmt: skip
        yield Hypothesis(
            kind="delay", joints=(j,), unit="s", width=np.array([0.05]), least=LEAST_DELAY_S,
            columns=torques.columns(np.where(own, -np.gradient(torques.smooth, step, axis=0), 0.0)),
            undo=lambda r, x: replace(r, tau=_shifted(r, float(x[0]), (j,))),
            # A lead cannot be told from stiction before a reversal.
            lowest=0.0,
        )  # fmt: skip
    slides = rec.robot.prismatic[j]
    # A zero of the last joint that is off is the same as another last link.
    if j < torques.joints - 1:
        moved = np.zeros((3, *rec.q.shape))
        moved[0, :, j] = 1e-3
        yield Hypothesis(
            kind="encoder_zero", joints=(j,), unit="m" if slides else "rad",
            width=np.array([0.2]), least=0.005 if slides else 0.02,
            columns=torques.columns(-torques.slope(1e-3, torques.at(by=moved))),
            undo=lambda r, x: replace(r, q=r.q - np.where(own, x[0], 0.0)),
        )  # fmt: skip
    carried = torques.links[:, j]
    bent = np.zeros((3, *rec.q.shape))
    bent[0, :, j] = carried
    bent[1, :, j] = np.gradient(carried, step)
    bent[2, :, j] = np.gradient(bent[1, :, j], step)
    small = 1e-3 / max(float(np.abs(carried).max()), 1e-9)  # Most bend by 1 mrad or 1 mm.
    yield Hypothesis(
        kind="flexibility", joints=(j,), unit="m/N" if slides else "rad/(N.m)",
        width=np.array([50 * small]), least=5 * small,
        columns=torques.columns(
            (torques.links - torques.at(by=small * bent, parameters=torques.beyond_gears)) / small
        ),
        lowest=0.0,
    )  # fmt: skip
    if j > 0 and np.linalg.norm(rec.robot.placements[j, :3, 3]) > LEAST_ARM_M:
        longer = _longer(rec.robot, j, 1e-4)
        yield Hypothesis(
            kind="link_length", joints=(j,), unit="m", width=np.array([0.05]), least=0.005,
            columns=torques.columns(torques.slope(1e-4, torques.at(robot=longer))),
            undo=lambda r, x: replace(r, robot=_longer(r.robot, j, float(x[0]))),
        )  # fmt: skip
    # Chebyshev polynomials of the place within its travel.
    place = (rec.q[:, j] - rec.q[:, j].min()) / max(float(np.ptp(rec.q[:, j])), 1e-9)
    shapes: Array = np.zeros((3, *rec.q.shape))
    shapes[:, :, j] = np.cos(np.outer([1, 2, 3], np.arccos(2 * place - 1)))
    # A dead torque has no springs of any size, but its rows are judged all the same.
    size = max(float(np.sqrt(np.square(rec.tau[:, j]).mean())), 1e-6)
    yield Hypothesis(
        kind="spring", joints=(j,), unit="N" if slides else "N.m", width=np.full(3, size),
        least=0.02 * size, columns=torques.columns(*shapes),
    )  # fmt: skip


def _of_a_coupling(torques: _Torques, total: Array, j: int, m: int) -> Iterator[Hypothesis]:
    """Motor m that turns with joint j before it as well; `total` (n, T) are all torques."""
    rec = torques.rec
    if rec.robot.prismatic[m] or rec.robot.prismatic[j]:
        return
    inverse_turns: Array = np.asarray(np.linalg.inv(_turns(rec.robot)), dtype=np.float64)
    bodies = torques.parameters.copy()
    bodies[10 * torques.joints :] = 0.0
    rigid = torques.at(parameters=bodies)
    motor = inverse_turns[:, m] @ rec.average(rigid.T)
    friction, measured = np.zeros((2, 1, *total.shape))
    friction[0, j] = inverse_turns[:, m] @ total - motor
    measured[0, j] = -motor
    by = -1e-3 * inverse_turns[:, m] * np.array([rec.q, rec.dq, rec.ddq])[:, :, j, None]
    moved = torques.columns((torques.at(by=by, parameters=bodies) - rigid) / 1e-3)
    moved[0, j] -= motor
    for kind, column in (
        ("coupled_friction", friction), ("coupled_torques", measured), ("coupled_motors", moved),
    ):  # fmt: skip
        yield Hypothesis(
            kind=kind, joints=(j, m), unit="1", width=np.array([0.5]), least=0.05, columns=column,
            undo=lambda r, x, kind=kind: _coupled(r, kind, j, m, float(x[0])),
        )  # fmt: skip


def _turns(robot: RobotModel) -> Array:
    """(n, n) turns of the motors per turn of the joints, their own joint's being 1."""
    if robot.drives.coupling is None:
        return np.eye(robot.joints)
    return robot.drives.coupling / np.diag(robot.drives.coupling)[:, None]


def _coupled(rec: Recording, kind: str, j: int, m: int, by: float) -> Recording:
    """The recording of a robot whose motor m turns `by` more with joint j."""
    before = _turns(rec.robot)
    after = before.copy()
    after[m, j] += by
    drives = replace(rec.robot.drives, coupling=after)
    rec = replace(rec, robot=replace(rec.robot, drives=drives))
    if kind != "coupled_friction":
        rec = replace(rec, tau=np.linalg.solve(before.T, rec.tau.T).T @ after)
    if kind == "coupled_motors":
        back = np.linalg.solve(after, before).T
        rec = rec.with_motion(lambda values: values @ back)
    return rec


def _shifted(rec: Recording, by: float, joints: tuple[int, ...]) -> Array:
    out = rec.tau.copy()
    for j in joints:
        out[:, j] = np.interp(rec.t + by, rec.t, rec.tau[:, j])
    return out


def _longer(robot: RobotModel, j: int, by: float) -> RobotModel:
    placements = robot.placements.copy()
    arrow = placements[j, :3, 3]
    placements[j, :3, 3] += by * arrow / np.linalg.norm(arrow)
    return replace(robot, placements=placements)


def _tilted(robot: RobotModel, lean: Array) -> RobotModel:
    """Gravity turned by (2) small angles about axes across it [rad]."""
    size = float(np.linalg.norm(robot.gravity))
    down = robot.gravity / size
    near = np.eye(3)[int(np.argmin(np.abs(down)))]
    first = np.cross(down, near)
    first /= np.linalg.norm(first)
    turned = down + lean[0] * first + lean[1] * np.cross(down, first)
    return replace(robot, gravity=turned * (size / np.linalg.norm(turned)))
