"""What goes to stdout, and progress on stderr."""

from __future__ import annotations

import json
import math
import os
import shlex
import sys
from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid import core

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress
    from rich.table import Column


WIDTH = 80
LONGEST_WORD = 20
"""Words in tables are folded beyond so many characters, where the terminal is narrow."""


def print_json(data: Mapping[str, Any]) -> None:
    """Print one JSON object; numbers that are not finite become null."""
    print(json.dumps(core.plain(data), allow_nan=False))


def console(*, stderr: bool = False) -> Console:
    """A console that prints text as it is; colour only on a terminal."""
    from rich.console import Console

    stream = sys.stderr if stderr else sys.stdout
    width = None if stream.isatty() else WIDTH
    return Console(file=stream, markup=False, highlight=False, emoji=False, width=width)


def print_table(
    screen: Console, title: str, columns: Mapping[str, int | None], rows: Iterable[Iterable[Any]]
) -> None:
    """Print a table below a title.

    Columns have so many digits, and never wrap; those of words have None. In both, text stays.
    """
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    for name, digits in columns.items():
        justify = "left" if digits is None else "right"
        table.add_column(name, justify=justify, overflow="fold", no_wrap=digits is not None)
    for row in rows:
        cells = zip(row, columns.values(), strict=True)
        texts = (str(x) if n is None or isinstance(x, str) else number(x, n) for x, n in cells)
        table.add_row(*texts)
    screen.print()
    screen.print(title, style="bold")
    # Cells that do not fit are cut by rich, digits first: rather a line that the terminal wraps.
    width, least = screen.width, sum(_least_width(column, screen) for column in table.columns)
    screen.width = max(width, least + 2 * len(table.columns))
    screen.print(table, soft_wrap=screen.width > width)
    screen.width = width


def _least_width(column: Column, screen: Console) -> int:
    """What a column needs: its longest number, or its longest word up to `LONGEST_WORD`."""
    from rich.measure import Measurement

    texts = (screen.render_str(str(cell)) for cell in (column.header, *column.cells))
    cells = [Measurement.get(screen, screen.options, text) for text in texts]
    if column.no_wrap:
        return max(cell.maximum for cell in cells)
    return min(max(cell.minimum for cell in cells), LONGEST_WORD)


def print_findings(screen: Console, title: str, findings: Sequence[core.Finding]) -> None:
    """Print findings in words, each with its code; nothing where there are none."""
    if not findings:
        return
    screen.print()
    screen.print(title, style="bold")
    for finding in findings:
        screen.print(_line(finding))


def _line(finding: core.Finding) -> str:
    return f"- {finding.code}: {finding.message}."


def fitting(screen: Console, findings: Sequence[core.Finding], lines: int) -> int:
    """How many of the first findings fit into so many lines; at least one."""
    from rich.text import Text

    taken = [len(Text(_line(told)).wrap(screen, screen.width)) for told in findings]
    return max(sum(end <= lines for end in accumulate(taken)), min(len(findings), 1))


def number(value: float | None, digits: int = 4) -> str:
    """A number for people; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return "-"
    if isinstance(value, int):
        return str(value)
    text = f"{value:.{digits}g}"
    if "e" in text or value == 0.0:
        return text
    places = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{places}f}"


def count(number: int, noun: str) -> str:
    """A number and its noun, in the plural where it is not one."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def check_output(
    path: Path,
    inputs: Iterable[Path] = (),
    suffix: str | None = None,
    *,
    where: str = "-o",
    force: bool = True,
) -> None:
    """Find out before a long job whether its result can be written to the path of an option.

    Raises:
        InputError: Another ending than the suffix, an input, a directory, a file that exists and
            must not be replaced, or a folder that is missing or closed.
    """
    import tempfile

    # os.path says False where Path raises, as for names that no file can have.
    there, folder = os.path.exists(path), str(path.parent)
    inputs = [source for source in inputs if os.path.exists(source)]
    kept = "must be a file that can be kept"
    for wrong, what, limit in (
        (suffix and path.suffix.lower() != suffix, "has another format", f"*{suffix}"),
        (os.path.isdir(path), "is a directory", None),
        (
            there and any(os.path.samefile(path, x) for x in inputs),
            "would overwrite an input",
            None,
        ),
        (str(path) == "-" or (there and not os.path.isfile(path)), kept, None),
    ):
        if wrong:
            raise core.InputError(f"the output {what}", where=where, value=str(path), limit=limit)
    core.require_absent(path, force=force)
    if not os.path.isdir(folder):
        said, step = "the output's directory does not exist", f"Run: mkdir -p {shlex.quote(folder)}"
        raise core.InputError(said, where=where, value=folder, next_step=step)
    try:
        # Permissions alone do not tell, least of all to root.
        with tempfile.TemporaryFile(dir=folder):
            return
    except OSError as error:
        said = "the output's directory cannot be written to"
        raise core.InputError(said, where=where, value=folder) from error


class ProgressBar:
    """Shows how far a job is."""

    def __init__(self, title: str, bars: Progress) -> None:
        self._title, self._bars = title, bars
        self._task = bars.add_task(title, total=1.0)

    def __call__(self, what: str, share: float) -> None:
        """Show what is being done and how far it is (0 to 1)."""
        self._bars.update(self._task, description=f"{self._title}: {what}", completed=share)

    @contextmanager
    def hidden(self) -> Generator[None]:
        """Show nothing while the context lasts: a bar is drawn over the line of a question."""
        self._bars.stop()
        yield
        self._bars.start()


@contextmanager
def progress_bar(title: str) -> Generator[ProgressBar | None]:
    """Show how far a job is; None, and nothing is shown, where stderr is no terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich import progress as bars

    columns = (
        bars.TextColumn("{task.description}", markup=False),
        bars.BarColumn(bar_width=None),
        bars.TaskProgressColumn(),
        bars.TimeRemainingColumn(),
    )
    with bars.Progress(*columns, console=console(stderr=True), transient=True) as progress:
        yield ProgressBar(title, progress)
