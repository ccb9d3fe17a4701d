"""Public names have docstrings; fields of what `dynid` itself exports have theirs, with shapes."""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
import re
from pathlib import Path

import pytest

import dynid
from dynid.core import Value

FACES = ["dynid", *(f"dynid.{m.name}" for m in pkgutil.iter_modules(dynid.__path__) if m.ispkg)]


def public(face: str) -> dict[str, object]:
    module = importlib.import_module(face)
    names = getattr(module, "__all__", dir(module))
    found = {name: getattr(module, name) for name in names if not name.startswith("__")}
    return {name: value for name, value in found.items() if not inspect.ismodule(value)}


@pytest.mark.parametrize("face", FACES)
def test_public_names_are_documented(face: str) -> None:
    bare: list[str] = []
    for name, value in public(face).items():
        if inspect.isfunction(value) and not value.__doc__:
            bare.append(name)
        if not inspect.isclass(value):
            continue
        # The docstring that dataclasses make is the signature.
        if not value.__doc__ or value.__doc__.startswith(f"{value.__name__}("):
            bare.append(name)
        for member, own in vars(value).items():
            code = own.fget if isinstance(own, property) else getattr(own, "__func__", own)
            inherited = any(getattr(base, member, None) for base in value.__mro__[1:])
            if inspect.isfunction(code) and member[0] != "_" and not (code.__doc__ or inherited):
                bare.append(f"{name}.{member}")
    assert bare == []


def test_fields_of_exported_classes_are_documented_with_shapes() -> None:
    bare: list[str] = []
    seen = 0
    for name, value in public("dynid").items():
        if not inspect.isclass(value):
            continue
        tree = ast.parse(Path(inspect.getfile(value)).read_text(encoding="utf-8"))
        (own,) = (c for c in tree.body if isinstance(c, ast.ClassDef) and c.name == value.__name__)
        text = ast.get_docstring(own) or ""
        for line, after in zip(own.body, [*own.body[1:], None], strict=True):
            if not isinstance(line, ast.AnnAssign) or not isinstance(line.target, ast.Name):
                continue
            field, kind = line.target.id, ast.unparse(line.annotation)
            assert "Array" not in kind or issubclass(value, Value), f"{name} cannot be compared"
            is_text = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
            said = str(after.value.value) if is_text else ""
            if isinstance(line.value, ast.Call):
                # The help of its option.
                said = said or " ".join(
                    str(word.value)
                    for word in line.value.args[1:]
                    if isinstance(word, ast.Constant)
                )
            named = re.search(rf"\b{field}\b.*", text)
            said = said or (named[0] if named else "")
            seen += 1
            if field[0] != "_" and (
                not said or ("Array" in kind and not re.search(r"[(\[]", said))
            ):
                bare.append(f"{name}.{field}: {kind}")
    assert bare == []
    assert seen > 200


def test_files_that_documents_name_are_there() -> None:
    """Those of an older commit are named with it."""
    root = Path(__file__).parents[2]
    gone: list[str] = []
    for page in [*root.glob("*.md"), *root.glob("docs/*.md"), *root.glob("urtwin/*.md")]:
        for name, commit in re.findall(
            r"`([\w.-]+/[\w./-]*\.py|src/[\w/]+)`( of commit)?", page.read_text()
        ):
            places = [root, page.parent, root / "src" / "dynid", root / "urtwin" / "src" / "urtwin"]
            if not commit and not any((place / name).exists() for place in places):
                gone.append(f"{page.name}: {name}")
    assert not gone
