"""The `--columns` mapping: `t=0,q=1:7,qd=7:13,current=13:19`, or names, or variable paths."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from dynid.core import RecordError
from dynid.recording.naming import Name, parse_name
from dynid.recording.record import JOINT_QUANTITIES
from dynid.recording.table import plain

QUANTITIES = ("t", *JOINT_QUANTITIES)
_RANGE = re.compile(r"(\d{1,6}):(\d{1,6})")
_EXAMPLE = "Write it like t=0,q=1:7,qd=7:13,current=13:19 (from 0, ranges exclude their end)."


def parse_columns(spec: str | Mapping[str, str]) -> dict[str, str]:
    """Take a mapping apart into quantity and selector.

    Args:
        spec: `quantity=selector` items with commas between, or a mapping of the same.

    Raises:
        RecordError: An item without `=`, an unknown quantity, or one named twice.
    """
    if isinstance(spec, Mapping):
        items = [(str(name), str(value)) for name, value in spec.items()]
    else:
        items = list[tuple[str, str]]()
        for item in filter(None, (part.strip() for part in re.split(r",(?![^\[]*\])", spec))):
            name, equals, value = item.partition("=")
            if not equals:
                raise _wrong(item, "has no '='")
            items.append((name, value))
    result: dict[str, str] = {}
    for name, value in items:
        quantity, selector = name.strip(), value.strip()
        if quantity not in QUANTITIES:
            raise _wrong(f"{quantity}={selector}", "names an unknown quantity", QUANTITIES)
        if quantity in result:
            raise _wrong(f"{quantity}={selector}", "names a quantity twice")
        if not selector:
            raise _wrong(f"{quantity}=", "says nothing")
        result[quantity] = selector
    if "q" not in result:
        raise RecordError("columns: positions q are missing", value=str(spec), next_step=_EXAMPLE)
    return result


def select(quantity: str, selector: str, width: int, names: Sequence[str] | None) -> list[int]:
    """The column numbers that a selector means.

    Args:
        quantity: The quantity, for messages.
        selector: `3`, `1:7`, `1+3+5`, a header name, or the stem of numbered header names.
        width: Number of columns there are.
        names: Header names, where the file has them.

    Raises:
        RecordError: A column that does not exist, a range that is empty, a name not found.
    """
    item = f"{quantity}={selector}"
    found: list[int] = []
    for part in selector.split("+"):
        text = part.strip()
        if text.isdecimal() and len(text) <= 6:
            found.append(int(text))
        elif match := _RANGE.fullmatch(text):
            start, stop = int(match.group(1)), int(match.group(2))
            if stop <= start:
                raise _wrong(item, "has an empty range")
            if stop > width:
                raise _wrong(item, "asks for columns that are not there", f"0:{width}")
            found.extend(range(start, stop))
        else:
            found.extend(_named(item, text, names))
    if max(found) >= width:
        raise _wrong(item, "asks for columns that are not there", f"0 to {width - 1}")
    if len(set(found)) != len(found):
        raise _wrong(item, "names a column twice")
    if quantity == "t" and len(found) != 1 and not (len(found) == 2 and "+" in selector):
        raise _wrong(item, "must be one column, or those of s and ns as in t=0+1")
    return found


def _named(item: str, name: str, names: Sequence[str] | None) -> list[int]:
    if names is None:
        raise _wrong(item, "is neither a column number nor a range, and there is no header")
    exact = [k for k, header in enumerate(names) if header == name]
    exact = exact or [k for k, header in enumerate(names) if header.partition(" [")[0] == name]
    if len(exact) == 1:
        return exact
    if len(exact) > 1:
        raise _wrong(item, f"fits {len(exact)} columns of the same name")
    stem = name.lower().rstrip("_")
    for same in (_starts, _means):
        numbered = sorted(
            (key.index, k)
            for k, header in enumerate(names)
            for key in [parse_name(header)]
            if key.index is not None and same(header, key, stem)
        )
        indices = [index for index, _ in numbered]
        if numbered and indices == list(range(indices[0], indices[0] + len(indices))):
            return [k for _, k in numbered]
    raise _wrong(item, f"is no column of the header ({plain(name)!r})", tuple(names))


def _starts(header: str, name: Name, stem: str) -> bool:
    """Whether a header is the stem with a number behind it: `state.q[3]` of `state.q`."""
    return bool(
        re.fullmatch(re.escape(stem) + r"[\s_\-.\[(/]*\d+[\])]?(\s*\[.*\])?", header.lower())
    )


def _means(header: str, name: Name, stem: str) -> bool:
    """Whether the stem is what a header is without its path and number."""
    return name.base == stem or header.lower().startswith(stem + "_")


def _wrong(item: str, why: str, limit: object = None) -> RecordError:
    return RecordError(f"columns: item {plain(item, 120)!r} {why}", limit=limit, next_step=_EXAMPLE)
