"""What the robot files say of their capsules: how far they may overlap, which links stay apart.

The whole proof, all pairs of three arms, is `benchmarks/capsule_credits.py`.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynid.robot import load_robot

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from capsule_credits import Judge, Meshes, prove
from collision_oracle import DATA

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason="the package example-robot-data is not installed"
)
EDGE = 0.003
"""Poses with less room than this are where a credit would be wrong first [m]."""


@pytest.mark.parametrize(("name", "inner", "outer"), [("ur5", 4, 6), ("ur3", 3, 5)])
def test_links_that_are_credited_do_not_touch_where_the_judge_is_content(
    name: str, inner: int, outer: int
) -> None:
    judge = Judge(load_robot(name), inner, outer)
    verdict, least, _ = prove(Meshes(name), judge, inner, outer)
    assert verdict == "proven"
    assert least > 0


def test_a_credit_that_is_too_large_is_found_out() -> None:
    robot = load_robot("ur5")
    generous = replace(robot, overlap=tuple((a, b, by + 0.02) for a, b, by in robot.overlap))
    verdict, least, _ = prove(Meshes("ur5"), Judge(generous, 3, 5), 3, 5)
    assert verdict == "touching"
    assert least <= 0


@pytest.mark.parametrize("name", ["ur5", "ur10"])
@pytest.mark.parametrize(("inner", "outer"), [(0, 2), (3, 5), (3, 6)])
def test_meshes_keep_apart_where_the_judge_is_only_just_content(
    name: str, inner: int, outer: int
) -> None:
    judge, meshes = Judge(load_robot(name), inner, outer), Meshes(name)
    assert judge.credit > 0
    q = np.zeros((3000, 6))
    q[:, inner:outer] = np.random.default_rng(0).uniform(-np.pi, np.pi, (3000, outer - inner))
    room = judge.room(q)
    edge = q[(room >= 0) & (room < EDGE)][:40]
    assert len(edge) > 10
    assert min(meshes.distance(one, inner, outer) for one in edge) > 0
