"""Every text of the sources that a user may read, to be read as a whole.

    python benchmarks/proof/messages.py > messages.txt

Texts of more than three words that are not docstrings, by module; what is filled in stands in
braces. Markup, style sheets and scripts are left out.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
SOURCES = (ROOT / "src" / "dynid", ROOT / "urtwin" / "src" / "urtwin")
WORDS = 4
MARKUP = ("<", "{{", ";}", "\n")


def text(node: ast.AST) -> str | None:
    """A text, its fields as their expressions in braces."""
    match node:
        case ast.Constant(value=str(value)):
            return value
        case ast.JoinedStr(values=parts):
            fields = (
                "{" + ast.unparse(part.value) + "}" if isinstance(part, ast.FormattedValue) else ""
                for part in parts
            )
            return "".join(field or text(p) or "" for field, p in zip(fields, parts, strict=True))
    return None


def texts(node: ast.AST) -> Iterator[str]:
    """Those of a tree in their order, docstrings left out."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant):
            continue
        found = text(child)
        if found is None:
            yield from texts(child)
        elif len(found.split()) >= WORDS and not any(mark in found for mark in MARKUP):
            yield found


def main() -> None:
    """Print them."""
    count = 0
    for source in SOURCES:
        for path in sorted(source.rglob("*.py")):
            found = list(dict.fromkeys(texts(ast.parse(path.read_text(encoding="utf-8")))))
            count += len(found)
            if found:
                print(f"\n== {path.relative_to(source.parent)}", *found, sep="\n")
    print(f"\n{count} texts")


if __name__ == "__main__":
    main()
