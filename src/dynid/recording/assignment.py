"""Which columns of a table hold what, by its header or by what the user says."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dynid.core import Array, Finding
from dynid.recording.clocks import Clock
from dynid.recording.columns import parse_columns, select
from dynid.recording.headers import match_headers
from dynid.recording.naming import Name, parse_name
from dynid.recording.table import plain
from dynid.recording.units import factor_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Assignment:
    """The columns of each quantity, and what their names say of units and joints."""

    columns: Mapping[str, list[int]]
    """Quantity to column numbers, joint by joint."""
    clocks: tuple[Clock, ...]
    """Columns of time, the best first."""
    factors: Mapping[str, tuple[float, ...]]
    """Quantity to what each column is multiplied by, to be in SI units."""
    said: frozenset[str]
    """Quantities whose units the names say."""
    joint_names: tuple[str, ...] = ()
    """Joint names in the columns' order, where the names have them."""
    notes: tuple[str, ...] = ()
    """Choices made, in words."""
    notices: tuple[Finding, ...] = ()
    """What is suspect."""

    def signals(self, column: Callable[[int], Array]) -> dict[str, Array]:
        """Quantity to (N, n) values in SI units.

        Args:
            column: Gives the (N) numbers of a column.
        """
        return {
            name: np.column_stack([column(k) for k in numbers])
            * np.array(self.factors.get(name, (1.0,)))
            for name, numbers in self.columns.items()
        }


def assign(
    names: Sequence[str] | None,
    columns: str | Mapping[str, str] | None,
    width: int,
    where: str,
    joints: Sequence[str] = (),
) -> Assignment:
    """Find out what the columns of a table hold.

    Args:
        names: Column names with their units; None for a table without a header.
        columns: What the user says; None to go by the names, which are then needed.
        width: Number of columns.
        where: The file, for messages.
        joints: The robot's joint names; empty if it is not known.

    Raises:
        RecordError: Columns that are not there, or a header that does not say what they are.
    """
    if columns is None:
        match = match_headers(names or (), where, joints)
        return Assignment(
            columns={name: cols for name, cols in match.columns.items() if name != "t"},
            clocks=match.clocks,
            factors=match.factors,
            said=match.said,
            joint_names=match.joint_names,
            notes=(*match.notes, *_conversions(match.factors)),
        )
    spec = parse_columns(columns)
    mapping = {name: select(name, value, width, names) for name, value in spec.items()}
    clocks: tuple[Clock, ...] = ()
    if time := mapping.pop("t", None):
        scale = parse_name(names[time[0]]).time_scale if names and len(time) == 1 else None
        label = names[time[0]] if names else f"column {time[0]}"
        clocks = (Clock(columns=tuple(time), scale=1.0 if len(time) == 2 else scale, label=label),)
    if names is None:
        return Assignment(columns=mapping, clocks=clocks, factors={}, said=frozenset())
    factors: dict[str, tuple[float, ...]] = {}
    said: set[str] = set()
    notices: list[Finding] = []
    for quantity, numbers in mapping.items():
        units = _units_of([parse_name(names[k]) for k in numbers])
        known = [factor_of(quantity, unit) for unit in units]
        if None in known:
            unit = units[known.index(None)]
            notices.append(
                Finding(
                    "unit_suspect",
                    f"{quantity} is taken as it is from {plain(names[numbers[0]])!r}, though "
                    f"{plain(unit, 20)!r} is no unit of it",
                )
            )
            known = [1.0] * len(known)
        factors[quantity] = tuple(value for value in known if value is not None)
        if all(units):
            said.add(quantity)
    named = {q: _joints_of([names[k] for k in cols], joints) for q, cols in mapping.items()}
    own = named.get("q", ())
    return Assignment(
        columns={
            # Each quantity in the joint order of q, where both tell their joints.
            q: [cols[named[q].index(joint)] for joint in own] if set(named[q]) == set(own) else cols
            for q, cols in mapping.items()
        }
        if own
        else mapping,
        clocks=clocks,
        factors=factors,
        said=frozenset(said),
        joint_names=own,
        notes=_conversions(factors),
        notices=tuple(notices),
    )


def _units_of(parsed: Sequence[Name]) -> list[str]:
    """Units of columns; what stands in brackets is a joint's name where each has another."""
    joints = {name.joint for name in parsed}
    if all(joints) and len(joints) == len(parsed) > 1:
        return [name.unit if name.joint not in name.unit else "" for name in parsed]
    return [name.unit for name in parsed]


def _joints_of(names: Sequence[str], joints: Sequence[str]) -> tuple[str, ...]:
    """The joints that some columns' names tell, or none."""
    found = tuple(parse_name(name, joints).joint for name in names) if joints else ()
    known = {parse_name(joint, joints).joint for joint in joints}
    return found if len(set(found)) == len(found) and set(found) <= known and found else ()


def _conversions(factors: Mapping[str, tuple[float, ...]]) -> tuple[str, ...]:
    """Units that were converted, in words."""
    changed = [
        f"{quantity} (times {values[0]:.6g})"
        for quantity, values in factors.items()
        if any(value != 1.0 for value in values)
    ]
    return (f"converted to SI units as the names say: {', '.join(changed)}",) if changed else ()
