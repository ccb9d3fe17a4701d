"""Random mutants of the numerical packages against their packages' own tests.

    python benchmarks/proof/mutants.py [-n 30] [--seed 0] [--packages WORD...]

Each mutant changes one operator, comparison, number or condition in a copy of the source, and the
package's tests that take less than a second each run on it until the first fails. The mutants of a
checkout are fixed by its source and the seed.
"""

import argparse
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

ROOT = Path(__file__).parents[2]
PACKAGES = ("regressor", "reduction", "identification", "constraints")
LONGEST_TEST_S = 1.0
"""Slower tests are left out."""
PATIENCE, START_S = 4.0, 60.0
"""A mutant may take so many times as long as the source, and longer by what compiling takes."""
_SWAPS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.MatMult: ast.Mult,
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.And: ast.Or,
    ast.Or: ast.And,
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


class Tests:
    """The fast tests of a package, run on a copy of the source.

    Args:
        package: The package.
        work: A folder for the copy.
    """

    def __init__(self, package: str, work: Path) -> None:
        self.work, self.package = work, package
        self.cache = work / "numba"
        self._chosen = work / f"{package}.txt"
        self.limit_s = 3600.0
        self.count = 0

    def baseline(self) -> None:
        """Find the tests that pass on the source as it is, and how long they take.

        Raises:
            RuntimeError: None passes.
        """
        report = self.work / f"{self.package}.xml"
        self._run([f"tests/{self.package}", f"--junitxml={report}", "-o", "junit_family=xunit1"])
        names: list[str] = []
        for case in ET.parse(report).iter("testcase"):
            fast = float(case.get("time", "9")) < LONGEST_TEST_S
            if fast and not list(case):
                names.append(f"{case.get('file')}::{case.get('name')}")
        if not names:
            raise RuntimeError(f"no fast test of {self.package} passes")
        self.count = len(names)
        self._chosen.write_text("\n".join(names) + "\n", encoding="utf-8")
        started = time.perf_counter()
        self._run([f"@{self._chosen}", "-x"])
        self.limit_s = PATIENCE * (time.perf_counter() - started) + START_S

    def kill(self, mutant: Mutant) -> bool:
        """Whether a test fails, or nothing comes to an end, with a mutant in the source."""
        path = self.work / "checkout" / mutant.path
        source = path.read_bytes()
        compiled = b"compiled(" in source
        try:
            with mutant.planted():
                path.write_text(ast.unparse(mutant.tree), encoding="utf-8")
            if compiled:
                # Numba's cache does not see changes in functions of other files.
                shutil.rmtree(self.cache, ignore_errors=True)
            return self._run([f"@{self._chosen}", "-x"]) != 0
        except subprocess.TimeoutExpired:
            return True
        finally:
            path.write_bytes(source)
            if compiled:
                shutil.rmtree(self.cache, ignore_errors=True)

    def _run(self, words: list[str]) -> int:
        checkout = self.work / "checkout"
        variables = {
            **os.environ,
            "PYTHONPATH": str(checkout / "src"),
            "PYTHONDONTWRITEBYTECODE": "1",
            "NUMBA_CACHE_DIR": str(self.cache),
        }
        options = ["-q", "-p", "no:cacheprovider", "-p", "no:xdist", "--no-header", "--tb=no"]
        return subprocess.run(
            [sys.executable, "-m", "pytest", *options, *words],
            cwd=checkout,
            env=variables,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=self.limit_s,
            check=False,
        ).returncode


def main() -> int:
    """Run the mutants and print who lived."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("-n", "--number", type=int, default=30, help="mutants a package")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--packages", nargs="*", default=PACKAGES)
    given = parser.parse_args()
    lived = total = 0
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        ignored = shutil.ignore_patterns(".git", ".venv", "runs", "__pycache__", "*_cache")
        shutil.copytree(ROOT, work / "checkout", ignore=ignored)
        shared = ROOT.parent / "shared"
        if shared.is_dir():
            (work / "shared").symlink_to(shared)
        for package in given.packages:
            tests = Tests(package, work)
            tests.baseline()
            killed = 0
            drawn = chosen(package, given.number, given.seed)
            for mutant in drawn:
                dead = tests.kill(mutant)
                killed += dead
                if not dead:
                    print(f"lived: {mutant}", flush=True)
            lived, total = lived + len(drawn) - killed, total + len(drawn)
            print(f"{package}: {killed} of {len(drawn)} killed by {tests.count} tests", flush=True)
    print(f"{total - lived} of {total} mutants killed")
    return 0


if __name__ == "__main__":
    sys.exit(main())
