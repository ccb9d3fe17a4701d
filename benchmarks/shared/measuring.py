"""What the benchmarks share: options, times in turn, processes that are measured, tables."""

import argparse
import inspect
import os
import platform
import re
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Iterable, Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np

ROOT = Path(__file__).parents[2]
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


def asked(what: str, value: float, *, least: float = -np.inf, most: float = np.inf) -> bool:
    """Print a figure beside what is asked of it; true if that is missed."""
    limits = (("at least", least), ("at most", most))
    limit = ", ".join(f"{word} {value:g}" for word, value in limits if np.isfinite(value))
    missed = not least <= value <= most
    print(f"{what}: {value:.3g} (asked: {limit}){', MISSED' * missed}", flush=True)
    return missed


def fastest(
    works: dict[str, Callable[[], object]],
    rounds: int,
    rare: Collection[str] = (),
    clock: Callable[[], float] = time.process_time,
) -> dict[str, float]:
    """The shortest time of each [s], by default of CPU, one after the other in every round.

    The first round warms the caches; rare ones run every 8th.
    """
    times = dict.fromkeys(works, np.inf)
    for number in range(rounds + 1):
        for name, work in works.items():
            if name in rare and number % 8:
                continue
            start = clock()
            work()
            if number:
                times[name] = min(times[name], clock() - start)
    return times


def child(words: Sequence[object], **variables: str) -> str:
    """What Python prints, run with these words and variables of the environment."""
    command, own = [sys.executable, *map(str, words)], os.environ | variables
    done = subprocess.run(command, env=own, stdout=subprocess.PIPE, text=True)
    if done.returncode:
        raise SystemExit(f"exit code {done.returncode}: {' '.join(command)[:200]}")
    return done.stdout


def peak_mb() -> float:
    """Most memory of this process so far; `ru_maxrss` would count its parent's."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return float(next(x for x in lines if x.startswith("VmHWM")).split()[1]) / 1024


def processor() -> str:
    """What the processor calls itself."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.exists() else []
    named = (line.partition(": ")[2] for line in lines if line.startswith("model name"))
    return next(named, platform.processor())


def fill(path: Path, name: str, text: str) -> None:
    """Replace what stands between two marks of a document."""
    marks = re.compile(rf"(<!-- {name} -->\n).*?(\n<!-- /{name} -->)", re.DOTALL)
    whole = path.read_text(encoding="utf-8")
    path.write_text(marks.sub(lambda found: found[1] + text + found[2], whole), encoding="utf-8")


def print_row(cells: Iterable[object]) -> None:
    """A row of a table in Markdown."""
    print("| " + " | ".join(map(str, cells)) + " |", flush=True)


def print_head(columns: Collection[str]) -> None:
    """The head of a table in Markdown."""
    print_row(columns)
    print("|" + "---|" * len(columns), flush=True)
