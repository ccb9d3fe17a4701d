"""Recordings and robots of degenerate numbers: every command ends in one line or a result."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from cli_runs import Run

ROWS, RATE_HZ = 1500, 125.0


def urdf(joints: int, mass: float = 1.0, length: float = 0.2, axis: str = "") -> str:
    """A chain of links, whose axes turn by turns unless one is given."""
    text = '<robot name="chain"><link name="l0"/>'
    for k in range(joints):
        along = axis or ("0 0 1" if k % 2 == 0 else "0 1 0")
        inertia = " ".join(f'{name}="{mass / 99}"' for name in ("ixx", "iyy", "izz"))
        text += (
            f'<link name="l{k + 1}"><inertial><mass value="{mass}"/>'
            f'<origin xyz="0 0 {length / 2}"/><inertia {inertia} ixy="0" ixz="0" iyz="0"/>'
            f'</inertial></link><joint name="j{k}" type="revolute"><parent link="l{k}"/>'
            f'<child link="l{k + 1}"/><axis xyz="{along}"/><origin xyz="0 0 {length}"/>'
            '<limit lower="-3" upper="3" velocity="3" effort="100"/></joint>'
        )
    return text + "</robot>"


@dataclass(frozen=True)
class Case:
    """A sound recording of a robot, and factors on it."""

    robot: str = "ur5"
    """A name, or the text of a URDF."""
    q: float = 1.0
    tau: float = 1.0
    joint: int | None = None
    """Whose positions and torques are scaled; None for all."""
    t: float = 1.0
    half_nan: bool = False

    @property
    def joints(self) -> int:
        return max(self.robot.count("<joint"), 6 if self.robot == "ur5" else 0)

    def write(self, path: Path) -> None:
        t, j = np.arange(ROWS) / RATE_HZ, np.arange(self.joints)
        q = sum(np.sin(k * 2 * np.pi * 0.1 * t[:, None] + k * j) / k for k in (1, 2, 3))
        noise = np.random.default_rng(0).normal(size=q.shape)
        tau = 10 * np.cos(q) + 3 * np.tanh(50 * np.gradient(q, axis=0)) + noise
        scaled = slice(None) if self.joint is None else self.joint
        q[:, scaled] *= 0.5 * self.q
        tau[:, scaled] *= self.tau
        if self.half_nan:
            q[::2] = np.nan
        names = ["t", *(f"{kind}{j}" for kind in ("q", "tau") for j in range(self.joints))]
        rows = np.column_stack([t * self.t, q, tau])
        np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="")


CASES = {
    "torques all zero": Case(tau=0.0),
    "one joint": Case(urdf(1)),
    "sound": Case(),
    "positions all zero": Case(q=0.0),
    "all zero": Case(q=0.0, tau=0.0),
    "torques 1e200": Case(tau=1e200),
    "torques 1e-200": Case(tau=1e-200),
    "positions 1e100": Case(q=1e100),
    "positions 1e-200": Case(q=1e-200),
    "everything 1e-200": Case(q=1e-200, tau=1e-200),
    "joint 3 still": Case(q=0.0, joint=2),
    "torque 3 dead": Case(tau=0.0, joint=2),
    "torque 3 1e200": Case(tau=1e200, joint=2),
    "joint 3 1e-9": Case(q=1e-9, joint=2),
    "time 1e-200": Case(t=1e-200),
    "positions half NaN": Case(half_nan=True),
    "one joint, dead": Case(urdf(1), tau=0.0),
    "thirty joints": Case(urdf(30)),
    "massless": Case(urdf(6, mass=0.0)),
    "mass 1e200": Case(urdf(6, mass=1e200)),
    "links 1e100 long": Case(urdf(6, length=1e100)),
    "links without length": Case(urdf(6, length=0.0)),
    "all axes parallel": Case(urdf(6, axis="0 0 1")),
}
QUICK = 2
"""How many of them every commit runs."""


@pytest.mark.parametrize(
    "name",
    [pytest.param(x, marks=pytest.mark.long if k >= QUICK else ()) for k, x in enumerate(CASES)],
)
def test_every_command_answers_in_one_line(run: Run, tmp_path: Path, name: str) -> None:
    case = CASES[name]
    arm, log, own = case.robot, tmp_path / "x.csv", tmp_path / "x.parquet"
    case.write(log)
    if arm.startswith("<"):
        arm = str(tmp_path / "arm.urdf")
        Path(arm).write_text(case.robot)

    def code(*words: str | Path) -> int:
        told = run(*words)
        lines = [line for line in told.err.splitlines() if line.startswith("dynid:")]
        assert not re.search("bug in dynid|Traceback|Warning", told.err)
        assert told.code in (0, 1) or (told.code == 2 and len(lines) == 1)
        return told.code

    if code("import", log, "--robot", arm, "-o", own) == 0:
        code("identify", own, "--preset", "paper", "-o", tmp_path / "x.json")
    if arm != case.robot:
        code("analyze", arm)
    if arm != case.robot and case.joints < 10:
        few = ("--population", "4", "--generations", "1", "--harmonics", "2")
        code("design", arm, "-o", tmp_path / "d.json", "--method", "ga", *few)
