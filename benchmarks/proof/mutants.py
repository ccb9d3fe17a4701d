"""Random mutants of the numerical packages against their packages' own tests.

    python benchmarks/proof/mutants.py [--number 30] [--seed 0] [--packages WORD...]

Each mutant changes one operator, comparison, number or condition in a copy of the source, and the
package's tests that take less than a second each run on it until the first fails. The mutants of a
checkout are fixed by its source and the seed.
"""

import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from shared.measuring import ROOT, run

PACKAGES = ("regressor", "reduction", "identification", "constraints")
LONGEST_TEST_S = 1.0
"""Slower tests are left out."""
PATIENCE, START_S, FIRST_S = 4.0, 60.0, 3600.0
"""A mutant may take so many times as long as the source, and longer by what compiling takes."""
_PAIRS = (
    (ast.Add, ast.Sub),
    (ast.Mult, ast.Div),
    (ast.Lt, ast.LtE),
    (ast.Gt, ast.GtE),
    (ast.Eq, ast.NotEq),
    (ast.And, ast.Or),
)
_SWAPS: dict[type[ast.AST], type[ast.AST]] = {
    **dict(_PAIRS),
    **{b: a for a, b in _PAIRS},
    ast.MatMult: ast.Mult,
}


@dataclass(frozen=True)
class Mutant:
    """One field of one node of a file's syntax tree that gets another value."""

    path: Path
    """Relative to the checkout."""
    tree: ast.AST
    node: ast.expr | ast.stmt
    field: str
    value: object

    @contextmanager
    def planted(self) -> Iterator[None]:
        """Change the tree for a while."""
        before = getattr(self.node, self.field)
        setattr(self.node, self.field, self.value)
        try:
            yield
        finally:
            setattr(self.node, self.field, before)

    def __str__(self) -> str:
        before = ast.unparse(self.node).partition("\n")[0]
        with self.planted():
            after = ast.unparse(self.node).partition("\n")[0]
        return f"{self.path}:{self.node.lineno}: {before} -> {after}"


def sites(path: Path) -> Iterator[Mutant]:
    """Every mutant of one file; annotations, messages and docstrings are left alone."""
    tree = ast.parse((ROOT / path).read_bytes())

    def walk(node: ast.AST) -> Iterator[Mutant]:
        match node:
            case ast.Raise() | ast.Import() | ast.ImportFrom():
                return
            case ast.BinOp(op=op) | ast.BoolOp(op=op) if type(op) in _SWAPS:
                yield Mutant(path, tree, node, "op", _SWAPS[type(op)]())
            case ast.Compare(ops=[op]) if type(op) in _SWAPS:
                yield Mutant(path, tree, node, "ops", [_SWAPS[type(op)]()])
            case ast.Constant(value=bool() as value):
                yield Mutant(path, tree, node, "value", not value)
            case ast.Constant(value=int() | float() as value):
                yield Mutant(path, tree, node, "value", value + 1 if value in (0, 1) else 2 * value)
            case ast.If(test=test) | ast.IfExp(test=test):
                yield Mutant(path, tree, node, "test", ast.UnaryOp(ast.Not(), test))
            case _:
                pass
        for name, value in ast.iter_fields(node):
            if name in ("annotation", "returns", "decorator_list"):
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from walk(child)

    yield from walk(tree)


def chosen(package: str, count: int, seed: int) -> list[Mutant]:
    """Mutants of a package, drawn at random."""
    folder = ROOT / "src" / "dynid" / package
    paths = [p.relative_to(ROOT) for p in sorted(folder.rglob("*.py")) if p.name != "__init__.py"]
    found = [mutant for path in paths for mutant in sites(path)]
    return random.Random(f"{seed} {package}").sample(found, min(count, len(found)))


def outcome(work: Path, words: list[str], limit_s: float = FIRST_S) -> int:
    """Exit code of pytest on the copy of the source."""
    variables = {"PYTHONPATH": str(work / "checkout" / "src"), "PYTHONDONTWRITEBYTECODE": "1"}
    options = ["-q", "-p", "no:cacheprovider", "-p", "no:xdist", "--no-header", "--tb=no"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    command, cache = [sys.executable, "-m", "pytest", *options, *words], str(work / "numba")
    own = os.environ | variables | {"NUMBA_CACHE_DIR": cache}
    return subprocess.run(
        command, cwd=work / "checkout", env=own, timeout=limit_s, check=False, **quiet
    ).returncode


def fast_tests(package: str, work: Path) -> list[str]:
    """Names of the package's tests that pass on the source as it is, in less than a second."""
    report = work / "report.xml"
    outcome(work, [f"tests/{package}", f"--junitxml={report}", "-o", "junit_family=xunit1"])
    return [
        f"{case.get('file')}::{case.get('name')}"
        for case in ET.parse(report).iter("testcase")
        if float(case.get("time", "9")) < LONGEST_TEST_S and not list(case)
    ]


def killed(mutant: Mutant, words: list[str], work: Path, limit_s: float) -> bool:
    """Whether a test fails, or nothing comes to an end, with a mutant in the source."""
    path = work / "checkout" / mutant.path
    source = path.read_bytes()
    try:
        with mutant.planted():
            path.write_text(ast.unparse(mutant.tree), encoding="utf-8")
        if b"compiled(" in source:
            # Numba's cache does not see changes in functions of other files.
            shutil.rmtree(work / "numba", ignore_errors=True)
        return outcome(work, words, limit_s) != 0
    except subprocess.TimeoutExpired:
        return True
    finally:
        path.write_bytes(source)
        if b"compiled(" in source:
            shutil.rmtree(work / "numba", ignore_errors=True)


def main(number: int = 30, seed: int = 0, packages: tuple[str, ...] = PACKAGES) -> None:
    """Run so many mutants a package and print who lived."""
    every: list[bool] = []
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        ignored = shutil.ignore_patterns(".git", ".venv", "runs", "__pycache__", "*_cache")
        shutil.copytree(ROOT, work / "checkout", ignore=ignored)
        (work / "shared").symlink_to(ROOT.parent / "shared")
        for package in packages:
            names = fast_tests(package, work)
            if not names:
                raise SystemExit(f"no fast test of {package} passes")
            (work / "names.txt").write_text("\n".join(names) + "\n", encoding="utf-8")
            words = [f"@{work / 'names.txt'}", "-x"]
            started = time.perf_counter()
            outcome(work, words)
            limit_s = PATIENCE * (time.perf_counter() - started) + START_S
            dead: list[bool] = []
            for mutant in chosen(package, number, seed):
                dead.append(killed(mutant, words, work, limit_s))
                if not dead[-1]:
                    print(f"lived: {mutant}", flush=True)
            print(f"{package}: {sum(dead)} of {len(dead)} killed by {len(names)} tests", flush=True)
            every += dead
    print(f"{sum(every)} of {len(every)} mutants killed")


if __name__ == "__main__":
    run(main)
