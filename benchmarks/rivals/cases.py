"""The same data for everybody: recordings of real arms, and simulated arms with their truth.

Each case becomes a folder with `robot.urdf` (kinematics, and the published inertias where there are
any) and `data.npz`: positions and joint torques on a uniform grid, of the part to identify and of
the part to predict. A counterbalance that the robot file knows is subtracted for everybody. dynid
identifies the same parts of the original recordings.
"""

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import dynid
from dynid.bench import motion, plant
from dynid.export.robot_xml import roll_pitch_yaw
from dynid.robot import tensor
from dynid.signals import ProcessingSettings, uniform_signals

sys.path.insert(0, str(Path(__file__).parents[1]))
import real_recordings

DENSITY = 1000.0
"""Of a ball in the place of a link whose inertia nobody published [kg/m^3]."""
MASS = 5.0
SIMULATED = (("ur5", 3, 30.0), ("ur10e", 4, 30.0))
"""Arm, seed, and length of the recordings [s]."""


@dataclass(frozen=True)
class Case(real_recordings.Case):
    """As of the real recordings; with the torques without noise where they are known."""

    truth: np.ndarray | None = None


def simulated(name: str, seed: int, length_s: float) -> Case:
    """An arm of the bench: links as built, Stribeck, load and presliding friction, noise."""
    real = plant(dynid.load_robot(name), seed)
    parts, clean = [], np.zeros(0)
    for k in range(2):
        path = motion(real.robot, "fourier", seed + k, 125.0, length_s)
        rigid = real.torque(path.q, path.dq, path.ddq)
        clean = rigid + real.friction(path.dq, rigid, 1 / 125)
        noise = real.torque_noise * np.random.default_rng([seed, k]).normal(size=clean.shape)
        step = real.position_step
        parts.append(
            dynid.ExperimentRecord(
                t=path.t,
                signals={"q": step * np.round(path.q / step), "effort": clean + noise},
            )
        )
    return Case(f"simulated {name}", parts[0], real.robot, parts[1], truth=clean)


def all_cases(data: Path) -> list[Case]:
    """Real recordings where they are there, then simulated ones."""
    real = real_recordings.cases(data) if data.exists() else []
    fields = ("name", "record", "robot", "other", "window", "check")
    return [
        *(Case(*(getattr(case, field) for field in fields)) for case in real),
        *(simulated(*words) for words in SIMULATED),
    ]


def folder_of(case: Case, place: Path) -> Path:
    """Where a case is written."""
    return place / "".join(c if c.isalnum() else "_" for c in case.name)


def write(case: Case, place: Path) -> Path:
    """Write what the rivals read."""
    folder = folder_of(case, place)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.urdf").write_text(urdf(case.robot))
    model = dynid.InverseDynamicModel(robot=case.robot)
    values = {"gravity": case.robot.gravity}
    for word, record, (start, stop) in (
        ("train", case.record, case.window),
        ("test", case.other, case.check),
    ):
        signals = uniform_signals(
            record, case.robot, ProcessingSettings(start_s=start, stop_s=stop)
        )
        torque = signals.torque + model.known_torque(signals.q)
        values |= {f"{word}_q": signals.q, f"{word}_tau": torque}
        values[f"{word}_rate"] = np.array(signals.rate_hz)
    if case.truth is not None:
        values["test_truth"] = case.truth
    np.savez(folder / "data.npz", **values)
    return folder


def urdf(robot: dynid.RobotModel) -> str:
    """A URDF of the chain; a ball of 5 kg where no inertia is published."""
    parts = [f'<robot name="{robot.name}"><link name="base"/>']
    limit = robot.limits
    for k in range(robot.joints):
        place, (mass, com, inertia) = robot.placements[k], _body(robot.inertias[k])
        bounds = " ".join(
            f'{name}="{values[k] if np.isfinite(values[k]) else other:.9g}"'
            for name, values, other in (
                ("lower", limit.lower, -6.28),
                ("upper", limit.upper, 6.28),
                ("effort", limit.torque, 1e4),
                ("velocity", limit.velocity, 10.0),
            )
        )
        kind = "prismatic" if robot.prismatic[k] else "revolute"
        turn = _text(roll_pitch_yaw(place[:3, :3]))
        parts.append(
            f'<link name="link{k + 1}"><inertial><origin xyz="{_text(com)}"/>'
            f'<mass value="{mass:.12g}"/><inertia {_inertia(inertia)}/></inertial></link>'
            f'<joint name="joint{k + 1}" type="{kind}">'
            f'<parent link="{f"link{k}" if k else "base"}"/><child link="link{k + 1}"/>'
            f'<origin xyz="{_text(place[:3, 3])}" rpy="{turn}"/>'
            f'<axis xyz="{_text(robot.axes[k])}"/><limit {bounds}/></joint>'
        )
    return "".join([*parts, "</robot>"])


def _body(row: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre and central tensor of a link, where they can be those of a body."""
    mass = float(row[0]) if row[0] > 0 else MASS
    com = row[1:4] / mass if np.isfinite(row[1:4]).all() else np.zeros(3)
    central = tensor(row) - mass * (com @ com * np.eye(3) - np.outer(com, com))
    if np.isfinite(central).all():
        size = np.linalg.eigvalsh(central)
        if size[0] > 0 and size[0] + size[1] > size[2]:
            return mass, com, central
    radius = (3 * mass / (4 * np.pi * DENSITY)) ** (1 / 3)
    return mass, com, 0.4 * mass * radius**2 * np.eye(3)


def _inertia(central: np.ndarray) -> str:
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    values = central[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    return " ".join(f'{name}="{value:.12g}"' for name, value in zip(names, values, strict=True))


def _text(values: Iterable[float]) -> str:
    return " ".join(f"{value:.12g}" for value in values)
