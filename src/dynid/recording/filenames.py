"""Files without headers whose names say what they hold: `run1_positions.txt`, `tau.csv`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from dynid.recording.naming import parse_name
from dynid.recording.vocabulary import OTHER, RANK, TARGET, TARGET_OF


def names_by_files(files: Sequence[Path], widths: Sequence[int]) -> tuple[str, ...] | None:
    """Column names made of the files' names, where each tells another quantity.

    Args:
        files: The files, side by side.
        widths: Columns of each.

    Returns:
        Names such as `positions[0]`, or None where a file's name says nothing or two say the
        same.
    """
    words = [quantity_word(file.stem) for file in files]
    meanings = [parse_name(word).meaning for word in words if word]
    quantities = [meaning[0] for meaning in meanings if meaning]
    if len(quantities) < len(files) or len(set(quantities)) < len(quantities):
        return None
    return tuple(
        word if width == 1 else f"{word}[{k}]"
        for word, width in zip(words, widths, strict=True)
        for k in range(width)
    )


def quantity_word(stem: str) -> str:
    """The words of a file's name that name a quantity; empty where none or several do.

    Args:
        stem: The name without its extension.
    """
    words = [word for word in parse_name(stem.replace(".", "_")).base.split("_") if word]
    whole = "_".join(words)
    if whole in RANK:
        return whole
    if OTHER & set(words):
        return ""
    # A single letter beside other words is too little to tell by.
    found = [
        (j - i, "_".join(words[i:j]))
        for i in range(len(words))
        for j in range(i + 1, len(words) + 1)
        if "_".join(words[i:j]) in RANK and len("_".join(words[i:j])) > 1
    ]
    longest = max((length for length, _ in found), default=0)
    best = {text for length, text in found if length == longest}
    if len({RANK[text][0] for text in best}) != 1:
        return ""
    word = min(best)
    asked = TARGET & set(words) and RANK[word][0] in TARGET_OF
    return f"desired_{word}" if asked and not word.startswith("desired") else word
