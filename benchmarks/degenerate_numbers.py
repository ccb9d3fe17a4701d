"""Recordings and robots of degenerate numbers: every command must end in one line or a result.

    python benchmarks/degenerate_numbers.py [NAME...]

Prints the exit code and the line for each; exits 1 where one is a traceback, a warning of Python's,
several lines, or called a bug in dynid.
"""

import contextlib
import io
import tempfile
import time
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from shared.measuring import run

from dynid.cli.app import main as dynid

ROWS, RATE_HZ = 1500, 125.0
RNG = np.random.default_rng(0)


def motion(joints: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(N) times, (N, n) positions and torques of a sound recording."""
    t = np.arange(ROWS) / RATE_HZ
    j = np.arange(joints)
    q = sum(np.sin(k * 2 * np.pi * 0.1 * t[:, None] + k * j) / k for k in (1, 2, 3))
    tau = 10 * np.cos(q) + 3 * np.tanh(50 * np.gradient(q, axis=0)) + RNG.normal(size=q.shape)
    return t, 0.5 * q, tau


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
        """How many."""
        return max(self.robot.count("<joint"), 6 if self.robot == "ur5" else 0)

    def write(self, path: Path) -> None:
        """A text file."""
        t, q, tau = motion(self.joints)
        scaled = slice(None) if self.joint is None else self.joint
        q[:, scaled] *= self.q
        tau[:, scaled] *= self.tau
        if self.half_nan:
            q[::2] = np.nan
        names = ["t", *(f"{kind}{j}" for kind in ("q", "tau") for j in range(self.joints))]
        rows = np.column_stack([t * self.t, q, tau])
        np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="")


CASES = {
    "sound": Case(),
    "torques all zero": Case(tau=0.0),
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
    "one joint": Case(urdf(1)),
    "one joint, dead": Case(urdf(1), tau=0.0),
    "thirty joints": Case(urdf(30)),
    "massless": Case(urdf(6, mass=0.0)),
    "mass 1e200": Case(urdf(6, mass=1e200)),
    "links 1e100 long": Case(urdf(6, length=1e100)),
    "links without length": Case(urdf(6, length=0.0)),
    "all axes parallel": Case(urdf(6, axis="0 0 1")),
}


def said(*words: str | Path) -> tuple[int, str, float]:
    """The exit code of a command, what it said on stderr, and its CPU time [s]."""
    out, err, begun = io.StringIO(), io.StringIO(), time.process_time()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = dynid([str(word) for word in words])
    return code, err.getvalue().strip(), time.process_time() - begun


def main(names: tuple[str, ...] = tuple(CASES), /) -> bool:
    """Print a line a case and command."""
    warnings.simplefilter("error")
    bad = count = 0

    def tell(name: str, command: str, *words: str | Path) -> int:
        nonlocal bad, count
        code, text, seconds = said(command, *words)
        lines = [line for line in text.splitlines() if line.startswith("dynid:")]
        wrong = "bug in dynid" in text or "Traceback" in text or "Warning" in text
        wrong |= code not in (0, 1, 2) or (code == 2 and len(lines) != 1)
        bad, count = bad + wrong, count + 1
        last = text.splitlines()[-1] if text else ""
        mark = "BAD" if wrong else "ok "
        print(f"{mark} {name:22} {command:8} {code} {seconds:5.1f} s  {last[:170]}", flush=True)
        return code

    for name in names:
        case = CASES[name]
        with tempfile.TemporaryDirectory() as place:
            folder, arm = Path(place), case.robot
            case.write(folder / "x.csv")
            if arm.startswith("<"):
                arm = str(folder / "arm.urdf")
                Path(arm).write_text(case.robot)
            own = folder / "x.parquet"
            if not tell(name, "import", folder / "x.csv", "--robot", arm, "-o", own):
                tell(name, "identify", own, "--preset", "paper", "-o", folder / "x.json")
            if arm != case.robot and name != "one joint, dead":
                tell(name, "analyze", arm)
                if case.joints < 10:
                    words = ["--population", "4", "--generations", "1", "--harmonics", "2"]
                    tell(name, "design", arm, "-o", folder / "d.json", "--method", "ga", *words)
    print(f"{bad} of {count} commands answered badly")
    return bad > 0


if __name__ == "__main__":
    run(main)
