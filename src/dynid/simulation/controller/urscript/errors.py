"""What can be wrong with a script."""

from __future__ import annotations

from dynid.core.errors import InputError, JobError


class ScriptError(InputError):
    """A script that does not compile; the program never starts."""

    def __init__(self, what: str, line: int, *, value: object = None, limit: object = None) -> None:
        super().__init__(what, where=f"line {line}", value=value, limit=limit)
        self.line = line


class ScriptFault(JobError):
    """A script that failed while it ran; the program stops."""


class ScriptHalt(Exception):
    """The program ended itself with `halt`."""
