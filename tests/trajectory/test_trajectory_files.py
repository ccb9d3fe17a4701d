import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dynid.core.errors import InputError
from dynid.core.provenance import provenance
from dynid.trajectory.bounds import MotionBounds
from dynid.trajectory.files import read_trajectory, write_trajectory
from dynid.trajectory.fourier import FourierSeries

NUMBERS = st.floats(-1e6, 1e6)
LIMITS = MotionBounds(
    lower=[-1.0, np.nan], upper=[1.0, 2.0], velocity=[np.nan, 3.0], acceleration=[np.nan, np.nan]
)


def written(path: Path) -> Path:
    series = FourierSeries(period=10.0, offset=[0.1, 0.2], a=np.ones((2, 3)), b=np.zeros((2, 3)))
    made = provenance(inputs={"a.urdf": "00"}, settings={"method": "ga"}, seed=5)
    write_trajectory(path, series, robot="ur5", limits=LIMITS, provenance=made)
    return path


@given(st.data(), st.integers(1, 7), st.integers(1, 6), st.floats(1e-3, 1e4), st.text(max_size=20))
@settings(max_examples=60, deadline=None)
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
    write_trajectory(path, series, robot=robot, limits=limits, provenance=made)
    back = read_trajectory(path)
    assert back.robot == robot
    assert back.provenance == made
    assert back.series.period == series.period
    for name in ("offset", "a", "b"):
        np.testing.assert_array_equal(getattr(back.series, name), getattr(series, name))
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
        (lambda d: d.update(kind="dynid.estimate"), "not a trajectory file"),
        (lambda d: d.update(version=2), "unknown file version"),
        (lambda d: d.update(robot=3), "robot must be a text"),
        (lambda d: d.pop("period"), "period must be a number"),
        (lambda d: d.update(period=True), "period must be a number"),
        (lambda d: d.update(period=-1), "period must be positive"),
        (lambda d: d.update(period=10**400), "period is too large"),
        (lambda d: d.update(offset=[0.1]), "wrong shape"),
        (lambda d: d.update(a=[[1, 2], [1]]), "rows of one length"),
        (lambda d: d.update(a=[]), "rows of one length"),
        (lambda d: d.update(a=[["1", 2, 3], [1, 2, 3]]), "a must be a number"),
        (lambda d: d.update(a=[[float("nan")] * 3] * 2), "NaN is not a JSON number"),
        (lambda d: d.update(b=5), "b must be a list"),
        (lambda d: d.pop("limits"), "limits must be a JSON object"),
        (lambda d: d["limits"].update(lower=[5, None]), "above the upper"),
        (lambda d: d["limits"].pop("velocity"), "limits.velocity must be a list"),
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
    series = read_trajectory(path).series
    bad = provenance(settings={"x": float("nan")})
    with pytest.raises(InputError, match="JSON values"):
        write_trajectory(path, series, robot="ur5", limits=LIMITS, provenance=bad)
    one = MotionBounds(lower=[0.0], upper=[1.0], velocity=[1.0], acceleration=[1.0])
    with pytest.raises(InputError, match="joints of the limits"):
        write_trajectory(path, series, robot="ur5", limits=one, provenance=provenance())
    assert path.read_text() == before
    assert [one.name for one in tmp_path.iterdir()] == ["t.json"]
