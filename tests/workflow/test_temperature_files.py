"""Temperature laws as a file: the same estimates after reading, and how others read it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dynid
from dynid.cli.app import main
from dynid.core import InputError
from dynid.regressor import parse_terms

ROBOT = dynid.load_robot("ur5")
SETTINGS = dynid.IdentifySettings(preset="paper", terms=parse_terms("fc,fv,im", width=0.01))
PERIOD = 4.0
ROUNDING = 1e-12


def recorded(temperature_degC: float, motion: int) -> dynid.ExperimentRecord:
    series = dynid.random_excitation(
        ROBOT.limits, seed=motion, period_s=PERIOD, margin=0.8, acceleration=10.0
    )
    return dynid.simulate_recording(ROBOT, series, thermal=temperature_degC, seed=motion)


@pytest.fixture(scope="module")
def found() -> dynid.TemperatureIdentification:
    records = [recorded(degC, k) for k, degC in enumerate((20.0, 28.0, 36.0))]
    return dynid.identify_temperature(records, ROBOT, SETTINGS)


@pytest.fixture(scope="module")
def file(found: dynid.TemperatureIdentification, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("temperature") / "ur5_any.json"
    dynid.write_temperature(found, str(path))
    return path


@pytest.mark.parametrize("degC", [20.0, 31.0, [20.0, 22.0, 24.0, 26.0, 28.0, 60.0]])
def test_it_gives_the_same_estimates_after_reading(
    found: dynid.TemperatureIdentification, file: Path, degC: float | list[float]
) -> None:
    ours, read = found.estimate_at(degC), dynid.read_temperature(file).estimate_at(degC)
    np.testing.assert_allclose(read.values, ours.values, rtol=ROUNDING, atol=0)
    scale = np.sqrt(np.outer(np.diag(ours.covariance), np.diag(ours.covariance)))
    assert np.abs(read.covariance - ours.covariance).max() < ROUNDING * scale.max()
    np.testing.assert_allclose(read.naive_std, ours.naive_std, rtol=1e-9, atol=0)
    assert read.choices == ours.choices
    assert read.warnings == ours.warnings


def test_written_again_it_is_the_same_file(file: Path, tmp_path: Path) -> None:
    again = tmp_path / "again.json"
    dynid.write_temperature(dynid.read_temperature(file), again)
    first, second = json.loads(file.read_text()), json.loads(again.read_text())
    assert first["temperature"] == second["temperature"]
    assert [row["name"] for row in first["parameters"]] == [
        row["name"] for row in second["parameters"]
    ]


def test_readers_of_estimates_take_the_middle(
    found: dynid.TemperatureIdentification, file: Path
) -> None:
    middle = dynid.read_estimate(file)
    degC = [law.reference_degC for law in found.laws]
    np.testing.assert_array_equal(middle.values, found.estimate_at(degC).values)
    assert middle.choices[-1].startswith("friction at 28")


def test_the_commands_take_a_temperature(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record = tmp_path / "cold.parquet"
    dynid.write_record(recorded(20.0, 7), record)

    def error(*at: str) -> float:
        assert main(["validate", str(file), str(record), *at, "--json"]) == 0
        found: float = json.loads(capsys.readouterr().out)["moving"][
            "relative_error_overall_percent"
        ]
        return found

    assert error("--at", "20") < 0.7 * error()
    assert main(["validate", str(file), str(record), "--at", "90", "--json"]) == 0
    assert "extrapolated" in [
        item["kind"] for item in json.loads(capsys.readouterr().out)["findings"]
    ]
    far = ["export", str(file), "--to", "json", "-o", str(tmp_path / "far.json"), "--at", "90"]
    assert main([*far, "--json"]) == 0
    assert "extrapolated" in [
        item["kind"] for item in json.loads(capsys.readouterr().out)["findings"]
    ]
    models: list[dict[str, Any]] = []
    for degC in ("20", "36"):
        out = tmp_path / f"{degC}.json"
        assert main(["export", str(file), "--to", "json", "-o", str(out), "--at", degC]) == 0
        models.append(json.loads(out.read_text()))
    cold, warm = (np.array(model["terms"]["Fv"]) for model in models)
    assert (warm < 0.9 * cold).all()


def test_a_plain_estimate_knows_no_temperature(
    found: dynid.TemperatureIdentification, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plain = tmp_path / "plain.json"
    dynid.write_estimate(found.estimate_at(25.0), plain)
    with pytest.raises(InputError, match="without temperature laws"):
        dynid.read_temperature(plain)
    words = ["export", str(plain), "--to", "json", "-o", str(tmp_path / "x.json"), "--at", "20"]
    assert main(words) == 2
    assert "identify_temperature" in capsys.readouterr().err
    with pytest.raises(InputError, match=r"none\.json"):
        dynid.read_temperature(tmp_path / "none.json")
    for wrong in (float("nan"), [20.0, 30.0]):
        with pytest.raises(InputError, match="temperature"):
            found.estimate_at(wrong)


@pytest.mark.parametrize(
    ("spoil", "named"),
    [
        (lambda t: t.pop("laws"), "laws"),
        (lambda t: t["laws"].pop(), "laws"),
        (lambda t: t["laws"][0].update(slope=[1.0]), "laws"),
        (lambda t: t["laws"][0].update(gain=[[1.0]]), "laws"),
        (lambda t: t.update(covariance=[[1.0]]), "covariance"),
        (lambda t: t.update(temperature_degC=[[1.0]]), "temperature_degC"),
        (lambda t: t.update(naive="x"), "naive"),
    ],
)
def test_damage_is_named(
    file: Path, tmp_path: Path, spoil: Callable[[dict[str, Any]], object], named: str
) -> None:
    data = json.loads(file.read_text())
    spoil(data["temperature"])
    path = tmp_path / "damaged.json"
    path.write_text(json.dumps(data))
    with pytest.raises(InputError, match=named) as caught:
        dynid.read_temperature(path)
    assert caught.value.where == str(path)


def test_estimates_without_intervals_say_which_have_them(
    found: dynid.TemperatureIdentification,
) -> None:
    record = recorded(28.0, 1)
    shared = dynid.identify_shared(record, ROBOT, SETTINGS).estimates[0]
    pose = np.zeros((1, 6))
    for estimate in (found.estimate_at(20.0), shared):
        with pytest.raises(InputError, match="shared inertias or temperatures") as caught:
            estimate.predict(pose, pose, pose, interval=0.9)
        assert "dynid identify" in str(caught.value.next_step)
        assert "interval" not in dynid.validate(estimate, record).to_json()


@pytest.mark.parametrize("degC", ["warm", [[20.0], [20.0, 30.0]], float("nan"), [20.0, 30.0]])
def test_what_is_no_temperature_is_refused(
    found: dynid.TemperatureIdentification, degC: Any
) -> None:
    with pytest.raises(InputError, match="temperature"):
        found.estimate_at(degC)
