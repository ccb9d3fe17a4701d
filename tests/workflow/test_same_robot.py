"""A robot that is written in another way is the same robot: findings, verdict and torques are."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dynid import ExperimentRecord, IdentifySettings, identify, load_robot, verdict
from dynid.bench import Case, recorded, urdf
from dynid.core import Array
from dynid.reduction import reduce_model
from dynid.regressor import InverseDynamicModel
from dynid.robot import RobotModel
from dynid.workflow import Identification

SIGNS = np.array([-1.0, 1.0, -1.0, -1.0])
SCALE = 37.0
SAME = 1e-4
"""Rounding, in what iterations and searches make of it."""
CASE = Case(
    arm="sliding",
    motion="fourier",
    rate_hz=125.0,
    duration_s=20.0,
    seed=5,
    fault="spring",
    size="large",
)
POOR = Case(arm="seven", motion="teach", rate_hz=100.0, duration_s=20.0, seed=2)
"""A motion that leaves much to the prior."""


def parts(root: ET.Element) -> list[tuple[ET.Element, ET.Element]]:
    links = {link.get("name"): link for link in root.findall("link")}
    found = [(joint, joint.find("child")) for joint in root.findall("joint")]
    return [(joint, links[child.get("link")]) for joint, child in found if child is not None]


def words(element: ET.Element, path: str, name: str) -> Array:
    found = element.find(path)
    assert found is not None
    return np.array([float(word) for word in (found.get(name) or "0 0 0").split()])


def put(element: ET.Element, path: str, name: str, values: Array) -> None:
    found = element.find(path)
    assert found is not None
    found.set(name, " ".join(repr(float(value)) for value in np.atleast_1d(values)))


def reversed_axes(root: ET.Element) -> None:
    for (joint, _), sign in zip(parts(root), SIGNS, strict=True):
        put(joint, "axis", "xyz", sign * words(joint, "axis", "xyz"))
        if sign < 0:
            lower, upper = words(joint, "limit", "lower"), words(joint, "limit", "upper")
            put(joint, "limit", "lower", -upper)
            put(joint, "limit", "upper", -lower)


def pose(rotation: Array, place: Array) -> Array:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation, place
    return out


def turned_frames(root: ET.Element, seed: int = 3, alike: bool = False) -> None:
    """Frames of links turned anyhow (or all alike), and shifted along their axes."""
    draw, before = np.random.default_rng(seed), np.eye(4)
    for joint, link in parts(root):
        turn = Rotation.from_euler("xyz", words(joint, "origin", "rpy")).as_matrix()
        axis = words(joint, "axis", "xyz")
        own = np.random.default_rng(seed) if alike else draw
        moved = pose(Rotation.random(rng=own).as_matrix(), draw.uniform(-0.2, 0.2) * axis)
        place = np.linalg.inv(before) @ pose(turn, words(joint, "origin", "xyz")) @ moved
        put(joint, "origin", "xyz", place[:3, 3])
        put(joint, "origin", "rpy", Rotation.from_matrix(place[:3, :3]).as_euler("xyz"))
        put(joint, "axis", "xyz", moved[:3, :3].T @ axis)
        centre = words(link, "inertial/origin", "xyz")
        put(link, "inertial/origin", "xyz", moved[:3, :3].T @ (centre - moved[:3, 3]))
        put(link, "inertial/origin", "rpy", Rotation.from_matrix(moved[:3, :3].T).as_euler("xyz"))
        before = moved


def heavier(root: ET.Element) -> None:
    for joint, link in parts(root):
        put(link, "inertial/mass", "value", SCALE * words(link, "inertial/mass", "value"))
        for name in ("ixx", "iyy", "izz"):
            put(link, "inertial/inertia", name, SCALE * words(link, "inertial/inertia", name))
        put(joint, "limit", "effort", SCALE * words(joint, "limit", "effort"))


def later(record: ExperimentRecord, signs: Array, scale: float) -> ExperimentRecord:
    sizes = {"q": signs, "qd": signs, "effort": signs * scale}
    signals = {name: values * sizes[name] for name, values in record.signals.items()}
    return ExperimentRecord(t=record.t + 1e6, signals=signals)


@cache
def usual(case: Case) -> Identification:
    made = recorded(case)
    return identify(made.record, made.robot, validation=made.validation)


def rewritten(arm: str, folder: Path, change: str) -> RobotModel:
    root = ET.fromstring(urdf(arm))
    for one in (reversed_axes, turned_frames, heavier):
        if one.__name__ in change:
            one(root)
    return loaded(root, folder)


def loaded(root: ET.Element, folder: Path) -> RobotModel:
    path = folder / "arm.urdf"
    path.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
    return load_robot(path)


def written(case: Case, folder: Path, change: str) -> Identification:
    made = recorded(case)
    signs = SIGNS if "reversed_axes" in change else np.ones(made.record.joints)
    scale = SCALE if "heavier" in change else 1.0
    record, other = (later(part, signs, scale) for part in (made.record, made.validation))
    robot = rewritten(case.arm, folder, change)
    return identify(record, robot, validation=other)


@pytest.mark.parametrize(
    ("case", "change"),
    [(CASE, "reversed_axes and heavier"), (CASE, "turned_frames"), (POOR, "turned_frames")],
)
def test_the_same_robot_has_the_same_faults_and_torques(
    case: Case, change: str, tmp_path: Path
) -> None:
    before, after = usual(case), written(case, tmp_path, change)
    assert before.validation is not None
    assert after.validation is not None
    assert verdict(after).level == verdict(before).level
    assert ("spring" in {finding.kind for finding in before.warnings}) == (case is CASE)
    told, again = ([(f.code, f.joints, f.severity) for f in x.warnings] for x in (before, after))
    assert again == told
    expected = before.validation.predicted
    signs = SIGNS if "reversed_axes" in change else np.ones(expected.shape[1])
    scale = SCALE if "heavier" in change else 1.0
    error = np.linalg.norm(after.validation.predicted * signs / scale - expected)
    assert error < SAME * np.linalg.norm(expected)


@pytest.mark.parametrize("estimator", ["wls", "bayes"])
def test_deviations_mean_the_same_in_any_frames(estimator: str, tmp_path: Path) -> None:
    """A variance raised alone, of base columns whose torques cancel, was one of all torques."""
    made, settings = recorded(POOR), IdentifySettings(preset="paper", estimator=estimator)
    draw = np.random.default_rng(0)
    q, dq, ddq = draw.uniform(-1.0, 1.0, (3, 40, made.robot.joints))
    torques, deviations = list[Array](), list[Array]()
    for robot in (made.robot, rewritten(POOR.arm, tmp_path, "turned_frames")):
        estimate = identify(made.record, robot, settings).estimate
        columns = estimate.model.stack(q, dq, ddq)[list(estimate.independent)]
        spread = np.tensordot(estimate.covariance, columns, axes=1)
        deviations.append(np.sqrt((columns * spread).sum(axis=0)))
        torques.append(estimate.predict(q, dq, ddq))
    np.testing.assert_allclose(deviations[1], deviations[0], rtol=SAME)
    assert np.linalg.norm(torques[1] - torques[0]) < SAME * np.linalg.norm(torques[0])


@pytest.mark.parametrize("seed", [3, 5])
def test_rank_is_the_same_in_any_frames(seed: int, tmp_path: Path) -> None:
    """Base columns that hardly differ, link after link, made of rounding a parameter."""
    root = ET.fromstring(urdf(POOR.arm))
    usual = reduce_model(InverseDynamicModel(robot=loaded(root, tmp_path)))
    turned_frames(root, seed, alike=True)
    base = reduce_model(InverseDynamicModel(robot=loaded(root, tmp_path)))
    assert base.rank == usual.rank == usual.classes.rank
    assert not base.warnings
