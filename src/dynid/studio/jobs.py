"""Long jobs as values, and the lines in which their process talks with the page.

A job's process reads its job from the first line of its stdin. What it has to say goes to its
stdout, one JSON object a line: `progress`, `ask`, then `result` or `error`. Further lines on
its stdin are `answer` and `stop`; the end of its stdin is a stop too, so that no robot goes on
moving for a page that is gone.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any, cast

from dynid.core.errors import InputError

KINDS = ("design", "run", "identify")


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """What another process shall do.

    Raises:
        InputError: An unknown kind.
    """

    kind: str
    """One of `KINDS`."""
    source: str
    """What it starts from: the robot, the design, or the recording."""
    output: str
    """The file it makes."""
    options: dict[str, Any]
    """Keyword arguments of the settings."""
    target: str = "sim"
    """What moves: `sim` or `ur://HOST`."""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError("unknown job", value=self.kind, limit=", ".join(KINDS))


def job_to_line(job: Job) -> str:
    """A job as a line."""
    return line(asdict(job))


def job_from_line(text: str) -> Job:
    """The inverse of `job_to_line`.

    Raises:
        InputError: It is no job.
    """
    fields = parse(text)
    try:
        return Job(**fields)
    except TypeError as error:
        raise InputError("this is no job", value=text) from error


def line(message: dict[str, Any]) -> str:
    """A message as a line."""
    return json.dumps(message) + "\n"


def parse(text: str) -> dict[str, Any]:
    """A message from its line.

    Raises:
        InputError: It is none.
    """
    try:
        found: object = json.loads(text)
    except ValueError as error:
        raise InputError("this is no message", value=text) from error
    if not isinstance(found, dict):
        raise InputError("this is no message", value=text)
    return cast("dict[str, Any]", found)
