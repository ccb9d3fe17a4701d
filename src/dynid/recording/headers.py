"""Find the quantities in a header, without being told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dynid.core import RecordError
from dynid.recording.chosen import choose
from dynid.recording.clocks import Clock, find_clocks
from dynid.recording.families import Family, collect
from dynid.recording.naming import parse_name, split_joint
from dynid.recording.table import ESSENTIAL, TORQUE_SOURCES
from dynid.recording.units import factor_of, refuse_unit


class NotRecognised(RecordError):
    """A header in which no positions are found."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Match:
    """Which columns hold what."""

    columns: Mapping[str, list[int]]
    """Quantity to column numbers, joint by joint; `t` to those of the best clock."""
    clocks: tuple[Clock, ...]
    """Columns of time, the best first."""
    factors: Mapping[str, tuple[float, ...]]
    """Quantity to what each column is multiplied by, to be in SI units."""
    said: frozenset[str]
    """Quantities whose units the header names."""
    joint_names: tuple[str, ...]
    """Joint names, where the header has them."""
    notes: tuple[str, ...]
    """Choices made, in words."""


def match_headers(names: Sequence[str], where: str, joints: Sequence[str] = ()) -> Match:
    """Find the quantities in a header.

    Args:
        names: Column names.
        where: The file, for messages.
        joints: The robot's joint names; empty if it is not known.

    Raises:
        RecordError: No positions, a joint's column missing, positions or torques that two
            sets of columns claim, or a unit that is not known.
    """
    families = _families(names, joints)
    chosen, notes = choose(families, names, where)
    scope = chosen["q"].scope if "q" in chosen else ""
    clocks = tuple(find_clocks([parse_name(text) for text in names], names, scope, where))
    columns: dict[str, list[int]] = {}
    factors: dict[str, tuple[float, ...]] = {}
    said: set[str] = set()
    joint_names: tuple[str, ...] = ()
    for quantity, family in chosen.items():
        try:
            columns[quantity], named = family.by_joint(names, quantity, where)
        except RecordError:
            if quantity in ESSENTIAL:
                raise
            notes.append(f"{quantity} is left out: a joint's column is missing or there twice")
            continue
        units = [family.unit_of(column) for column in columns[quantity]]
        known = [factor_of(quantity, unit) for unit in units]
        if None in known:
            at = known.index(None)
            if quantity in ESSENTIAL:
                raise refuse_unit(quantity, units[at], names[columns[quantity][at]], where)
            notes.append(f"{quantity} is left out: its unit {units[at]!r} is not known")
            del columns[quantity]
            continue
        factors[quantity] = tuple(value for value in known if value is not None)
        if all(units):
            said.add(quantity)
        if named and quantity == "q":
            joint_names = named
        elif named and joint_names:
            columns[quantity] = _same_order(columns[quantity], named, joint_names)
            if not columns[quantity]:
                del columns[quantity]
                notes.append(f"{quantity} is left out: its joints are not those of q")
    if "q" not in columns:
        raise NotRecognised(
            "no columns of positions are recognised",
            where=where,
            value=tuple(names)[:40],
            next_step="Name them with --columns, for example t=0,q=1:7,current=13:19.",
        )
    width = len(columns["q"])
    for quantity in [name for name in columns if len(columns[name]) != width]:
        if quantity in ESSENTIAL:
            raise RecordError(
                f"{quantity} has {len(columns[quantity])} columns but q has {width}",
                where=where,
                next_step="Check the header, or name the columns with --columns.",
            )
        notes.append(f"{quantity} is left out: its columns do not match the joints")
        del columns[quantity]
    return Match(
        columns={"t": list(clocks[0].columns), **columns} if clocks else columns,
        clocks=clocks,
        factors=factors,
        said=frozenset(said),
        joint_names=joint_names,
        notes=tuple(notes),
    )


def _families(names: Sequence[str], joints: Sequence[str]) -> dict[str, list[Family]]:
    """Families of each quantity.

    By the robot's joint names where all of them are there, by the names' own structure, or by
    what stands before and after a quantity's word.
    """
    if joints:
        found = collect(parse_name(text, joints) for text in names)
        wanted = {name.joint for joint in joints for name in [parse_name(joint, joints)]}
        found = {
            quantity: [_only(family, wanted) for family in families]
            for quantity, families in found.items()
        }
        if not found.get("q"):
            # Columns that are called as the joints, beside `elbow_joint_effort`, are positions.
            bare = [x for x in found.get("", []) if not x.base and set(x.joints) == wanted]
            found["q"] = bare
        if any(set(family.joints) == wanted for family in found["q"]):
            return found
    plainly = collect(map(parse_name, names))
    if any(family.whole for family in plainly.get("q", [])):
        return plainly
    split = collect(split_joint(text) or parse_name(text) for text in names)
    torques = [set(x.joints) for name in TORQUE_SOURCES for x in split.get(name, [])]
    # `q_raw` and `q_filtered` are no two joints; where torques have the same names, they are.
    sure = any(
        family.joints and any(set(family.joints) <= joints for joints in torques)
        for family in split.get("q", [])
    )
    return split if sure else plainly


def _only(family: Family, wanted: set[str]) -> Family:
    """A family without the columns of other joints, as of a gripper, if it has all wanted."""
    if set(family.joints) > wanted:
        family.members = [item for item in family.members if item[0].joint in wanted]
    return family


def _same_order(
    columns: list[int], named: tuple[str, ...], joint_names: tuple[str, ...]
) -> list[int]:
    """Columns in the order of other joint names; none where a joint is missing."""
    if not set(joint_names) <= set(named):
        return []
    return [columns[named.index(joint)] for joint in joint_names]
