import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dynid.core import InputError, JsonFields, MotionBounds, provenance
from dynid.trajectory import (
    FAMILY_NAMES,
    BSpline,
    FourierQuintic,
    FourierSeries,
    JointMotion,
    MotionSequence,
    Quintic,
    Repetition,
    Trajectory,
    motion_family,
    read_trajectory,
    trajectory_from_json,
    trajectory_to_json,
    write_trajectory,
)

NUMBERS = st.floats(-1e3, 1e3)
"""With the periods below, accelerations stay under the 1e9 beyond which no file is read."""
LIMITS = MotionBounds(
    lower=[-1.0, np.nan], upper=[1.0, 2.0], velocity=[np.nan, 3.0], acceleration=[np.nan, np.nan]
)


def written(path: Path) -> Path:
    series = FourierSeries(period=10.0, offset=[0.1, 0.2], a=np.ones((2, 3)), b=np.zeros((2, 3)))
    made = provenance(inputs={"a.urdf": "00"}, settings={"method": "ga"}, seed=5)
    write_trajectory(series, path, robot="ur5", limits=LIMITS, provenance=made)
    return path


def test_numbers_of_numpy_are_written(tmp_path: Path) -> None:
    zero = np.zeros((1, 1))
    part = FourierSeries(period=2.0, offset=np.zeros(1), a=zero, b=zero)
    spline = BSpline(travel_time=2.0, control=np.zeros((1, 8)), degree=np.int64(5))
    for motion in (Repetition(part=part, times=np.int64(3)), spline):
        write_trajectory(motion, tmp_path / "a.json")
        assert read_trajectory(tmp_path / "a.json").trajectory == motion


@given(st.data(), st.integers(1, 7), st.integers(1, 6), st.floats(0.1, 1e4), st.text(max_size=20))
@settings(max_examples=20)
def test_round_trip_is_exact(
    tmp_path_factory: pytest.TempPathFactory,
    data: st.DataObject,
    joints: int,
    harmonics: int,
    period: float,
    robot: str,
) -> None:
    draw = lambda *shape: data.draw(hnp.arrays(np.float64, shape, elements=NUMBERS))  # noqa: E731
    series = FourierSeries(
        period=period, offset=draw(joints), a=draw(joints, harmonics), b=draw(joints, harmonics)
    )
    limits = MotionBounds(
        lower=np.full(joints, np.nan),
        upper=draw(joints),
        velocity=np.full(joints, np.pi),
        acceleration=np.full(joints, np.nan),
    )
    made = provenance(settings={"harmonics": harmonics}, seed=None)
    path = tmp_path_factory.mktemp("files") / "t.json"
    write_trajectory(series, path, robot=robot, limits=limits, provenance=made)
    back = read_trajectory(path)
    assert back.robot == robot
    assert back.provenance == made
    assert isinstance(back.trajectory, FourierSeries)
    assert back.trajectory.period == series.period
    for name in ("offset", "a", "b"):
        np.testing.assert_array_equal(getattr(back.trajectory, name), getattr(series, name))
    for name in ("lower", "upper", "velocity", "acceleration"):
        np.testing.assert_array_equal(getattr(back.limits, name), getattr(limits, name))
    assert [one.name for one in path.parent.iterdir()] == ["t.json"]


def spoil(path: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
    return path


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(kind="dynid.analysis"), "no other trajectory; got dynid.analysis"),
        (lambda d: d.update(kind=None, format="dynid"), "no other trajectory; got dynid[;.]"),
        (lambda d: d.pop("kind"), "no other trajectory; got a JSON object of another kind"),
        (lambda d: d.update(version=3), "unknown file version"),
        (lambda d: d.update(robot=3), "robot must be a text"),
        (lambda d: d["trajectory"].pop("period"), "period is missing"),
        (lambda d: d["trajectory"].update(period=True), "period must be a number"),
        (lambda d: d["trajectory"].update(period=-1), "period must be positive"),
        (lambda d: d["trajectory"].update(offset=[1e9, 0.0]), "position; .* below 1e"),
        (
            lambda d: d["trajectory"].update(period=1e-3, a=[[3e4] * 3] * 2),
            "acceleration; .* below",
        ),
        (lambda d: d["trajectory"].update(period=10**400), "period is too large"),
        (lambda d: d["trajectory"].update(offset=[0.1]), "wrong shape"),
        (lambda d: d["trajectory"].update(a=[[1, 2], [1]]), "rows of one length"),
        (lambda d: d["trajectory"].update(a=[]), "wrong shape"),
        (lambda d: d["trajectory"].update(a=[["1", 2, 3], [1, 2, 3]]), "a must be a number"),
        (lambda d: d["trajectory"].update(a=[[float("nan")] * 3] * 2), "NaN is not a JSON number"),
        (lambda d: d["trajectory"].update({k: [[0.0] * 3000] * 2 for k in "ab"}), "3000.* 200"),
        (lambda d: d["trajectory"].update(b=5), "b must be a list"),
        (lambda d: d.pop("limits"), "limits must be a JSON object"),
        (lambda d: d["limits"].update(lower=[5, None]), "above the upper"),
        (lambda d: d["limits"].pop("velocity"), "limits.velocity is missing"),
        (
            lambda d: d.update(
                limits={k: [None] for k in ("lower", "upper", "velocity", "acceleration")}
            ),
            "joints of the limits",
        ),
        (lambda d: d["provenance"].update(seed="x"), "seed must be a whole number"),
        (lambda d: d["provenance"].update(versions=[]), "provenance.versions"),
        (lambda d: d.pop("provenance"), "provenance must be"),
    ],
)
def test_reading_names_what_is_wrong(
    tmp_path: Path, change: Callable[[dict[str, Any]], object], message: str
) -> None:
    path = spoil(written(tmp_path / "t.json"), change)
    with pytest.raises(InputError, match=message) as caught:
        read_trajectory(path)
    assert caught.value.where == str(path)


@pytest.mark.parametrize("text", ["", "[1, 2]", "{", "\x00", "[" * 100_000])
def test_reading_something_else(tmp_path: Path, text: str) -> None:
    path = tmp_path / "t.json"
    path.write_text(text)
    with pytest.raises(InputError):
        read_trajectory(path)


def test_a_missing_file_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_trajectory(tmp_path / "none.json")
    (tmp_path / "latin.json").write_bytes(b'{"kind": "\xe9"}')
    with pytest.raises(InputError, match="not JSON"):
        read_trajectory(tmp_path / "latin.json")


def test_writing_refuses_and_leaves_the_old_file(tmp_path: Path) -> None:
    path = written(tmp_path / "t.json")
    before = path.read_text()
    series = read_trajectory(path).trajectory
    bad = provenance(settings={"x": float("nan")})
    with pytest.raises(InputError, match="JSON values"):
        write_trajectory(series, path, robot="ur5", limits=LIMITS, provenance=bad)
    one = MotionBounds(lower=[0.0], upper=[1.0], velocity=[1.0], acceleration=[1.0])
    with pytest.raises(InputError, match="joints of the limits"):
        write_trajectory(series, path, robot="ur5", limits=one, provenance=provenance())
    assert path.read_text() == before
    assert [one.name for one in tmp_path.iterdir()] == ["t.json"]


def every_kind() -> list[Trajectory]:
    generator = np.random.default_rng(0)
    members: list[Trajectory] = []
    for name in FAMILY_NAMES:
        family = motion_family(name, 3.0, 4)
        members.append(
            family.trajectory(
                generator.normal(size=2), generator.normal(size=(2, family.free_count))
            )
        )
    start = members[0].evaluate([0.0]).q[0]
    return [
        *members,
        FourierQuintic(
            period=2.0, start=[0.1, 0.2], goal=[1.0, -1.0], a=np.ones((2, 2)), b=np.ones((2, 2)) / 3
        ),
        BSpline(travel_time=2.0, control=generator.normal(size=(2, 7)), degree=3),
        MotionSequence(
            parts=(
                Quintic(start=[0.0, 0.0], goal=start, travel_time=1 / 3),
                Repetition(part=members[0], times=3),
            )
        ),
    ]


@pytest.mark.parametrize("kind", range(len(every_kind())))
def test_every_kind_comes_back_as_it_was(tmp_path: Path, kind: int) -> None:
    trajectory, path = every_kind()[kind], tmp_path / "t.json"
    write_trajectory(
        trajectory,
        path,
        robot="ur5",
        limits=LIMITS,
        provenance=provenance(),
        extra={"design": {"condition_number": 51.0}},
    )
    back = read_trajectory(path)
    assert type(back.trajectory) is type(trajectory)
    assert back.trajectory.duration == trajectory.duration
    assert back.extra == {"design": {"condition_number": 51.0}}
    t = np.linspace(-0.5, trajectory.duration + 0.5, 60)
    for name in ("q", "dq", "ddq"):
        np.testing.assert_array_equal(
            getattr(back.trajectory.evaluate(t), name), getattr(trajectory.evaluate(t), name)
        )


def test_files_of_the_first_version_are_still_read(tmp_path: Path) -> None:
    path = written(tmp_path / "t.json")
    document = json.loads(path.read_text())
    flat = {**document, **document["trajectory"], "version": 1}
    del flat["trajectory"]
    path.write_text(json.dumps(flat))
    back = read_trajectory(path)
    assert isinstance(back.trajectory, FourierSeries)
    np.testing.assert_array_equal(back.trajectory.a, np.ones((2, 3)))
    assert back.extra == {}
    path.write_text(json.dumps({**flat, "type": "chirp"}))
    with pytest.raises(InputError, match="no kind of trajectory"):
        read_trajectory(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d["parts"][1].update(times=2.5), r"parts\[1\].times must be a whole number"),
        (lambda d: d["parts"][1].update(times=0), "number of repetitions"),
        (lambda d: d["parts"][1].update(times=True), "whole number"),
        (lambda d: d["parts"][1].update(times=10**9), "number of repetitions"),
        (lambda d: d["parts"][1].pop("part"), r"parts\[1\].part must be a JSON object"),
        (lambda d: d.update(parts=[]), "needs a part"),
        (lambda d: d.update(parts=[1]), r"parts\[0\] must be a JSON object"),
        (lambda d: d.update(parts={}), "list of objects"),
        (lambda d: d["parts"].reverse(), "jumps"),
        (lambda d: d["parts"][0].update(travel_time=0), "travel time"),
        (lambda d: d["parts"][0].update(goal=[9.0, 9.0]), "the position jumps"),
        (lambda d: d["parts"][0].update(type=None), r"parts\[0\].type must be a text"),
    ],
)
def test_damaged_sequences_are_named(
    change: Callable[[dict[str, Any]], object], message: str
) -> None:
    document = json.loads(json.dumps(trajectory_to_json(every_kind()[-1])))
    change(document)
    with pytest.raises(InputError, match=message):
        trajectory_from_json(JsonFields(document))


def test_no_file_nests_without_end() -> None:
    document = trajectory_to_json(every_kind()[0])
    for _ in range(500):
        document = {"type": "repetition", "times": 1, "part": document}
    with pytest.raises(InputError, match="sequences within sequences"):
        trajectory_from_json(JsonFields(document))


def test_writing_refuses_foreign_kinds_and_keys(tmp_path: Path) -> None:
    class Foreign(Trajectory):
        joints, duration = 2, 1.0

        def evaluate(self, t: object) -> JointMotion:
            raise NotImplementedError

    with pytest.raises(InputError, match="no file form"):
        write_trajectory(
            Foreign(), tmp_path / "t.json", robot="ur5", limits=LIMITS, provenance=provenance()
        )
    with pytest.raises(InputError, match="the file's own"):
        write_trajectory(
            every_kind()[0],
            tmp_path / "t.json",
            robot="ur5",
            limits=LIMITS,
            provenance=provenance(),
            extra={"limits": {}},
        )
    assert list(tmp_path.iterdir()) == []
