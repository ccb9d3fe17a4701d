"""Programs that the dashboard can load, from a folder of this machine.

PolyScope saves `work.urp` together with `work.script`, which is what runs: `load work.urp` takes
`work.script` of the folder, with or without a file `work.urp` beside it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path, PurePosixPath

from dynid.core import InputError
from dynid.simulation.controller.urscript.tokens import MAX_CHARACTERS

FindProgram = Callable[[str], str | None]
"""The text of a program, or None if there is none of that name."""
_ON_THE_ROBOT = "programs"
_SUFFIXES = (".urp", ".script")


def no_programs(name: str) -> str | None:
    """A controller without files."""
    return None


def program_folder(folder: Path) -> FindProgram:
    """Finds the programs of a folder; each is read when it is loaded.

    Args:
        folder: Stands for the robot's `/programs`.

    Raises:
        InputError: It is no folder.
    """
    if not folder.is_dir():
        raise InputError("there is no such folder of programs", where=str(folder))
    root = folder.resolve()

    def find(name: str) -> str | None:
        parts = PurePosixPath(name).parts
        if parts[:1] == ("/",):
            parts = parts[2:] if parts[1:2] == (_ON_THE_ROBOT,) else parts[1:]
        path = root.joinpath(*parts).with_suffix(".script") if _is_program(parts) else root
        try:
            path = path.resolve(strict=True)
            if not path.is_relative_to(root) or path.stat().st_size > MAX_CHARACTERS:
                return None
            return path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError):
            return None

    return find


def _is_program(parts: tuple[str, ...]) -> bool:
    return bool(parts) and PurePosixPath(parts[-1]).suffix in _SUFFIXES
