"""What can be wrong with a script."""

from __future__ import annotations

from dynid.core import InputError, JobError

UNKNOWN_NAME, UNKNOWN_FUNCTION, UNKNOWN_THREAD = (
    "unknown name",
    "unknown function",
    "unknown thread",
)
_NAMES = (UNKNOWN_NAME, UNKNOWN_FUNCTION, UNKNOWN_THREAD)


class ScriptError(InputError):
    """A script that does not compile; the program never starts."""

    def __init__(self, what: str, line: int, *, value: object = None, limit: object = None) -> None:
        super().__init__(what, where=f"line {line}", value=value, limit=limit)
        self.line = line

    @property
    def code(self) -> str:
        """What UR's controller calls it."""
        if self.what in _NAMES:
            return f"compile_error_name_not_found:{self.value}:"
        return (
            f"syntax_error_on_line:{self.line}:{self.what if self.value is None else self.value}:"
        )


class ScriptFault(JobError):
    """A script that failed while it ran; the program stops."""


class ScriptHalt(Exception):
    """The program ended itself with `halt`."""
