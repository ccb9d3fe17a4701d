"""Recordings that no algebra should see, named before it does."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from dynid.core import InputError, RecordError
from dynid.recording import ExperimentRecord, check_channels, checked_records, read_recording


def record(seed: int = 0, **changes) -> ExperimentRecord:
    rng = np.random.default_rng(seed)
    t = np.arange(200) / 125
    signals = {"q": np.sin(t[:, None] + np.arange(3)), "current": rng.normal(size=(200, 3))}
    return ExperimentRecord(t=t, signals={**signals, **changes})


def damaged(quantity: str, joint: int, value) -> ExperimentRecord:
    signals = {name: values.copy() for name, values in record().signals.items()}
    signals.setdefault("qd", np.cos(record().t[:, None] + np.arange(3)))
    signals[quantity][:, joint] = value
    return record(**signals)


def test_a_sound_recording_has_no_findings() -> None:
    (kept,) = checked_records([record()])
    assert kept.problems == ()


@pytest.mark.parametrize(("quantity", "value"), [("current", -0.0), ("current", 1.5), ("q", 0.2)])
def test_dead_channels_are_named_by_joint(quantity: str, value: float) -> None:
    (kept,) = checked_records([damaged(quantity, 1, value)])
    (found,) = kept.problems
    assert (found.kind, found.joints, found.value) == ("dead_channel", (1,), value)
    assert "is -0" not in found.text
    # Once is enough.
    assert checked_records([kept])[0].problems == (found,)


def test_a_locked_joint_is_no_dead_channel() -> None:
    signals = {name: values.copy() for name, values in record().signals.items()}
    signals["q"][:, 2] = 0.4
    assert check_channels(record(**signals)) == ()


@pytest.mark.parametrize("scale", [1e-200, 1e-12, 1e9, 1e200])
@pytest.mark.parametrize("quantity", ["effort", "current"])
def test_absurd_scales_are_refused_by_channel(quantity: str, scale: float) -> None:
    values = np.random.default_rng(0).normal(size=(200, 3))
    values[:, 2] *= scale
    with pytest.raises(RecordError, match=f"{quantity} of joint 3 reaches"):
        checked_records([record(**{quantity: values})])


def test_positions_of_another_world_are_refused() -> None:
    with pytest.raises(RecordError, match="q of joint 1 reaches"):
        checked_records([damaged("q", 0, np.linspace(0, 1e100, 200))])


@pytest.mark.parametrize("value", [0.0, 3.0])
def test_torques_that_never_change_are_refused(value: float) -> None:
    with pytest.raises(RecordError, match="the same on every row"):
        checked_records([record(current=np.full((200, 3), value))])


def test_the_same_recording_counts_once() -> None:
    one, other = record(), record(seed=1)
    kept = checked_records([one, other, record()])
    assert len(kept) == 2
    (found,) = kept[0].problems
    assert (found.kind, found.value) == ("duplicate_record", 3.0)
    assert kept[1].problems == ()
    # The same run in two files of other names has the same numbers.
    renamed = replace(one, metadata=replace(one.metadata, origin="copy.csv", input_hash="5e"))
    assert len(checked_records([one, renamed])) == 1
    # So it has with other stamps.
    shifted = replace(renamed, t=(one.t + 1.7e9) - 1.7e9)
    assert (shifted.t != one.t).any()
    assert len(checked_records([one, shifted])) == 1


def test_time_that_hardly_moves_is_refused_in_one_line(tmp_path: Path) -> None:
    t = np.arange(500) * 8e-203
    q = np.sin(np.arange(500) / 40)
    path = tmp_path / "x.csv"
    np.savetxt(
        path, np.column_stack([t, q, np.cos(q)]), delimiter=",", header="t,q,tau", comments=""
    )
    with pytest.raises(RecordError, match="hardly increase"):
        read_recording(path)


@pytest.mark.parametrize(
    ("t", "what"),
    [
        (np.arange(200) * np.timedelta64(8, "ms"), "not dates or durations"),
        (list(np.arange(200) * np.timedelta64(8, "ms")), "not dates or durations"),
        (np.ma.masked_equal(np.arange(200) / 125, 1.0), "masked"),
        (np.arange(200) / 125 + 0j, "real numbers"),
    ],
)
def test_numbers_are_real_unmasked_and_no_dates(t: ArrayLike, what: str) -> None:
    with pytest.raises(InputError, match=f"t .*{what}"):
        ExperimentRecord(t=t, signals=record().signals)


@pytest.mark.parametrize("q", [np.zeros(200), np.zeros((3, 200))])
def test_the_shape_that_positions_should_have_is_told(q: np.ndarray) -> None:
    with pytest.raises(InputError, match=r"allowed: \(200, any\)"):
        ExperimentRecord(t=np.arange(200) / 125, signals={"q": q})


@pytest.mark.parametrize(
    "wrong",
    [
        {"signals": None},
        {"signals": [np.zeros((2, 3))]},
        {"signals": {"q": None}},
        {"signals": {"q": 3.0}},
        {"signals": {"q": [[1, 2], [3]]}},
        {"channels": None},
        {"metadata": None},
        {"metadata": {"robot": "ur5"}},
    ],
)
def test_recordings_of_other_types_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(InputError, match=r"signals|channels|metadata|q "):
        ExperimentRecord(**{"t": [0.0, 1.0], "signals": {"q": np.zeros((2, 3))}} | wrong)


class Table:
    """As one of pandas: an array, and a sequence of its column names."""

    def __array__(self, dtype: object = None, copy: object = None) -> np.ndarray:
        return np.zeros((3, 2))

    def __iter__(self) -> Iterator[str]:
        return iter("ab")


@pytest.mark.parametrize("table", [Table(), {"a": [0.0], "b": [1.0]}, np.zeros((3, 2))])
def test_numbers_in_memory_are_no_files(table: Any) -> None:
    with pytest.raises(RecordError, match=r"no file.*got .*ExperimentRecord"):
        read_recording(table)
