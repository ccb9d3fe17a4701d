"""The observers of the generated files are the library's."""

import runpy
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from known_exports import (
    EVERY_TERM,
    WIDE_TERMS,
    estimate_of,
    heavy_arm,
    mixed_chain,
    parameters_of,
    with_load,
    with_ripple,
)

from dynid.core import Array
from dynid.export import write_model
from dynid.export.verification import C_FLAGS, c_compiler
from dynid.identification import Estimate
from dynid.validation import MomentumObserver

SAME = 1e-9
PROGRAM = """
#include <stdio.h>
#include "arm.h"

int main(void)
{
    static ur5_observer observer;
    double x[19];
    int i;
    for (;;) {
        for (i = 0; i < 19; ++i)
            if (scanf("%lf", &x[i]) != 1) return 0;
        ur5_observer_step(&observer, 40.0, x[0], x + 1, x + 7, x + 13);
        for (i = 0; i < 6; ++i) printf("%.17g ", observer.residual[i]);
        printf("\\n");
    }
}
"""


def motion(joints: int) -> tuple[Array, Array, Array, Array]:
    t = np.arange(150) / 125.0
    # Each joint turns back within this time.
    turn = np.linspace(1.5, 3.0, joints)
    q, dq = np.sin(np.outer(t, turn)), turn * np.cos(np.outer(t, turn))
    return t, q, dq, np.random.default_rng(0).normal(size=q.shape)


@pytest.fixture(scope="module", params=["speed alone", "load and ripple"])
def heavy(request: pytest.FixtureRequest) -> Estimate:
    robot = heavy_arm()
    shaped = request.param == "load and ripple"
    terms = with_ripple(with_load(WIDE_TERMS, 6), 6) if shaped else EVERY_TERM
    return estimate_of(robot, parameters_of(robot, 1, terms), terms)


def check_python_observer(estimate: Estimate, folder: Path) -> None:
    t, q, dq, torque = motion(estimate.model.robot.joints)
    write_model(estimate, folder / "arm.py", "python")
    observer = runpy.run_path(str(folder / "arm.py"))["Observer"](bandwidth=40.0)
    got = [observer.step(1 / 125.0, *state) for state in zip(q, dq, torque, strict=True)]
    expected = MomentumObserver(estimate=estimate, bandwidth=40.0).residuals(t, q, dq, torque)
    np.testing.assert_allclose(got, expected, rtol=0, atol=SAME)


def test_python_observer_is_the_librarys(heavy: Estimate, tmp_path: Path) -> None:
    check_python_observer(heavy, tmp_path)


def test_python_observer_of_sliding_joints_is_the_librarys(tmp_path: Path) -> None:
    check_python_observer(estimate_of(mixed_chain(), parameters_of(mixed_chain(), 1)), tmp_path)


@pytest.mark.skipif(c_compiler() is None, reason="no C compiler")
def test_c_observer_is_the_librarys(heavy: Estimate, tmp_path: Path) -> None:
    t, q, dq, torque = motion(6)
    write_model(heavy, tmp_path / "arm.h", "c")
    (tmp_path / "main.c").write_text(PROGRAM)
    program = tmp_path / "main"
    compiler = shutil.which(c_compiler() or "cc") or "cc"
    source = str(tmp_path / "main.c")
    subprocess.run([compiler, *C_FLAGS, source, "-o", str(program), "-lm"], check=True)
    rows = np.column_stack([np.append(0.0, np.diff(t)), q, dq, torque]).tolist()
    given = "\n".join(" ".join(map(repr, row)) for row in rows)
    done = subprocess.run([str(program)], input=given, capture_output=True, text=True, check=True)
    got = np.array([line.split() for line in done.stdout.splitlines()], dtype=float)
    expected = MomentumObserver(estimate=heavy, bandwidth=40.0).residuals(t, q, dq, torque)
    np.testing.assert_allclose(got, expected, rtol=0, atol=SAME)


@pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler")
def test_the_header_is_one_of_cpp_too(heavy: Estimate, tmp_path: Path) -> None:
    plain = estimate_of(mixed_chain(), parameters_of(mixed_chain(), 1))
    for name, estimate in (("heavy", heavy), ("plain", plain)):
        write_model(estimate, tmp_path / f"{name}.h", "c")
    source = tmp_path / "main.cpp"
    source.write_text('#include "heavy.h"\n#include "plain.h"\n')
    flags = ("-std=c++11", "-fsyntax-only", *C_FLAGS[1:])
    subprocess.run(["g++", *flags, str(source)], check=True)
