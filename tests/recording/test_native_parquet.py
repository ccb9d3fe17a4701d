from __future__ import annotations

import copy
import os
import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dynid.core import CODES, Finding, InputError, RecordError
from dynid.recording import (
    JOINT_QUANTITIES,
    ExperimentRecord,
    RecordMetadata,
    open_record,
    open_stored,
    read_record,
    read_recording,
    write_record,
)
from dynid.recording.store import KEY
from dynid.robot import load_robot

FINITE = st.floats(allow_nan=False, allow_infinity=False)
TEXT = st.text(max_size=12)


@st.composite
def records(draw) -> ExperimentRecord:
    samples = draw(st.integers(2, 12))
    joints = draw(st.integers(1, 4))
    stamps = draw(
        st.lists(
            st.floats(-1e9, 1e9, allow_subnormal=True),
            min_size=samples,
            max_size=samples,
            unique_by=float,
        )
    )
    others = draw(st.sets(st.sampled_from(JOINT_QUANTITIES[1:]), max_size=4))
    shape = (samples, joints)
    names = draw(st.sampled_from([(), tuple(f"joint {k}" for k in range(joints))]))
    gains = draw(st.none() | st.lists(FINITE, min_size=joints, max_size=joints).map(tuple))
    metadata = RecordMetadata(
        robot=draw(st.none() | TEXT),
        joint_names=names,
        origin=draw(TEXT),
        format=draw(TEXT),
        clock=draw(st.sampled_from(["recorded", "header", "receive", "rate"])),
        drive_gains=gains,
        dropped_rows=draw(st.integers(0, 10**6)),
        input_hash=draw(TEXT),
        extra=draw(st.dictionaries(TEXT, TEXT, max_size=3)),
    )
    channel = hnp.arrays(np.float64, samples, elements=st.floats(allow_nan=True))
    return ExperimentRecord(
        t=np.sort(np.array(stamps)),
        signals={
            name: draw(hnp.arrays(np.float64, shape, elements=FINITE))
            for name in ("q", *sorted(others))
        },
        metadata=metadata,
        problems=tuple(
            Finding(code, draw(TEXT))
            for code in draw(st.lists(st.sampled_from(sorted(CODES)), max_size=3))
        ),
        channels=draw(
            st.dictionaries(st.sampled_from(["mode", "q_0", "t", ""]) | TEXT, channel, max_size=3)
        ),
    )


def assert_same(a: ExperimentRecord, b: ExperimentRecord) -> None:
    assert a.t.tobytes() == b.t.tobytes()
    assert list(a.signals) == list(b.signals)
    for name, value in a.signals.items():
        assert (
            np.ascontiguousarray(b.signals[name]).tobytes() == np.ascontiguousarray(value).tobytes()
        )
    assert a.metadata == b.metadata
    assert a.problems == b.problems
    assert list(a.channels) == list(b.channels)
    for name, value in a.channels.items():
        np.testing.assert_array_equal(b.channels[name], value)


@settings(max_examples=25, suppress_health_check=[HealthCheck.too_slow])
@given(record=records())
def test_round_trip_is_exact(record: ExperimentRecord, tmp_path_factory) -> None:
    path = tmp_path_factory.getbasetemp() / "round_trip.parquet"
    write_record(record, path, force=True)
    assert_same(record, read_record(path))
    assert_same(record, copy.deepcopy(record))


def small_record(**changes: object) -> ExperimentRecord:
    t = np.arange(200) / 100
    q = np.sin(t)[:, None] * np.array([1.0, 2.0])
    return ExperimentRecord(
        t=t, signals={"q": q, "current": 3 * q}, metadata=RecordMetadata(origin="here")
    )


def test_columns_and_units_can_be_read_by_others(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    write_record(small_record(), path)
    table = pq.read_table(path)
    assert table.column_names == ["t", "q_0", "q_1", "current_0", "current_1"]
    assert b'"current": "A"' in table.schema.metadata[KEY]


def test_nothing_is_left_beside_the_file(tmp_path: Path) -> None:
    write_record(small_record(), tmp_path / "run.parquet")
    assert os.listdir(tmp_path) == ["run.parquet"]


def test_failed_write_keeps_the_old_file(tmp_path: Path, monkeypatch) -> None:
    path = tmp_path / "run.parquet"
    write_record(small_record(), path)
    before = path.read_bytes()

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(InputError, match="nothing is replaced unasked"):
        write_record(small_record(), path)
    with pytest.raises(KeyboardInterrupt):
        write_record(small_record(), path, force=True)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["run.parquet"]


def test_unwritable_place_is_one_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        write_record(small_record(), tmp_path / "no" / "folder" / "run.parquet")


def test_foreign_parquet_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "foreign.parquet"
    pq.write_table(pa.table({"a": [1.0, 2.0]}), path)
    with pytest.raises(RecordError, match="not a dynid recording"):
        read_record(path)


def test_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="no such file"):
        read_record(tmp_path / "none.parquet")
    with pytest.raises(RecordError, match="this is a folder"):
        read_record(tmp_path)


def test_changed_numbers_are_noticed(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    write_record(small_record(), path)
    table = pq.read_table(path)
    changed = table.set_column(1, "q_0", pa.array(table.column("q_0").to_numpy() + 1e-9))
    pq.write_table(changed, path)
    with pytest.raises(RecordError, match="changed or damaged"):
        read_record(path)


def test_changed_description_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    write_record(small_record(), path)
    table = pq.read_table(path)
    text = table.schema.metadata[KEY].replace(b'"origin": "here"', b'"origin": "there"')
    pq.write_table(table.replace_schema_metadata({KEY: text}), path)
    with pytest.raises(RecordError, match="changed or damaged"):
        read_record(path)


@pytest.mark.parametrize(
    "description",
    [b"{", b"[]", b"{}", b'{"schema": 99}', b'{"schema": 1, "joints": "x"}', b"\xff\xfe"],
)
def test_damaged_description_is_one_error(tmp_path: Path, description: bytes) -> None:
    path = tmp_path / "run.parquet"
    write_record(small_record(), path)
    table = pq.read_table(path)
    pq.write_table(table.replace_schema_metadata({KEY: description}), path)
    with pytest.raises(RecordError):
        read_record(path)


def test_another_version_is_refused_in_parts_too(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    write_record(small_record(), path)
    table = pq.read_table(path)
    text = re.sub(rb'"schema": \d+', b'"schema": 99', table.schema.metadata[KEY])
    pq.write_table(table.replace_schema_metadata({KEY: text}), path)
    for read in (read_record, lambda file: open_stored(file, load_robot("ur5"))):
        with pytest.raises(RecordError, match="version"):
            read(path)


@pytest.mark.parametrize(("prefix", "known"), [("", True), ("left_", True), ("my_", False)])
def test_joints_by_name_where_the_recording_was_made_without_its_robot(
    tmp_path: Path, prefix: str, known: bool
) -> None:
    """Drivers sort joints by letter and write a prefix before their names."""
    robot = load_robot("ur5")
    places = np.argsort(robot.joint_names)
    given = tuple(f"{prefix}{robot.joint_names[k]}" for k in places)
    names = given if known else tuple(f"{prefix}{k}" for k in range(6))
    q = np.linspace(0, 1, 30)[:, None] * np.arange(6)
    record = ExperimentRecord(
        t=np.arange(30) / 125,
        signals={"q": q, "effort": q + 1},
        metadata=RecordMetadata(joint_names=names, drive_gains=tuple(np.arange(1.0, 7.0))),
    )
    write_record(record, tmp_path / "run.parquet")
    expected = q[:, np.argsort(places)] if known else q
    found = read_recording(tmp_path / "run.parquet", robot=robot)
    stored = open_stored(tmp_path / "run.parquet", robot)
    part = stored.part(0, 30, ["effort"])
    for own in (found, open_record(record, robot), part):
        np.testing.assert_array_equal(own.signals["q"], expected)
    assert found.metadata.drive_gains == stored.metadata.drive_gains
    assert found.metadata.joint_names == robot.joint_names
    told = [problem.text for problem in found.problems]
    assert told == [problem.text for problem in stored.problems]
    assert len(told) == (0 if known else 1), told
    # Once is enough.
    assert open_record(found, robot).problems == found.problems
