"""Which columns are meant where several could be: the measured ones, beside the positions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dynid.core import RecordError
from dynid.recording.clocks import find_clocks
from dynid.recording.families import Family, spelled
from dynid.recording.naming import parse_name
from dynid.recording.table import TORQUE_SOURCES
from dynid.recording.units import factor_of
from dynid.recording.vocabulary import OTHER, TARGET

_TORQUE_STEMS = ("torque", "tau", "effort", "current", "cur")
_NOT_MEASURED = frozenset(
    word
    for line in (
        "ext external error err gravity grav friction coriolis residual model estimated est",
        "predicted feedforward ff limit limits max min bias offset hat voltage cmd command",
        "desired target position positions pos velocity velocities vel speed speeds angle angles",
        "pose q qd dq time mode state id step index name gain enable enabled constant const rate",
        "ratio temperature temp",
    )
    for word in line.split()
)
NOT_TAKEN = "not taken for measured torques:"
"""Begins the note on columns that look like torques and may be others."""
_MAIN_SCOPES = frozenset({"joint_states", "joint_state", "actual", "feedback", "measured", "state"})


def choose(
    families: Mapping[str, list[Family]], names: Sequence[str], where: str
) -> tuple[dict[str, Family], list[str]]:
    """Choose the columns of each quantity among all that may be it.

    Args:
        families: Quantity to families of columns; those of no quantity under ``""``.
        names: All column names.
        where: The file, for messages.

    Returns:
        Quantity to its family, and the choices in words.

    Raises:
        RecordError: Several sets of columns can be positions or torques.
    """
    chosen: dict[str, Family] = {}
    notes: list[str] = []
    # Positions first: all other quantities are looked for beside them.
    for quantity in sorted(filter(None, families), key=lambda name: name != "q"):
        home = chosen["q"].scope if "q" in chosen else None
        ranked = sorted(families[quantity], key=lambda family: _order(family, home))
        tied = [family for family in ranked if _order(family, home) == _order(ranked[0], home)]
        if len(tied) > 1 and quantity in ("q", *TORQUE_SOURCES):
            columns = {
                name: [column for _, column in family.members]
                for name in ("q", "qd", "effort", "current")
                for family in families.get(name, [])
                if family.scope == tied[0].scope
            }
            clocks = find_clocks(list(map(parse_name, names)), names, tied[0].scope, where)
            if clocks:
                columns = {"t": list(clocks[0].columns), **columns}
            raise RecordError(
                f"{len(tied)} sets of columns can be {quantity}",
                where=where,
                value=", ".join(family.label for family in tied),
                next_step=f"Say which with --columns, for those of {tied[0].label}: "
                f"--columns {spelled(columns)}",
            )
        chosen[quantity] = ranked[0]
        if len(ranked) > 1:
            others = ", ".join(repr(family.label) for family in ranked[1:6])
            notes.append(f"{quantity} is read from {ranked[0].label!r}, not from {others}")
    like = [
        family
        for family in families.get("", [])
        if set(_TORQUE_STEMS) & set(family.base.split("_"))
        or family.base.startswith(_TORQUE_STEMS)
        or _by_unit(family)
    ]
    others = [
        family
        for family in like
        if (family.base.startswith(_TORQUE_STEMS) or _by_unit(family))
        and not _NOT_MEASURED & set(family.base.split("_"))
        and not (OTHER | TARGET) & set(family.scope.replace(".", "_").split("_"))
    ]
    if others and "effort" not in chosen and "current" not in chosen:
        if len(others) > 1:
            raise RecordError(
                "more than one set of columns can be torques",
                where=where,
                value=", ".join(family.label for family in others),
                next_step="Say which with --columns, for example "
                + spelled({"effort": [column for _, column in others[0].members]}),
            )
        stem = others[0].base
        current = _by_unit(others[0]) == "current" or stem.startswith("cur")
        chosen["current" if current else "effort"] = others[0]
        notes.append(f"the only torque-like columns are {stem!r}; they are taken")
    elif others:
        kept = [chosen[x].label for x in ("effort", "current") if x in chosen]
        notes.append(
            f"torques are read from {' and '.join(map(repr, kept))}; not used: "
            + ", ".join(repr(family.label) for family in others[:8])
        )
    passed = [family.label for family in like if family not in others]
    if passed and not any(name in chosen for name in TORQUE_SOURCES):
        notes.append(f"{NOT_TAKEN} {', '.join(map(repr, passed[:8]))}")
    return chosen, notes


def _by_unit(family: Family) -> str:
    """`effort` or `current`, where all columns of a name that is not known have such a unit."""
    units = {name.unit for name, _ in family.members}
    if not family.whole or "" in units or len(family.members) < 2:
        return ""
    # Forces in N may be anything's.
    for quantity, letter in (("effort", "m"), ("current", "a")):
        if all(factor_of(quantity, unit) is not None and letter in unit for unit in units):
            return quantity
    return ""


def _order(family: Family, home: str | None) -> tuple[bool, bool, bool, bool, int]:
    """The best family has the smallest: complete, beside the positions, a well-known path.

    Of a joint's and its motor's states, the joint's is meant.
    """
    words = set(family.scope.split(".")) | set(family.scope.replace(".", "_").split("_"))
    away = home is not None and family.scope != home
    known = not family.scope or words & _MAIN_SCOPES
    return (not family.whole, away, "motor" in words, not known, family.rank)
