import json
import pickle
from copy import deepcopy
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from known_robot import identified, recording

from dynid.core import InputError
from dynid.identification import Estimate, read_estimate, write_estimate
from dynid.reduction import reduce_model
from dynid.validation import MomentumObserver, validate

pytestmark = pytest.mark.usefixtures("undiagnosed")


@pytest.fixture(scope="module")
def estimate() -> Estimate:
    return identified().estimate


def test_an_estimate_survives_its_file(estimate: Estimate, tmp_path: Path) -> None:
    path = tmp_path / "estimate.json"
    write_estimate(estimate, path)
    again = read_estimate(path)
    for copy in (again, pickle.loads(pickle.dumps(estimate)), deepcopy(estimate)):
        assert copy == estimate
        assert not copy.values.flags.writeable
        assert len(repr(copy)) < 2000
    assert again != replace(estimate, values=estimate.values + 1e-9)
    other = recording(1)
    np.testing.assert_array_equal(
        validate(again, other).predicted, validate(estimate, other).predicted
    )


def test_the_file_is_strict_json_without_pickles(estimate: Estimate, tmp_path: Path) -> None:
    path = tmp_path / "estimate.json"
    write_estimate(estimate, path)

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    data = json.loads(path.read_text(), parse_constant=refuse)
    assert data["format"] == "dynid-estimate"
    assert [row["name"] for row in data["parameters"]] == list(estimate.names)


def test_unwritable_and_missing_files_are_said(estimate: Estimate, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        write_estimate(estimate, tmp_path / "absent" / "estimate.json")
    with pytest.raises(InputError, match="cannot be read"):
        read_estimate(tmp_path / "absent.json")
    (tmp_path / "other.json").write_text('{"kind": "dynid.trajectory"}')
    with pytest.raises(InputError, match="not a dynid estimate"):
        read_estimate(tmp_path / "other.json")


@pytest.mark.parametrize("damages", [150, pytest.param(500, marks=pytest.mark.long)])
def test_damaged_files_are_refused_in_words(
    estimate: Estimate, damages: int, tmp_path: Path
) -> None:
    path = tmp_path / "estimate.json"
    write_estimate(estimate, path)
    good = path.read_bytes()
    generator = np.random.default_rng(0)
    messages: list[str] = []
    for _ in range(damages):
        data = bytearray(good)
        match generator.integers(3):
            case 0:
                for at in generator.integers(len(data), size=generator.integers(1, 20)):
                    data[at] = generator.integers(256)
            case 1:
                del data[generator.integers(len(data)) :]
            case _:
                at = generator.integers(len(data))
                del data[at : at + generator.integers(1, 200)]
        path.write_bytes(bytes(data))
        try:
            read_estimate(path)
        except InputError as error:
            messages.append(str(error))
    assert len(messages) > damages / 4
    assert not any("\n" in message for message in messages)


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [("seed", "x", "whole number"), ("versions", [], "JSON object"), ("created", None, "text")],
)
def test_where_an_estimate_comes_from_is_checked(
    estimate: Estimate, tmp_path: Path, key: str, value: object, said: str
) -> None:
    path = tmp_path / "estimate.json"
    write_estimate(estimate, path)
    data = json.loads(path.read_text())
    data["provenance"][key] = value
    path.write_text(json.dumps(data))
    with pytest.raises(InputError, match=rf"provenance\.{key} must be a {said}"):
        read_estimate(path)


def test_predictions_take_lists_and_refuse_what_does_not_fit(estimate: Estimate) -> None:
    motion = [np.linspace(-0.5, 0.5, 18).reshape(3, 6) for _ in range(3)]
    lists, state = [x.tolist() for x in motion], np.full((6, 3), 0.5)
    same = np.testing.assert_array_equal
    same(estimate.half_width(*lists), estimate.half_width(*motion))
    same(estimate.predict(*lists, state.tolist()), estimate.predict(*motion, state))
    for wrong in (state.T, state[:3], state[:, :2], "x", 1.0):
        for call in (estimate.predict, estimate.half_width):
            with pytest.raises(InputError, match="state"):
                call(*motion, wrong)
    model, values = estimate.model, estimate.standard_parameters()
    base = reduce_model(model)
    for call, good, wrong in (
        (partial(model.inverse_dynamics, *lists), values.tolist(), values[1:]),
        (partial(model.mass_matrix, lists[0]), values.tolist(), values[1:]),
        (base.from_standard, values.tolist(), values[1:]),
        (base.to_standard, estimate.values.tolist(), [1.0]),
        (model.known_torque, lists[0], motion[0][:, :4]),
        (partial(MomentumObserver(estimate=estimate).momentum, lists[0]), lists[1], lists[1][0]),
    ):
        call(good)
        with pytest.raises(InputError, match="wrong shape"):
            call(wrong)
    for level in ("0.9", 2, True, float("nan")):
        with pytest.raises(InputError, match="level"):
            estimate.predict(*motion, interval=level)
    for call in (estimate.half_width, estimate.predict, estimate.model.regressor):
        with pytest.raises(InputError, match="dq"):
            call(motion[0], motion[1][:2], motion[2])
        with pytest.raises(InputError, match="q "):
            call(*(x[0] for x in motion))
