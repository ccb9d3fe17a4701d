"""Mistakes that people make, and what they are told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dynid
from dynid.core import Finding, InputError
from dynid.recording import ExperimentRecord
from dynid.robot import load_robot
from dynid.workflow import open_records

PAPER = dynid.IdentifySettings(preset="paper")


@pytest.fixture(scope="module")
def record() -> ExperimentRecord:
    return simulated(1)


@pytest.fixture(scope="module")
def alone(record: ExperimentRecord) -> dynid.Identification:
    """Identified from the one record, nothing beside it."""
    return dynid.identify(record, "ur5", PAPER)


def simulated(seed: int) -> ExperimentRecord:
    robot = load_robot("ur5")
    motion = dynid.random_excitation(robot.limits, seed=seed)
    return dynid.simulate_recording(robot, motion, seed=seed)


def codes(result: dynid.Identification) -> set[str]:
    return {notice.code for notice in result.warnings}


@pytest.mark.usefixtures("undiagnosed_once")
def test_a_record_does_not_confirm_itself(
    record: ExperimentRecord, alone: dynid.Identification
) -> None:
    uneven = Finding("clock_jitter", "steps between 7 and 9 ms")
    told = replace(record, problems=(*record.problems, uneven))
    result = dynid.identify(told, "ur5", PAPER, validation=told)
    judged = dynid.verdict(result)
    assert result.warnings.count(uneven) == 1
    assert result.validation is not None
    assert uneven in result.validation.warnings
    assert "over_fitted" in codes(result)
    # What was left out says what it says without it.
    assert judged.prediction == dynid.verdict(alone).prediction
    assert "another motion's" not in judged.headline


@pytest.mark.usefixtures("undiagnosed_once")
def test_words_and_lists_are_taken_where_python_has_values(
    record: ExperimentRecord, alone: dynid.Identification
) -> None:
    settings = dynid.IdentifySettings(preset="paper", terms="fc,fv,im")  # pyright: ignore[reportArgumentType]
    assert dynid.identify(record, "ur5", settings).estimate.names == alone.estimate.names
    pose = [[0.1] * 6]
    assert np.array_equal(
        alone.estimate.predict(pose, pose, pose), alone.estimate.predict(*3 * [np.array(pose)])
    )
    with pytest.raises(InputError, match=r"dq has the wrong shape; got \(1, 5\)"):
        alone.estimate.predict(pose, [[0.1] * 5], pose)


@pytest.mark.usefixtures("undiagnosed_once")
def test_windows_that_overlap_do_not_confirm_either(record: ExperimentRecord) -> None:
    late = dynid.identify(record, "ur5", PAPER, validation=record, validation_start_s=5.0)
    assert "over_fitted" in codes(late)
    estimate = late.estimate
    assert any(n.code == "over_fitted" for n in dynid.validate(estimate, record).warnings)


def test_swapped_torques_must_not_be_used(record: ExperimentRecord) -> None:
    effort = record.signals["current"] * load_robot("ur5").drives.gain
    wrong = ExperimentRecord(
        t=record.t, signals={"q": record.signals["q"], "effort": effort[:, [1, 0, 2, 3, 4, 5]]}
    )
    judged = dynid.verdict(dynid.identify(wrong, "ur5", PAPER))
    assert judged.level == "do_not_use"
    assert "look exchanged" in judged.headline


def test_reversed_torques_are_called_so(record: ExperimentRecord) -> None:
    wrong = ExperimentRecord(
        t=record.t,
        signals={"q": record.signals["q"], "current": -record.signals["current"]},
    )
    judged = dynid.verdict(dynid.identify(wrong, "ur5", PAPER))
    assert judged.level == "do_not_use"
    assert "sign of the torques" in judged.headline


def test_the_robot_of_another_record_is_noticed(
    alone: dynid.Identification, tmp_path: Path
) -> None:
    other = simulated(2)
    foreign = replace(other, metadata=replace(other.metadata, robot="ur10"))
    kinds = {finding.kind for finding in dynid.validate(alone.estimate, foreign).warnings}
    assert "another_robot" in kinds
    dynid.write_record(foreign, tmp_path / "ur10.parquet")
    kinds = {f.kind for f in dynid.validate(alone.estimate, tmp_path / "ur10.parquet").warnings}
    assert "another_robot" in kinds
    found = dynid.identify(tmp_path / "ur10.parquet", "ur5", PAPER).warnings
    assert [f.message for f in found if f.kind == "another_robot"] == [
        "the record is of robot ur10, not of ur5"
    ]


def test_the_robot_of_a_file_is_told_by_its_axes(
    alone: dynid.Identification, tmp_path: Path
) -> None:
    library = Path(dynid.robot.__file__).parent / "library"
    model = replace(alone.estimate.model, robot=replace(alone.estimate.model.robot, name="ours"))
    estimate, other = replace(alone.estimate, model=model), simulated(2)
    for kind, named in (("ur5", False), ("ur5e", False), ("ur3", True)):
        path = tmp_path / f"{kind}.toml"
        path.write_text((library / f"{kind}.toml").read_text())
        for robot in (kind, str(path)):
            foreign = replace(other, metadata=replace(other.metadata, robot=robot))
            found = {finding.kind for finding in dynid.validate(estimate, foreign).warnings}
            assert ("another_robot" in found) == named
    lost = replace(other, metadata=replace(other.metadata, robot=str(tmp_path / "lost.toml")))
    found = {finding.kind for finding in dynid.validate(estimate, lost).warnings}
    assert "another_robot" not in found


@pytest.mark.parametrize("preset", ["paper", "best"])
def test_a_cutoff_that_leaves_no_motion_is_refused(record: ExperimentRecord, preset: str) -> None:
    low = 1.0 / record.duration_s
    with pytest.raises(InputError, match="too low for the record's duration"):
        dynid.identify(record, "ur5", dynid.IdentifySettings(preset=preset, cutoff_hz=low))
    beyond = dynid.IdentifySettings(preset=preset, cutoff_hz=10.0, start_s=record.duration_s + 9)
    with pytest.raises(InputError, match="window"):
        dynid.identify(record, "ur5", beyond)
    signals = {name: x if name in ("q", "qd") else 1.01 * x for name, x in record.signals.items()}
    loaded = replace(record, signals=signals)
    for cutoff_hz, words in ((low, "too low"), (100.0, "too high")):
        with pytest.raises(InputError, match=words):
            dynid.identify_payload(record, loaded, "ur5", cutoff_hz=cutoff_hz)


def test_a_cutoff_that_the_rate_cannot_carry_is_refused(record: ExperimentRecord) -> None:
    settings = dynid.IdentifySettings(preset="paper", cutoff_hz=100.0)
    with pytest.raises(InputError, match="too high for the record's rate"):
        dynid.identify(record, "ur5", settings)


def test_what_is_no_recording_is_said() -> None:
    with pytest.raises(InputError, match=r"run\.csv"):
        dynid.identify(["run.csv"], "ur5")
    with pytest.raises(InputError, match="not a recording or its file"):
        dynid.identify([3], "ur5")  # type: ignore[list-item]
    q = np.zeros((9, 6))
    for wrong in ({"t": q, "q": q}, q, [q, q]):
        with pytest.raises(InputError, match=r"Numbers in memory: dynid\.ExperimentRecord"):
            dynid.identify(wrong, "ur5")  # type: ignore[arg-type]


def test_a_recording_without_a_robot_is_not_one_of_another(
    tmp_path: Path, record: ExperimentRecord
) -> None:
    dynid.write_record(record, tmp_path / "ours.parquet")
    nobody = replace(record, metadata=replace(record.metadata, robot=None))
    dynid.write_record(nobody, tmp_path / "log.parquet")
    paths = [tmp_path / name for name in ("ours.parquet", "log.parquet")]
    with pytest.raises(InputError, match=r"log\.parquet: the recording does not say which robot"):
        open_records(paths)


def test_degrees_in_arrays_are_refused_as_those_of_files_are(
    record: ExperimentRecord, alone: dynid.Identification
) -> None:
    wrong = replace(record, signals={**record.signals, "q": np.degrees(record.signals["q"])})
    for call in (
        lambda: dynid.identify(wrong, "ur5", PAPER),
        lambda: dynid.validate(alone.estimate, wrong),
    ):
        with pytest.raises(InputError, match=r"cannot be radians.*numpy\.radians"):
            call()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: dynid.identify(None, "ur5"), "'records' of dynid.identify; got NoneType; allowed"),
        (lambda: dynid.identify("a", "ur5", {"preset": "paper"}), "'settings'.*got dict; allowed"),
        (lambda: dynid.analyze("ur5", terms=None), "'terms'.*NoneType; allowed: str or Friction"),
        (lambda: dynid.analyze("ur5", samples="9"), "'samples'.*str; allowed: a whole number, 0"),
        (lambda: dynid.analyze("ur5", seed=-1), "'seed'.*-1; allowed: a whole number, 0 or more"),
        (lambda: dynid.load_robot("ur5", mount=45), "'mount' of dynid.load_robot; got 45; allowed"),
        (lambda: dynid.check(None), "'design' of dynid.check; got NoneType"),
        (lambda: dynid.run_design("a.json", ""), r"output: .*\*\.parquet"),
    ],
)
def test_arguments_of_a_wrong_kind_are_refused_by_name(
    call: Callable[[], Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        call()


def test_sequences_and_arrays_of_numbers_are_arguments(tmp_path: Path) -> None:
    table = np.column_stack([np.arange(40) / 100, np.zeros((40, 12))])
    names = ["t", *(f"q{j}" for j in range(6)), *(f"current{j}" for j in range(6))]
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=",".join(names), comments="")
    for gains in (np.ones(6), [1] * 6, (1.0,) * 6):
        found = dynid.read_recording([tmp_path / "a.csv"], robot="ur5", gains=gains)
        assert found.metadata.drive_gains == (1.0,) * 6


class Own(dynid.Estimator):
    """Returns what it is given."""

    def __init__(self, found: Any) -> None:
        self.found = found

    def fit(self, problem: dynid.IdentificationProblem) -> dynid.Fit:
        return self.found(problem)


def _fit(problem: dynid.IdentificationProblem, **changed: Any) -> dynid.Fit:
    r, n = problem.base.rank, 6
    right = {"values": np.ones(r), "noise": np.ones(n), "weights": np.ones(n)}
    return dynid.Fit(**{**right, "information": np.eye(r), **changed})


@pytest.mark.parametrize(
    ("estimator", "message", "preset"),
    [
        (
            Own(lambda _: np.zeros(3)),
            "Own.fit: returned no Fit; got ndarray; allowed: dynid.Fit",
            "paper",
        ),
        (
            Own(lambda p: _fit(p, values=np.ones(3))),
            r"Own.fit: values has the wrong shape.*\(3,\)",
            "paper",
        ),
        (Own(lambda p: _fit(p, noise=np.full(6, np.nan))), "Own.fit: noise is not finite", "paper"),
        pytest.param(
            Own(lambda p: _fit(p, noise=np.full(6, np.nan))),
            "Own.fit: noise is not finite",
            "best",
            marks=pytest.mark.long,
        ),
    ],
)
def test_an_estimator_of_ones_own_is_told_what_is_wrong(
    record: ExperimentRecord, estimator: Any, message: str, preset: str
) -> None:
    asked: list[str] = []
    settings = dynid.IdentifySettings(preset=preset, estimator=estimator)
    with pytest.raises(InputError, match=message):
        dynid.identify(record, "ur5", settings, progress=lambda word, _: asked.append(word))
    assert bool(asked) == (preset == "best")


@pytest.mark.parametrize(
    ("wrong", "option"),
    [
        ({"estimator": Own}, "--estimator"),
        ({"estimator": np.zeros(3)}, "--estimator"),
        ({"estimator": type("Nothing", (), {"fit": Own.fit})()}, "--estimator"),
        ({"terms": ["fc"]}, "--terms"),
        ({"terms": "fc,xx"}, "--terms"),
    ],
)
def test_settings_refuse_what_is_no_estimator_and_no_terms(
    wrong: dict[str, Any], option: str
) -> None:
    with pytest.raises(InputError) as caught:
        dynid.IdentifySettings(**wrong)
    assert caught.value.where == option


def test_names_stand_for_robots() -> None:
    assert dynid.analyze("ur5").base.rank == 52
    assert dynid.analyze("ur5").base.samples == 25
    assert np.isfinite(dynid.analyze("ur5").base.singular_values).all()


def test_a_clipped_torque_is_told_once(tmp_path: Path, record: ExperimentRecord) -> None:
    current = record.signals["current"].copy()
    top = 0.5 * np.abs(current[:, 1]).max()
    current[:, 1] = np.clip(current[:, 1], -top, top)
    names = [f"{word}{j}" for word in ("q", "current") for j in range(6)]
    table = np.column_stack([record.t, record.signals["q"], current])
    np.savetxt(
        tmp_path / "log.csv", table, delimiter=",", header=",".join(["t", *names]), comments=""
    )
    result = dynid.identify(dynid.read_recording(tmp_path / "log.csv", robot="ur5"), "ur5", PAPER)
    told = [finding.joints for finding in result.warnings if finding.kind == "saturated"]
    assert told == [(1,)]


def test_meshes_are_not_read_before_a_mistake_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Nothing that identifies needs collision bodies, and to decompose meshes takes seconds.
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("collision geometry was read")

    monkeypatch.setattr("dynid.robot.urdf_bodies.with_collision_geometry", refuse)
    arm, away = Path(__file__).parents[2] / "examples" / "robots" / "tx40.urdf", tmp_path / "a.csv"
    for job in (
        lambda: dynid.identify([], arm),
        lambda: open_records([away], arm),
        lambda: dynid.fit(arm, away, tmp_path / "fitted"),
    ):
        with pytest.raises(dynid.DynidError, match=r"at least one record|no such file"):
            job()
