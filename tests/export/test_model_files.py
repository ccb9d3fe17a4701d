import ast
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from known_exports import (
    WIDE_TERMS,
    estimate_of,
    heavy_arm,
    mixed_chain,
    parameters_of,
    with_load,
    with_ripple,
)

from dynid.cli.app import main
from dynid.export import ExportModel, completed_model
from dynid.export.generated_code import c_code, c_prefix, c_safe, number, python_code
from dynid.export.writing import FORMATS, model_from_json, model_to_json
from dynid.identification import write_estimate
from dynid.regressor import parse_terms
from dynid.robot import load_robot

UR5 = load_robot("ur5")


@pytest.fixture(scope="module")
def heavy() -> ExportModel:
    robot, terms = heavy_arm(), with_ripple(with_load(WIDE_TERMS, 6), 6)
    return completed_model(estimate_of(robot, parameters_of(robot, 1, terms), terms))[0]


def test_json_comes_back_as_it_was(heavy: ExportModel) -> None:
    back = model_from_json(json.loads(json.dumps(model_to_json(heavy), allow_nan=False)))
    for name in ("inertials", "width", "stribeck_velocity", "shares", "load"):
        np.testing.assert_array_equal(getattr(back, name), getattr(heavy, name))
    for symbol, values in heavy.terms.items():
        np.testing.assert_array_equal(back.terms[symbol], values)
    for name in ("motors", "physical", "worst", "origin"):
        assert getattr(back, name) == getattr(heavy, name)
    assert back.robot.counterbalances == heavy.robot.counterbalances
    assert back.ripples == heavy.ripples
    assert len(back.ripples) == 2
    assert back.terms["Fl"].any()
    assert back.robot.joint_names == heavy.robot.joint_names


@pytest.mark.parametrize(
    ("name", "prefix"),
    [
        ("ur5", "ur5"),
        ("KR 300 R2500/Ultra", "kr_300_r2500_ultra"),
        ("7dof", "robot_7dof"),
        ("_x", "x"),
        ("", "robot"),
        ("Größe*/", "gr_e"),
    ],
)
def test_prefixes_are_identifiers(name: str, prefix: str) -> None:
    assert c_prefix(name) == prefix
    assert prefix.isidentifier()


def test_numbers_read_back_exactly() -> None:
    for value in (0.0, -0.0, 1.0, -3.0, 1e300, 1e-300, 0.1 + 0.2, 5e-324, 123456789.0):
        assert float(number(value)) == value
        assert any(mark in number(value) for mark in ".e")


def test_the_head_of_a_header_names_what_there_is_to_call(heavy: ExportModel) -> None:
    text = c_code(heavy)
    head, code = text.split("*/", 1)
    listed = set(re.findall(r"\bur5_\w+", head.split("To call:")[1]))
    defined = set(re.findall(r"static inline void (ur5_\w+)\(", code))
    assert listed < defined
    assert "ur5_observer_step" in listed
    assert "Link with -lm" in head


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain text, 1/2", "plain text, 1/2"),
        ("a */ b /* c", "a * / b / * c"),
        ("line\nline\ttab\0", "line?line?tab?"),
        ("Größe \u2028", "Gr??e ?"),
        ("@MARK@ $x \\", "?MARK? ?x ?"),
    ],
)
def test_comments_of_c_hold_plain_characters_alone(text: str, shown: str) -> None:
    assert c_safe(text) == shown


def test_names_cannot_break_out_of_comments_and_strings(heavy: ExportModel) -> None:
    evil = '*/ int x; /* """ \\ \n import os @ $ <a> &'
    robot = replace(heavy.robot, name=evil, joint_names=tuple(f"{evil}{k}" for k in range(6)))
    model = replace(heavy, robot=robot)
    header = c_code(model, evil)
    assert header.count("*/ int x") == 0
    tree = ast.parse(python_code(model, evil))
    found = [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]
    assert [ast.unparse(node) for node in found] == ["import numpy as np"]
    names = next(node for node in tree.body if isinstance(node, ast.Assign))
    assert ast.literal_eval(names.value) == robot.joint_names


@pytest.fixture(scope="module")
def estimate_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("estimates") / "ur5.json"
    write_estimate(estimate_of(UR5, parameters_of(UR5, 0)), path)
    return path


@pytest.mark.parametrize("to", FORMATS)
def test_the_command_writes_and_verifies(
    to: str, estimate_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "model"
    assert main(["export", str(estimate_path), "--to", to, "-o", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["file"] == str(out)
    assert 0.0 <= told["verified"]["max_torque_difference"] < (1e-6 if to == "mjcf" else 1e-9)
    assert told["verified"]["states"] == 200
    assert told["physical"] is True
    # A motor's inertia has no place in URDF.
    expected = ["extrapolated"] if to == "urdf" else []
    assert [warning["code"] for warning in told["warnings"]] == expected
    assert out.stat().st_size > 1000


def test_the_command_says_what_is_not_physical(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parameters = parameters_of(UR5, 0)
    parameters[75] = -0.2
    path, out = tmp_path / "e.json", tmp_path / "model"
    write_estimate(estimate_of(UR5, parameters), path)
    assert main(["export", str(path), "--to", "urdf", "-o", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [one["code"] for one in told["warnings"]] == ["not_physical", "extrapolated"]
    assert told["left_out"] == ["motor inertias"]
    assert main(["export", str(path), "--to", "mjcf", "-o", str(out), "--force"]) == 1
    assert "not physical" in capsys.readouterr().err


def test_the_command_says_when_much_friction_is_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    terms = with_ripple(parse_terms("fc,fv,im"), 6)
    path, out = tmp_path / "e.json", tmp_path / "model"
    for size, codes in ((0.01, []), (3.0, ["extrapolated"])):
        parameters = parameters_of(UR5, 0, terms)
        parameters[-2:] = size
        write_estimate(estimate_of(UR5, parameters, terms), path)
        for to in ("mjcf", "c"):
            words = ["export", str(path), "--to", to, "-o", str(out), "--json", "--force"]
            assert main(words) == 0
            told = json.loads(capsys.readouterr().out)
            assert [one["code"] for one in told["warnings"]] == (codes if to == "mjcf" else [])
            assert told["left_out"] == (["torque ripple of gears"] if to == "mjcf" else [])
            if told["warnings"]:
                assert "at joint 1" in told["warnings"][0]["message"]


def test_the_command_refuses_bad_usage(
    estimate_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "model")
    given = str(estimate_path)
    for words in (
        ["export", given, "--to", "sdf", "-o", out],
        ["export", given, "-o", out],
        ["export", given, "--to", "c"],
        ["export", given, "--to", "c", "-o", given],
        ["export", given, "--to", "c", "-o", str(tmp_path / "none" / "x.h")],
        ["export", str(tmp_path / "none.json"), "--to", "c", "-o", out],
    ):
        assert main(words) == 2, words
        assert capsys.readouterr().err.strip()
    assert list(tmp_path.iterdir()) == []


def test_people_read_what_was_done(
    estimate_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "arm.urdf"
    assert main(["export", str(estimate_path), "--to", "urdf", "-o", str(out)]) == 0
    text = capsys.readouterr().out
    assert "Verified with pinocchio" in text
    assert "Not representable in urdf: motor inertias." in text


def test_a_sliding_chain_has_its_header(tmp_path: Path) -> None:
    model = completed_model(estimate_of(mixed_chain(), parameters_of(mixed_chain(), 0)))[0]
    text = c_code(model)
    assert "MIXED_CHAIN_CO_4_JOINTS 4" in text
    assert text.count("*/ 4") == 0
