"""What the benchmarks share: options, times in turn, processes that are measured, tables."""

import argparse
import inspect
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src"
DATA = ROOT.parent / "shared" / "data"


def run(main: Callable[..., object]) -> NoReturn:
    """Call a script's `main`, whose parameters are its options, and exit with what it returns.

    Parameters have defaults, tuples where several values may stand; those before `/` are named by
    their place.
    """
    form, about = argparse.RawDescriptionHelpFormatter, sys.modules["__main__"].__doc__
    parser = argparse.ArgumentParser(description=about, formatter_class=form)
    placed: list[str] = []
    for name, one in inspect.signature(main).parameters.items():
        default, many = one.default, isinstance(one.default, tuple)
        kind = type([*default, ""][0] if many else default)
        if one.kind is one.POSITIONAL_ONLY:
            placed.append(name)
            parser.add_argument(name, nargs="*" if many else "?", type=kind, default=default)
        elif kind is bool:
            parser.add_argument(f"--{name.replace('_', '-')}", action="store_true")
        else:
            words = {"nargs": "+"} if many else {}
            parser.add_argument(f"--{name}", type=kind, default=default, **words)
    given = vars(parser.parse_args())
    first = [given.pop(name) for name in placed]
    sys.exit(main(*first, **given))


def commit() -> str:
    """The commit that is run, marked if files differ from it; what is measured writes documents."""

    def git(*words: str) -> str:
        told = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True)
        return told.stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no", "--", ".", ":!docs")
    return git("rev-parse", "--short", "HEAD") + (" with changes" if changed else "")


def fastest(
    works: dict[str, Callable[[], object]], rounds: int, rare: Collection[str] = ()
) -> dict[str, float]:
    """The shortest CPU time of each [s], one after the other in every round.

    The first round warms the caches; rare ones run every 8th.
    """
    times = dict.fromkeys(works, np.inf)
    for number in range(rounds + 1):
        for name, work in works.items():
            if name in rare and number % 8:
                continue
            start = time.process_time()
            work()
            if number:
                times[name] = min(times[name], time.process_time() - start)
    return times


@dataclass(frozen=True)
class Child:
    """What a process came to, its children counted."""

    code: int
    said: str
    cpu_s: float
    peak_mb: float


def child(
    words: Sequence[object],
    *,
    source: Path | None = None,
    stderr: int | None = None,
    check: bool = True,
    **variables: str,
) -> Child:
    """Run Python with these words.

    Args:
        words: Options, script and its arguments.
        source: Folder `src` of another release; an environment `.venv` beside it is taken.
        stderr: As of `subprocess`.
        check: Whether a failure ends this script.
        variables: Of the environment.
    """
    python = sys.executable
    if source is not None:
        own = source.parent / ".venv" / "bin" / "python"
        python = str(own) if own.exists() else python
        variables["PYTHONPATH"] = str(source)
    process = subprocess.Popen(
        [python, *map(str, words)],
        env=os.environ | variables,
        stdout=subprocess.PIPE,
        stderr=stderr,
        text=True,
    )
    assert process.stdout is not None
    said = process.stdout.read().strip()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if check and process.returncode:
        raise SystemExit(f"exit code {process.returncode}: {' '.join(map(str, words))[:200]}")
    cpu = usage.ru_utime + usage.ru_stime
    return Child(process.returncode, said, cpu, usage.ru_maxrss / 1024)


def processor() -> str:
    """What the processor calls itself."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.exists() else []
    named = (line.partition(": ")[2] for line in lines if line.startswith("model name"))
    return next(named, platform.processor())


def print_row(cells: Iterable[object]) -> None:
    """A row of a table in Markdown."""
    print("| " + " | ".join(map(str, cells)) + " |", flush=True)


def print_head(columns: Collection[str]) -> None:
    """The head of a table in Markdown."""
    print_row(columns)
    print("|" + "---|" * len(columns), flush=True)
