"""A robot that is written in another way is the same robot: findings, verdict and torques are."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dynid import ExperimentRecord, identify, load_robot, verdict
from dynid.bench import Case, recorded, urdf
from dynid.core import Array
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


def turned_frames(root: ET.Element) -> None:
    """Frames of links turned anyhow, and shifted along their axes."""
    draw, before = np.random.default_rng(3), np.eye(4)
    for joint, link in parts(root):
        turn = Rotation.from_euler("xyz", words(joint, "origin", "rpy")).as_matrix()
        axis = words(joint, "axis", "xyz")
        moved = pose(Rotation.random(rng=draw).as_matrix(), draw.uniform(-0.2, 0.2) * axis)
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


def written(case: Case, folder: Path, change: str) -> Identification:
    made = recorded(case)
    root = ET.fromstring(urdf(case.arm))
    for one in (reversed_axes, turned_frames, heavier):
        if one.__name__ in change:
            one(root)
    path = folder / "arm.urdf"
    path.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
    signs = SIGNS if "reversed_axes" in change else np.ones(made.record.joints)
    scale = SCALE if "heavier" in change else 1.0
    record, other = (later(part, signs, scale) for part in (made.record, made.validation))
    return identify(record, load_robot(path), validation=other)


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
