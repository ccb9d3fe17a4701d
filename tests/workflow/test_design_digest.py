"""What was edited since a design was certified is noticed: a digest a subject."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynid.core import InputError, JobError, write_json
from dynid.excitation import DesignOptimiser, MotionSearch, random_numbers
from dynid.experiment import ExperimentPlan, check_design
from dynid.workflow import (
    DesignSettings,
    RunSettings,
    check,
    design,
    given_limits,
    judge_of,
    read_design,
)

Document = dict[str, Any]
SCENE = {"shapes": [{"type": "box", "size": [0.2, 0.2, 0.2], "position": [0.8, 0.8, 0.1]}]}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    folder = tmp_path_factory.mktemp("digest")
    (folder / "scene.json").write_text(json.dumps(SCENE))
    settings = DesignSettings(
        method="ga", population=4, generations=1, harmonics=3, period_s=8.0,
        scene=str(folder / "scene.json"), tool=(0.0, 0.0, 0.1), payload=(1.0, 0.0, 0.0, 0.05),
    )  # fmt: skip
    design("ur5", settings, output=folder / "design.json")
    return folder, (folder / "design.json").read_text()


@pytest.fixture(scope="module")
def untouched(made: tuple[Path, str]) -> str:
    return check(made[0] / "design.json").certificate.verdict


def put(*keys: str | int, value: Any) -> Callable[[Document], None]:
    def edit(document: Document) -> None:
        at: Any = document
        for key in keys[:-1]:
            at = at[key]
        if isinstance(at, dict):
            assert at.get(keys[-1], "absent") != value
        at[keys[-1]] = value

    return edit


def drop(*keys: str) -> Callable[[Document], None]:
    def edit(document: Document) -> None:
        at: Any = document
        for key in keys[:-1]:
            at = at[key]
        del at[keys[-1]]

    return edit


def nudge(*keys: str | int, by: float = 1e-12) -> Callable[[Document], None]:
    def edit(document: Document) -> None:
        at: Any = document
        for key in keys[:-1]:
            at = at[key]
        at[keys[-1]] += by

    return edit


D, L, G = "design", ("design", "limits"), ("design", "digest")
NOTICED: dict[str, tuple[Callable[[Document], None], str]] = {
    "a coefficient": (nudge("trajectory", "a", 0, 0, by=0.01), "motion"),
    "a coefficient's last digits": (nudge("trajectory", "b", 3, 1), "motion"),
    "an offset": (nudge("trajectory", "offset", 5, by=-0.2), "motion"),
    "the period": (put("trajectory", "period", value=4.0), "motion"),
    "the scene removed": (put(*L, "scene", value=None), "scene"),
    "the scene without its key": (drop(*L, "scene"), "scene"),
    "a shape removed": (put(*L, "scene", "shapes", value=[]), "scene"),
    "a shape moved": (put(*L, "scene", "shapes", 0, "position", value=[9, 9, 9]), "scene"),
    "a shape made smaller": (put(*L, "scene", "shapes", 0, "size", value=[0.1] * 3), "scene"),
    "a shape added": (
        put(*L, "scene", "payload", value=[{"type": "sphere", "radius": 0.1, "position": [0] * 3}]),
        "scene",
    ),
    "the scene's name": (put(*L, "scene_file", value="other.json"), "scene"),
    "the floor taken away": (put(*L, "floor", value="none"), "scene"),
    "the floor lowered": (put(*L, "floor", value=-2.0), "scene"),
    "the mounting": (put(D, "mount", value="ceiling"), "robot"),
    "another robot": (put("robot", value="ur10"), "robot"),
    "a cousin of the robot": (put("robot", value="ur5e"), "robot"),
    "the tool taken away": (put(*L, "tool", value=None), "tool"),
    "the tool shortened": (put(*L, "tool", value=[0, 0, 0.02]), "tool"),
    "the payload taken away": (put(*L, "payload", value=None), "tool"),
    "the payload lightened": (put(*L, "payload", 0, value=0.2), "tool"),
    "the payload's centre": (put(*L, "payload", 3, value=0.01), "tool"),
    "the limits": (put(*L, "preset", value="paper"), "limits"),
    "collisions off": (put(*L, "collision", value=False), "limits"),
    "no margin": (put(*L, "margin_percent", value=0.0), "limits"),
    "less clearance": (put(*L, "clearance", value=0.001), "limits"),
    "a bound widened": (nudge("limits", "velocity", 0, by=1.0), "limits"),
    "a bound unknown": (put("limits", "acceleration", value=[None] * 6), "limits"),
    "feasible flipped": (lambda d: d[D].update(feasible=not d[D]["feasible"]), "statements"),
    "the verdict": (put(D, "certificate", value="sure"), "statements"),
    "a margin": (put(D, "margins", "torque", value=0.9), "statements"),
    "a note removed": (put(D, "notes", value=[]), "statements"),
    "the condition number": (put(D, "condition_number", value=1.0), "statements"),
    "the seed": (put("provenance", "seed", value=99), "statements"),
    "a key of one's own": (put("approved_by", value="somebody"), "statements"),
    "a key among the limits": (put(*L, "approved_by", value="somebody"), "statements"),
    "the digest of the motion": (put(*G, "motion", value="0" * 64), "motion"),
    "the digest of them all": (put(*G, "sha256", value="0" * 64), "digest"),
    "a digest too few": (drop(*G, "scene"), "scene"),
    "a digest too many": (put(*G, "extra", value="0" * 64), "digest"),
    "the version": (put(*G, "version", value="9.9.9"), "version"),
}  # fmt: skip


def written(made: tuple[Path, str], edit: Callable[[Document], None], tmp_path: Path) -> Path:
    document = json.loads(made[1])
    edit(document)
    write_json(tmp_path / "edited.json", document)
    return tmp_path / "edited.json"


def test_an_untouched_design_matches_and_layout_does_not_count(
    made: tuple[Path, str], tmp_path: Path
) -> None:
    assert read_design(made[0] / "design.json").digest == "matches"
    file = tmp_path / "tight.json"
    file.write_text(json.dumps(json.loads(made[1]), sort_keys=True, separators=(",", ":")))
    assert read_design(file).digest == "matches"


@pytest.mark.parametrize("name", NOTICED)
def test_an_edit_is_noticed_and_its_subject_named(
    made: tuple[Path, str], name: str, tmp_path: Path
) -> None:
    edit, subject = NOTICED[name]
    found = read_design(written(made, edit, tmp_path))
    assert found.digest == "differs"
    assert subject in found.changed
    assert subject in str(found.describe_digest())


@pytest.mark.parametrize("name", ["design", "digest"])
def test_without_a_digest_it_is_said(made: tuple[Path, str], name: str, tmp_path: Path) -> None:
    keys = ("design",) if name == "design" else ("design", "digest")
    found = read_design(written(made, drop(*keys), tmp_path))
    assert found.digest == "absent"
    assert "no digest" in str(found.describe_digest())


def test_an_edited_design_is_certified_anew(made: tuple[Path, str], tmp_path: Path) -> None:
    before = check(made[0] / "design.json").to_json()
    assert (before["digest"], before["changed"]) == ("matches", [])
    path = written(made, put("trajectory", "offset", 1, value=0.6), tmp_path)
    after = check(path).to_json()
    assert (after["certificate"], after["changed"]) == ("violated", ["motion"])
    assert json.loads(path.read_text())["design"]["margins"] == before["margins"]


@pytest.mark.parametrize(
    "name",
    [
        "the scene removed",
        "a shape made smaller",
        pytest.param("the floor lowered", marks=pytest.mark.long),
    ],
)
def test_a_scene_that_was_edited_must_be_given_again(
    made: tuple[Path, str], untouched: str, name: str, tmp_path: Path
) -> None:
    path = written(made, NOTICED[name][0], tmp_path)
    found = check(path)
    assert "environment" in [item.kind for item in found.certificate.unjudged]
    assert not found.feasible
    assert found.limits.floor == "mount"
    stored = read_design(path)
    plan = ExperimentPlan(robot=stored.robot, trajectory=stored.stored.trajectory)
    _, judge = judge_of(stored, RunSettings())
    with pytest.raises(InputError, match=r"must not run.*environment.*scene"):
        check_design(plan, judge)
    again = check(path, scene=made[0] / "scene.json")
    assert again.certificate.verdict == untouched


def test_the_scene_s_own_file_must_not_have_changed_unnoticed(
    made: tuple[Path, str], untouched: str, tmp_path: Path
) -> None:
    """A wall that was put there since is in no certificate."""
    own, path = tmp_path / "scene.json", tmp_path / "design.json"
    path.write_text(made[1].replace(str(made[0] / "scene.json"), str(own)))
    moved = read_design(path)
    assert moved.limits is not None
    for shapes in (SCENE["shapes"], [], None):
        if shapes is None:
            own.unlink()
        else:
            own.write_text(json.dumps({**SCENE, "shapes": shapes}))
        _, judge = judge_of(replace(moved, changed=()), RunSettings())
        causes = [cause for item in judge.unjudged for cause in item.causes]
        assert any("scene.json is not the scene" in cause for cause in causes) == (shapes == [])
    own.write_text(json.dumps({**SCENE, "shapes": []}))
    assert check(path, scene=made[0] / "scene.json").certificate.verdict == untouched


def test_the_scene_s_own_file_is_looked_at_from_any_folder(
    made: tuple[Path, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was looked for where the command runs: a wall was not seen from elsewhere."""
    (tmp_path / "scene.json").write_text(json.dumps(SCENE))
    monkeypatch.chdir(tmp_path)
    held = given_limits(RunSettings(scene="scene.json"))
    monkeypatch.chdir(made[0])
    stored = replace(read_design("design.json"), limits=held, changed=())
    assert judge_of(stored, RunSettings())[1].unjudged == ()
    (tmp_path / "scene.json").write_text(json.dumps({**SCENE, "shapes": []}))
    (lost,) = judge_of(stored, RunSettings())[1].unjudged
    assert lost.kind == "environment"


@pytest.mark.parametrize("name", ["no margin", "less clearance", "collisions off", "the limits"])
def test_limits_that_were_edited_hold_no_less_than_the_usual_ones(
    made: tuple[Path, str], name: str, tmp_path: Path
) -> None:
    def unsigned(document: Document) -> None:
        NOTICED[name][0](document)
        drop("design", "digest")(document)

    for edit in (NOTICED[name][0], unsigned):
        found = check(written(made, edit, tmp_path))
        assert (found.limits.margin_percent, found.limits.clearance) == (5.0, 0.01)
        assert found.limits.collision
        assert found.limits.preset == "safe"


@pytest.mark.parametrize(
    ("text", "by", "said"),
    [
        ('"robot"', '"robot": "ur10", "robot"', "more than once"),
        ('"preset"', '"scene": null, "preset"', "more than once"),
    ],
)
def test_a_key_that_stands_twice_is_refused(
    made: tuple[Path, str], text: str, by: str, said: str, tmp_path: Path
) -> None:
    path = tmp_path / "twice.json"
    path.write_text(made[1].replace(text, by, 1))
    with pytest.raises(InputError, match=said):
        read_design(path)


@pytest.mark.parametrize("value", [1e308, -1e200, 1e12, 1e-308])
@pytest.mark.parametrize("place", [("a", 0, 0), ("offset", 2), ("period",)])
def test_hostile_numbers_are_one_line(
    made: tuple[Path, str], place: tuple[str | int, ...], value: float, tmp_path: Path
) -> None:
    path = written(made, put("trajectory", *place, value=value), tmp_path)
    if place[0] != "period" and abs(value) < 1.0:
        assert check(path).certificate.margins["position"] is not None
        return
    with pytest.raises(InputError) as caught:
        check(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (put(D, "repetitions", value="three"), "design.repetitions must be a whole number"),
        (put(D, "repetitions", value=-2), "must be positive"),
        (put(D, "predicted_torque_error_percent", value=0.0), "must be positive"),
        (put(*L, "mesh_dirs", value=5), "mesh_dirs must be a list"),
        (put(*L, "margin_percent", value="five"), "design.limits.margin_percent must be a number"),
        (put(*L, "tool", value=[0, 0]), "needs 3 numbers"),
        (put(*L, "payload", 0, value=1e9), "the payload's mass"),
        (put(D, "digest", value="abc"), "design.digest must be a JSON object"),
    ],
)
def test_a_value_that_makes_no_sense_is_refused_with_the_file(
    made: tuple[Path, str], edit: Callable[[Document], None], said: str, tmp_path: Path
) -> None:
    path = written(made, edit, tmp_path)
    with pytest.raises(InputError, match=said) as caught:
        read_design(path)
    assert str(path) in str(caught.value)


ARM = """<robot name="arm"><link name="base"/><link name="one">
<inertial><mass value="2"/><origin xyz="0 0 0.2"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><mesh filename="package://arm/meshes/part.stl"/></geometry></collision></link>
<joint name="j" type="revolute"><parent link="base"/><child link="one"/><axis xyz="0 1 0"/>
<origin xyz="0 0 0.5"/><limit lower="-1" upper="1" velocity="1" effort="90"/></joint></robot>"""
STL = """solid part
facet normal 0 0 1
outer loop
vertex 0.01 0.02 0
vertex 0.2 0 0
vertex 0 0.2 0.1
endloop
endfacet
endsolid part
"""


def test_a_design_remembers_where_meshes_are(tmp_path: Path) -> None:
    path, folder = tmp_path / "arm.urdf", tmp_path / "meshes of mine"
    path.write_text(ARM)
    folder.mkdir()
    (folder / "part.stl").write_text(STL)
    settings = DesignSettings(
        method="ga", population=4, generations=1, harmonics=3, period_s=8.0,
        mesh_dirs=(str(folder),),
    )  # fmt: skip
    design(path, settings, output=tmp_path / "design.json")
    stored = read_design(tmp_path / "design.json")
    assert (len(stored.robot.bodies), stored.changed) == (1, ())
    folder.rename(tmp_path / "elsewhere")
    stored = read_design(tmp_path / "design.json")
    assert (len(stored.robot.bodies), stored.changed) == (0, ("robot",))
    there = [str(tmp_path / "elsewhere")]
    assert check(tmp_path / "design.json", mesh_dirs=there).design.digest == "matches"


def test_how_the_path_of_the_robot_was_written_is_no_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("arm.urdf").write_text(ARM)
    settings = DesignSettings(method="ga", population=4, generations=1, harmonics=3, period_s=8.0)
    design("arm.urdf", settings, output=Path("design.json"))
    stored = read_design("design.json")
    # The mesh is nowhere, and where it was looked for is told with the robot's path.
    assert any(str(tmp_path) in note for note in stored.robot.body_notes)
    assert stored.changed == ()


@pytest.mark.parametrize(
    ("poses", "said"),
    [
        ([[0.0] * 6], "a motion needs two poses"),
        ([[0.0] * 3, [1.0] * 3], "wrong shape"),
        ([[0.0] * 6, [9.0] * 6], "outside the position limits"),
    ],
)
def test_poses_of_a_task_that_make_no_sense_are_refused_with_the_file(
    poses: list[list[float]], said: str, tmp_path: Path
) -> None:
    task = tmp_path / "task.json"
    task.write_text(json.dumps({"poses": poses}))
    with pytest.raises(InputError, match=said) as caught:
        design("ur5", DesignSettings(motions=(str(task),), collision=False))
    assert str(task) in str(caught.value)


def test_a_task_of_another_robot_is_refused(made: tuple[Path, str], tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM.replace("package://arm/meshes/part.stl", "part.stl"))
    (tmp_path / "part.stl").write_text(STL)
    task = DesignSettings(motions=(str(made[0] / "design.json"),), collision=False)
    with pytest.raises(InputError, match=r"design\.json: the motion is one of another robot"):
        design(tmp_path / "arm.urdf", task)


class NoTries(DesignOptimiser):
    """Forgets to judge."""

    def minimize(self, search: MotionSearch) -> int:
        return 0


class FewTries(DesignOptimiser):
    """The best of some random motions."""

    def minimize(self, search: MotionSearch) -> int:
        random = np.random.default_rng(search.seed)
        for x in random_numbers(search.region, 4, random, fill=0.5):
            search.judge(x)
        return 1


def test_an_optimiser_of_ones_own_finds_a_design(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    settings = DesignSettings(method=FewTries(), harmonics=3, period_s=8.0, limits="paper")
    found = design(tmp_path / "arm.urdf", settings, output=tmp_path / "design.json")
    assert (found.method, found.ended_by, found.evaluations) == ("own", "optimiser", 4)
    assert found.certificate.holds
    stored = read_design(tmp_path / "design.json")
    assert (stored.facts["method"], stored.changed) == ("own", ())
    with pytest.raises(InputError) as caught:
        DesignSettings(method=FewTries)  # pyright: ignore[reportArgumentType]
    assert caught.value.where == "--method"
    with pytest.raises(JobError, match=r"optimiser own judged no motion"):
        design(tmp_path / "arm.urdf", replace(settings, method=NoTries()))
