"""Recordings and robots of degenerate numbers: every command must end in one line or a result.

    python benchmarks/degenerate_numbers.py [NAME...]

Prints the exit code and the line for each; exits 1 where one is a traceback, a warning of Python's,
several lines, or called a bug in dynid.
"""

from __future__ import annotations

import contextlib
import io
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

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


def signals(q: float | None = None, tau: float | None = None, joint: int | None = None):
    """A change of a sound recording: a scale, of all joints or of one; None leaves it."""

    def change(t: np.ndarray, a: np.ndarray, b: np.ndarray):
        for value, scale in ((a, q), (b, tau)):
            if scale is not None:
                value[:, slice(None) if joint is None else joint] *= scale
        return t, a, b

    return change


def stepped(t: np.ndarray, a: np.ndarray, b: np.ndarray):
    """Time that goes 1e-200 s a row."""
    return t * 1e-200, a, b


def with_nan(t: np.ndarray, a: np.ndarray, b: np.ndarray):
    a[::2] = np.nan
    return t, a, b


RECORDINGS = {
    "sound": (6, "ur5", signals()),
    "torques all zero": (6, "ur5", signals(tau=0.0)),
    "positions all zero": (6, "ur5", signals(q=0.0)),
    "all zero": (6, "ur5", signals(q=0.0, tau=0.0)),
    "torques 1e200": (6, "ur5", signals(tau=1e200)),
    "torques 1e-200": (6, "ur5", signals(tau=1e-200)),
    "positions 1e100": (6, "ur5", signals(q=1e100)),
    "positions 1e-200": (6, "ur5", signals(q=1e-200)),
    "everything 1e-200": (6, "ur5", signals(q=1e-200, tau=1e-200)),
    "joint 3 still": (6, "ur5", signals(q=0.0, joint=2)),
    "torque 3 dead": (6, "ur5", signals(tau=0.0, joint=2)),
    "torque 3 1e200": (6, "ur5", signals(tau=1e200, joint=2)),
    "joint 3 1e-9": (6, "ur5", signals(q=1e-9, joint=2)),
    "time 1e-200": (6, "ur5", stepped),
    "positions half NaN": (6, "ur5", with_nan),
    "one joint": (1, urdf(1), signals()),
    "one joint, dead": (1, urdf(1), signals(tau=0.0)),
    "thirty joints": (30, urdf(30), signals()),
    "massless": (6, urdf(6, mass=0.0), signals()),
    "mass 1e200": (6, urdf(6, mass=1e200), signals()),
    "links 1e100 long": (6, urdf(6, length=1e100), signals()),
    "links without length": (6, urdf(6, length=0.0), signals()),
    "all axes parallel": (6, urdf(6, axis="0 0 1"), signals()),
}
ROBOTS = {
    name: text
    for name, (_, text, _) in RECORDINGS.items()
    if text.startswith("<") and name != "one joint, dead"
}


def said(*words: str | Path) -> tuple[int, str, float]:
    """The exit code of a command, what it said on stderr, and its CPU time [s]."""
    out, err, begun = io.StringIO(), io.StringIO(), time.process_time()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = dynid([str(word) for word in words])
    return code, err.getvalue().strip(), time.process_time() - begun


def main(names: list[str]) -> int:
    """Print a line a case and command."""
    warnings.simplefilter("error")
    bad = count = 0

    def tell(name: str, command: str, found: tuple[int, str, float]) -> int:
        nonlocal bad, count
        code, text, seconds = found
        lines = [line for line in text.splitlines() if line.startswith("dynid:")]
        wrong = "bug in dynid" in text or "Traceback" in text or "Warning" in text
        wrong |= code not in (0, 1, 2) or (code == 2 and len(lines) != 1)
        bad, count = bad + wrong, count + 1
        last = text.splitlines()[-1] if text else ""
        mark = "BAD" if wrong else "ok "
        print(f"{mark} {name:22} {command:8} {code} {seconds:5.1f} s  {last[:170]}", flush=True)
        return code

    with tempfile.TemporaryDirectory() as place:
        for k, (name, (joints, robot, change)) in enumerate(RECORDINGS.items()):
            if names and name not in names:
                continue
            folder = Path(place) / str(k)
            folder.mkdir()
            t, q, tau = change(*motion(joints))
            header = ["t", *(f"q{j}" for j in range(joints)), *(f"tau{j}" for j in range(joints))]
            np.savetxt(folder / "x.csv", np.column_stack([t, q, tau]), delimiter=",",
                       header=",".join(header), comments="")  # fmt: skip
            arm = robot
            if robot.startswith("<"):
                arm = str(folder / "arm.urdf")
                Path(arm).write_text(robot)
            own = folder / "x.parquet"
            code = tell(name, "import", said("import", folder / "x.csv", "--robot", arm, "-o", own))
            if code == 0:
                words = ["identify", own, "--preset", "paper", "-o", folder / "x.json"]
                tell(name, "identify", said(*words))
            if name in ROBOTS:
                tell(name, "analyze", said("analyze", arm))
                words = ["design", arm, "-o", folder / "d.json", "--method", "ga"]
                words += ["--population", "4", "--generations", "1", "--harmonics", "2"]
                if joints < 10:
                    tell(name, "design", said(*words))
    print(f"{bad} of {count} commands answered badly")
    return bool(bad)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
