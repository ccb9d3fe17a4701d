"""Scripts that no commit runs use names and arguments that the library has."""

from __future__ import annotations

import ast
import importlib
import inspect
import warnings
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
OURS = ("dynid", "urtwin")
SCRIPTS = sorted(
    path for folder in ("benchmarks", "examples") for path in (ROOT / folder).rglob("*.py")
)


def is_ours(name: str | None) -> bool:
    return name is not None and name.split(".")[0] in OURS


def imports_of(tree: ast.AST) -> tuple[dict[str, Any], list[str]]:
    """What a script's names of ours stand for, and those that are not there."""
    found: dict[str, Any] = {}
    missing: list[str] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in filter(lambda alias: is_ours(alias.name), node.names):
                module = importlib.import_module(alias.name)
                first = importlib.import_module(alias.name.split(".")[0])
                found[alias.asname or alias.name.split(".")[0]] = module if alias.asname else first
        elif isinstance(node, ast.ImportFrom) and is_ours(node.module):
            module = importlib.import_module(str(node.module))
            for alias in node.names:
                if hasattr(module, alias.name):
                    found[alias.asname or alias.name] = getattr(module, alias.name)
                else:
                    missing.append(f"{node.module}.{alias.name}")
    return found, missing


def resolved(node: ast.expr, found: dict[str, Any]) -> Any:
    """What a name, or an attribute of a module of ours, stands for; None where that is not ours."""
    if isinstance(node, ast.Name):
        return found.get(node.id)
    if isinstance(node, ast.Attribute):
        owner = resolved(node.value, found)
        if inspect.ismodule(owner) and is_ours(owner.__name__):
            return getattr(owner, node.attr)
    return None


def refusal(call: ast.Call, target: Any) -> str | None:
    """Why a target does not take the arguments of a call."""
    starred = any(isinstance(argument, ast.Starred) for argument in call.args)
    words = [keyword.arg for keyword in call.keywords]
    if not callable(target) or starred or None in words:
        return None
    try:
        signature = inspect.signature(target)
    except ValueError:  # compiled
        return None
    try:
        signature.bind(*call.args, **dict.fromkeys(filter(None, words)))
    except TypeError as error:
        return f"{ast.unparse(call.func)}: {error}"
    return None


def faults(source: str) -> list[str]:
    """Names and arguments of a script that the library does not have."""
    tree = ast.parse(source)
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        found, wrong = imports_of(tree)
        for node in ast.walk(tree):
            try:
                if isinstance(node, ast.Attribute):
                    resolved(node, found)
                elif isinstance(node, ast.Call):
                    told = refusal(node, resolved(node.func, found))
                    wrong += [] if told is None else [told]
            except AttributeError as error:
                wrong.append(str(error))
    return wrong


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_script_uses_what_there_is(path: Path) -> None:
    assert faults(path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("source", "wrong"),
    [
        ("from dynid.core import no_such", "no_such"),
        ("import dynid\ndynid.no_such.x", "no_such"),
        ("import dynid\ndynid.load_robot('ur5', colour=1)", "colour"),
        ("from dynid import validate\nvalidate('estimate.json')", "record"),
    ],
)
def test_what_is_not_there_is_told(source: str, wrong: str) -> None:
    told = faults(source)
    assert told
    assert all(wrong in line for line in told)
