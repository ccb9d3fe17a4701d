"""Random mutants of the numerical packages against their packages' own tests.

    python benchmarks/proof/mutants.py [--root CHECKOUT] [-n 30] [--seed 0] [--packages WORD...]

Each mutant changes one operator, comparison, number or condition in a copy of the source, and the
package's tests that take less than a second each run on it until the first fails. The mutants of a
checkout are fixed by its source and the seed.
"""

from __future__ import annotations

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
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("regressor", "reduction", "identification", "constraints")
LONGEST_TEST_S = 1.0
"""Slower tests are left out."""
PATIENCE, START_S = 4.0, 60.0
"""A mutant may take so many times as long as the source, and longer by what compiling takes."""
_SWAPS: dict[type[ast.AST], str] = {
    ast.Add: "-",
    ast.Sub: "+",
    ast.Mult: "/",
    ast.Div: "*",
    ast.MatMult: "*",
    ast.Lt: "<=",
    ast.LtE: "<",
    ast.Gt: ">=",
    ast.GtE: ">",
    ast.Eq: "!=",
    ast.NotEq: "==",
    ast.And: "or",
    ast.Or: "and",
}


@dataclass(frozen=True)
class Mutant:
    """One change of one file."""

    path: Path
    """Relative to the checkout."""
    line: int
    start: int
    stop: int
    """Bytes of the file that are replaced."""
    before: str
    after: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.before} -> {self.after}"


def sites(root: Path, path: Path) -> Iterator[Mutant]:
    """Every mutant of one file; annotations, messages and docstrings are left alone."""
    source = (root / path).read_bytes()
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))

    def place(line: int, column: int) -> int:
        return starts[line - 1] + column

    def between(left: ast.expr, right: ast.expr, kind: ast.AST) -> Iterator[Mutant]:
        start = place(left.end_lineno or 0, left.end_col_offset or 0)
        stop = place(right.lineno, right.col_offset)
        text, new = source[start:stop].decode(), _SWAPS.get(type(kind))
        old = text.strip("() \n\t\\")
        if new and old and "#" not in text:
            begin = start + text.index(old)
            yield Mutant(path, left.end_lineno or 0, begin, begin + len(old), old, new)

    def whole(node: ast.expr, new: str) -> Iterator[Mutant]:
        start = place(node.lineno, node.col_offset)
        stop = place(node.end_lineno or 0, node.end_col_offset or 0)
        old = source[start:stop].decode()
        yield Mutant(path, node.lineno, start, stop, old, new)

    def walk(node: ast.AST) -> Iterator[Mutant]:
        match node:
            case ast.Raise() | ast.Import() | ast.ImportFrom():
                return
            case ast.BinOp():
                yield from between(node.left, node.right, node.op)
            case ast.Compare(ops=[op], comparators=[right]):
                yield from between(node.left, right, op)
            case ast.BoolOp():
                for left, right in zip(node.values, node.values[1:], strict=False):
                    yield from between(left, right, node.op)
            case ast.Constant(value=bool() as value):
                yield from whole(node, str(not value))
            case ast.Constant(value=int() | float() as value):
                yield from whole(node, repr(value + 1 if value in (0, 1) else value * 2))
            case ast.If() | ast.IfExp():
                for found in whole(node.test, ""):
                    if "\n" not in found.before:
                        yield Mutant(
                            path,
                            found.line,
                            found.start,
                            found.stop,
                            found.before,
                            f"not ({found.before})",
                        )
            case _:
                pass
        for name, value in ast.iter_fields(node):
            if name in ("annotation", "returns", "decorator_list"):
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from walk(child)

    yield from walk(ast.parse(source))


def chosen(root: Path, package: str, count: int, seed: int) -> list[Mutant]:
    """Mutants of a package, drawn at random."""
    folder = root / "src" / "dynid" / package
    paths = [p.relative_to(root) for p in sorted(folder.rglob("*.py")) if p.name != "__init__.py"]
    found = [mutant for path in paths for mutant in sites(root, path)]
    return random.Random(f"{seed} {package}").sample(found, min(count, len(found)))


class Tests:
    """The fast tests of a package, run on a copy of the source.

    Args:
        root: The checkout.
        package: Its package.
        work: A folder for the copy.
    """

    def __init__(self, root: Path, package: str, work: Path) -> None:
        self.root, self.work, self.package = root, work, package
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
        changed = source[: mutant.start] + mutant.after.encode() + source[mutant.stop :]
        compiled = b"njit" in source
        try:
            path.write_bytes(changed)
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
    parser.add_argument("--root", type=Path, default=ROOT, help="the checkout")
    parser.add_argument("-n", "--number", type=int, default=30, help="mutants a package")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--packages", nargs="*", default=PACKAGES)
    given = parser.parse_args()
    root, lived, total = given.root.resolve(), 0, 0
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        ignored = shutil.ignore_patterns(".git", ".venv", "runs", "__pycache__", "*_cache")
        shutil.copytree(root, work / "checkout", ignore=ignored)
        shared = root.parent / "shared"
        if shared.is_dir():
            (work / "shared").symlink_to(shared)
        for package in given.packages:
            tests = Tests(root, package, work)
            tests.baseline()
            killed = 0
            drawn = chosen(root, package, given.number, given.seed)
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
