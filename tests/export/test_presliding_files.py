"""Presliding friction in generated files: along a motion they are the estimate with its state."""

import ctypes
import runpy
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from known_exports import (
    WIDE_TERMS,
    States,
    estimate_of,
    heavy_arm,
    mixed_chain,
    parameters_of,
    with_load,
    with_ripple,
)

from dynid.cli.app import main
from dynid.core import Array, JobError
from dynid.export import ExportModel, write_model, writing
from dynid.export.verification import C_FLAGS, c_compiler, c_torque
from dynid.identification import Estimate, write_estimate
from dynid.regressor import FrictionTerms, InverseDynamicModel, friction_state
from dynid.robot import RobotModel, load_robot

# The asked agreement of torques [N.m or N], for torques up to a few hundred; of states [-].
EXACT, SAME = 1e-9, 1e-12
STROKE = 0.3
"""Displacement where motions are drawn from -1 to 1 [rad]."""
needs_compiler = pytest.mark.skipif(c_compiler() is None, reason="no C compiler")


def with_presliding(terms: FrictionTerms, joints: int, over: float = 1e-3) -> FrictionTerms:
    """On all joints but the first, each over another displacement."""
    return replace(terms, presliding=(0.0, *(over * (1 + j) for j in range(1, joints))))


def estimate_called(name: str) -> Estimate:
    robot: RobotModel
    terms: FrictionTerms
    match name:
        case "fs":
            robot, speeds = load_robot("ur5"), (0.8, 1.0, 1.2, 0.9, 1.1, 0.7)
            terms = replace(WIDE_TERMS, stribeck_velocity=speeds)
        case "sliding, load":
            robot = mixed_chain()
            terms = with_load(WIDE_TERMS, robot.joints)
        case _:
            robot = heavy_arm()
            terms = with_ripple(with_load(WIDE_TERMS, robot.joints), robot.joints)
    terms = with_presliding(terms, robot.joints)
    return estimate_of(robot, parameters_of(robot, 3, terms), terms)


ESTIMATES = ("fs", "sliding, load", "coupled motors, load, ripple")


def recorded(joints: int) -> States:
    """2.4 s at 125 Hz with a rest and reversals; the positions with the noise of an encoder."""
    t = np.arange(300)[:, None] / 125.0
    turn, phase = np.linspace(2.0, 5.0, joints), np.arange(joints)
    moving = np.where((t > 1.5) & (t < 2.0), 0.0, 1.0)
    q = 0.2 * np.sin(turn * np.where(moving > 0, t, 1.5) + phase)
    noise = np.random.default_rng(0).normal(scale=2e-5, size=q.shape)
    dq = moving * 0.2 * turn * np.cos(turn * t + phase)
    return States(q + noise, dq, -moving * 0.2 * turn**2 * np.sin(turn * t + phase))


def predicted(estimate: Estimate, motion: States) -> tuple[Array, Array]:
    """(N, n) torques of sliding joints, and along the motion."""
    state = estimate.model.friction_state(motion.q)
    return estimate.predict(*motion), estimate.predict(*motion, state)


@pytest.mark.parametrize("name", [pytest.param("fs", marks=pytest.mark.long), *ESTIMATES[1:]])
def test_python_stepped_along_a_motion_is_the_estimate(name: str, tmp_path: Path) -> None:
    estimate = estimate_called(name)
    motion = recorded(estimate.model.robot.joints)
    sliding, along = predicted(estimate, motion)
    assert np.abs(along - sliding).max() > 0.5
    write_model(estimate, tmp_path / "arm.py", "python")
    arm = runpy.run_path(str(tmp_path / "arm.py"))
    state, states, torque = None, [], []
    for k, now in enumerate(zip(*motion, strict=True)):
        state = arm["presliding_step"](state, now[0].tolist(), *motion.q[k + 1 : k + 2])
        states.append(state)
        torque.append(arm["inverse_dynamics"](*now, state))
    np.testing.assert_allclose(torque, along, rtol=0, atol=EXACT)
    # Of all samples at once, and without a state as before.
    at_once = arm["inverse_dynamics"](*motion, np.array(states))
    np.testing.assert_allclose(at_once, along, rtol=0, atol=EXACT)
    np.testing.assert_allclose(arm["inverse_dynamics"](*motion), sliding, rtol=0, atol=EXACT)


@needs_compiler
@pytest.mark.parametrize("name", ESTIMATES)
def test_c_stepped_along_a_motion_is_the_estimate(name: str, tmp_path: Path) -> None:
    estimate = estimate_called(name)
    motion = recorded(estimate.model.robot.joints)
    done = write_model(estimate, tmp_path / "arm.h", "c")
    prefix = "mixed_chain_co_4" if name.startswith("sliding") else "ur5"
    torque, _ = c_torque(done.path, prefix, motion)
    assert torque is not None
    expected = np.hstack(predicted(estimate, motion))
    np.testing.assert_allclose(torque, expected, rtol=0, atol=EXACT)
    if compiler := shutil.which("g++"):
        (tmp_path / "main.cpp").write_text('#include "arm.h"\n')
        flags = ("-std=c++11", "-fsyntax-only", *C_FLAGS[1:])
        subprocess.run([compiler, *flags, str(tmp_path / "main.cpp")], check=True)


Step = Callable[[Any, Array, Array | None], tuple[Any, Array]]
"""From a state or None, positions now and next: the state, and the shares of friction in it."""


def wide_strokes() -> InverseDynamicModel:
    robot = heavy_arm()
    return InverseDynamicModel(robot=robot, friction=with_presliding(WIDE_TERMS, 6, STROKE / 2))


@pytest.fixture(scope="module", params=["python", pytest.param("c", marks=needs_compiler)])
def step(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Step:
    folder, terms = tmp_path_factory.mktemp("step"), wide_strokes().friction
    estimate = estimate_of(heavy_arm(), parameters_of(heavy_arm(), 3, terms), terms)
    done = write_model(estimate, folder / "arm", request.param)
    if request.param == "python":
        function = runpy.run_path(str(done.path))["presliding_step"]

        def in_python(
            state: Array | None, q: Array, following: Array | None
        ) -> tuple[Array, Array]:
            after = function(state, q, following)
            return after, after[0]

        return in_python
    source, library = folder / "step.c", folder / "step.so"
    call = "void step(void *p, double *q, double *next) { ur5_presliding_step(p, q, next); }"
    source.write_text(f'#include "arm"\n{call}\n')
    compiler = c_compiler() or "cc"
    command = [compiler, *C_FLAGS, "-shared", "-fPIC", str(source), "-o", str(library), "-lm"]
    subprocess.run(command, check=True)
    function = ctypes.CDLL(str(library)).step
    turned, pointer = 7, ctypes.POINTER(ctypes.c_double)

    def in_c(state: Array | None, q: Array, following: Array | None) -> tuple[Array, Array]:
        # Three lists of doubles and an int: with room for it.
        after = np.zeros(3 * turned + 1) if state is None else state.copy()
        given = [None if x is None else x.ctypes.data_as(pointer) for x in (after, q, following)]
        function(*given)
        return after, after[:turned]

    return in_c


positions = arrays(
    np.float64, st.tuples(st.integers(1, 25), st.just(6)), elements=st.floats(-1.0, 1.0)
)


@settings(max_examples=100)
@given(q=positions, pause=st.integers(1, 3))
def test_states_are_those_of_the_library(step: Step, q: Array, pause: int) -> None:
    """Along the whole motion, and at every sample as if it were the last."""
    model = wide_strokes()
    q = np.repeat(q, pause, axis=0)
    expected = model.friction_state(q)
    assert expected is not None
    has = ~np.isnan(expected[:, 0])
    over = np.array(model.friction.presliding)[1:]
    state, ends, along = None, [], []
    for k, now in enumerate(q):
        ends.append(step(state, now, None)[1])
        state, shares = step(state, now, q[k + 1] if k + 1 < len(q) else None)
        along.append(shares)
        last = friction_state(q[: k + 1, 1:].T, over)[:, -1]
        np.testing.assert_allclose(ends[k][1:6], last, rtol=0, atol=SAME)
    np.testing.assert_allclose(np.array(along).T[has], expected[has], rtol=0, atol=SAME)


def test_files_say_how_it_is_called_and_others_do_not_have_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    estimate = estimate_called("fs")
    plain = replace(estimate, model=replace(
        estimate.model, friction=replace(estimate.model.friction, presliding=())))  # fmt: skip
    for to, word in (("c", "ur5_presliding_step("), ("python", "presliding_step("),
                     ("json", '"presliding"')):  # fmt: skip
        text = write_model(estimate, tmp_path / to, to).path.read_text()
        assert word in text
        assert "needs the past" not in text
        assert "presliding" not in write_model(plain, tmp_path / to, to).path.read_text()
    for to in ("urdf", "mjcf"):
        done = write_model(estimate, tmp_path / to, to)
        (told,) = (item for item in done.warnings if item.kind == "extrapolated")
        assert "after reversals comes on top" in told.text
        text = done.path.read_text()
        assert "Its presliding needs the past" in text
    # "Sliding joints" would be those that the torques before are of, in N where sliding.
    write_estimate(estimate, tmp_path / "arm.json")
    out = ["-o", str(tmp_path / "arm.xml")]
    assert main(["export", str(tmp_path / "arm.json"), "--to", "mjcf", *out]) == 0
    assert "That is without presliding: friction" in capsys.readouterr().out


@pytest.mark.parametrize("to", ["json", "c", "python"])
def test_another_displacement_leaves_no_file(
    to: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kind = writing._FORMATS[to]

    def longer(model: ExportModel) -> ExportModel:
        assert model.presliding is not None
        return replace(model, presliding=model.presliding * (1 + 1e-6))

    text = partial(lambda model, note: kind.text(longer(model), note))
    monkeypatch.setitem(writing._FORMATS, to, replace(kind, text=text))
    with pytest.raises(JobError, match="torques differ"):
        write_model(estimate_called("fs"), tmp_path / "arm", to)
    assert list(tmp_path.iterdir()) == []
