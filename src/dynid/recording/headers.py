"""Find the quantities in a header, without being told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dynid.core.errors import RecordError
from dynid.recording.naming import RANK, Name, parse_name
from dynid.recording.table import ESSENTIAL, plain
from dynid.recording.units import check_unit

_TORQUE_STEMS = ("torque", "tau", "effort", "current", "cur")


@dataclass(frozen=True, slots=True, kw_only=True)
class Match:
    """Which columns hold what."""

    columns: Mapping[str, list[int]]
    """Quantity to column numbers, joint by joint; `t` has one."""
    time_scale: float | None
    """Seconds per unit of the time column, where its name says so."""
    in_degrees: frozenset[str]
    """Quantities whose names say degrees."""
    joint_names: tuple[str, ...]
    """Joint names, where the header has them."""
    notes: tuple[str, ...]
    """Choices made, in words."""


def match_headers(names: Sequence[str], where: str) -> Match:
    """Find the quantities in a header.

    Args:
        names: Column names.
        where: The file, for messages.

    Raises:
        RecordError: No positions, a joint's column missing, or a name that is there twice.
    """
    families: dict[str, list[tuple[Name, int]]] = {}
    for column, text in enumerate(names):
        key = parse_name(text)
        families.setdefault(key.base, []).append((key, column))
    chosen, notes = _choose(families)
    columns: dict[str, list[int]] = {}
    joint_names: tuple[str, ...] = ()
    degrees: set[str] = set()
    for quantity, base in chosen.items():
        family = families[base]
        if quantity == "t":
            columns["t"] = [_only_time(family, names, where)]
            check_unit("t", family[0][0].unit, names[columns["t"][0]], where)
            continue
        try:
            columns[quantity], joints = _by_joint(family, names, quantity, where)
        except RecordError:
            if quantity in ESSENTIAL:
                raise
            notes.append(f"{quantity} is left out: a joint's column is missing or there twice")
            continue
        joint_names = joint_names or joints
        for key, column in family:
            check_unit(quantity, key.unit, names[column], where)
        if any(key.degrees for key, _ in family):
            degrees.add(quantity)
    if "q" not in columns:
        raise RecordError(
            "no columns of positions are recognised",
            where=where,
            value=tuple(names)[:40],
            next_step="Name them with --columns, for example t=0,q=1:7,current=13:19.",
        )
    joints = len(columns["q"])
    for quantity in [x for x in columns if x not in ("t", "q")]:
        if len(columns[quantity]) == joints:
            continue
        # One lone column beside many joints is a counter or a total, not a damaged family.
        if quantity in ESSENTIAL and len(columns[quantity]) > 1:
            raise RecordError(
                f"{quantity} has {len(columns[quantity])} columns but q has {joints}",
                where=where,
                next_step="Check the header, or name the columns with --columns.",
            )
        del columns[quantity]
        notes.append(f"{quantity} is left out: its columns do not match the joints")
    time = families[chosen["t"]][0][0] if "t" in columns else None
    return Match(
        columns=columns,
        time_scale=time.time_scale if time else None,
        in_degrees=frozenset(degrees),
        joint_names=joint_names,
        notes=tuple(notes),
    )


def _choose(families: Mapping[str, Sequence[object]]) -> tuple[dict[str, str], list[str]]:
    ranked: dict[str, list[tuple[int, str]]] = {}
    for base in families:
        if base in RANK:
            quantity, rank = RANK[base]
            ranked.setdefault(quantity, []).append((rank, base))
    chosen = {quantity: min(options)[1] for quantity, options in ranked.items()}
    notes = [
        f"{quantity} is read from {chosen[quantity]!r}, not from "
        + ", ".join(repr(base) for _, base in sorted(options)[1:])
        for quantity, options in ranked.items()
        if len(options) > 1
    ]
    taken = set(chosen.values())
    others = sorted(
        base
        for base in families
        if base not in RANK and base.startswith(_TORQUE_STEMS) and base not in taken
    )
    if "effort" not in chosen and "current" not in chosen and others:
        stem = others[0]
        chosen["current" if stem.startswith("cur") else "effort"] = stem
        notes.append(f"the only torque-like columns are {stem!r}; they are taken")
    elif others:
        kept = [chosen[x] for x in ("effort", "current") if x in chosen]
        notes.append(
            f"torques are read from {' and '.join(map(repr, kept))}; not used: "
            + ", ".join(map(repr, others[:8]))
        )
    return chosen, notes


def _only_time(family: list[tuple[Name, int]], names: Sequence[str], where: str) -> int:
    if len(family) > 1:
        raise RecordError(
            "more than one time column",
            where=where,
            value=[names[k] for _, k in family],
            next_step="Say which with --columns t=...",
        )
    return family[0][1]


def _by_joint(
    family: list[tuple[Name, int]], names: Sequence[str], quantity: str, where: str
) -> tuple[list[int], tuple[str, ...]]:
    """Columns of a quantity, joint by joint, and joint names where the header has them."""
    numbered = sorted((key.index, column) for key, column in family if key.index is not None)
    if numbered:
        indices = [index for index, _ in numbered]
        if indices[0] in (0, 1) and indices == list(range(indices[0], indices[0] + len(indices))):
            return [column for _, column in numbered], ()
        raise RecordError(
            f"a column of {quantity} is missing or there twice: joints {indices}",
            where=where,
            value=[names[column] for _, column in numbered],
            next_step="Check the header, or name the columns with --columns.",
        )
    joints = tuple(key.joint for key, _ in family)
    if len(family) > 1 and (not all(joints) or len(set(joints)) != len(joints)):
        raise RecordError(
            f"{len(family)} columns are called {plain(names[family[0][1]])!r}",
            where=where,
            next_step="Say which are meant with --columns.",
        )
    return [column for _, column in family], joints if len(family) > 1 else ()
