"""Files that the page may write."""

from __future__ import annotations

from pathlib import Path

from dynid.core.errors import InputError

LONGEST = 120


def file_in(folder: Path, name: str, suffix: str) -> Path:
    """A file in the studio's folder: a name typed into a page chooses no other place.

    Args:
        folder: The studio's folder.
        name: What was typed.
        suffix: What the name must end in.

    Raises:
        InputError: More than a name, or another ending.
    """
    odd = name.startswith(".") or any(not c.isprintable() or c in "/\\" for c in name)
    if odd or len(name) > LONGEST or Path(name).suffix.lower() != suffix:
        raise InputError(
            "a file name without a directory is needed", value=name, limit=f"*{suffix}"
        )
    return folder / name


def free_name(folder: Path, name: str) -> str:
    """A name that no file of the folder has: what is there is overwritten only when typed.

    Args:
        folder: The studio's folder.
        name: What is wished, such as `design.json`; `design_2.json` comes after it.
    """
    wished, free, count = Path(name), name, 1
    while (folder / free).exists():
        count += 1
        free = f"{wished.stem}_{count}{wished.suffix}"
    return free
