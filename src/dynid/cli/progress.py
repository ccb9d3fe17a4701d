"""A progress bar on stderr, with the time left, where a person is watching."""

from __future__ import annotations

import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager


@contextmanager
def progress_bar(title: str) -> Generator[Callable[[str, float], None] | None]:
    """Show how far a job is.

    Args:
        title: What is being done.

    Yields:
        To be told what is being done and how far it is (0 to 1); None where stderr is no
        terminal, and nothing is shown.
    """
    if not sys.stderr.isatty():
        yield None
        return
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeRemainingColumn,
    )

    from dynid.cli.output import console

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=None),
        TaskProgressColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console(stderr=True), transient=True) as progress:
        task = progress.add_task(title, total=1.0)

        def tell(what: str, share: float) -> None:
            progress.update(task, description=f"{title}: {what}", completed=share)

        yield tell
