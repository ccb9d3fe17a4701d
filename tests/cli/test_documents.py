"""What the documents say is true: examples run, commands and names exist."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import shlex
from functools import partial, reduce
from importlib.util import find_spec
from pathlib import Path

import pytest
from cli_runs import COMMANDS, LISTED, Run

import dynid
from dynid.core import CODES, KINDS
from dynid.settings import LimitSettings
from dynid.workflow import given_limits

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
DOCUMENTS = {path.name: path.read_text() for path in sorted(ROOT.glob("docs/*.md"))}
HEADING = re.compile(r"^#+ (.*)$", re.MULTILINE).findall
DATA = ROOT.parent / "shared" / "data"


def commands_in(text: str) -> list[list[str]]:
    return [
        shlex.split(line, comments=True)[1:]
        for line in re.findall(r"^ {4}(dynid .*)$", text, re.MULTILINE)
    ]


def test_every_public_name_loads_from_where_it_lives() -> None:
    assert sorted(dynid.__all__) == dynid.__all__
    tree = ast.parse(Path(dynid.__file__).read_text())
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    seen_by_types = {
        item.name: node.module
        for node in imports
        if (node.module or "").startswith("dynid.")
        for item in node.names
    }
    assert set(seen_by_types) == set(dynid.__all__) - {"__version__"}
    for name, face in seen_by_types.items():
        assert inspect.unwrap(getattr(dynid, name)) is getattr(importlib.import_module(face), name)
    assert set(dynid.__all__) <= set(dir(dynid))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        dynid.nothing  # noqa: B018


def test_the_ten_lines_of_the_readme_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    short = partial(dynid.DesignSettings, harmonics=4, period_s=6.0)
    monkeypatch.setattr(dynid, "DesignSettings", short)
    (code,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    lines = [line for line in code.splitlines() if line.strip()]
    assert len(lines) <= 11  # ten and the import
    exec(compile(code, "README.md", "exec"), {})
    printed = capsys.readouterr().out
    assert "52 of 78 parameters" in printed
    assert "This result can be used" in printed


@pytest.mark.parametrize(
    "words",
    [words for text in (README, *DOCUMENTS.values()) for words in commands_in(text)],
    ids=lambda words: " ".join(words)[:60],
)
def test_commands_of_the_documents_exist_with_their_options(run: Run, words: list[str]) -> None:
    assert words[0] in LISTED
    text = run(words[0], "--help").out
    for option in (word for word in words if word.startswith("-")):
        assert re.search(rf"(?<![\w-]){option}(?![\w-])", text), option
    for robot in (word for word in words if word.startswith("examples/")):
        assert (ROOT / robot).is_file()


@pytest.mark.skipif(not DATA.exists(), reason=f"the recordings are not at {DATA}")
@pytest.mark.parametrize(
    "words", [w for w in commands_in(README) if "$DATA" in " ".join(w)], ids=lambda w: w[-1]
)
def test_imports_of_the_readme_work(
    run: Run, words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    target = tmp_path / words[-1]
    places = [word.replace("$DATA", str(DATA)) for word in words[:-1]]
    data = run(*places, target, "--json").json()
    assert data["samples"] > 1000
    assert dynid.read_record(target).samples == data["samples"]


def test_every_document_is_listed_in_the_readme() -> None:
    assert {name for name in DOCUMENTS if f"(docs/{name})" not in README} == set()


def test_every_option_that_is_written_in_words_exists(run: Run) -> None:
    known = {
        option
        for command in (*COMMANDS, "bench estimators", "bench verdicts")
        for option in re.findall(r"--[a-z][\w-]*", run(*command.split(), "--help").out)
    }
    for name, text in {"README.md": README, **DOCUMENTS}.items():
        if name == "proof.md":  # written by a script, with commands of other programs
            continue
        for option in re.findall(r"`[^`\n]*?(--[a-z][\w-]*)", text):
            assert option in known, f"{name}: {option}"


def test_the_scene_of_the_documents_is_one(tmp_path: Path) -> None:
    (scene,) = re.findall(r"```json\n(.*?)```", DOCUMENTS["excitation.md"], re.DOTALL)
    (tmp_path / "scene.json").write_text(scene)
    robot = dynid.load_robot("ur5")
    limits = given_limits(LimitSettings(scene=tmp_path / "scene.json"))
    assert limits.constraints(robot).settings.scene is not None


@pytest.mark.skipif(not find_spec("mujoco"), reason="needs MuJoCo")
def test_the_controller_of_the_documents_starts(capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", DOCUMENTS["controller.md"], re.DOTALL)
    exec(compile(code, "controller.md", "exec"), {})
    assert "127." in capsys.readouterr().out


def test_temperatures_of_the_documents(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    plainly = partial(dynid.identify_temperature, settings=dynid.IdentifySettings(preset="paper"))
    monkeypatch.setattr(dynid, "identify_temperature", plainly)
    (code,) = re.findall(r"```python\n(.*?)```", DOCUMENTS["models.md"], re.DOTALL)
    robot = dynid.load_robot("ur5")
    motion = dynid.random_excitation(robot.limits, seed=1)
    names = {"cold": 20.0, "warmer": 30.0, "warm": 40.0}
    for seed, (name, degC) in enumerate(names.items()):
        record = dynid.simulate_recording(robot, motion, seed=seed, thermal=degC)
        dynid.write_record(record, f"{name}.parquet")
    space = {"dynid": dynid}
    exec(compile(code, "models.md", "exec"), space)
    assert space["estimate"].model.robot.name == "ur5"  # type: ignore[attr-defined]


def test_links_of_the_documents_lead_somewhere() -> None:
    for document in (*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")):
        for link in re.findall(r"\]\(([^)]+)\)", document.read_text()):
            if not link.startswith("http"):
                place, _, heading = link.partition("#")
                target = document.parent / place if place else document
                assert target.exists(), f"{document.name}: {link}"
                if heading:
                    words = [h.lower().replace(" ", "-") for h in HEADING(target.read_text())]
                    assert heading in words, f"{document.name}: {link}"


def test_names_in_the_table_of_equations_exist() -> None:
    names = re.findall(r"`(dynid\.[\w.]+)`", (ROOT / "docs" / "equations.md").read_text())
    assert len(names) > 15
    for name in names:
        module, attributes = name, []
        while True:
            try:
                found = importlib.import_module(module)
                break
            except ModuleNotFoundError:
                module, _, last = module.rpartition(".")
                attributes.insert(0, last)
        assert attributes, name
        reduce(getattr, attributes, found)


def test_every_warning_is_explained() -> None:
    text = DOCUMENTS["warnings.md"]
    assert set(re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE)) == CODES
    assert [kind for kind in KINDS if f"`{kind}`" not in text] == []


def test_the_robot_file_of_the_documents_is_one(tmp_path: Path) -> None:
    (text,) = re.findall(
        r"```toml\n(.*?)```", (ROOT / "docs" / "robot-files.md").read_text(), re.DOTALL
    )
    path = tmp_path / "myarm.toml"
    path.write_text(text)
    assert dynid.load_robot(path).mount == "wall"


def test_the_documents_are_finished() -> None:
    assert not re.search(r"^[A-Z]{4,}$", README, re.MULTILINE)


def test_the_version_is_the_same_everywhere() -> None:
    assert f"version: {dynid.__version__}" in (ROOT / "CITATION.cff").read_text()
