"""Find the quantities in a header: columns that belong together, and which are meant."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dynid.core import Array, Finding, RecordError, UnclearRecordError, printable
from dynid.recording import cells, table
from dynid.recording.names import OTHER, TARGET, Name, parse_name, split_joint, words_of


@dataclass(slots=True, kw_only=True)
class Family:
    """Columns of the same name, each of another joint."""

    base: str = ""
    scope: str = ""
    rank: int = 0
    """Place of the name among those of its quantity; the first is the surest."""
    members: list[tuple[Name, int]] = field(default_factory=list[tuple[Name, int]])
    """Name and column number."""

    @property
    def label(self) -> str:
        """What to call it in a message."""
        return f"{self.scope}.{self.base}" if self.scope else self.base

    @property
    def joints(self) -> tuple[str, ...]:
        """The joint names in the columns' order, where each column has another."""
        names = tuple(name.joint for name, _ in self.members)
        return names if all(names) and len(set(names)) == len(names) > 1 else ()

    @property
    def whole(self) -> bool:
        """Whether the columns make one quantity of several joints, or of one."""
        return bool(self.joints) or len(self.members) == 1 or self._numbered() is not None

    def unit_of(self, column: int) -> str:
        """The unit that a column's name gives; empty for none."""
        name = next(name for name, number in self.members if number == column)
        # What stands in brackets is a joint's name where all columns have another.
        return "" if self.joints and name.unit and name.joint in name.unit else name.unit

    def by_joint(self, names: Sequence[str], quantity: str) -> tuple[list[int], tuple[str, ...]]:
        """Columns joint by joint, and joint names where the header has them.

        Raises:
            RecordError: A joint's column is missing or there twice.
        """
        numbered = self._numbered()
        if numbered is not None:
            return numbered, ()
        found = [column for _, column in self.members]
        if any(name.index is not None for name, _ in self.members):
            indices = sorted(name.index for name, _ in self.members if name.index is not None)
            raise UnclearRecordError(
                f"a column of {quantity} is missing or there twice: joints {indices}",
                value=[names[column] for column in found],
                next_step="Check the header, or name the columns with --columns.",
            )
        if len(found) > 1 and not self.joints:
            what = f"{len(found)} columns are called {printable(names[found[0]])!r}"
            raise UnclearRecordError(what, next_step="Choose them with --columns.")
        return found, self.joints

    def _numbered(self) -> list[int] | None:
        pairs = sorted((n.index, column) for n, column in self.members if n.index is not None)
        indices = [index for index, _ in pairs]
        if not indices or indices[0] not in (0, 1):
            return None
        if indices != list(range(indices[0], indices[0] + len(indices))):
            return None
        return [column for _, column in pairs]


_SLIDING = {"q": words_of("d stroke"), "effort": words_of("force f kraft")}
"""What a prismatic joint's column may be called beside those of revolute ones."""


def _collect(names: Iterable[Name]) -> dict[str, list[Family]]:
    """Group columns by quantity, path and name; those of no quantity stand under ``""``."""
    found: dict[tuple[str, str, str], Family] = {}
    for column, name in enumerate(names):
        quantity, rank = name.meaning or ("", 0)
        if quantity == "t":
            continue
        key = (quantity, name.scope, name.base)
        family = found.setdefault(key, Family(base=name.base, scope=name.scope, rank=rank))
        family.members.append((name, column))
    grouped: dict[str, list[Family]] = {}
    for (quantity, _, _), family in found.items():
        grouped.setdefault(quantity, []).append(family)
    for quantity, words in _SLIDING.items():
        for family in grouped.get(quantity, []):
            for other in list(grouped.get("", [])):
                both = Family(members=[*family.members, *other.members])
                if both.whole and words & {*other.base.split("_")} and other.scope == family.scope:
                    family.members = both.members
                    grouped[""].remove(other)
    return grouped


def spelled(columns: Mapping[str, Sequence[int]]) -> str:
    """A `--columns` option that means these columns: `q=1:7,effort=13+15`."""
    items: list[str] = []
    for quantity, numbers in columns.items():
        first, count = numbers[0], len(numbers)
        if count > 1 and list(numbers) == list(range(first, first + count)):
            items.append(f"{quantity}={first}:{first + count}")
        else:
            items.append(f"{quantity}={'+'.join(map(str, numbers))}")
    return ",".join(items)


def by_rows(columns: Mapping[str, Sequence[int]]) -> str:
    """What to type to count time by rows in place of the time column, beside these columns."""
    kept = {name: columns[name] for name in ("q", "qd", "effort", "current") if name in columns}
    if "q" not in kept:
        return "Leave t out of --columns and give the clock with --rate."
    return f"Leave the time out and give the clock: --columns {spelled(kept)} --rate HZ."


_TORQUE_STEMS = ("torque", "tau", "effort", "current", "cur")
_TORQUES = words_of("torque torques tau taus effort efforts")
_NOT_MEASURED = words_of(
    "ext external error err gravity grav friction coriolis residual model estimated est predicted "
    "feedforward ff limit limits max min bias offset hat voltage cmd command desired target "
    "position positions pos velocity velocities vel speed speeds angle angles pose q qd dq time "
    "mode state id step index name gain enable enabled constant const rate ratio temperature temp"
)
_MAIN_SCOPES = frozenset({"joint_states", "joint_state", "actual", "feedback", "measured", "state"})


def _choose(
    families: Mapping[str, list[Family]], names: Sequence[str]
) -> tuple[dict[str, Family], list[str]]:
    """Choose the columns of each quantity among all that may be it.

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
        if len(tied) > 1 and quantity in ("q", *table.TORQUE_SOURCES):
            columns = {
                name: [column for _, column in family.members]
                for name in ("q", "qd", "effort", "current")
                for family in families.get(name, [])
                if family.scope == tied[0].scope
            }
            raise UnclearRecordError(
                f"{len(tied)} sets of columns can be {quantity}",
                value=", ".join(family.label for family in tied),
                next_step=_advice(tied[0], columns, names),
            )
        chosen[quantity] = ranked[0]
        if len(ranked) > 1:
            others = ", ".join(repr(family.label) for family in ranked[1:6])
            notes.append(f"{quantity} is read from {ranked[0].label!r}, not from {others}")
    like = [family for family in families.get("", []) if _is_torque_like(family)]
    if like and "q" in chosen and not set(table.TORQUE_SOURCES) & set(chosen):
        if len(like) > 1:
            sets = {name: chosen[name] for name in ("q", "qd") if name in chosen}
            sets["effort"] = like[0]
            columns = {name: [column for _, column in x.members] for name, x in sets.items()}
            raise UnclearRecordError(
                "more than one set of columns can be torques",
                value=", ".join(family.label for family in like),
                next_step=_advice(like[0], columns, names),
            )
        stem = like[0].base
        # `current_effort` is the present one, as `current_position` is.
        torque = not stem.startswith("cur") or _TORQUES & {*stem.split("_")}
        chosen["effort" if torque else "current"] = like[0]
        notes.append(f"the only torque-like columns are {stem!r}; they are taken")
    elif like:
        kept = [repr(chosen[name].label) for name in table.TORQUE_SOURCES if name in chosen]
        unused = ", ".join(repr(family.label) for family in like[:8])
        notes.append(f"torques are read from {' and '.join(kept)}; not used: {unused}")
    return chosen, notes


def _advice(family: Family, columns: Mapping[str, Sequence[int]], names: Sequence[str]) -> str:
    """What to type for one of several sets, with the time beside these columns."""
    clocks = table.find_clocks(list(map(parse_name, names)), names, family.scope)
    time = {"t": clocks[0].columns} if clocks else {}
    option = spelled({**time, **columns})
    return f"Choose with --columns, for those of {family.label}: --columns {option}"


def _is_torque_like(family: Family) -> bool:
    """Whether a name that no recorder is known for begins as a measured torque's does."""
    words, around = (set(text.replace(".", "_").split("_")) for text in (family.base, family.scope))
    measured = not (_NOT_MEASURED & words or (OTHER | TARGET) & around)
    return measured and family.base.startswith(_TORQUE_STEMS)


def _order(family: Family, home: str | None) -> tuple[bool, bool, bool, bool, int]:
    """The best family has the smallest: complete, beside the positions, a well-known path.

    Of a joint's and its motor's states, the joint's is meant.
    """
    words = set(family.scope.split(".")) | set(family.scope.replace(".", "_").split("_"))
    away = home is not None and family.scope != home
    known = not family.scope or words & _MAIN_SCOPES
    return (not family.whole, away, "motor" in words, not known, family.rank)


class NotRecognised(UnclearRecordError):
    """A header in which no positions are found."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Match:
    """Which columns hold what."""

    columns: Mapping[str, list[int]]
    """Quantity to column numbers, joint by joint; `t` to those of the best clock."""
    clocks: tuple[table.Clock, ...]
    """Columns of time, the best first."""
    factors: Mapping[str, tuple[float, ...]] = field(default_factory=dict[str, tuple[float, ...]])
    """Quantity to what each column is multiplied by, to be in SI units."""
    said: frozenset[str] = frozenset()
    """Quantities whose units the header names."""
    joint_names: tuple[str, ...] = ()
    """Joint names in the columns' order, where the header has them."""
    notes: tuple[str, ...] = ()
    """Choices made, in words."""
    notices: tuple[Finding, ...] = ()
    """What is suspect."""

    def table(
        self,
        names: Sequence[str] | None,
        column: Callable[[int], Array],
        moments: frozenset[int] = frozenset(),
        beside: tuple[str, ...] = (),
        **facts: Any,
    ) -> table.RawTable:
        """The raw table of these columns, in SI units.

        `column` gives the (N) numbers of a column; `moments` are columns that were dates, in
        seconds by now; `beside` are joint names that stand with the numbers, for columns without;
        `facts` are more of the table.
        """
        whole = len(beside) == len({*beside}) == len(self.columns["q"])
        time = table.stamps_of(self.clocks, column, moments)
        notes = (*self.notes, *time.pop("notes"))
        return table.RawTable(
            signals={
                name: np.column_stack([column(k) for k in numbers])
                * np.array(self.factors.get(name, (1.0,)))
                for name, numbers in self.columns.items()
            },
            labels={
                name: tuple(names[k] if names else f"column {k}" for k in numbers)
                for name, numbers in self.columns.items()
            },
            columns=dict(self.columns),
            said=self.said,
            joint_names=self.joint_names or (beside if whole else ()),
            notices=self.notices,
            notes=notes,
            **time,
            **facts,
        )


def match_headers(names: Sequence[str], joints: Sequence[str] = ()) -> Match:
    """Find the quantities in a header; of a robot that is not known `joints` is empty.

    Raises:
        RecordError: No positions, a joint's column missing, positions or torques that two
            sets of columns claim, or a unit that is not known.
    """
    families = _families(names, joints)
    chosen, notes = _choose(families, names)
    scope = chosen["q"].scope if "q" in chosen else ""
    clocks = tuple(table.find_clocks([parse_name(text) for text in names], names, scope))
    columns: dict[str, list[int]] = {}
    factors: dict[str, tuple[float, ...]] = {}
    said: set[str] = set()
    joint_names: tuple[str, ...] = ()
    # Positions come first.
    for quantity, family in chosen.items():
        try:
            found, named = family.by_joint(names, quantity)
            if quantity == "q":
                joint_names = named
            elif named and joint_names:
                if not set(joint_names) <= set(named):
                    notes.append(f"{quantity} is left out: its joints are not those of q")
                    continue
                found = [found[named.index(joint)] for joint in joint_names]
            require_one_order(quantity, found, named, joint_names, joints)
            units = [family.unit_of(column) for column in found]
            known, at = cells.factors_of(quantity, units)
            if at is not None:
                raise cells.refuse_unit(quantity, units[at], names[found[at]], len(found))
            width = len(columns.get("q", found))
            if len(found) != width:
                raise UnclearRecordError(
                    f"{quantity} has {len(found)} columns but q has {width}",
                    next_step="Check the header, or name the columns with --columns.",
                )
        except RecordError as error:
            if quantity in table.ESSENTIAL:
                raise
            notes.append(f"{quantity} is left out: {error.what}")
            continue
        columns[quantity], factors[quantity] = found, known
        if all(units):
            said.add(quantity)
    if "q" not in columns:
        raise NotRecognised(
            "no columns of positions are recognised",
            value=tuple(names)[:40],
            next_step=f"Name them with --columns, for example {cells.example_columns(len(joints))} "
            "(currents [A]; torques are effort=).",
        )
    return Match(
        columns={"t": list(clocks[0].columns), **columns} if clocks else columns,
        clocks=clocks,
        factors=factors,
        said=frozenset(said),
        joint_names=joint_names,
        notes=tuple(notes),
    )


def require_one_order(
    quantity: str,
    columns: Sequence[int],
    named: tuple[str, ...],
    of_q: tuple[str, ...],
    robot: Sequence[str],
) -> None:
    """Refuse numbers beside joint names that do not stand in the robot's order.

    Numbers may count from the base, or in the order of the names: nobody can tell which. `named`
    and `of_q` are the joints' names in the order of the columns, of the quantity and of q, or none.

    Raises:
        RecordError: Only one of the quantity and the positions names its joints, in another order.
    """
    base = tuple(parse_name(joint, robot).joint for joint in robot)
    if len(columns) < 2 or bool(named) == bool(of_q) or (named or of_q) == base:
        return
    told = ("q", quantity) if of_q else (quantity, "q")
    raise UnclearRecordError(
        f"{told[0]} names its joints and {told[1]} only numbers them",
        value=printable(", ".join(named or of_q), 200),
        next_step=f"List the columns of {told[0]} base to tip with --columns and --robot, "
        "for example q=3+2+1+4+5+6.",
    )


def _families(names: Sequence[str], joints: Sequence[str]) -> dict[str, list[Family]]:
    """Families of each quantity.

    By the robot's joint names where all of them are there, by the names' own structure, or by
    what stands before and after a quantity's word.
    """
    if joints:
        found = _collect(parse_name(text, joints) for text in names)
        wanted = {name.joint for joint in joints for name in [parse_name(joint, joints)]}
        for family in [x for families in found.values() for x in families]:
            # Without the columns of other joints, as of a gripper.
            if set(family.joints) > wanted:
                family.members = [item for item in family.members if item[0].joint in wanted]
        _take_bare(found)
        if any(set(family.joints) == wanted for family in found.get("q", [])):
            return found
    plainly = _collect(map(parse_name, names))
    _take_bare(plainly)
    if any(family.whole for family in plainly.get("q", [])):
        return plainly
    split = _collect(split_joint(text) or parse_name(text) for text in names)
    torques = [set(x.joints) for name in table.TORQUE_SOURCES for x in split.get(name, [])]
    # `q_raw` and `q_filtered` are no two joints; where torques have the same names, they are.
    named = [set(family.joints) for family in split.get("q", []) if family.joints]
    sure = any(own <= joints for own in named for joints in torques)
    return split if sure else plainly


def _take_bare(found: dict[str, list[Family]]) -> None:
    """Take columns that are called as their joints, beside those of torques, for positions.

    As `joint_1` beside `effort_1`, or `elbow_joint` beside `elbow_joint_effort`.
    """
    torques = {len(x.members) for name in table.TORQUE_SOURCES for x in found.get(name, [])}
    nameless = [x for x in found.get("", []) if not x.base and len(x.members) in torques]
    bare = [x for x in nameless if not any(name.unit for name, _ in x.members)]
    if bare and not found.get("q"):
        found["q"] = bare
