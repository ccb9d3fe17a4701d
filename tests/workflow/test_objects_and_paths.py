"""Every verb takes an object and the path of its file alike, and names a path that is not there."""

from __future__ import annotations

import inspect
import math
import re
import types
import typing
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from designed_arm import written_arm
from numpy.typing import ArrayLike

import dynid
from dynid.core import plain
from dynid.regressor import parse_terms
from dynid.trajectory import JointMotion, Trajectory

PAPER = dynid.IdentifySettings(
    preset="paper", estimator="wls", cutoff_hz=10.0, terms=parse_terms("fc,fv,im", width=0.01)
)
QUICK = dynid.DesignSettings(period_s=2.0, harmonics=3, starts=1, limits="paper", rate_hz=50.0)
PERIOD_S = 4.0


@dataclass(frozen=True)
class Given:
    """What verbs take: all as objects, or all as paths."""

    folder: Path
    """Of the files, in both cases."""
    robot: Any
    record: Any
    other: Any
    """At another temperature."""
    loaded: Any
    poses: Any
    """The motion of `record` with a payload."""
    estimate: Any
    warm: Any
    temperature: Any
    design: Any
    trajectory: Any


@pytest.fixture(scope="module")
def paths(tmp_path_factory: pytest.TempPathFactory) -> Given:
    folder = tmp_path_factory.mktemp("given")
    path = written_arm(folder, whole=True)
    text = path.read_text(encoding="utf-8")
    path.write_text(text + "[drives]\ngain = [12.0, 12.0, 10.0]\n", encoding="utf-8")
    robot = dynid.load_robot(path)
    heavy = replace(robot, tool=replace(robot.tool, mass=2.0, com=np.array([0.02, 0.0, 0.05])))
    first, second = (
        dynid.random_excitation(robot.limits, seed=seed, period_s=PERIOD_S) for seed in (1, 2)
    )
    for name, arm, motion, degC in (
        ("record", robot, first, 22.0),
        ("other", robot, second, 35.0),
        ("loaded", heavy, first, 22.0),
    ):
        record = dynid.simulate_recording(arm, motion, thermal=degC, seed=len(name))
        dynid.write_record(record, folder / f"{name}.parquet")
    single = np.random.default_rng(0).uniform(-1, 1, (2, 40, robot.joints))
    signals = {"q": single[0], "effort": single[1]}
    poses = dynid.ExperimentRecord(t=np.arange(40.0), signals=signals)
    dynid.write_record(poses, folder / "poses.parquet")
    found = dynid.identify_temperature(
        [folder / "record.parquet", folder / "other.parquet"], robot, PAPER
    )
    dynid.write_temperature(found, folder / "temperature.json")
    dynid.write_estimate(found.estimate_at(22.0), folder / "estimate.json")
    dynid.write_estimate(found.estimate_at(35.0), folder / "warm.json")
    dynid.design(path, QUICK, output=folder / "design.json")
    dynid.write_design(dynid.read_trajectory(folder / "design.json"), folder / "trajectory.json")
    return Given(
        folder=folder,
        robot=path,
        **{name: folder / f"{name}.parquet" for name in ("record", "other", "loaded", "poses")},
        **{
            name: folder / f"{name}.json"
            for name in ("estimate", "warm", "temperature", "design", "trajectory")
        },
    )


@pytest.fixture(scope="module")
def objects(paths: Given) -> Given:
    return Given(
        folder=paths.folder,
        robot=dynid.load_robot(paths.robot),
        record=dynid.read_record(paths.record),
        other=dynid.read_record(paths.other),
        loaded=dynid.read_record(paths.loaded),
        poses=dynid.read_record(paths.poses),
        estimate=dynid.read_estimate(paths.estimate),
        warm=dynid.read_estimate(paths.warm),
        temperature=dynid.read_temperature(paths.temperature),
        design=dynid.read_design(paths.design),
        trajectory=dynid.read_trajectory(paths.trajectory),
    )


def recorded(record: dynid.ExperimentRecord) -> dict[str, Any]:
    return {"t": record.t, "problems": [p.kind for p in record.problems], **record.signals}


def run_of(run: dynid.Run) -> dict[str, Any]:
    assert run.record is not None
    record = dynid.read_record(run.record)
    return {**recorded(record), "design": record.metadata.extra["design_sha256"]}


def design_of(found: dynid.ExcitationDesign) -> dict[str, Any]:
    told = found.to_json()
    return {key: told[key] for key in ("condition_number", "feasible", "margins")}


def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def stored(found: dynid.StoredDesign) -> list[Any]:
    return [found.stored.trajectory, found.robot.name, found.facts, found.changed]


def written(given: Given, out: Path) -> str:
    """A design as `write_design` writes it with the robot given."""
    asked = dynid.design(given.folder / "small.toml", QUICK)
    dynid.write_design(asked, out, robot=given.robot)
    return stored(dynid.read_design(out))[2]["digest"]["robot"]


def seen(estimate: Any, record: Any) -> Any:
    """What an observer sees of a recording."""
    return dynid.MomentumObserver(estimate=estimate).of_record(record)


RUN = dynid.RunSettings(repeat=2)
CASES: dict[str, tuple[str, Callable[[Given, Path], Any]]] = {
    "load_robot": ("robot", lambda g, _: dynid.load_robot(g.robot)),
    "analyze": ("robot", lambda g, _: dynid.analyze(g.robot).to_json()),
    "design": ("robot", lambda g, _: design_of(dynid.design(g.robot, QUICK))),
    "check": ("design", lambda g, _: dynid.check(g.design).to_json()),
    "check, robot": ("design robot", lambda g, _: dynid.check(g.design, robot=g.robot).to_json()),
    "check, trajectory": (
        "trajectory",
        lambda g, _: dynid.check(g.trajectory, limits="paper").to_json(),
    ),
    "run_design": (
        "design",
        lambda g, out: run_of(dynid.run_design(g.design, out, settings=RUN)),
    ),
    "run_design, robot": (
        "design robot",
        lambda g, out: run_of(
            dynid.run_design(g.design, out, settings=replace(RUN, robot=g.robot))
        ),
    ),
    "run_until": (
        "design",
        lambda g, out: [
            one.accuracy
            for one in dynid.run_until(
                g.design, out, 100.0, settings=RUN, identification=PAPER
            ).rounds
        ],
    ),
    "simulate_recording": (
        "robot trajectory",
        lambda g, _: recorded(dynid.simulate_recording(g.robot, g.trajectory)),
    ),
    "simulate_recording, design": (
        "robot design",
        lambda g, _: recorded(dynid.simulate_recording(g.robot, g.design)),
    ),
    "fit": (
        "robot record loaded",
        lambda g, out: dynid.fit(
            g.robot, g.record, out, validation=g.loaded, settings=PAPER
        ).identification.to_json(),
    ),
    "identify": (
        "robot record other loaded",
        lambda g, _: dynid.identify(
            [g.record, g.other], g.robot, PAPER, validation=g.loaded
        ).to_json(),
    ),
    "identify, one": (
        "robot record",
        lambda g, _: dynid.identify(g.record, g.robot, PAPER).to_json(),
    ),
    "identify_shared": (
        "robot record other",
        lambda g, _: dynid.identify_shared([g.record, g.other], g.robot, PAPER).to_json(),
    ),
    "identify_shared, one": (
        "robot record",
        lambda g, _: dynid.identify_shared(g.record, g.robot, PAPER).to_json(),
    ),
    "identify_temperature": (
        "robot record other",
        lambda g, _: dynid.identify_temperature([g.record, g.other], g.robot, PAPER).to_json(),
    ),
    "identify_gains": ("robot record", lambda g, _: dynid.identify_gains(g.record, g.robot)),
    "identify_payload": (
        "robot record loaded",
        lambda g, _: dynid.identify_payload(g.record, g.loaded, g.robot).to_json(),
    ),
    "identify_payload, several": (
        "robot record other loaded",
        lambda g, _: dynid.identify_payload([g.record, g.other], [g.loaded], g.robot).to_json(),
    ),
    "identify_gravity": (
        "robot poses",
        lambda g, _: dynid.identify_gravity(g.poses, g.robot).to_json(),
    ),
    "identify_gains_from_payload": (
        "robot record loaded",
        lambda g, _: dynid.identify_gains_from_payload([g.record], g.loaded, g.robot, mass=2.0),
    ),
    "validate": (
        "estimate other",
        lambda g, _: dynid.validate(g.estimate, g.other).to_json(),
    ),
    "validate, temperature laws": (
        "temperature other",
        lambda g, _: dynid.validate(g.temperature, g.other).to_json(),
    ),
    "compare": ("estimate warm", lambda g, _: dynid.compare(g.estimate, g.warm).to_json()),
    "compare, temperature laws": (
        "temperature warm",
        lambda g, _: dynid.compare(g.warm, g.temperature).to_json(),
    ),
    "write_model": (
        "estimate",
        lambda g, out: text_of(dynid.write_model(g.estimate, out, "json").path),
    ),
    "write_model, temperature laws": (
        "temperature",
        lambda g, out: text_of(dynid.write_model(g.temperature, out, "json").path),
    ),
    "write_design": ("robot", written),
    "process": ("robot record", lambda g, _: dynid.process(g.record, g.robot)),
    "read_design": (
        "robot",
        lambda g, _: stored(dynid.read_design(g.folder / "design.json", robot=g.robot)),
    ),
    "read_recording": (
        "robot",
        lambda g, _: recorded(dynid.read_recording(g.folder / "record.parquet", robot=g.robot)),
    ),
    "import_recording": (
        "robot",
        lambda g, out: recorded(
            dynid.import_recording(g.folder / "record.parquet", out, robot=g.robot).record
        ),
    ),
    "MomentumObserver": ("estimate record", lambda g, _: seen(g.estimate, g.record)),
    "MomentumObserver, temperature laws": (
        "temperature record",
        lambda g, _: seen(g.temperature, g.record),
    ),
}
"""What each call takes, and the call, whose answer can be compared."""


def same(one: Any, other: Any) -> bool:
    """Equal but for the rounding of sums, whose order follows the layout of arrays in memory."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, float):
        return math.isclose(one, other, rel_tol=1e-9, abs_tol=1e-12)
    return one == other


@pytest.mark.parametrize("case", CASES)
def test_object_and_path_give_one_answer(
    case: str, objects: Given, paths: Given, tmp_path: Path
) -> None:
    _, call = CASES[case]
    answers = [
        plain(call(given, tmp_path / f"{name}.parquet"))
        for name, given in (("object", objects), ("path", paths))
    ]
    assert same(*answers), answers


@pytest.mark.parametrize(
    ("case", "what"), [(case, what) for case, (uses, _) in CASES.items() for what in uses.split()]
)
def test_a_path_that_is_not_there_is_named(
    case: str, what: str, paths: Given, tmp_path: Path
) -> None:
    there: Path = getattr(paths, what)
    missing = str(there.with_name(f"no_{there.name}"))
    with pytest.raises(dynid.InputError, match=f"no_{there.stem}"):
        CASES[case][1](replace(paths, **{what: missing}), tmp_path / "out.parquet")
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


VALUES = (
    dynid.RobotModel,
    dynid.ExperimentRecord,
    dynid.Estimate,
    dynid.TemperatureModel,
    dynid.ExcitationDesign,
    dynid.StoredDesign,
    dynid.StoredTrajectory,
)
"""What has a file."""
WRITTEN = {
    "write_record": "record",
    "write_estimate": "estimate",
    "write_temperature": "found",
    "write_design": "design",
    "write_trajectory": "trajectory",
}
"""What is given to be written is no file."""
VERBS = {name: verb for name in dynid.__all__ if inspect.isfunction(verb := getattr(dynid, name))}


def kinds(annotation: Any) -> set[Any]:
    """The types that an annotation names."""
    if isinstance(annotation, types.UnionType) or typing.get_origin(annotation) is not None:
        parts = [part for part in typing.get_args(annotation) if not isinstance(part, list)]
        return set().union(*map(kinds, parts))
    return {annotation}


@pytest.mark.parametrize("verb", VERBS)
def test_every_argument_that_has_a_file_takes_its_path(verb: str) -> None:
    hints = typing.get_type_hints(VERBS[verb])
    hints.pop("return")
    taken = {name: kinds(hint) for name, hint in hints.items()}
    valued = [name for name, found in taken.items() if found & set(VALUES)]
    for name in valued:
        if WRITTEN.get(verb) != name:
            assert {str, Path} <= taken[name], name
    assert not set(valued) - {WRITTEN.get(verb)} or any(
        case.split(",")[0] == verb for case in CASES
    )


@pytest.mark.parametrize("verb", VERBS)
def test_what_a_verb_returns_is_exported(verb: str) -> None:
    found = kinds(typing.get_type_hints(VERBS[verb])["return"]) - {type(None)}
    assert {kind.__name__ for kind in found} <= set(dynid.__all__)


@pytest.mark.parametrize("verb", [name for name in VERBS if name.startswith("write_")])
def test_writers_take_the_value_and_then_the_path(verb: str) -> None:
    first, second, *_ = inspect.signature(VERBS[verb]).parameters
    assert first != "path"
    assert second == "path"


def test_orders_and_names_of_release_0_1_are_taken_with_a_warning(
    objects: Given, tmp_path: Path
) -> None:
    limits = objects.robot.limits
    with pytest.warns(DeprecationWarning, match="period_s"):
        old = dynid.random_excitation(limits, seed=1, period=PERIOD_S)
    assert plain(old) == plain(dynid.random_excitation(limits, seed=1, period_s=PERIOD_S))
    with pytest.warns(DeprecationWarning, match=r"write_model\(estimate, path, to\)"):
        dynid.write_model(objects.estimate, "json", str(tmp_path / "old.json"))
    dynid.write_model(objects.estimate, tmp_path / "new.json", "json")
    assert text_of(tmp_path / "old.json") == text_of(tmp_path / "new.json")
    made = objects.trajectory
    facts = {"robot": made.robot, "limits": made.limits, "provenance": made.provenance}
    with pytest.warns(DeprecationWarning, match=r"write_trajectory\(trajectory, path\)"):
        dynid.write_trajectory(tmp_path / "old.traj", made.trajectory, **facts)
    dynid.write_trajectory(made.trajectory, tmp_path / "new.traj", **facts)
    assert text_of(tmp_path / "old.traj") == text_of(tmp_path / "new.traj")


def test_what_is_neither_is_refused(objects: Given) -> None:
    with pytest.raises(dynid.InputError, match="not a recording or its file"):
        dynid.process(3, objects.robot)
    with pytest.raises(dynid.InputError, match="not an estimate or its file"):
        dynid.compare(3, objects.estimate)
    with pytest.raises(dynid.InputError, match="not a trajectory, a design or its file"):
        dynid.simulate_recording(objects.robot, 3)
    with pytest.raises(dynid.InputError, match="not an estimate or its file"):
        dynid.MomentumObserver(estimate=objects.record)  # type: ignore[arg-type]
    wrongs: list[dict[str, Any]] = [{"previous": (objects.record,)}, {"previous": 3}, {"scene": 3}]
    for wrong in wrongs:
        with pytest.raises(dynid.InputError, match="settings of a design name files"):
            dynid.DesignSettings(**wrong)
    for wrong in ({"harmonics": ""}, {"harmonics": [5]}, {"jobs": None}, {"rate_hz": "x"}):
        with pytest.raises(dynid.InputError, match=r"harmonics|jobs|rate_hz"):
            dynid.DesignSettings(**wrong)


def test_a_trajectory_of_ones_own_is_checked_and_run_beside_a_robot(tmp_path: Path) -> None:
    arm = written_arm(tmp_path)
    motion = dynid.random_excitation(dynid.load_robot(arm).limits, seed=1)
    found = dynid.check(motion, robot=arm, collision=False)
    assert found.design.robot.joints == motion.joints
    settings = dynid.RunSettings(robot=arm, repeat=1)
    run = dynid.run_design(motion, tmp_path / "run.parquet", settings=settings)
    assert not run.to_json()["aborted"]
    with pytest.raises(dynid.InputError, match="which robot"):
        dynid.check(motion)


class Own(Trajectory):
    """The motion of another one, of a class that no file knows."""

    def __init__(self, motion: Trajectory, duration: float | None = None) -> None:
        self.motion = motion
        self.length = motion.duration if duration is None else duration

    @property
    def joints(self) -> int:
        return self.motion.joints

    @property
    def duration(self) -> float:
        return self.length

    def evaluate(self, t: ArrayLike) -> JointMotion:
        return self.motion.evaluate(t)


def test_a_trajectory_of_a_class_of_ones_own_is_judged_from_samples(
    objects: Given, tmp_path: Path
) -> None:
    robot = objects.robot
    known = dynid.random_excitation(robot.limits, seed=1, margin=0.8)
    wild = replace(known, a=4 * known.a, b=4 * known.b)
    for motion, holds in ((known, True), (wild, False)):
        found, own = (
            dynid.check(one, robot=robot, limits="paper").certificate
            for one in (motion, Own(motion))
        )
        assert own.holds == found.holds == holds
        assert own.broken == found.broken
        assert own.proven == ()
        for kind, margin in found.margins.items():
            assert own.margins[kind] == pytest.approx(margin, abs=0.02)
    with pytest.raises(dynid.InputError, match="another robot"):
        dynid.check(Own(known), robot="ur5")
    for duration in (0.0, math.inf, math.nan):
        with pytest.raises(dynid.InputError, match="duration"):
            dynid.check(Own(known, duration), robot=robot)
    with pytest.raises(dynid.InputError, match="no file form") as caught:
        dynid.run_design(
            Own(known), tmp_path / "run.parquet", settings=dynid.RunSettings(robot=robot)
        )
    assert "dynid.check" in str(caught.value.next_step)


def test_a_trajectory_is_written_without_more_and_keeps_what_it_knows(
    objects: Given, tmp_path: Path
) -> None:
    motion = dynid.random_excitation(objects.robot.limits, seed=1)
    dynid.write_trajectory(motion, tmp_path / "bare.json")
    found = dynid.read_trajectory(tmp_path / "bare.json")
    assert plain(found.trajectory) == plain(motion)
    assert np.isnan(found.limits.velocity).all()
    assert found.provenance.versions
    with pytest.raises(dynid.InputError, match="Pass robot"):
        dynid.check(tmp_path / "bare.json")
    dynid.check(tmp_path / "bare.json", robot=objects.robot, limits="paper")
    dynid.write_trajectory(objects.trajectory, tmp_path / "again.json")
    assert text_of(tmp_path / "again.json") == text_of(objects.folder / "trajectory.json")
    dynid.write_trajectory(objects.trajectory, tmp_path / "moved.json", robot="elsewhere.toml")
    assert dynid.read_trajectory(tmp_path / "moved.json").robot == "elsewhere.toml"


def test_recordings_remember_a_robot_that_is_given_as_an_object(tmp_path: Path) -> None:
    motion = dynid.random_excitation(dynid.load_robot("ur5").limits, seed=1, period_s=PERIOD_S)
    dynid.write_record(dynid.simulate_recording("ur3", motion), tmp_path / "log.parquet")
    for name, robot in (("object", dynid.load_robot("ur5")), ("name", "UR5")):
        found = dynid.import_recording(
            tmp_path / "log.parquet", tmp_path / f"{name}.parquet", robot=robot
        )
        assert found.record.metadata.robot == "ur5"


def test_columns_in_another_order_are_those_of_their_names(objects: Given) -> None:
    robot, record = objects.robot, objects.record
    order = [2, 0, 1]
    names = tuple(robot.joint_names[k] for k in order)
    turned = replace(
        record,
        signals={name: values[:, order] for name, values in record.signals.items()},
        metadata=replace(record.metadata, joint_names=names),
    )
    same = dynid.validate(objects.estimate, record).metrics.rmse
    np.testing.assert_array_equal(dynid.validate(objects.estimate, turned).metrics.rmse, same)
    found, plain_order = (
        dynid.identify(one, robot, PAPER).estimate.values for one in (turned, record)
    )
    np.testing.assert_array_equal(found, plain_order)


def test_a_recording_given_twice_counts_once(objects: Given) -> None:
    once = dynid.identify(objects.record, objects.robot, PAPER).estimate
    twice = dynid.identify([objects.record, objects.record], objects.robot, PAPER)
    assert twice.estimate.samples == once.samples
    assert [x.kind for x in twice.warnings].count("duplicate_record") == 1
    shared = dynid.identify_shared([objects.record, objects.record], objects.robot, PAPER)
    assert len(shared.estimates) == 1


def test_a_dead_torque_is_named_before_a_payload(objects: Given) -> None:
    signals = {name: values.copy() for name, values in objects.loaded.signals.items()}
    torques = next(name for name in ("effort", "current") if name in signals)
    signals[torques][:, 1] = 0.0
    dead = replace(objects.loaded, signals=signals)
    with pytest.raises(dynid.InputError, match="a torque is the same on every row"):
        dynid.identify_payload(objects.record, dead, objects.robot)
    found = dynid.validate(objects.estimate, dead).warnings
    assert any(x.kind == "dead_channel" and x.joints == (1,) for x in found)


def test_a_robot_object_is_found_again_by_its_file(tmp_path: Path) -> None:
    path = written_arm(tmp_path, whole=True)
    path.write_text(re.sub('name = ".*"', 'name = "ur5"', path.read_text("utf-8"), count=1))
    robot = dynid.load_robot(path)
    assert robot.name == "ur5"
    design = dynid.design(robot, QUICK)
    dynid.write_design(design, tmp_path / "design.json")
    found = dynid.read_design(tmp_path / "design.json")
    assert found.robot.joint_names == robot.joint_names
    assert found.changed == ()
    record = dynid.simulate_recording(robot, design)
    assert record.metadata.robot == str(path)
