"""Files that appear whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dynid.core.errors import InputError, JobError


def write_text(path: Path, text: str) -> None:
    """Write a file in one piece: an interrupt leaves the old file or the new one.

    Args:
        path: File to write.
        text: Its content.

    Raises:
        JobError: The file cannot be written.
    """
    # Beside the file: only within one folder does a rename happen in one piece.
    try:
        part = path.with_name(f".{path.name}.{os.getpid()}.part")
        try:
            part.write_text(text, encoding="utf-8")
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
    # ValueError: no name for a file at all.
    except (OSError, ValueError) as error:
        raise JobError(
            "the file cannot be written",
            where=str(path),
            value=getattr(error, "strerror", None) or str(error),
            next_step="Name a file in a folder that exists and has room.",
        ) from error


def write_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write a JSON object in one piece.

    Args:
        path: File to write.
        data: JSON values; NaN and infinity are none.

    Raises:
        InputError: Something that JSON cannot hold.
        JobError: The file cannot be written.
    """
    try:
        text = json.dumps(data, indent=1, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InputError(
            "only JSON values can be kept in a file", where=str(path), value=str(error)
        ) from error
    write_text(path, text + "\n")
