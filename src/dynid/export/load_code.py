"""Torques of generated code, run in a process of its own."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import JobError
from dynid.export.verification import States

_TIMEOUT_S = 120.0
C_FLAGS = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror")
_PYTHON = """
import json, runpy, sys
import numpy as np
model = runpy.run_path(sys.argv[1])
q, dq, ddq = np.array(json.load(sys.stdin))
json.dump(model["inverse_dynamics"](q, dq, ddq).tolist(), sys.stdout)
"""
_C = """
#include <stdio.h>
#include "%(header)s"

int main(void)
{
    double x[3][%(upper)s_JOINTS], torque[%(upper)s_JOINTS];
    int i, k;
    for (;;) {
        for (k = 0; k < 3; ++k)
            for (i = 0; i < %(upper)s_JOINTS; ++i)
                if (scanf("%%lf", &x[k][i]) != 1) return 0;
        %(lower)s_inverse_dynamics(x[0], x[1], x[2], torque);
        for (i = 0; i < %(upper)s_JOINTS; ++i) printf("%%.17g ", torque[i]);
        printf("\\n");
    }
}
"""


def python_torque(path: Path, states: States) -> tuple[Array, str]:
    """(N, n) torques of a generated Python file, in a fresh interpreter, and its name.

    Args:
        path: The file.
        states: Where.

    Raises:
        JobError: The file does not run.
    """
    given = json.dumps([states.q.tolist(), states.dq.tolist(), states.ddq.tolist()])
    answer = _run([sys.executable, "-I", "-c", _PYTHON, str(path)], given, "the Python file")
    name = f"Python {sys.version_info.major}.{sys.version_info.minor}, NumPy {np.__version__}"
    return np.array(json.loads(answer)), name


def c_torque(path: Path, prefix: str, states: States) -> tuple[Array | None, str]:
    """(N, n) torques of a generated header, compiled, and the compiler; None without one.

    Args:
        path: The header.
        prefix: What its names start with.
        states: Where.

    Raises:
        JobError: It does not compile without a warning, or does not run.
    """
    compiler = c_compiler()
    if compiler is None:
        return None, "no C compiler was found (cc, gcc or clang)"
    rows = np.concatenate([states.q, states.dq, states.ddq], axis=1)
    given = "\n".join(" ".join(map(repr, row)) for row in rows.tolist())
    with tempfile.TemporaryDirectory(prefix="dynid-c-") as folder:
        source, program = Path(folder) / "main.c", Path(folder) / "main"
        header = Path(folder) / "model.h"
        shutil.copyfile(path, header)
        names = {"header": header.name, "lower": prefix, "upper": prefix.upper()}
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
