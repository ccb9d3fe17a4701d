"""Which columns hold what: by the header, or by `--columns`."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

from dynid.core import Finding, RecordError, printable
from dynid.recording import cells, headers, records, table
from dynid.recording.names import parse_name

QUANTITIES = ("t", *records.JOINT_QUANTITIES)
_RANGE = re.compile(r"(\d{1,6}):(\d{1,6})")
_EXAMPLE = "Write t=0,q=1:7,qd=7:13,current=13:19 (six joints; from 0, ranges exclude their end)."


def parse_columns(spec: str | Mapping[str, str]) -> dict[str, str]:
    """Take a mapping, or `quantity=selector` items with commas between, apart into these two.

    Raises:
        RecordError: An item without `=`, an unknown quantity, or one named twice.
    """
    if isinstance(spec, Mapping):
        items = [f"{name}={value}" for name, value in spec.items()]
    else:
        items = re.split(r",(?![^\[]*\])", spec)
    result: dict[str, str] = {}
    for item in filter(None, map(str.strip, items)):
        quantity, equals, selector = map(str.strip, item.partition("="))
        if not equals:
            raise _wrong(item, "has no '='")
        if quantity not in QUANTITIES:
            raise _wrong(f"{quantity}={selector}", "names an unknown quantity", QUANTITIES)
        if quantity in result or not selector:
            raise _wrong(f"{quantity}={selector}", "names a quantity twice, or no columns")
        result[quantity] = selector
    if "q" not in result:
        raise RecordError("columns: positions q are missing", value=str(spec), next_step=_EXAMPLE)
    return result


def select(quantity: str, selector: str, width: int, names: Sequence[str] | None) -> list[int]:
    """The column numbers that a selector means, of `width` columns.

    It is `3`, `1:7`, `1+3+5`, a header name, or the stem of numbered header names.

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
    known = [(header.lower(), parse_name(header)) for header in names]
    # The stem with a number behind it, as `state.q[3]`; or what is left without path and number.
    behind = re.compile(re.escape(stem) + r"[\s_\-.\[(/]*\d+[\])]?(\s*\[.*\])?")
    starts = [behind.fullmatch(header) is not None for header, _ in known]
    means = [key.base == stem or header.startswith(stem + "_") for header, key in known]
    for same in (starts, means):
        numbered = sorted(
            (key.index, k) for k, (_, key) in enumerate(known) if key.index is not None and same[k]
        )
        indices = [index for index, _ in numbered]
        if numbered and indices == list(range(indices[0], indices[0] + len(indices))):
            return [k for _, k in numbered]
    # `position[elbow_joint]`
    if joints := [k for k, (header, _) in enumerate(known) if header.startswith(f"{stem}[")]:
        return joints
    raise _wrong(item, f"is no column of the header ({printable(name)!r})", tuple(names))


def _wrong(item: str, why: str, limit: object = None) -> RecordError:
    text = f"columns: item {printable(item, 120)!r} {why}"
    return RecordError(text, limit=limit, next_step=_EXAMPLE)


def assign(
    names: Sequence[str] | None,
    columns: Mapping[str, str] | None,
    width: int,
    joints: Sequence[str] = (),
) -> headers.Match:
    """Find out what the columns of a table hold: as the user says, else by their names.

    Raises:
        RecordError: Columns that are not there, or a header that does not say what they are.
    """
    if columns is None:
        match = headers.match_headers(names or (), joints)
        signals = {name: cols for name, cols in match.columns.items() if name != "t"}
        notes = (*match.notes, *conversions(match.factors))
        return replace(match, columns=signals, notes=notes)
    mapping = {name: select(name, value, width, names) for name, value in columns.items()}
    clocks: tuple[table.Clock, ...] = ()
    if time := mapping.pop("t", None):
        label = names[time[0]] if names else f"column {time[0]}"
        scale = 1.0 if len(time) == 2 else parse_name(label).time_scale if names else None
        clocks = (table.Clock(columns=tuple(time), scale=scale, label=label),)
    if names is None:
        return headers.Match(columns=mapping, clocks=clocks)
    named = {q: _joints_of([names[k] for k in cols], joints) for q, cols in mapping.items()}
    own = named.get("q", ())
    for quantity, numbers in mapping.items():
        headers.require_one_order(quantity, numbers, named[quantity], own, joints)
    if own:
        # Each quantity in the joint order of q, where both tell their joints.
        alike = [q for q in mapping if set(named[q]) == set(own)]
        mapping |= {q: [mapping[q][named[q].index(joint)] for joint in own] for q in alike}
    factors: dict[str, tuple[float, ...]] = {}
    said: set[str] = set()
    notices: list[Finding] = []
    for quantity, numbers in mapping.items():
        family = headers.Family(members=[(parse_name(names[k]), k) for k in numbers])
        units = [family.unit_of(k) for k in numbers]
        factors[quantity], unknown = cells.factors_of(quantity, units)
        if unknown is not None:
            notices.append(cells.taken_as_it_is(quantity, names[numbers[0]], units[unknown]))
        if all(units):
            said.add(quantity)
    return headers.Match(
        columns=mapping,
        clocks=clocks,
        factors=factors,
        said=frozenset(said),
        joint_names=own,
        notes=conversions(factors),
        notices=tuple(notices),
    )


def _joints_of(names: Sequence[str], joints: Sequence[str]) -> tuple[str, ...]:
    """The joints that some columns' names tell, or none."""
    found = tuple(parse_name(name, joints).joint for name in names) if joints else ()
    known = {parse_name(joint, joints).joint for joint in joints}
    return found if len(set(found)) == len(found) and set(found) <= known and found else ()


def conversions(factors: Mapping[str, tuple[float, ...]]) -> tuple[str, ...]:
    """Units that were converted, in words."""
    changed = [
        f"{quantity} (times {', '.join(f'{x:.6g}' for x in (values if several else values[:1]))})"
        for quantity, values in factors.items()
        for several in (len({*values}) > 1,)
        if any(value != 1.0 for value in values)
    ]
    return (f"converted to SI units as the names say: {', '.join(changed)}",) if changed else ()
