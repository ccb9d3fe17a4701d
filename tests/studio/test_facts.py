from __future__ import annotations

import base64
import json
import math

import numpy as np
import pytest

from dynid.constraints import Worst, safe_constraints
from dynid.core import InputError, printable
from dynid.recording import ExperimentRecord, RecordMetadata
from dynid.robot import joint_poses, load_robot
from dynid.studio import facts
from dynid.studio.scene_editing import SceneEditor, instant
from dynid.studio.session import file_in
from dynid.studio.solids import arm_skins

SINGLE = 2e-7
"""Rounding of single precision, relative."""


def numbers(text: str, columns: int) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype="<f4").reshape(-1, columns)


@pytest.mark.parametrize(
    "name", ["a" * 10_000, "\u202egpj.exe", "\x00\x1b[31m", "a\nb", "\udcff", "名前 🤖"]
)
def test_any_name_is_one_printable_line(name: str) -> None:
    shown = printable(name)
    assert len(shown) <= 60
    assert shown.isprintable()
    shown.encode("utf-8")


def test_a_robot_is_told_as_it_moves() -> None:
    robot = load_robot("ur5")
    told = facts.robot(robot, arm_skins(robot))
    json.dumps(told, allow_nan=False)
    assert told["joints"][0] == "Shoulder pan"
    q = np.random.default_rng(0).normal(size=6)
    pose = np.eye(4)
    for k in range(6):
        x, y, z = told["axes"][k]
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        turn = np.eye(4)
        turn[:3, :3] += np.sin(q[k]) * cross + (1 - np.cos(q[k])) * cross @ cross
        pose = pose @ np.reshape(told["placements"][k], (4, 4)) @ turn
    np.testing.assert_allclose(pose, joint_poses(robot, q)[-1], rtol=0, atol=1e-12)


def test_margins_read_the_same_way() -> None:
    worst = {
        "torque": Worst(margin=0.2, what="elbow_joint", value=-8.0, limit=10.0, required=0.05),
        # Sampled at 9.4, and never above 9.5 between samples.
        "velocity": Worst(margin=0.05, value=9.4, limit=10.0, required=0.05),
        "power": Worst(margin=-0.5, value=15.0, limit=10.0, required=0.05),
        "momentum": Worst(margin=math.nan),
        "self_collision": Worst(
            margin=0.02, value=0.021, limit=0.01, required=0.01, distance=True, what="a - b"
        ),
        "environment": Worst(margin=-0.001, value=-0.001, limit=0.01, required=0.01, distance=True),
    }
    rows = {row["kind"]: row for row in facts.margins(worst)}
    assert "momentum" not in rows
    levels = {kind: row["level"] for kind, row in rows.items()}
    assert levels == {
        "torque": "good", "velocity": "warn", "power": "bad", "self_collision": "good",
        "environment": "bad",
    }  # fmt: skip
    assert rows["torque"]["used"] == pytest.approx(0.8)
    assert (rows["torque"]["value"], rows["torque"]["what"]) == (8.0, "elbow")
    assert rows["velocity"]["value"] == pytest.approx(9.5)
    assert rows["self_collision"]["used"] == pytest.approx(0.5)
    assert (rows["self_collision"]["value"], rows["self_collision"]["unit"]) == (20.0, "mm")
    assert (rows["environment"]["used"] > 1, rows["environment"]["value"]) == (True, -1.0)


def test_limits_of_sliding_joints_have_their_units() -> None:
    worst = {
        "position": Worst(margin=0.5, what="lift", value=0.1, limit=0.2),
        "velocity": Worst(margin=0.5, what="lift", value=0.1, limit=0.2),
        "torque": Worst(margin=0.5, what="elbow", value=5.0, limit=10.0),
    }
    units = [row["unit"] for row in facts.margins(worst, {"lift"})]
    assert units == ["m", "m/s", "N·m"]


def test_an_instant_of_a_robot_without_anything_known_is_json() -> None:
    constraints = safe_constraints(load_robot("ur5"))
    told = facts.instant_facts(*instant(constraints, *np.zeros((3, 6))))
    json.dumps(told, allow_nan=False)
    assert {row["kind"] for row in told["margins"]} >= {"position", "velocity", "torque"}


def test_shapes_are_told_with_their_triangles() -> None:
    editor = SceneEditor()
    for kind in ("box", "floor"):
        editor.add(kind)
    box, floor = facts.scene_shapes(editor)["shapes"]
    assert (box["kind"], floor["endless"]) == ("box", True)
    corners = numbers(box["corners"], 6)
    np.testing.assert_allclose(np.abs(corners[:, :3]), 0.1, rtol=SINGLE)
    np.testing.assert_allclose(np.linalg.norm(corners[:, 3:], axis=1), 1.0, rtol=1e-6)


def test_torques_follow_from_currents_where_gains_are_known() -> None:
    robot, t = load_robot("ur5"), np.arange(50) / 125.0
    signals = {"q": np.zeros((50, 6)), "current": np.ones((50, 6))}
    tail = facts.tail_facts(ExperimentRecord(t=t, signals=signals), robot)
    torque = numbers(tail["groups"]["Torque"], 6)
    np.testing.assert_allclose(torque[0], robot.drives.gain, rtol=SINGLE)
    own = RecordMetadata(drive_gains=(1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
    tail = facts.tail_facts(ExperimentRecord(t=t, signals=signals, metadata=own), robot)
    torque = numbers(tail["groups"]["Torque"], 6)
    np.testing.assert_allclose(torque[0], [1, 2, 3, 4, 5, 6], rtol=SINGLE)


def test_the_tail_ends_with_the_newest_sample() -> None:
    t = np.arange(12_500) / 125.0
    record = ExperimentRecord(t=t + 7.0, signals={"q": np.outer(t, np.ones(6))})
    tail = facts.tail_facts(record, load_robot("ur5"))
    shown = numbers(tail["t"], 1)
    assert 300 <= len(shown) <= 400
    assert tail["samples"] == 12_500
    assert shown[-1] == pytest.approx(t[-1])
    assert shown[0] >= shown[-1] - 10.0
    np.testing.assert_allclose(numbers(tail["q"], 6)[-1], t[-1], rtol=SINGLE)


def test_long_recordings_are_thinned_and_keep_their_end() -> None:
    t = np.arange(100_000.0)
    kept, values = facts.thinned(t, t[:, None])
    assert len(kept) <= facts.MOST_SAMPLES + 1
    assert kept[-1] == t[-1]
    np.testing.assert_array_equal(kept, values[:, 0])


@pytest.mark.parametrize(
    "name", ["", "../up.json", "/etc/x.json", "a/b.json", "a\\b.json", ".json", ".x.json",
             "a.txt", "a.json\x00", "x" * 200 + ".json", "a\n.json"],
)  # fmt: skip
def test_the_page_writes_nowhere_but_into_its_folder(name: str, tmp_path) -> None:
    with pytest.raises(InputError, match="file name"):
        file_in(tmp_path, name, ".json")


def test_a_plain_name_is_taken(tmp_path) -> None:
    assert file_in(tmp_path, "名前.json", ".json") == tmp_path / "名前.json"
