"""What the house promises of its own code, read from the code."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest
import yaml

import dynid

ROOT = Path(__file__).parents[2]
LONGEST = 500
"""Lines of a module."""
SPEAKING = "cli"
"""The one room that prints."""


Sources = dict[Path, list[ast.AST]]
"""Every module's nodes, the module itself first."""


@pytest.fixture(scope="module")
def sources() -> Sources:
    # Not where tests are collected: every worker would parse them.
    house = ROOT / "src" / "dynid"
    return {
        path.relative_to(house): list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        for path in sorted(house.rglob("*.py"))
    }


def calls(nodes: list[ast.AST], name: str) -> list[ast.Call]:
    return [
        node
        for node in nodes
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == name
    ]


def imported(nodes: list[ast.AST]) -> set[str]:
    found: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found.add(node.module.split(".")[0])
    return found


def test_there_is_a_house_to_look_at(sources: Sources) -> None:
    assert len(sources) > 100


def test_scipy_is_loaded_at_its_first_use(sources: Sources) -> None:
    # By `scipy_part`: one import at a module's top would make every command start 0.5 s later.
    assert {path for path, nodes in sources.items() if "scipy" in imported(nodes)} == set()


def test_only_the_command_line_prints(sources: Sources) -> None:
    # The controller's log prints too, into a stream that it is given.
    aloud = {
        path
        for path, nodes in sources.items()
        for call in calls(nodes, "print")
        if all(word.arg != "file" for word in call.keywords)
    }
    assert {path.parts[0] for path in aloud} == {SPEAKING}


def test_nothing_is_asserted_evaluated_or_unpickled(sources: Sources) -> None:
    for path, nodes in sources.items():
        assert not [node for node in nodes if isinstance(node, ast.Assert)], path
        assert not calls(nodes, "eval"), path
        assert not calls(nodes, "exec"), path
        assert not imported(nodes) & {"pickle", "marshal", "shelve", "random"}, path


def test_no_error_is_swallowed_unnamed(sources: Sources) -> None:
    for path, nodes in sources.items():
        for node in nodes:
            if isinstance(node, ast.ExceptHandler):
                assert node.type is not None, (path, node.lineno)
                broad = ast.unparse(node.type) in ("Exception", "BaseException")
                silent = all(isinstance(line, ast.Pass | ast.Continue) for line in node.body)
                assert not (broad and silent), (path, node.lineno)


def test_random_numbers_come_from_a_seed(sources: Sources) -> None:
    for path, nodes in sources.items():
        for node in nodes:
            if (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Attribute)
                and ast.unparse(node.func.value) == "np.random"
            ):
                assert node.func.attr in ("default_rng", "Generator"), (path, node.lineno)
                assert node.args, (path, node.lineno)


def test_modules_are_small_and_say_what_they_are(sources: Sources) -> None:
    for path, nodes in sources.items():
        lines = (ROOT / "src" / "dynid" / path).read_text(encoding="utf-8").count("\n")
        assert lines <= LONGEST, path
        tree = nodes[0]
        assert isinstance(tree, ast.Module)
        assert ast.get_docstring(tree), path
        assert path.stem not in ("utils", "helpers", "common"), path
        if path.name == "__init__.py" and len(path.parts) > 1:
            for node in tree.body[1:]:
                if path.parts[0] == "core":
                    break  # It loads NumPy when that is first needed.
                face = isinstance(node, ast.ImportFrom) and all(
                    name.asname == name.name for name in node.names
                )
                assert face, f"{path} holds more than the names of its package"


def test_the_version_is_the_same_everywhere() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == dynid.__version__
    assert citation["license"] == "Apache-2.0"
    assert "Apache License" in (ROOT / "LICENSE").read_text(encoding="utf-8")
    told = re.findall(r"^## \[(.+?)\]", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.M)
    assert told[0] in ("Unreleased", dynid.__version__)
