"""Recordings that stay in their files: the same answers as in memory, and memory that does not
grow with them."""

from __future__ import annotations

import importlib
import json
import tracemalloc
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

import dynid
from dynid.cli.ask import Interrupted, exit_code_of, kept_in
from dynid.core import InputError, JobError, RecordError, Workers
from dynid.identification import IdentificationProblem, PanelRows, PassPlan, RowSums, sum_rows
from dynid.identification.problem import joint_factors
from dynid.recording import ExperimentRecord, open_stored
from dynid.reduction import reduce_model
from dynid.regressor import FrictionTerms, Gear, InverseDynamicModel, LoadFriction, TorqueRipple
from dynid.robot import load_robot
from dynid.signals import LongSignals, ProcessingSettings, TorqueFilter, process
from dynid.workflow import IdentifySettings
from dynid.workflow.long_recordings import fit_long

identify_module = importlib.import_module("dynid.workflow.identify")
long_module = importlib.import_module("dynid.workflow.long_recordings")
UR5 = load_robot("ur5")
NOISE = np.array([2.0, 2.5, 1.5, 0.4, 0.4, 0.3])
BY_QR, BY_GRAM = 1e-9, 1e-6
"""Asked equality with the in-memory way."""
STD = 0.3
"""The same of standard deviations, for parts of a few seconds."""
PAPER = IdentifySettings(preset="paper", cutoff_hz=5.0)


def recording(
    kind: str = "uniform",
    seconds: float = 12.0,
    rate: float = 500.0,
    moves: slice = slice(0, 6),
) -> ExperimentRecord:
    """A UR5 that does not repeat itself, with torques of a random model and noise.

    Some of its joints may move alone.
    """
    random = np.random.default_rng(3)
    t = np.arange(int(seconds * rate)) / rate
    if "jitter" in kind:
        t = t + random.uniform(-0.2, 0.2, len(t)) / rate
    if "gap" in kind:
        t = t[(t < 0.4 * seconds) | (t > 0.44 * seconds)]
    series = dynid.random_excitation(UR5.limits, seed=1, period_s=seconds, harmonics=8)
    motion = series.evaluate(t)
    moving = np.isin(np.arange(6), np.arange(6)[moves])
    q = motion.q[0] + (motion.q - motion.q[0]) * moving
    dq, ddq = motion.dq * moving, motion.ddq * moving
    model = InverseDynamicModel(robot=UR5)
    parameters = random.uniform(0.1, 2.0, len(model.columns))
    torque = model.inverse_dynamics(q, dq, ddq, parameters)
    noisy = torque + NOISE * random.normal(size=torque.shape)
    return ExperimentRecord(t=t, signals={"q": q, "qd": dq, "effort": noisy})


@pytest.fixture(autouse=True)
def short_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is minutes in use is a second here."""
    monkeypatch.setattr(long_module, "PART", 1000)
    monkeypatch.setattr(long_module, "CHOOSING_ROWS", 5400)
    monkeypatch.setattr(long_module, "FEWEST_PIECES", 3)
    monkeypatch.setattr(long_module, "LOOKED_AT_ROWS", 2000)
    monkeypatch.setattr("dynid.recording.store.ROWS_A_GROUP", 4096)
    monkeypatch.setattr("dynid.workflow.choosing.LONG_RECORD", 0)


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("long") / "a.parquet"
    dynid.write_record(recording(), path)
    return path


def force(monkeypatch: pytest.MonkeyPatch, factors: bool) -> None:
    coarsest = 0.0 if factors else 1e30
    monkeypatch.setattr("dynid.identification.fitting.COARSEST", coarsest)


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param("uniform", marks=pytest.mark.long),
        pytest.param("gap", marks=pytest.mark.long),
        "jitter and gap",
    ],
)
@pytest.mark.parametrize("factors", [True, False])
def test_the_same_parameters_as_in_memory(
    kind: str, factors: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    force(monkeypatch, factors)
    record = recording(kind)
    dynid.write_record(record, tmp_path / "a.parquet")
    held = identify_module.fit_records([record], UR5, PAPER).estimate
    found = fit_long([open_stored(tmp_path / "a.parquet", UR5)], UR5, PAPER).estimate
    assert found.samples == held.samples < record.samples / 2
    away = np.linalg.norm(found.values - held.values) / np.linalg.norm(held.values)
    assert away < (BY_QR if factors else BY_GRAM)
    np.testing.assert_allclose(found.noise, held.noise, rtol=BY_GRAM)
    np.testing.assert_allclose(found.naive_std, held.naive_std, rtol=BY_GRAM)
    assert found.condition_number == pytest.approx(held.condition_number, rel=BY_GRAM)
    # Scores of the part's fit, windows that end with each part.
    assert np.median(np.abs(found.std / held.std - 1)) < STD
    assert found.assessment is not None
    assert held.assessment is not None
    np.testing.assert_allclose(
        found.assessment.this_motion, held.assessment.this_motion, rtol=BY_GRAM
    )
    np.testing.assert_allclose(found.assessment.anywhere, held.assessment.anywhere, rtol=0.02)
    np.testing.assert_allclose(found.motion.lower, held.motion.lower, atol=1e-9)
    assert ("factors" if factors else "products") in found.choices[-1]


def test_friction_of_all_rows_follows_positions_without_their_noise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    record, passed = recording(rate=125.0), list[LongSignals]()
    noisy = record.signals["q"] + 1e-3 * np.random.default_rng(4).normal(size=(record.samples, 6))
    plain = long_module._run_pass

    def seen(everything: list[LongSignals], *given: Any, **named: Any) -> Any:
        passed.extend(everything)
        return plain(everything, *given, **named)

    monkeypatch.setattr(long_module, "_run_pass", seen)
    fit_long([replace(record, signals={**record.signals, "q": noisy})], UR5, PAPER)
    held = passed[0].samples(0, 1000).friction_q
    turns = [
        np.count_nonzero(np.diff(q, axis=0)[1:] * np.diff(q, axis=0)[:-1] < 0)
        for q in (held, noisy[:1000])
    ]
    assert turns[0] < 0.2 * turns[1]


@pytest.mark.usefixtures("undiagnosed_once")
def test_one_cut_off_suits_the_fastest_recording() -> None:
    slow = recording(seconds=24.0, rate=125.0)
    signals = {**slow.signals, "qd": 4 * slow.signals["qd"]}
    fast = ExperimentRecord(t=slow.t / 4, signals=signals)
    paper, known = IdentifySettings(preset="paper"), list[float]()
    for one in (slow, fast):
        cutoff_hz = identify_module.fit_records([one], UR5, paper).estimate.settings.cutoff_hz
        assert cutoff_hz is not None
        known.append(cutoff_hz)
    found = fit_long([slow, fast], UR5, paper).estimate.settings.cutoff_hz
    assert found == pytest.approx(known[1], rel=0.2)
    assert known[1] > 1.5 * known[0]


def test_several_recordings_and_a_window(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    force(monkeypatch, True)
    records = [recording(rate=125.0), recording("gap", 16.0, rate=125.0)]
    settings = replace(PAPER, cutoff_hz=8.0, start_s=1.0, stop_s=10.5, estimator="wls")
    files = [tmp_path / f"{k}.parquet" for k in range(2)]
    for record, file in zip(records, files, strict=True):
        dynid.write_record(record, file)
    held = identify_module.fit_records(records, UR5, settings).estimate
    found = fit_long([open_stored(file, UR5) for file in files], UR5, settings).estimate
    assert found.samples == held.samples
    assert found.settings.stop_s == 10.5
    assert np.linalg.norm(found.values / held.values - 1) < 1e-7


def test_recordings_that_each_move_other_joints_are_left_out_by_halves() -> None:
    """A whole one took the friction of its joints along."""
    records = [recording(seconds=24.0, rate=125.0, moves=slice(k, k + 3)) for k in (0, 3)]
    told = [
        fit(records, UR5, PAPER).estimate.assessment
        for fit in (identify_module.fit_records, fit_long)
    ]
    held, found = (np.linalg.norm(one.anywhere) for one in told if one is not None)
    assert found == pytest.approx(held, rel=0.3)


def test_a_disk_without_room_for_the_pass_does_not_end_it(
    stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise JobError("the file cannot be written")

    monkeypatch.setattr(long_module, "SAVE_S", 0.0)
    monkeypatch.setattr("dynid.core.write_arrays", full)
    partial = tmp_path / "e.json.partial"
    assert fit_long([open_stored(stored, UR5)], UR5, PAPER, partial=partial).estimate.samples
    assert not partial.exists()


def test_an_interrupted_pass_goes_on(
    stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(long_module, "SAVE_S", 0.0)
    monkeypatch.setattr(long_module, "CHOOSING_SHARE", 0.0)
    keep, source = tmp_path / "e.json.partial", open_stored(stored, UR5)
    whole = fit_long([source], UR5, PAPER).estimate
    done: list[Any] = []
    plain = long_module._sum_part

    def counted(part: Any) -> RowSums:
        done.append(part)
        return plain(part)

    def tell(what: str, share: float) -> None:
        if what == "summing all rows" and share > 0.5:
            raise KeyboardInterrupt

    monkeypatch.setattr(long_module, "_sum_part", counted)
    with pytest.raises(KeyboardInterrupt):
        fit_long([source], UR5, PAPER, partial=keep, progress=tell)
    first = len(done)
    assert keep.is_file()
    said: list[str] = []
    again = fit_long(
        [source], UR5, PAPER, partial=keep, progress=lambda what, _: said.append(what)
    ).estimate
    assert "summing the rows that an interrupted pass left" in said
    assert len(done) - first < first
    np.testing.assert_array_equal(again.values, whole.values)
    np.testing.assert_array_equal(again.covariance, whole.covariance)
    assert not keep.exists()
    # What another pass left, or anybody else, is not taken up.
    keep.write_bytes(b"no sums")
    np.testing.assert_array_equal(
        fit_long([source], UR5, PAPER, partial=keep).estimate.values, whole.values
    )


def test_workers_that_finish_in_any_order(stored: Path) -> None:
    source = open_stored(stored, UR5)
    alone = fit_long([source], UR5, PAPER).estimate
    with ThreadPoolExecutor(2) as pool:
        beside = fit_long([source], UR5, PAPER, beside=Workers(pool, 2)).estimate
    np.testing.assert_array_equal(beside.values, alone.values)


def test_memory_does_not_grow_with_the_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Eight stretches fill up with all regions as the recording grows, and then no more.
    monkeypatch.setattr("dynid.identification.selection.regions.BLOCKS", 2)
    record = recording()

    def peak(copies: int) -> int:
        path = tmp_path / f"{copies}.parquet"
        signals = {k: np.concatenate([v] * copies) for k, v in record.signals.items()}
        t = np.arange(copies * record.samples) / 500.0
        dynid.write_record(ExperimentRecord(t=t, signals=signals), path)
        source = open_stored(path, UR5)
        tracemalloc.start()
        fit_long([source], UR5, PAPER)
        found = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return found

    assert peak(6) < 1.1 * peak(2)


def test_the_command_and_the_function(
    stored: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for module in ("recording", "recording.stored"):
        monkeypatch.setattr(importlib.import_module(f"dynid.{module}"), "LONG", 3000)
    monkeypatch.setattr(identify_module, "diagnose", lambda *_: ())
    monkeypatch.chdir(tmp_path)
    from dynid.cli.app import main

    words = ["--preset", "paper", "--cutoff", "5", "--robot", "ur5", "--json"]
    assert main(["identify", str(stored), "-o", "e.json", *words, "--validate-to", "4"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert "long recordings" in told["choices"][-1]
    assert told["validation"]["samples"] > 1000
    assert sorted(item.name for item in tmp_path.iterdir()) == ["e.json"]
    # One in memory is summed in the same way.
    held = dynid.identify(recording(), UR5, PAPER).estimate
    np.testing.assert_array_equal(dynid.read_estimate("e.json").values, held.values)


def test_what_cannot_be_done_is_said(stored: Path, tmp_path: Path) -> None:
    source = open_stored(stored, UR5)
    with pytest.raises(InputError, match="needs all rows at once"):
        fit_long([source], UR5, replace(PAPER, estimator="irls"))
    with pytest.raises(InputError, match="too high"):
        fit_long([source], UR5, replace(PAPER, cutoff_hz=400.0))
    whole = recording()
    effort = whole.signals["effort"].copy()
    effort[:, 2] = 1.5
    dead = tmp_path / "dead.parquet"
    signals = {**whole.signals, "effort": effort}
    dynid.write_record(ExperimentRecord(t=whole.t, signals=signals), dead)
    with pytest.raises(InputError, match="same on every row; got elbow_joint"):
        fit_long([open_stored(dead, UR5)], UR5, PAPER)
    broken = tmp_path / "broken.parquet"
    content = bytearray(stored.read_bytes())
    content[len(content) // 2] ^= 255
    broken.write_bytes(content)
    with pytest.raises(RecordError, match="damaged"):
        fit_long([open_stored(broken, UR5)], UR5, PAPER)


def friction(kind: str) -> FrictionTerms:
    if kind in ("plain", "smoothed"):
        return FrictionTerms()
    gear = Gear(joint=1, waves=(100.0,), speed=2.0, powers=1)
    return FrictionTerms(
        presliding=(1e-3, 0.0, 0.0, 0.0, 0.0, 2e-3) if kind == "presliding" else (),
        load=LoadFriction(joints=(1,), parameters=(1.0,) * 60) if kind == "load" else None,
        ripples=(TorqueRipple(joint=1, gears=(gear,), coefficients=(0.5, 0.1)),)
        if kind == "ripple"
        else (),
    )


@pytest.mark.parametrize("kind", ["plain", "presliding", "load", "ripple", "smoothed"])
def test_sums_are_those_of_all_columns(kind: str) -> None:
    model = InverseDynamicModel(robot=UR5, friction=friction(kind))
    base = reduce_model(model)
    passed = TorqueFilter(cutoff_hz=30.0, order=2) if kind == "smoothed" else None
    settings = ProcessingSettings(cutoff_hz=5.0, decimate=True, torque_filter=passed)
    problem = IdentificationProblem(base=base, samples=process(recording(), UR5, settings))
    plan = PassPlan(
        base=base,
        values=np.zeros(base.rank),
        weights=np.ones(6),
        lag=5,
        regions=None,
        stretches=8,
        factors=False,
    )
    used = problem.samples.rows
    inner = slice(used.start, used.start + problem.blocks * problem.samples.block)
    sums = sum_rows(PanelRows(base), plan, problem.samples, inner, 0, problem.blocks)
    factors = joint_factors(problem)
    wanted = factors.transpose(0, 2, 1) @ factors
    blocks, keys = sums.blocks()
    assert keys.shape == (2, 8)
    np.testing.assert_allclose(blocks.products.sum(axis=1), wanted, rtol=1e-9, atol=1e-6)


def test_panels_use_their_memory_again() -> None:
    base = reduce_model(InverseDynamicModel(robot=UR5))
    samples = process(recording(), UR5, ProcessingSettings(cutoff_hz=5.0))
    panels, part = PanelRows(base), slice(100, 200)
    (_, first), (_, second) = (next(panels.chunks(samples, part)) for _ in range(2))
    assert all(map(np.shares_memory, first, second))


def test_row_groups_let_parts_be_read(tmp_path: Path) -> None:
    rows = 140_000
    q = np.cumsum(np.ones((rows, 2)), axis=0)
    record = ExperimentRecord(t=np.arange(rows) / 500.0, signals={"q": q, "effort": -q})
    dynid.write_record(record, tmp_path / "a.parquet")
    assert pq.read_metadata(tmp_path / "a.parquet").num_row_groups == 35
    with pytest.raises(RecordError, match="2 joints"):
        open_stored(tmp_path / "a.parquet", UR5)
    source = open_stored(tmp_path / "a.parquet")
    for first, last in ((10, 50), (131_000, 131_100), (40_000, 40_001 + 1), (139_990, rows)):
        part = source.part(first, last, ("effort",))
        np.testing.assert_array_equal(part.t, record.t[first:last])
        np.testing.assert_array_equal(part.signals["effort"], -q[first:last])


def test_ctrl_c_says_where_a_pass_goes_on_from(tmp_path: Path) -> None:
    kept = tmp_path / "e.json.partial"

    def job() -> int:
        with kept_in(kept):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        job()
    kept.touch()
    with pytest.raises(Interrupted, match=r"settings of .*e\.json\.partial goes on from it"):
        job()
    assert exit_code_of(job) == 130
