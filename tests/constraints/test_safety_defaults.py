"""Floor, tool, margins and the three verdicts: what holds unless one says otherwise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynid.constraints import (
    ConstraintSettings,
    MotionConstraints,
    certify,
    safe_constraints,
    scene_from_json,
)
from dynid.core import InputError, JsonFields
from dynid.robot import RobotModel, joint_poses, load_robot, with_tool
from dynid.trajectory import Quintic, usable_bounds

UR5 = load_robot("ur5")
HOME = np.array([0.0, -1.2, 0.9, -1.2, -1.57, 0.0])
DOWN = np.array([0.0, 0.5, 0.0, -1.2, -1.57, 0.0])
"""The forearm far below the mounting plane."""
CLOSE = 1e-6


def resting(pose: np.ndarray) -> Quintic:
    return Quintic(start=pose, goal=pose + 0.01, travel_time=5.0)


@pytest.mark.parametrize("mount", ["floor", "wall", "ceiling", "tilt:30"])
def test_nothing_passes_the_mounting_plane_unless_told(mount: str) -> None:
    robot = load_robot("ur5", mount=mount)
    held = certify(resting(DOWN), safe_constraints(robot))
    assert held.broken == ("environment",)
    assert held.worst["environment"].what.endswith(" - mounting plane")
    assert certify(resting(DOWN), safe_constraints(robot, floor="none")).broken == ()
    assert certify(resting(DOWN), safe_constraints(robot, floor=-1.2)).broken == ()
    assert certify(resting(HOME), safe_constraints(robot)).verdict == "certified"


def test_a_scene_that_has_a_floor_says_where_it_is() -> None:
    low = {"type": "floor", "height": -1.2}
    judge = safe_constraints(UR5, scene_from_json(JsonFields({"shapes": [low]})))
    assert certify(resting(DOWN), judge).broken == ()


@pytest.mark.parametrize("mount", ["wall", "ceiling", "tilt:30"])
def test_a_floor_of_the_scene_does_not_take_a_wall_away(mount: str) -> None:
    low = {"type": "floor", "height": -1.2}
    judge = safe_constraints(
        load_robot("ur5", mount=mount), scene_from_json(JsonFields({"shapes": [low]}))
    )
    held = certify(resting(DOWN), judge)
    assert held.broken == ("environment",)
    assert held.worst["environment"].what.endswith(" - mounting plane")
    assert any("not horizontal" in note for note in judge.notes)


@pytest.mark.parametrize("far", [39.4, 100.0])
def test_a_scene_of_which_nothing_is_in_reach_certifies_nothing(far: float) -> None:
    box = {"type": "box", "size": [0.3, 0.3, 0.5], "position": [0.6, 0.0, 0.4]}
    table = {"type": "table", "size": [0.6, 0.6], "position": [0.0, 0.5, -0.2]}
    assert not safe_constraints(UR5, scene_from_json(JsonFields({"shapes": [box]}))).unjudged
    many = [
        item | {key: [far * x for x in item[key]] for key in ("size", "position")}
        for item in (box, table)
    ]
    (item,) = safe_constraints(UR5, scene_from_json(JsonFields({"shapes": many}))).unjudged
    assert item.kind == "environment"
    assert "metres" in item.next_step


def test_the_plane_is_exact_and_the_margin_is_kept() -> None:
    # The tip of a straight tool points down: its height is known without any body.
    pose = np.array([[0.0, -1.0, 1.6, -0.6 - np.pi / 2, -np.pi / 2, 0.0]])
    robot = with_tool(UR5, tcp=[0.0, 0.0, 0.3])
    flange = joint_poses(robot, pose[0])[-1] @ robot.flange
    tip = float(flange[2, 3] + 0.3 * flange[2, 2])
    judge = safe_constraints(robot, floor=tip - 0.05)
    worst = judge.usage(pose, 0 * pose, 0 * pose)["environment"]
    assert worst.what == "payload tool - floor"
    # The tool's rod may be covered a little beyond its end, never short of it.
    assert 0.035 < worst.margin <= 0.05 + CLOSE
    assert not safe_constraints(robot, floor=tip - 0.009).holds(pose, 0 * pose, 0 * pose)


def test_a_robot_that_reaches_below_its_plane_must_be_told_where_the_floor_is() -> None:
    sunk = replace(UR5, placements=np.array([_lowered(UR5), *UR5.placements[1:]]))
    judge = safe_constraints(sunk)
    assert [item.kind for item in judge.unjudged] == ["environment"]
    assert "--floor" in judge.unjudged[0].next_step
    assert certify(resting(HOME), judge).verdict == "unjudged"
    assert not certify(resting(HOME), judge).feasible
    with pytest.raises(InputError, match="no room"):
        safe_constraints(sunk, floor=0.0)


def _lowered(robot: RobotModel) -> np.ndarray:
    first = np.array(robot.placements[0])
    first[2, 3] -= 5.0
    return first


def test_the_tools_point_is_what_the_speed_limit_holds() -> None:
    tcp = np.array([0.05, 0.02, 0.3])
    judge = safe_constraints(with_tool(UR5, tcp=tcp))
    q, dq = np.random.default_rng(0).uniform(-1, 1, (2, 5, 6))
    step = 1e-6

    def tip(at: np.ndarray) -> np.ndarray:
        pose = joint_poses(UR5, at)[-1] @ UR5.flange
        return pose[:3, :3] @ tcp + pose[:3, 3]

    speeds = [
        np.linalg.norm(tip(a + step * b) - tip(a - step * b)) / (2 * step)
        for a, b in zip(q, dq, strict=True)
    ]
    points, limit = judge.points["tcp_speed"]
    np.testing.assert_allclose(points.norms(q, dq), speeds, rtol=CLOSE)
    assert limit == pytest.approx(0.95 * UR5.safety.tcp_speed)


def test_five_percent_are_kept_free_and_shown() -> None:
    q = np.array([HOME])
    dq = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.96 * UR5.limits.velocity[5]]])

    def worst(margin: float) -> tuple[float, float, bool]:
        usage = safe_constraints(UR5, margin=margin).usage(q, dq, 0 * q)
        item = usage["velocity"]
        return item.margin, item.required, item.room >= 0

    share, required, holds = worst(0.05)
    assert (share, required) == (pytest.approx(0.04), 0.05)
    assert not holds
    assert worst(0.03) == (pytest.approx(0.04), 0.03, True)
    assert worst(0.0)[2]


def test_a_certificate_without_a_margin_says_that_the_controller_may_stop_the_motion() -> None:
    note = "no margin is kept: the controller may stop a motion that overshoots"
    for margin, said in ((0.0, True), (0.01, False), (None, False)):
        judge = safe_constraints(UR5) if margin is None else safe_constraints(UR5, margin=margin)
        notes = certify(resting(HOME), judge).to_json()["notes"]
        assert (note in notes) == said, (margin, notes)


@pytest.mark.parametrize("name", ["margin", "clearance", "self_clearance"])
@pytest.mark.parametrize("value", [-1e-3, 1.0, 1.5, np.nan])
def test_what_is_kept_free_is_a_share_or_less_than_a_metre(name: str, value: float) -> None:
    bounds = usable_bounds(UR5.limits)
    assert getattr(ConstraintSettings(bounds=bounds, **{name: 0.999}), name) == 0.999
    with pytest.raises(InputError, match="0 to 1"):
        ConstraintSettings(bounds=bounds, **{name: value})


def test_the_search_sees_what_the_certificate_sees() -> None:
    robot = with_tool(UR5, tcp=[0, 0, 0.2], payload=[2.0, 0, 0, 0.1])
    judge = safe_constraints(robot)
    random = np.random.default_rng(3)
    q = HOME + random.uniform(-0.4, 0.4, (200, 6))
    dq = random.uniform(-1, 1, (200, 6)) * robot.limits.velocity
    rest = np.zeros((1, 6))
    seen = {True: 0, False: 0}
    for a, b in zip(q, dq, strict=True):
        holds = judge.holds(a[None], b[None], rest)
        assert (judge.violation(a[None], b[None], rest)[0] == 0.0) == holds
        seen[holds] += 1
    assert min(seen.values()) > 5


def test_what_is_unknown_is_unjudged_and_never_feasible() -> None:
    nothing = replace(UR5.limits, torque=np.full(6, np.nan), acceleration=np.full(6, np.nan))
    judges: dict[str, MotionConstraints] = {
        "torque": safe_constraints(replace(UR5, limits=nothing)),
        "self_collision": safe_constraints(replace(UR5, bodies=())),
        "velocity": safe_constraints(
            replace(UR5, limits=replace(UR5.limits, velocity=np.full(6, np.nan)))
        ),
    }
    for kind, judge in judges.items():
        found = certify(resting(HOME), judge)
        assert (found.verdict, found.feasible, found.holds) == ("unjudged", False, True)
        document = found.to_json()
        assert kind in [item["kind"] for item in document["unjudged"]]
        assert all(item["next_step"] for item in document["unjudged"])
        assert kind in found.headline
        assert "feasible" not in found.headline
    # Torque limits bound an acceleration that has no limit of its own.
    free = replace(UR5.limits, acceleration=np.full(6, np.nan))
    assert certify(resting(HOME), safe_constraints(replace(UR5, limits=free))).feasible


def test_a_robot_file_brings_its_tool(tmp_path: Path) -> None:
    library = Path(__file__).parents[2] / "src/dynid/robot/library"
    text = (library / "ur5.toml").read_text().split("[drives]")
    tool = "[tool]\ntcp = [0.0, 0.0, 0.12]\nmass = 1.5\ncom = [0.0, 0.0, 0.05]\n\n[drives]"
    file = tmp_path / "with_tool.toml"
    file.write_text(tool.join(text))
    robot = load_robot(file)
    assert robot.tool.mass == 1.5
    assert robot.tool.tcp.tolist() == [0.0, 0.0, 0.12]
    names = safe_constraints(robot).surroundings
    assert names is not None
    assert any("payload tool" in name for name in names.pairs["environment"].names)
    with pytest.raises(InputError, match="mass"):
        with_tool(robot, payload=[-1, 0, 0, 0])
