"""Columns that belong together: one quantity of all joints."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from dynid.core import RecordError
from dynid.recording.naming import Name
from dynid.recording.table import plain


@dataclass(slots=True, kw_only=True)
class Family:
    """Columns of the same name, each of another joint."""

    base: str
    scope: str
    rank: int
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

    def by_joint(
        self, names: Sequence[str], quantity: str, where: str
    ) -> tuple[list[int], tuple[str, ...]]:
        """Columns joint by joint, and joint names where the header has them.

        Args:
            names: All column names, for messages.
            quantity: What the columns hold.
            where: The file, for messages.

        Raises:
            RecordError: A joint's column is missing or there twice.
        """
        numbered = self._numbered()
        if numbered is not None:
            return numbered, ()
        found = [column for _, column in self.members]
        if any(name.index is not None for name, _ in self.members):
            indices = sorted(name.index for name, _ in self.members if name.index is not None)
            raise RecordError(
                f"a column of {quantity} is missing or there twice: joints {indices}",
                where=where,
                value=[names[column] for column in found],
                next_step="Check the header, or name the columns with --columns.",
            )
        if len(found) > 1 and not self.joints:
            raise RecordError(
                f"{len(found)} columns are called {plain(names[found[0]])!r}",
                where=where,
                next_step="Say which are meant with --columns.",
            )
        return found, self.joints

    def _numbered(self) -> list[int] | None:
        pairs = sorted((n.index, column) for n, column in self.members if n.index is not None)
        indices = [index for index, _ in pairs]
        if not indices or indices[0] not in (0, 1):
            return None
        if indices != list(range(indices[0], indices[0] + len(indices))):
            return None
        return [column for _, column in pairs]


def collect(names: Iterable[Name]) -> dict[str, list[Family]]:
    """Group columns by quantity, path and name; those of no quantity stand under ``""``.

    Args:
        names: The column names taken apart, in the order of the columns.
    """
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
    return grouped


def spelled(columns: Mapping[str, Sequence[int]]) -> str:
    """A `--columns` option that means these columns: `q=1:7,effort=13+15`.

    Args:
        columns: Quantity to column numbers.
    """
    items: list[str] = []
    for quantity, numbers in columns.items():
        first, count = numbers[0], len(numbers)
        if count > 1 and list(numbers) == list(range(first, first + count)):
            items.append(f"{quantity}={first}:{first + count}")
        else:
            items.append(f"{quantity}={'+'.join(map(str, numbers))}")
    return ",".join(items)


def by_rows(columns: Mapping[str, Sequence[int]]) -> str:
    """What to type to count time by rows in place of the time column.

    Args:
        columns: Quantity to column numbers, without the time; empty where there are none.
    """
    kept = {name: columns[name] for name in ("q", "qd", "effort", "current") if name in columns}
    if "q" not in kept:
        return "Leave t out of --columns and give the clock with --rate."
    return f"Leave the time out and give the clock: --columns {spelled(kept)} --rate HZ."
