"""What is too long for every commit, run step by step, and `docs/proof.md` written from it.

    python benchmarks/proof/proof.py [STEP...]      all steps, or those whose names hold a word

The variables that choose the kernels of BLAS and Numba are set for one command alone. A step that
cannot run here is written down with the reason; results of steps that are not run are kept.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import platform
import re
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "proof.md"
LAST_LINES = 3
"""Lines of a step's output that are quoted."""


@dataclass(frozen=True)
class Step:
    """One command."""

    name: str
    words: tuple[str, ...]
    variables: dict[str, str] = field(default_factory=dict[str, str])
    obstacle: Callable[[], str | None] = lambda: None
    """Why it cannot run here, or None."""

    @property
    def shown(self) -> str:
        """The command as one types it."""
        before = "".join(f"{name}={value} " for name, value in self.variables.items())
        return before + " ".join(word.replace(sys.executable, "python") for word in self.words)


@dataclass(frozen=True)
class Result:
    """What a step came to."""

    passed: bool | None
    """None: it could not run."""
    wall_s: float
    last: tuple[str, ...]


def flag_missing(flag: str) -> Callable[[], str | None]:
    """Whether the processor lacks a feature."""

    def obstacle() -> str | None:
        path = Path("/proc/cpuinfo")
        flags = path.read_text().split() if path.exists() else []
        return None if flag in flags else f"this processor has no {flag}"

    return obstacle


def absent(path: Path, what: str) -> Callable[[], str | None]:
    """Whether something that a step needs is not there."""
    return lambda: None if path.exists() else f"{what} is not at {path.name}"


def steps() -> list[Step]:
    """Everything that `make proof` runs."""
    python = sys.executable
    suite = (python, "-m", "pytest", "-q", "-n", "2", "--dist", "loadfile", "-m", "not realtime")
    data = ROOT.parent / "shared" / "data"
    kernels = [
        ("Haswell", {}, flag_missing("avx2")),
        ("SkylakeX", {}, flag_missing("avx512f")),
        ("Nehalem", {"NUMBA_CPU_NAME": "generic"}, flag_missing("sse4_2")),
    ]
    clients = ROOT.parent / "shared" / "clients"
    found = [
        Step(f"suite, kernel {name}", suite, {"OPENBLAS_CORETYPE": name, **more}, obstacle)
        for name, more, obstacle in kernels
    ]
    found.append(
        Step(
            "answers of release 0.1",
            (python, "tests/frozen/answers.py", "compare"),
            obstacle=absent(data, "the folder of recordings"),
        )
    )
    hook = ROOT / "urtwin" / "tests" / "real_clients.py"
    found.append(
        Step(
            "real clients of urtwin",
            (python, str(hook.relative_to(ROOT)), str(clients)),
            obstacle=lambda: absent(hook, "the script")() or absent(clients, "their source")(),
        )
    )
    found += [
        Step(
            f"20 000 hostile lines at {rate} Hz",
            (python, "urtwin/tests/fuzzing.py", "--lines", "20000", "--rate", rate),
        )
        for rate in ("125", "500")
    ]
    found += [
        Step(f"benchmark {path.stem}", (python, str(path.relative_to(ROOT))))
        for path in sorted((ROOT / "benchmarks").glob("*.py"))
    ]
    found += [
        Step(f"example {path.stem}", (python, str(path.relative_to(ROOT))))
        for path in sorted((ROOT / "examples").glob("*.py"))
        if path.stem != "own_urdf"
    ]
    found.append(Step("site and notebooks", (python, "benchmarks/proof/build_site.py")))
    found.append(Step("wheels with each extra", (python, "benchmarks/proof/wheels.py")))
    found.append(Step("demo, seeds 1 to 20", (python, "benchmarks/proof/demo_seeds.py")))
    found.append(Step("mutants, 3 a package", (python, "benchmarks/proof/mutants.py", "-n", "3")))
    return found


def run(step: Step) -> Result:
    """Run one step; its output goes to the terminal, too."""
    reason = step.obstacle()
    if reason:
        return Result(None, 0.0, (reason,))
    started = time.perf_counter()
    process = subprocess.Popen(
        step.words,
        cwd=ROOT,
        env={**os.environ, **step.variables},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    lines: list[str] = []
    assert process.stdout is not None
    for line in process.stdout:
        print(line, end="", flush=True)
        lines.append(line.strip().strip("=").strip())
    code = process.wait()
    last = tuple(line for line in lines if line)[-LAST_LINES:]
    return Result(code == 0, time.perf_counter() - started, last)


def machine() -> str:
    """The processor, the system, and what computes."""
    import numpy as np
    import threadpoolctl

    path = Path("/proc/cpuinfo")
    model = re.search(r"model name\s*: (.+)", path.read_text()) if path.exists() else None
    blas = [info for info in threadpoolctl.threadpool_info() if info["user_api"] == "blas"]
    kernel = ", ".join(f"{b['internal_api']} {b['version']} ({b['architecture']})" for b in blas)
    processor = model.group(1) if model else platform.processor()
    return (
        f"{processor}, {os.cpu_count()} cores; {platform.system()} {platform.release()}; "
        f"Python {platform.python_version()}, NumPy {np.__version__}, {kernel}"
    )


def commit() -> str:
    """The commit that was run, marked if files differ from it."""

    def git(*words: str) -> str:
        return subprocess.run(
            ["git", *words], cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no", "--", ".", ":!docs/proof.md")
    return git("rev-parse", "--short", "HEAD") + (" with changes" if changed else "")


def row(step: Step, result: Result, where: str) -> str:
    """One line of the table."""
    word = {True: "passed", False: "**failed**", None: "not run"}[result.passed]
    said = " / ".join(line[:120] for line in result.last).replace("|", "\\|")
    return f"| {step.name} | {word} | {result.wall_s:.0f} | {where} | {said} | `{step.shown}` |"


def kept_rows() -> dict[str, str]:
    """The rows that the page holds, by step."""
    if not PAGE.exists():
        return {}
    lines = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line[:2] == "| "]
    return {line.split(" | ")[0].removeprefix("| "): line for line in lines}


def write_page(rows: dict[str, str], known: list[Step]) -> None:
    """The page, with a row for each step that was ever run."""
    order = [rows[step.name] for step in known if step.name in rows]
    head = "step", "result", "wall [s]", "commit, date", "last lines", "command"
    text = [
        "# Proof",
        "",
        "What `make proof` ran last: it is too long for every commit (`make test`).",
        "",
        f"Machine of the last run: {machine()}.",
        "",
        f"| {' | '.join(head)} |",
        "|---|---|---|---|---|---|",
        *order,
    ]
    PAGE.write_text("\n".join(text) + "\n", encoding="utf-8")


def main() -> int:
    """Run the steps, and write the page after each."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("words", nargs="*", help="steps to run: words of their names")
    parser.add_argument("--list", action="store_true", help="print the steps and run nothing")
    given = parser.parse_args()
    known = steps()
    chosen = [s for s in known if not given.words or any(w in s.name for w in given.words)]
    if given.list:
        print(json.dumps({step.name: step.shown for step in chosen}, indent=1))
        return 0
    where = f"{commit()}, {datetime.datetime.now(datetime.UTC):%Y-%m-%d}"
    rows, failed = kept_rows(), 0
    for step in chosen:
        print(f"== {step.name}: {step.shown}", flush=True)
        result = run(step)
        failed += result.passed is False
        rows[step.name] = row(step, result, where)
        write_page(rows, known)
    print(f"{len(chosen)} steps, {failed} failed; see {PAGE.relative_to(ROOT)}")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
