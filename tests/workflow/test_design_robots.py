"""Designs for arms of all kinds, with everything on and little effort: all must be certified."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from designed_arm import written_arm

import dynid
from dynid.constraints import certify, safe_constraints

EXAMPLES = Path(__file__).parents[2] / "examples" / "robots"
SLIDING = """
name = "gantry"
joint_names = ["rail", "swing", "reach"]
[[joint]]
name = "rail"
type = "prismatic"
axis = [1.0, 0.0, 0.0]
[[joint]]
name = "swing"
type = "revolute"
xyz = [0.0, 0.0, 0.5]
axis = [0.0, 1.0, 0.0]
[[joint]]
name = "reach"
type = "prismatic"
xyz = [0.0, 0.0, 0.2]
axis = [0.0, 0.0, 1.0]
[limits]
lower = [-1.0, -2.0, 0.0]
upper = [1.0, 2.0, 0.4]
velocity = [1.0, 2.0, 0.5]
acceleration = [4.0, 8.0, 3.0]
torque = [400.0, 150.0, 150.0]
[inertia]
frames = "urdf"
mass = [8.0, 5.0, 2.0]
com = [[0.0, 0.0, 0.1], [0.0, 0.0, 0.1], [0.0, 0.0, 0.1]]
"""


def certified(robot: dynid.RobotModel, **settings: object) -> dynid.ExcitationDesign:
    asked = dynid.DesignSettings(**{"starts": 1, **settings})  # type: ignore[arg-type]
    found = dynid.design(robot, asked)
    # Arms without bodies are unjudged in what their bodies could meet, and hold all the rest.
    assert found.certificate.holds
    assert np.isfinite(found.condition_number)
    # A judge of its own, at samples of its own.
    judge = safe_constraints(robot)
    t = np.linspace(0.0, found.trajectory.duration, 5003)
    motion = found.trajectory.evaluate(t)
    lower, upper = judge.settings.bounds.lower, judge.settings.bounds.upper
    assert (motion.q >= lower).all()
    assert (motion.q <= upper).all()
    assert (np.abs(motion.dq) <= judge.settings.bounds.velocity).all()
    assert (np.abs(motion.ddq) <= judge.settings.bounds.acceleration).all()
    np.testing.assert_allclose(motion.dq[[0, -1]], 0.0, atol=1e-9)
    np.testing.assert_allclose(motion.ddq[[0, -1]], 0.0, atol=1e-8)
    return found


def gantry(folder: Path) -> dynid.RobotModel:
    path = folder / "gantry.toml"
    path.write_text(SLIDING, encoding="utf-8")
    return dynid.load_robot(path)


def test_panda() -> None:
    found = certified(dynid.load_robot(EXAMPLES / "panda.toml"))
    assert found.trajectory.evaluate([0.0]).q.shape == (1, 7)


def test_sliding_joints(tmp_path: Path) -> None:
    certified(gantry(tmp_path), harmonics=3, period_s=8.0)


@pytest.mark.parametrize("mount", ["wall", "ceiling", "tilt:30"])
def test_mountings(tmp_path: Path, mount: str) -> None:
    robot = dynid.load_robot(written_arm(tmp_path), mount=mount)
    found = certified(robot, harmonics=3, period_s=6.0)
    assert found.mount == mount


@pytest.mark.parametrize(
    ("period", "harmonics"),
    [
        (5.0, 3),
        *(pytest.param(*few, marks=pytest.mark.long) for few in ((20.0, 8), (60.0, 15), (5.0, 15))),
    ],
)
def test_periods_and_harmonics(tmp_path: Path, period: float, harmonics: int) -> None:
    robot = dynid.load_robot(written_arm(tmp_path))
    found = certified(robot, harmonics=harmonics, period_s=period, rate_hz=100.0)
    assert found.trajectory.duration == period
    assert found.samples == round(100.0 * period)


@pytest.mark.parametrize(
    "name",
    [
        "prediction",
        "d-opt",
        *(
            pytest.param(name, marks=pytest.mark.long)
            for name in ("cond", "a-opt", "e-opt", "cond+sigma")
        ),
    ],
)
def test_a_builtin_criterion_gets_better_than_its_start(tmp_path: Path, name: str) -> None:
    found = certified(
        dynid.load_robot(written_arm(tmp_path)), harmonics=3, period_s=6.0, criterion=name
    )
    assert found.history[-1].feasible
    assert found.history[-1].value < found.history[0].value


def test_an_interrupted_search_returns_a_certified_design(tmp_path: Path) -> None:
    told: list[float] = []

    def tell(words: str, share: float) -> None:
        told.append(share)
        if len(told) == 3:
            raise KeyboardInterrupt

    robot = dynid.load_robot(written_arm(tmp_path, whole=True))
    settings = dynid.DesignSettings(harmonics=3, period_s=6.0, starts=9)
    found = dynid.design(robot, settings, output=tmp_path / "d.json", progress=tell)
    assert found.interrupted
    assert found.certificate.feasible
    assert certify(found.trajectory, safe_constraints(robot, clearance=0.01)).feasible
    stored = dynid.read_design(tmp_path / "d.json", robot=tmp_path / "small.toml")
    assert stored.facts["ended_by"] == "interrupt"
