"""The answers of every command, kept: what release 0.1 said stands beside what is said today.

    python tests/frozen/answers.py compare [WORD...] [--fast]    differences by command and key
    python tests/frozen/answers.py write FILE                    the answers of the dynid in use

`answers.json` was written by release 0.1 (commit 67f4645). Numbers have six significant digits;
what differs from run to run or is prose is left out. `intended.toml` lists the differences that a
release makes on purpose, with the reason: an entry that no longer matches a difference is reported.
"""

from __future__ import annotations

import argparse
import contextlib
import fnmatch
import io
import json
import math
import runpy
import sys
import tempfile
import tomllib
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
DATA = ROOT.parent / "shared" / "data"
GOLDEN = HERE / "answers.json"
INTENDED = HERE / "intended.toml"
COMMANDS = HERE / "commands.toml"

ANY_KERNEL = 1e-4
"""Relative tolerance: another processor's BLAS may have computed them."""
SMALL = 1e-3
"""Share of a list's largest number below which its numbers are not compared relatively."""
ZERO = 1e-9
"""Numbers as small as this are rounding errors."""
LONGEST = 400
"""Numbers of a list that are kept; longer ones keep their length alone."""
LEFT_OUT = frozenset(
    [
        "bytes",
        "essential",
        "estimate",
        "file",
        "files",
        "history",
        "interrupted",
        "loaded_with",
        "pid",
        "ports",
        "record",
        "relative_std_percent",
        "scene_file",
        "seconds",
        "skipped",
        "source",
        "std_naive",
        "url",
        "wall_s",
    ]
)
"""Files, times, and what follows from other keys."""
PROSE = frozenset(
    [
        "choices",
        "expression",
        "expressions",
        "findings",
        "left_out",
        "message",
        "next_step",
        "note",
        "notes",
        "problems",
        "proven",
        "reason",
        "reasons",
        "warnings",
    ]
)
"""What is said in words; of warnings and problems the codes are kept."""

Answer = dict[str, Any]


@dataclass(frozen=True)
class Command:
    """One command line; `{data}`, `{robots}` and `{files}` stand for folders."""

    name: str
    words: tuple[str, ...]
    fast: bool

    @property
    def needs_data(self) -> bool:
        """Whether it reads the real recordings."""
        return any("{data}" in word for word in self.words)


def commands(only: tuple[str, ...] = (), fast: bool = False) -> list[Command]:
    """The commands of `commands.toml`, in order; later ones may read files of earlier ones."""
    found: list[Command] = []
    for speed, table in tomllib.loads(COMMANDS.read_text(encoding="utf-8")).items():
        found += [Command(n, tuple(line.split()), speed == "fast") for n, line in table.items()]
    found = [c for c in found if c.fast or not fast]
    return [c for c in found if not only or any(word in c.name for word in only)]


def answers(chosen: list[Command]) -> Iterator[tuple[str, Answer]]:
    """Run commands in a folder of their own, one after the other, and give what each answered."""
    places = {
        "{data}": str(DATA),
        "{robots}": str(ROOT / "examples" / "robots"),
        "{files}": str(HERE / "files"),
    }
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for command in chosen:
            words = list(command.words)
            for place, path in places.items():
                words = [word.replace(place, path) for word in words]
            yield command.name, ask([*words, "--json"])


def ask(words: list[str], parse: bool = True) -> Answer:
    """The exit code of a command under `exit`, and its JSON as a flat table if asked for."""
    out, before = io.StringIO(), sys.argv
    sys.argv = ["dynid", *words]
    code: Any = 0
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()):
            runpy.run_module("dynid", run_name="__main__")
    except SystemExit as stop:
        code = stop.code or 0
    finally:
        sys.argv = before
    answer: Answer = {"exit": code}
    if parse and code in (0, 1) and out.getvalue():
        # Where the repository and the recordings are is nobody's answer.
        text = out.getvalue().replace(str(DATA.resolve()), "DATA").replace(str(DATA), "DATA")
        _flatten("", json.loads(text.replace(str(ROOT), "ROOT")), answer)
    return answer


def _flatten(key: str, value: Any, into: Answer) -> None:
    """Tables become dotted keys, lists of tables one list a key, numbers six digits."""
    name = key.rpartition(".")[2]
    if name in ("warnings", "problems") and isinstance(value, list):
        into[f"{key}.codes"] = sorted({row["code"] for row in value})
    if name in LEFT_OUT | PROSE:
        return
    if isinstance(value, dict):
        for inner, item in value.items():
            _flatten(f"{key}.{inner}" if key else inner, item, into)
    elif isinstance(value, list) and value and all(isinstance(row, dict) for row in value):
        inside = {inner: None for row in value for inner in row}
        for inner in inside:
            if inner not in LEFT_OUT | PROSE:
                into[f"{key}.{inner}"] = [_rounded(row.get(inner)) for row in value]
    elif isinstance(value, list) and len(value) > LONGEST:
        into[f"{key}.length"] = len(value)
    else:
        into[key] = _rounded(value)


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.6g}") if abs(value) > ZERO else 0.0
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items() if key not in LEFT_OUT | PROSE}
    return value


def differences(before: Answer, now: Answer, tolerance: float) -> dict[str, str]:
    """What differs, by key; keys that came in addition are no difference."""
    found: dict[str, str] = {}
    for key, value in before.items():
        if key not in now:
            found[key] = f"{_short(value)}, now absent"
        elif not _alike(value, now[key], tolerance):
            found[key] = f"{_short(value)}, now {_short(now[key])}"
    return found


def _alike(a: Any, b: Any, tolerance: float, scale: float = 0.0) -> bool:
    if isinstance(a, dict) and isinstance(b, dict):
        return all(key in b and _alike(a[key], b[key], tolerance) for key in a)
    if isinstance(a, list) and isinstance(b, list):
        scale = max([scale, *(abs(x) for x in a if _is_number(x))])
        return len(a) == len(b) and all(
            _alike(x, y, tolerance, scale) for x, y in zip(a, b, strict=True)
        )
    if _is_number(a) and _is_number(b):
        size = max(abs(a), abs(b), SMALL * scale)
        return math.isclose(a, b, rel_tol=0.0, abs_tol=tolerance * size + ZERO)
    return a == b


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 100 else f"{text[:97]}..."


@dataclass
class Intended:
    """The table of differences that are meant: pattern of command and key -> reason."""

    table: dict[str, dict[str, str]]
    used: set[tuple[str, str]]

    @classmethod
    def read(cls, path: Path = INTENDED) -> Intended:
        """The table of a file."""
        return cls(tomllib.loads(path.read_text(encoding="utf-8")), set())

    def reason(self, command: str, key: str) -> str | None:
        """Why a difference is meant, or None; the entry counts as used."""
        for names, keys in self.table.items():
            if fnmatch.fnmatchcase(command, names):
                for pattern, reason in keys.items():
                    if fnmatch.fnmatchcase(key, pattern):
                        self.used.add((names, pattern))
                        return reason
        return None

    def unused(self, ran: set[str], kept: set[str]) -> list[str]:
        """Entries that matched nothing although every command that they name was run."""
        return [
            f"{names}: {pattern}"
            for names, keys in self.table.items()
            for pattern in keys
            if (names, pattern) not in self.used
            and {name for name in kept if fnmatch.fnmatchcase(name, names)} <= ran
        ]


def compare(chosen: list[Command], tolerance: float, speak: bool = True) -> list[str]:
    """Run commands and compare with what is kept.

    Returns:
        Every difference that is not meant, and every entry of `intended.toml` without one.
    """
    kept: dict[str, Answer] = json.loads(GOLDEN.read_text(encoding="utf-8"))["answers"]
    intended, wrong, ran = Intended.read(), [], set[str]()
    if not DATA.is_dir():
        chosen = [command for command in chosen if not command.needs_data]
    for name, answer in answers(chosen):
        ran.add(name)
        for key, what in differences(kept[name], answer, tolerance).items():
            reason = intended.reason(name, key)
            if reason is None:
                wrong.append(f"{name}: {key}: {what}")
            if speak:
                print(f"{name}: {key}: {what} ({reason or 'NOT INTENDED'})", flush=True)
    left = [f"intended.toml, {entry}: no longer differs" for entry in intended.unused(ran, {*kept})]
    if speak:
        print(f"{len(ran)} commands, {len(wrong)} unintended differences", *left, sep="\n")
    return [*wrong, *left]


def write(path: Path) -> None:
    """Write the answers of the dynid that is on the path."""
    import dynid

    found: dict[str, Answer] = {}
    for name, answer in answers(commands()):
        print(name, answer["exit"], flush=True)
        found[name] = answer
    rows = ",\n".join(f"{json.dumps(n)}: {json.dumps(a)}" for n, a in found.items())
    path.write_text(
        f'{{"version": "{dynid.__version__}", "answers": {{\n{rows}\n}}}}\n', encoding="utf-8"
    )


def main() -> int:
    """The two modes of the script."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("mode", choices=("compare", "write"))
    parser.add_argument("words", nargs="*", help="compare: parts of names; write: the file")
    parser.add_argument("--fast", action="store_true", help="those of the test suite alone")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    if given.mode == "write":
        write(Path(given.words[0]).resolve())
        return 0
    return bool(compare(commands(tuple(given.words), given.fast), ANY_KERNEL))


if __name__ == "__main__":
    sys.exit(main())
