"""Whether a written file gives our torques when another program loads it."""

import importlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core import Array, JobError
from dynid.export.completion import Completion
from dynid.export.model import NearestFriction
from dynid.identification import Estimate

STATES = 200
States = tuple[Array, Array, Array]
"""(N, n) each: positions, velocities, accelerations."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Verification:
    """The largest difference between a file's torques and ours."""

    max_torque_difference: float | None
    """[N.m or N]; None where no other program could load the file."""
    tolerance: float
    """What is allowed [N.m or N]."""
    loaded_with: str
    """The program, with its version; or why there was none."""
    states: int = STATES
    """Random states compared."""

    @property
    def passed(self) -> bool:
        """Whether the file was loaded and its torques are ours."""
        found = self.max_torque_difference
        return found is not None and found <= self.tolerance

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return asdict(self)


def our_torque(
    estimate: Estimate,
    completed: Completion,
    states: States,
    held: Iterable[str] | None,
    friction: NearestFriction | None,
) -> Array:
    """(N, n) torques by the model that was identified, not by anything in this package.

    Of sliding joints; beside them (N, 2 n) those along the states in order, for presliding.

    Of terms beside the inertias only those that the file has a place for are `held`,
    counterbalances left out, with the Coulomb and viscous friction of such a file; None for
    everything.
    """
    model, values = estimate.model, np.array(completed.values)
    if held is None or friction is None:
        past, known = model.friction_state(states[0]), model.known_torque(states[0])
        ways = [None] if past is None else [None, past]
        return np.hstack([model.inverse_dynamics(*states, values, way) - known for way in ways])
    kept = set(held) - {"Fc", "Fv"}
    for k, column in enumerate(model.columns[10 * model.robot.joints :]):
        if column.name.rstrip("0123456789") not in kept:
            values[10 * model.robot.joints + k] = 0.0
    torque = model.inverse_dynamics(*states, values)
    return torque + friction.torque(states[1])


_TIMEOUT_S = 120.0
C_FLAGS = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror")
_PYTHON = """
import json, runpy, sys
import numpy as np
model = runpy.run_path(sys.argv[1])
q, dq, ddq = np.array(json.load(sys.stdin))
torque = model["inverse_dynamics"](q, dq, ddq)
if step := model.get("presliding_step"):
    states = [None]
    for k in range(len(q)):
        states.append(step(states[-1], q[k], *q[k + 1 : k + 2]))
    past = np.array(states[1:])
    torque = np.hstack([torque, model["inverse_dynamics"](q, dq, ddq, past)])
json.dump(torque.tolist(), sys.stdout)
"""
_C = """
#include <stdio.h>
#include "%(header)s"

int main(void)
{
    double x[4][%(upper)s_JOINTS], torque[%(upper)s_JOINTS];
    int i, k;
    for (;;) {
        for (k = 0; k < 4; ++k)
            for (i = 0; i < %(upper)s_JOINTS; ++i)
                if (scanf("%%lf", &x[k][i]) != 1) return 0;
        %(lower)s_inverse_dynamics(x[0], x[1], x[2], torque);
        for (i = 0; i < %(upper)s_JOINTS; ++i) printf("%%.17g ", torque[i]);
%(motion)s        printf("\\n");
    }
}
"""
_C_MOTION = """
        static %(lower)s_presliding past;
        %(lower)s_presliding_step(&past, x[0], x[3]);
        %(lower)s_presliding_inverse_dynamics(&past, x[0], x[1], x[2], torque);
        for (i = 0; i < %(upper)s_JOINTS; ++i) printf("%%.17g ", torque[i]);
"""


def python_torque(path: Path, states: States) -> tuple[Array, str]:
    """Torques of a generated Python file, as `our_torque`, in a fresh interpreter, and its name.

    Raises:
        JobError: The file does not run.
    """
    given = json.dumps([values.tolist() for values in states])
    answer = _run([sys.executable, "-I", "-c", _PYTHON, str(path)], given, "the Python file")
    name = f"Python {sys.version_info.major}.{sys.version_info.minor}, NumPy {np.__version__}"
    return np.array(json.loads(answer)), name


def c_torque(path: Path, prefix: str, states: States) -> tuple[Array | None, str]:
    """Torques of a generated header, as `our_torque`, compiled, and the compiler; None without one.

    `prefix` is what its names start with.

    Raises:
        JobError: It does not compile without a warning, or does not run.
    """
    compiler = c_compiler()
    if compiler is None:
        return None, "no C compiler was found (cc, gcc or clang)"
    q = states[0]
    # The last of a motion goes on as it came.
    rows = np.hstack([*states, np.vstack([q[1:], 2 * q[-1:] - q[-2:][:1]])])
    given = "\n".join(" ".join(map(repr, row)) for row in rows.tolist())
    with tempfile.TemporaryDirectory(prefix="dynid-c-") as folder:
        source, program = Path(folder) / "main.c", Path(folder) / "main"
        header = Path(folder) / "model.h"
        shutil.copyfile(path, header)
        names = {"header": header.name, "lower": prefix, "upper": prefix.upper()}
        known = f"{prefix}_presliding_step" in header.read_text(encoding="utf-8")
        names["motion"] = _C_MOTION % names if known else ""
        source.write_text(_C % names, encoding="utf-8")
        command = [compiler, *C_FLAGS, str(source), "-o", str(program), "-lm"]
        _run(command, "", f"{Path(compiler).name} on the header")
        answer = _run([str(program)], given, "the compiled header")
    return np.array([row.split() for row in answer.splitlines()], dtype=np.float64), compiler


def c_compiler() -> str | None:
    """The path of a C compiler, or None."""
    wanted = [os.environ.get("CC", ""), "cc", "gcc", "clang"]
    return next((found for name in wanted if name and (found := shutil.which(name))), None)


def _run(command: list[str], given: str, what: str) -> str:
    try:
        done = subprocess.run(
            command, input=given, capture_output=True, text=True, timeout=_TIMEOUT_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise JobError(f"{what} did not run", value=str(error)) from error
    if done.returncode != 0:
        raise JobError(f"{what} failed", value=done.stderr.strip()[-500:])
    return done.stdout


def urdf_torque(
    path: Path,
    states: States,
    gravity: Array,
    joints: Sequence[str],
    frozen: Mapping[str, float] | None = None,
) -> tuple[Array | None, str]:
    """(N, n) torques of a URDF file by pinocchio, and its name; None if it is not installed.

    Args:
        path: The file.
        states: Of the joints.
        gravity: (3) in the frame of the file's root [m/s^2], which URDF does not hold.
        joints: n names.
        frozen: Where other joints stand, zero for those left out [rad or m].

    Raises:
        JobError: Pinocchio cannot read the file.
    """
    try:
        pin: Any = importlib.import_module("pinocchio")
    except ImportError:
        return None, "pinocchio is not installed (pip install pin)"
    try:
        model = pin.buildModelFromUrdf(str(path))
    except (ValueError, RuntimeError) as error:
        raise JobError("pinocchio cannot read the file", where=str(path), value=error) from error
    model.gravity.linear = gravity
    data, base = model.createData(), pin.neutral(model)
    for name, value in (frozen or {}).items():
        _place(model, base, name, value)
    at = [model.idx_vs[model.getJointId(name)] for name in joints]
    torque = np.empty(states[0].shape)
    for k, (q, dq, ddq) in enumerate(zip(*states, strict=True)):
        pose, speed, acceleration = base.copy(), np.zeros(model.nv), np.zeros(model.nv)
        for name, value in zip(joints, q, strict=True):
            _place(model, pose, name, value)
        speed[at], acceleration[at] = dq, ddq
        torque[k] = pin.rnea(model, data, pose, speed, acceleration)[at]
    rubbing = model.damping[at] * states[1] + model.friction[at] * np.sign(states[1])
    return torque + rubbing, f"pinocchio {pin.__version__}"


def _place(model: Any, pose: Array, name: str, value: float) -> None:
    """Put a joint where it shall stand; endless turns are a cosine and a sine to pinocchio."""
    joint = model.getJointId(name)
    if joint < model.njoints and model.nvs[joint] == 1:
        first, size = model.idx_qs[joint], model.nqs[joint]
        pose[first : first + size] = value if size == 1 else (np.cos(value), np.sin(value))


def mjcf_torque(path: Path, states: States) -> tuple[Array | None, str]:
    """(N, n) torques of an MJCF file by MuJoCo, and its name; None if it is not installed.

    MuJoCo softens dry friction into a constraint; here the loss it read acts against the speed.

    Raises:
        JobError: MuJoCo cannot read the file.
    """
    try:
        mujoco: Any = importlib.import_module("mujoco")
    except ImportError:
        return None, "MuJoCo is not installed (pip install 'dynid[sim]')"
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise JobError("MuJoCo cannot read the file", where=str(path), value=error) from error
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(model)
    torque = np.empty(states[0].shape)
    for k, (q, dq, ddq) in enumerate(zip(*states, strict=True)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
        mujoco.mj_inverse(model, data)
        torque[k] = data.qfrc_inverse
    torque += model.dof_frictionloss * np.sign(states[1])
    return torque, f"MuJoCo {mujoco.__version__}"
