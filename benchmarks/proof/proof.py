"""What is too long for every commit, run step by step, and `docs/proof.md` written from it.

    python benchmarks/proof/proof.py [STEP...] [--list]     all, or those whose names hold a word

The variables that choose the kernels of BLAS and Numba are set for one command alone. A step that
cannot run here is written down with the reason; results of steps that are not run are kept.
"""

import datetime
import os
import platform
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import threadpoolctl

sys.path.insert(0, str(Path(__file__).parents[1]))
from shared.measuring import ROOT, commit, processor, run
from wheels import interpreter

PAGE = ROOT / "docs" / "proof.md"
NEVER = "not run yet"
LAST_LINES = 3
"""Lines of a step's output that are quoted."""


@dataclass(frozen=True)
class Step:
    """One command of Python, or of `make`."""

    name: str
    words: tuple[str, ...]
    variables: dict[str, str] = field(default_factory=dict[str, str])
    obstacle: str | None = None
    """Why it cannot run here."""

    @property
    def shown(self) -> str:
        """The command as one types it."""
        before = "".join(f"{name}={value} " for name, value in self.variables.items())
        return before + " ".join(self.words if self.words[0] == "make" else ("python", *self.words))


@dataclass(frozen=True)
class Result:
    """What a step came to."""

    passed: bool | None
    """None: it could not run."""
    wall_s: float
    last: tuple[str, ...]


def steps() -> list[Step]:
    """Everything that `make proof` runs."""
    suite = ("-m", "pytest", "-q", "-n", "2", "--dist", "loadfile", "-m", "not realtime")
    cpu, shared = Path("/proc/cpuinfo"), ROOT.parent / "shared"
    flags = cpu.read_text().split() if cpu.exists() else []
    found = []
    for kernel, flag in (("Haswell", "avx2"), ("SkylakeX", "avx512f"), ("Nehalem", "sse4_2")):
        variables = {"OPENBLAS_CORETYPE": kernel}
        variables |= {"NUMBA_CPU_NAME": "generic"} if kernel == "Nehalem" else {}
        obstacle = None if flag in flags else f"this processor has no {flag}"
        found.append(Step(f"suite, kernel {kernel}", suite, variables, obstacle))
    for version in ("3.12", "3.13"):
        # Newer packages than with 3.11; an environment of its own, which stays for the next time.
        python = interpreter(version)
        words = ("make", f"VENV=build/py{version}", f"PYTHON={python}", "ASIDE=", "test")
        obstacle = None if python else f"no Python {version} here"
        found.append(Step(f"make test with Python {version}", words, obstacle=obstacle))
    for name, words, needed in (
        ("answers of release 0.1", ("tests/frozen/answers.py", "compare"), shared / "data"),
        ("real clients of urtwin", ("urtwin/tests/real_clients.py", str(shared / "clients")),
         shared / "clients"),
    ):  # fmt: skip
        obstacle = None if needed.exists() else f"not there: {needed.name}"
        found.append(Step(name, words, obstacle=obstacle))
    for rate in ("125", "500"):
        words = ("urtwin/tests/fuzzing.py", "--lines", "20000", "--rate", rate)
        found.append(Step(f"20 000 hostile lines at {rate} Hz", words))
    for kind in ("benchmark", "example"):
        for path in sorted((ROOT / f"{kind}s").glob("*.py")):
            if path.stem != "own_urdf":
                found.append(Step(f"{kind} {path.stem}", (str(path.relative_to(ROOT)),)))
    return [
        *found,
        Step("site and notebooks", ("benchmarks/proof/build_site.py",)),
        Step("wheels with each extra", ("benchmarks/proof/wheels.py",)),
        Step("demo, seeds 1 to 20", ("benchmarks/proof/demo_seeds.py",)),
        Step("fleet on Dask", ("benchmarks/fleet.py", "--robots", "20", "--dask", "3")),
        Step("mutants, 3 a package", ("benchmarks/proof/mutants.py", "--number", "3")),
    ]


def result_of(step: Step) -> Result:
    """Run one step; its output goes to the terminal, too."""
    if step.obstacle:
        return Result(None, 0.0, (step.obstacle,))
    started = time.perf_counter()
    process = subprocess.Popen(
        step.words if step.words[0] == "make" else [sys.executable, *step.words],
        cwd=ROOT,
        env={**os.environ, **step.variables},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    lines: list[str] = []
    for line in process.stdout or ():
        print(line, end="", flush=True)
        lines.append(line.strip().strip("=").strip())
    code = process.wait()
    last = tuple(line for line in lines if line)[-LAST_LINES:]
    return Result(code == 0, time.perf_counter() - started, last)


def machine() -> str:
    """The processor, the system, and what computes."""
    blas = [info for info in threadpoolctl.threadpool_info() if info["user_api"] == "blas"]
    kernel = ", ".join(f"{b['internal_api']} {b['version']} ({b['architecture']})" for b in blas)
    return (
        f"{processor()}, {os.cpu_count()} cores; {platform.system()} {platform.release()}; "
        f"Python {platform.python_version()}, NumPy {np.__version__}, {kernel}"
    )


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
    lines = [line for line in lines if f"| {NEVER} |" not in line]
    return {line.split(" | ")[0].removeprefix("| "): line for line in lines}


def write_page(rows: dict[str, str], known: list[Step]) -> None:
    """The page, with a row for each step."""
    never = Result(None, 0.0, (NEVER,))
    order = [rows.get(step.name) or row(step, never, "-") for step in known]
    ran = sum(step.name in rows for step in known)
    head = ("step", "result", "wall [s]", "commit, date", "last lines", "command")
    text = [
        "# Proof\n",
        "What `make proof` ran last: it is too long for every commit (`make test`).\n",
        f"Steps that have a result: {ran} of {len(known)}. Machine of the last run: {machine()}.\n",
        f"| {' | '.join(head)} |",
        "|---" * len(head) + "|",
        *order,
    ]
    PAGE.write_text("\n".join(text) + "\n", encoding="utf-8")


def main(words: tuple[str, ...] = (), /, list: bool = False) -> bool:
    """Run the steps, and write the page after each; true if one fails."""
    known = steps()
    chosen = [s for s in known if not words or any(w in s.name for w in words)]
    where = f"{commit()}, {datetime.datetime.now(datetime.UTC):%Y-%m-%d}"
    rows, failed = kept_rows(), 0
    for step in chosen:
        print(f"== {step.name}: {step.shown}", flush=True)
        if list:
            continue
        result = result_of(step)
        failed += result.passed is False
        rows[step.name] = row(step, result, where)
        write_page(rows, known)
    print(f"{len(chosen)} steps, {failed} failed; see {PAGE.relative_to(ROOT)}")
    return failed > 0


if __name__ == "__main__":
    run(main)
