from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from designed_arm import written_arm

import dynid
from dynid.cli.app import main
from dynid.settings import LimitSettings
from dynid.trajectory import FAMILY_NAMES
from dynid.workflow import DEFAULT_STARTS, check_export, given_limits

QUICK = ("--no-collision", "--harmonics", "3", "--period", "6", "--starts", "2", "--jobs", "1")
BINDING = {
    "condition_number", "scaled_condition_number", "log_det", "criterion", "method", "feasible",
    "margins", "evaluations", "wall_s", "seed", "predicted_torque_error_percent",
    "largest_parameter_std",
}  # fmt: skip
MARGINS = {
    "position", "velocity", "acceleration", "torque", "tcp_speed", "self_collision_m",
    "environment_m",
}  # fmt: skip
Run = Callable[..., tuple[int, dict[str, Any], str]]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    def call(*words: object) -> tuple[int, dict[str, Any], str]:
        capsys.readouterr()
        code = main([str(word) for word in words])
        out, err = capsys.readouterr()
        return code, json.loads(out) if out.startswith("{") else {}, err

    return call


def test_design_and_check_tell_the_same_story(run: Run, tmp_path: Path) -> None:
    arm, file = written_arm(tmp_path, whole=True), tmp_path / "design.json"
    code, found, err = run("design", arm, "-o", file, *QUICK[1:], "--json")
    assert (code, err) == (0, "")
    assert set(found) >= BINDING
    assert set(found["margins"]) >= MARGINS
    assert found["feasible"]
    assert found["method"] == "gradient"
    code, checked, _ = run("check", file, "--json")
    assert (code, checked["certificate"]) == (0, "certified")
    assert checked["margins"] == found["margins"]
    assert checked["margins"]["torque"] > 0
    assert checked["margins"]["self_collision_m"] > 0
    # The floor that the arm stands on.
    assert checked["margins"]["environment_m"] > 0

    # The file alone gives the figures again: by numpy, from the trajectory in it.
    stored = dynid.read_design(file)
    times = np.arange(found["samples"]) / 125.0
    motion = stored.stored.trajectory.evaluate(times)
    base = dynid.reduce_model(dynid.InverseDynamicModel(robot=dynid.load_robot(arm)))
    w = base.model.observation_matrix(motion.q, motion.dq, motion.ddq)[:, list(base.independent)]
    assert found["condition_number"] == pytest.approx(np.linalg.cond(w), rel=1e-8)
    unit = w / np.linalg.norm(w, axis=0)
    assert found["scaled_condition_number"] == pytest.approx(np.linalg.cond(unit), rel=1e-8)
    assert found["log_det"] == pytest.approx(np.linalg.slogdet(w.T @ w)[1], rel=1e-8)
    ends = stored.stored.trajectory.evaluate([0.0, 6.0])
    np.testing.assert_allclose(ends.dq, 0.0, atol=1e-12)
    np.testing.assert_allclose(ends.ddq, 0.0, atol=1e-12)


def test_a_seed_gives_the_same_file_again(run: Run, tmp_path: Path) -> None:
    arm = written_arm(tmp_path)
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        assert run("design", arm, "-o", tmp_path / f"{name}.json", *QUICK, "--seed", seed)[0] == 0
    first, again, other = (
        json.loads((tmp_path / f"{name}.json").read_text())["trajectory"] for name in "abc"
    )
    assert first == again
    assert first != other


def test_the_default_search_is_a_number_of_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever searches, and however fast: a seed gives the same motion again."""
    monkeypatch.setitem(DEFAULT_STARTS, "prediction", 2)
    arm, quick = written_arm(tmp_path), {"harmonics": 2, "period_s": 4.0}
    one, two = (
        dynid.design(arm, dynid.DesignSettings(jobs=jobs, seed=5, **quick)) for jobs in (1, 2)
    )
    assert (one.ended_by, one.starts, two.starts) == ("starts", 2, 2)
    for name in ("offset", "a", "b"):
        ours, theirs = (getattr(found.trajectory, name) for found in (one, two))
        np.testing.assert_array_equal(ours, theirs)
    assert one.criteria == two.criteria


def test_the_robot_is_named_and_its_file_kept(run: Run, tmp_path: Path) -> None:
    arm, file = written_arm(tmp_path), tmp_path / "design.json"
    code, found, _ = run("design", arm, "-o", file, *QUICK, "--json")
    assert code == 0
    assert found["robot"] == dynid.load_robot(arm).name
    assert Path(json.loads(file.read_text())["robot"]) == arm
    assert run("check", file, "--no-collision", "--json")[1]["robot"] == found["robot"]


def test_options_of_the_other_method_are_said(run: Run, tmp_path: Path) -> None:
    words = (*QUICK[:5], "--population", "10", "--starts", "1", "--json")
    code, _, err = run("design", written_arm(tmp_path), "-o", tmp_path / "d.json", *words)
    assert (code, err) == (0, "dynid: --population is not used by --method gradient\n")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"accuracy_percent": 3.0, "period_s": 20.0}, "--period"),
        ({"motions": ("task.json",), "criterion": "cond"}, "--motion"),
        ({"motions": ("task.json",), "purpose": "parameters"}, "--motion"),
        ({"criterion": "cond", "purpose": "prediction"}, "--for"),
        ({"motions": ("task.json",), "criterion": "cond", "accuracy_percent": 3.0}, None),
        ({"motions": ("task.json",)}, None),
        ({"accuracy_percent": 3.0}, None),
    ],
)
def test_options_without_an_effect_beside_others_are_said(
    given: dict[str, Any], said: str | None
) -> None:
    found = dynid.DesignSettings(**given).unused
    assert [words.split()[0] for words in found] == ([said] if said else [])


def test_the_genetic_algorithm_with_the_paper_limits(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "ga.json"
    words = ("--method", "ga", "--limits", "paper", "--population", "20", "--generations", "2")
    code, found, err = run("design", written_arm(tmp_path), "-o", file, *QUICK, *words, "--json")
    assert (code, err) == (0, "dynid: --starts is not used by --method ga\n")
    assert found["method"] == "ga"
    assert found["margins"]["torque"] is None
    assert found["evaluations"] == 20 + 2 * 19  # One survives each generation unchanged.
    # What was made for the paper's limits is held to all of them, unless told otherwise.
    code, strict, _ = run("check", file, "--no-collision", "--json")
    assert strict["designed_for"] == "paper"
    assert code == (0 if strict["feasible"] else 1)
    assert strict["margins"]["torque"] is not None
    assert run("check", file, "--limits", "paper")[0] == 0


@pytest.mark.parametrize("family", FAMILY_NAMES)
def test_every_family_gives_a_feasible_design(run: Run, tmp_path: Path, family: str) -> None:
    file = tmp_path / "design.json"
    words = (*QUICK, "--starts", "1", "--trajectory", family)
    code, found, _ = run("design", written_arm(tmp_path), "-o", file, *words, "--json")
    assert code == 0
    assert found["feasible"]
    assert run("check", file, "--no-collision")[0] == 0


def test_motions_begin_at_the_pose_that_is_given(run: Run, tmp_path: Path) -> None:
    arm, file = written_arm(tmp_path), tmp_path / "design.json"
    words = (*QUICK, "--trajectory", "modified-fourier", "--start", "0.5,-1,1")
    assert run("design", arm, "-o", file, *words)[0] == 0
    motion = dynid.read_design(file).stored.trajectory.evaluate([0.0, 6.0])
    np.testing.assert_allclose(motion.q, [[0.5, -1.0, 1.0]] * 2, atol=1e-9)


def test_exports_stand_beside_the_design(run: Run, tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("d.json", "d.csv", "d.yaml")]
    words = ("--csv", files[1], "--ros", files[2])
    assert run("design", written_arm(tmp_path), "-o", files[0], *QUICK, *words)[0] == 0
    table = np.loadtxt(files[1], delimiter=",", skiprows=1)
    trajectory = dynid.read_design(files[0]).stored.trajectory
    np.testing.assert_allclose(table[:, 1:4], trajectory.evaluate(table[:, 0]).q, atol=1e-12)
    assert "joint_names" in files[2].read_text()


def test_the_shortest_motion_for_an_accuracy_is_found(tmp_path: Path) -> None:
    quick = dynid.DesignSettings(harmonics=3, period_s=6.0, starts=1, collision=False)
    robot = dynid.load_robot(written_arm(tmp_path))
    once = dynid.design(robot, quick)
    asked = once.expected.bound_percent / 1.8
    found = dynid.design(robot, replace(quick, accuracy_percent=asked))
    total = found.repetitions * found.trajectory.duration
    assert found.expected.bound_percent <= asked
    # The square of the factor, and no more than ramps and rounding on top.
    assert 0.7 * 1.8**2 * 6.0 < total < 1.25 * 1.8**2 * 6.0
    loose = dynid.design(robot, replace(quick, accuracy_percent=2.0 * once.expected.bound_percent))
    assert loose.repetitions == 1
    assert loose.trajectory.duration < 6.0
    with pytest.raises(dynid.JobError, match=r"would take \d+ s of motion"):
        dynid.design(robot, replace(quick, accuracy_percent=asked / 20))


def test_a_motion_that_excites_too_little_says_what_is_lost(run: Run, tmp_path: Path) -> None:
    words = (
        "design",
        written_arm(tmp_path),
        "-o",
        tmp_path / "d.json",
        *QUICK[:5],
        "--starts",
        "1",
    )
    loud = (*words, "--noise", "400,400,400", "--json")
    code, found, err = run(*loud)
    assert code == 1
    (finding,) = found["findings"]
    assert finding["kind"] == "weak_excitation"
    assert finding["value"] > 20
    assert finding["joints"]
    assert "excites too little" in err
    assert "; not identified: " in err
    assert run(*loud, "--accept-weak", "--force")[0] == 0


def test_a_sequential_design_completes_what_is_recorded(tmp_path: Path) -> None:
    robot = dynid.load_robot(written_arm(tmp_path))
    first = dynid.DesignSettings(harmonics=3, period_s=6.0, starts=1, criterion="d-opt")
    before = dynid.design(robot, first)
    motion = before.trajectory.evaluate(np.arange(750) / 125.0)
    record = dynid.ExperimentRecord(
        t=motion.t,
        signals={"q": motion.q, "qd": motion.dq, "effort": np.zeros_like(motion.q)},
        metadata=dynid.RecordMetadata(robot="small", joint_names=robot.joint_names),
    )
    path = tmp_path / "before.parquet"
    dynid.write_record(record, path)
    alone, after = (
        dynid.design(
            robot,
            dynid.DesignSettings(
                harmonics=3, period_s=6.0, starts=4, criterion="a-opt", previous=previous
            ),
        )
        for previous in ((), (str(path),))
    )
    assert after.certificate.holds
    assert str(path) in after.provenance.inputs
    # Alone it is worse, as it must be: it spends itself on what the record lacks.
    assert after.criteria["a-opt"] >= alone.criteria["a-opt"]


def test_an_infeasible_design_is_named_as_such(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The arm holds its own weight only where it stands upright; nobody looks there.
    monkeypatch.setattr("dynid.excitation.gradient.free_poses", lambda *_, **__: [])
    arm, file = written_arm(tmp_path, torque=0.5), tmp_path / "design.json"
    code, found, err = run("design", arm, "-o", file, *QUICK[1:], "--starts", "1", "--json")
    assert code == 1
    assert found["feasible"] is False
    assert "NOT feasible: torque" in err
    assert json.loads(file.read_text())["design"]["feasible"] is False
    code, checked, _ = run("check", file, "--no-collision", "--json")
    assert code == 1
    assert checked["broken"][0] == "torque"
    assert checked["margins"]["torque"] < 0


SCENES: dict[str, Any] = {
    "enclosing": {"type": "box", "size": [4, 4, 4], "position": [0, 0, 0]},
    "unknown": {"type": "cloud"},
}


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--harmonics", "0"), "--harmonics"),
        (("--harmonics", "1"), "--harmonics"),
        (("--harmonics", "-3"), "--harmonics"),
        (("--harmonics", "1000000"), "2 to 100"),
        (("--start", "nan,0,0", "--trajectory", "bspline"), "--start: needs finite"),
        (("--noise", "1,inf,1"), "--noise: needs finite"),
        (("--csv", "d.json"), "--csv: the same file as -o"),
        (("--ros", "missing/m.yaml"), "--ros: the output's directory"),
        (("--period", "0"), "--period"),
        (("--period", "nan"), "--period"),
        (("--criterion", "best"), "--criterion"),
        (("--method", "luck"), "--method"),
        (("--limits", "none"), "--limits"),
        (("--trajectory", "spiral"), "--trajectory"),
        (("--starts", "0"), "--starts"),
        (("--budget", "0"), "--budget"),
        (("--budget", "1e-7"), "--budget"),
        (("--budget", "nan"), "--budget"),
        (("--population", "1", "--method", "ga"), "--population"),
        (("--scene", "enclosing.json"), "leaves the robot no room"),
        (("--scene", "unknown.json"), "unknown shape"),
        (("--scene", "missing.json"), "missing.json"),
        (("--start", "0,0"), "--start|start pose"),
        (("--start", "0,0,0"), "--trajectory"),
        (("--start", "a,b,c", "--trajectory", "bspline"), "--start"),
        (("--start", "0,9,0", "--trajectory", "bspline"), "start pose"),
        (("--start", "0,1.3,2.5", "--trajectory", "bspline"), "start pose|collision"),
        (("--noise", "1,1"), "noise"),
        (("--limits", "paper", "--margin", "10"), "--margin: it is looked at only with"),
        (("--limits", "paper", "--clearance", "0.05"), "--clearance: it is looked at only with"),
        (("--no-collision", "--clearance", "0.05"), "--clearance: it is looked at only with"),
        (("--noise", "1,0,1"), "noise"),
        (("--noise", "1e200,1e200,1e200"), "--noise: out of bounds"),
        (("--noise", "1e-200,1,1"), "--noise: out of bounds"),
        (("--terms", "magic"), "--terms"),
        (("--frames", "polar"), "--frames"),
        (("--mount", "moon"), "mounting"),
        (("--previous", "missing.parquet"), "missing.parquet"),
        (("--dask", "nowhere"), "--dask"),
        # Before the search, not after it.
        (("--krl", "d.src"), "--krl"),
        (("--movej", "d.script", "--trajectory", "points"), "six joints"),
        (("--urscript", "d.script"), "six joints"),
    ],
)
def test_bad_input_is_one_clear_message(
    run: Run,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    told: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("dynid.core.parallel.DASK_TIMEOUT_S", 0.5)
    for name, shape in SCENES.items():
        Path(f"{name}.json").write_text(json.dumps({"shapes": [shape]}))
    base = () if "--starts" in words or "--budget" in words else ("--starts", "1")
    code, _, err = run("design", written_arm(tmp_path), "-o", "d.json", *base, *words)
    assert code == 2, err
    assert err.count("\n") == 1
    assert any(part in err for part in told.split("|")), err
    assert not Path("d.json").exists()


@pytest.mark.parametrize("kind", ["urscript", "movej", "krl", "rapid"])
def test_a_program_of_joint_angles_is_refused_for_a_joint_that_slides(kind: str) -> None:
    arm = dynid.load_robot("ur5")
    sliding = replace(arm, joint_types=("prismatic", *arm.joint_types[1:]))
    with pytest.raises(dynid.InputError, match=f"{kind}: .*slides; got {arm.joint_names[0]}"):
        check_export(kind, sliding, "points")
    for other in ("csv", "ros", "waypoints"):
        check_export(other, sliding, "points")


def test_programs_for_other_players_run_alone_and_say_what_was_not_judged(
    run: Run, tmp_path: Path
) -> None:
    program, ros = tmp_path / "d.script", tmp_path / "d.yaml"
    words = ("--limits", "paper", "--for", "cond", "--urscript", program, "--ros", ros)
    code, _, err = run("design", "ur5", "-o", tmp_path / "d.json", *QUICK, *words)
    assert (code, err) == (0, "")
    said = "# dynid: certified, feasible; not judged: torque, tcp_speed, elbow_speed, momentum"
    for text in (program.read_text(), ros.read_text()):
        assert f"{said}, power, self_collision, environment, the way to the start\n" in text
    # Nobody feeds a program that is sent by hand: it stopped before it moved.
    assert "watchdog" not in program.read_text()


def test_contradictory_limits_are_named(run: Run, tmp_path: Path) -> None:
    arm = written_arm(tmp_path, upper=-2.0)
    code, _, err = run("design", arm, "-o", tmp_path / "d.json")
    assert code == 2
    assert "joint 2" in err
    assert "no room" in err


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"kind": "dynid.trajectory", "version": 2}'])
def test_check_refuses_what_is_no_design(run: Run, tmp_path: Path, text: str) -> None:
    path = tmp_path / "broken.json"
    path.write_text(text)
    code, _, err = run("check", path)
    assert code == 2
    assert "broken.json" in err


def test_ctrl_c_writes_the_best_design_so_far(tmp_path: Path) -> None:
    """Not in the place of a finished one, whatever may be replaced."""
    finished, csv = tmp_path / "design.json", tmp_path / "design.csv"
    finished.write_text("finished")
    file = tmp_path / "design.interrupted-1.json"
    script = """
import sys
import dynid.workflow as designing
from dynid.cli.app import main
# A line on stdout with every better motion: when to interrupt.
real = designing.design
def design(*words, **options):
    options["progress"] = lambda what, share: print(what, flush=True)
    return real(*words, **options)
designing.design = design
sys.exit(main(sys.argv[1:]))
"""
    arm = written_arm(tmp_path, whole=True)
    words = ("design", arm, "-o", finished, "--jobs", "2", "--budget", "120")
    words += ("--force", "--csv", csv)
    process = subprocess.Popen(
        [sys.executable, "-c", script, *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    assert process.stdout is not None
    for _ in range(3):
        assert "prediction" in process.stdout.readline()
    # The whole group, as a terminal does.
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert f"interrupted; the best design so far is in {file}" in err
    assert finished.read_text() == "finished"
    assert csv.exists()
    design = json.loads(file.read_text())["design"]
    assert design["interrupted"]
    assert design["ended_by"] == "interrupt"
    assert design["feasible"]
    assert "interrupted: the best so far" in out
    assert "Traceback" not in err


def test_a_scene_that_would_not_be_looked_at_is_refused(run: Run, tmp_path: Path) -> None:
    file, scene = tmp_path / "design.json", tmp_path / "scene.json"
    assert run("design", written_arm(tmp_path, whole=True), "-o", file, *QUICK[1:])[0] == 0
    scene.write_text(json.dumps({"shapes": [{"type": "floor", "height": -1.0}]}))
    assert run("check", file, "--scene", scene)[0] == 0
    for words in (("--no-collision",), ("--limits", "paper")):
        code, _, err = run("check", file, "--scene", scene, *words)
        assert code == 2
        assert "--scene: " in err
        assert "--limits safe" in err


def test_a_payload_that_is_in_the_arm_everywhere_is_refused_at_once(tmp_path: Path) -> None:
    scene = tmp_path / "scene.json"
    # One end reaches into the forearm, the other into it when the wrist is turned.
    box = {"type": "box", "size": [0.1, 0.5, 0.7], "position": [0, 0, 0.1]}
    scene.write_text(json.dumps({"payload": [box]}))
    with pytest.raises(dynid.InputError, match=r"was found: self collision|in every pose; got"):
        dynid.design("ur5", dynid.DesignSettings(scene=str(scene), starts=1))


def test_the_scene_of_the_documents_leaves_room(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "docs" / "excitation.md").read_text()
    (shown,) = re.findall(r"```json\n(.*?)```", text, re.DOTALL)
    scene = tmp_path / "cell.json"
    scene.write_text(shown)
    judge = given_limits(LimitSettings(scene=scene)).constraints(dynid.load_robot("ur5"))
    random, still = np.random.default_rng(0), np.zeros((1, 6))
    poses = random.uniform(-np.pi, np.pi, (300, 1, 6))
    usages = [judge.usage(q, still, still) for q in poses]
    free = [
        usage["self_collision"].margin > 0.001 and usage["environment"].margin > 0.01
        for usage in usages
    ]
    assert sum(free) > 5
