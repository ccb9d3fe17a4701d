"""Take the names of columns and variables apart."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from dynid.recording.units import factor_of, is_unit
from dynid.recording.vocabulary import CONTENT, OTHER, PLAIN, RANK, TARGET, TARGET_OF

_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z][a-z])")
_BRACKET = re.compile(r"[\[({]([^\[\](){}]*)[\])}]\s*$")
_INDEX_LAST = re.compile(r"^(.*?)[\s_\-]*(?:(?<![a-z])(?:joint|jnt|axis|j|a))?[\s_\-]*(\d{1,3})$")
_INDEX_FIRST = re.compile(r"^(?:joint|jnt|axis|motor|j|a)[\s_\-]*(\d{1,3})[\s_\-:]+(.+)$")
_INDEX_WITHIN = re.compile(r"^([a-z][a-z_\s\-]*?)[\s_\-]*(\d{1,3})[\s_\-]+([a-z][a-z_\s\-]*)$")
_INDEX_ALONE = re.compile(r"(?:joint|jnt|axis|motor|j|a)?[\s_\-]*(\d{1,3})")
_INDEX_PATH = re.compile(r"^(.*?)[\[(]?(?<![a-z\d])(\d{1,3})[\])]?$")
_DEGREES = re.compile(r"(^|_)(deg|degs|degree|degrees)(_|$)")
_SECONDS = frozenset({"sec", "secs"})
_NANOSECONDS = frozenset({"nanosec", "nanosecs", "nsec", "nsecs"})
_NO_JOINT = PLAIN | TARGET | OTHER | {"header", "stamp", "time", "current", "previous"}
_QUALIFIERS = (TARGET | OTHER | CONTENT) | frozenset(
    [
        "raw",
        "filtered",
        "filt",
        "smooth",
        "sim",
        "simulated",
        "model",
        "mean",
        "std",
        "var",
        "min",
        "max",
        "rms",
        "init",
        "start",
        "end",
    ]
)
_SUNRISE = re.compile(r"_lbr_[a-z]+_\d+_r\d+(_\d+)?")
"""KUKA's DataRecorder writes the robot's name into each column's."""
_ONE_LETTER = {"a": "current", "s": "t"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Name:
    """A column name taken apart."""

    base: str
    """Lower case, words joined by underscores, without index and unit."""
    index: int | None = None
    """The joint's number in the name, as written."""
    joint: str = ""
    """A joint's name, from paths such as `/joint_states/elbow_joint/position`."""
    unit: str = ""
    """The unit in brackets, or at the end of the name."""
    scope: str = ""
    """What stands before in a path, as `joint_states` does."""

    @property
    def time_scale(self) -> float | None:
        """Seconds per unit, where a time column names its unit."""
        return factor_of("t", self.unit) if self.unit else None

    @property
    def clock(self) -> str:
        """`sec` or `nanosec` for half of a stamp, `stamp` for a header's, else empty."""
        words = [word for word in (*self.scope.split("."), *self.base.split("_")) if word] or [""]
        if words[-1] in _NANOSECONDS or words[-2:] == ["nano", "sec"]:
            return "nanosec"
        if words[-1] in _SECONDS and (words[:-1] in ([], ["zeit", "in"]) or "stamp" in words):
            return "sec"
        return "stamp" if words[-1] == "stamp" and "header" in words else ""

    @property
    def meaning(self) -> tuple[str, int] | None:
        """The quantity and the name's rank among its names; None for anything else.

        Words of the path count: `desired/positions` are target positions.
        """
        around = {word for part in self.scope.split(".") for word in part.split("_")}
        if around & OTHER:
            return None
        found = RANK.get(self.base) or _by_words(self.base)
        if found and around & TARGET and found[0] in TARGET_OF:
            return TARGET_OF[found[0]], found[1]
        return found


def says_degrees(name: str) -> bool:
    """Whether a name has the word `deg` in it, as `act_pos_mot_deg` does."""
    return bool(_DEGREES.search(re.sub(r"[^a-z0-9]+", "_", name.lower())))


def parse_name(text: str, joints: Sequence[str] = ()) -> Name:
    """Take a column name apart: `actual_q_3`, `tau [Nm] 2`, `/states/elbow_joint/position`.

    Args:
        text: The name as the file has it.
        joints: Names of the robot's joints, which are then found wherever they stand.
    """
    name, index, unit, inside = _brackets(_plain(text))
    parts = [part for part in re.split(r"[/.]", name) if part.strip()]
    known = _known_joint([*parts, inside] if inside else parts, joints)
    if known is not None:
        joint, parts = known
        last = parts.pop() if parts else ""
        while parts and _joined(last) in CONTENT:
            last = parts.pop()
        return _unit_at_the_end(_name(last, parts, joint=joint, unit=unit))
    last = ""
    while parts and (not last or _joined(last) in CONTENT):
        last = parts.pop()
        if index is None:
            if parts and (match := _INDEX_ALONE.fullmatch(last)):
                # `position.3`, `AIPos.A1`
                index, last = int(match.group(1)), parts.pop()
            else:
                last, index = _index(last)
    if index is None and not inside and parts and (match := _INDEX_PATH.match(parts[-1])):
        index, parts[-1] = int(match.group(2)), match.group(1)
    joint = ""
    if index is None and inside:
        # `position[elbow_joint]`; it is a unit after all where all columns have the same.
        joint, unit = _joined(inside), inside
    elif index is not None:
        unit = unit or inside
    elif parts and not set(_joined(parts[-1]).split("_")) <= _NO_JOINT:
        joint = _joined(parts.pop())
    return _unit_at_the_end(_name(last, parts, joint=joint, unit=unit, index=index))


def _brackets(name: str) -> tuple[str, int | None, str, str]:
    """A name without its brackets; the number, the unit, and any other text in them."""
    index, unit, inside = None, "", ""
    while match := _BRACKET.search(name):
        text = match.group(1).strip()
        if text.isdecimal() and len(text) <= 3:
            index = int(text)
        elif is_unit(text):
            unit = text
        else:
            inside = text
        name = name[: match.start()].strip()
    return name, index, unit, inside


def _name(
    last: str, parts: Sequence[str], *, joint: str, unit: str, index: int | None = None
) -> Name:
    scope = ".".join(filter(None, map(_joined, parts)))
    return Name(base=_joined(last), index=index, joint=joint, unit=unit, scope=scope)


def split_joint(text: str) -> Name | None:
    """A name whose first or last words are a joint's: `elbow_joint_position`, `tau_elbow`.

    Args:
        text: The name as the file has it.

    Returns:
        The name taken apart so, or None where no words of it are a quantity's.
    """
    name, _, unit, _ = _brackets(_plain(text))
    parts = [part for part in re.split(r"[/.]", name) if part.strip()]
    words = _joined(parts[-1]).split("_") if parts else []
    for k in range(1, len(words)):
        tail = "_".join(words[k:])
        # `elbow_joint_position` is the position of `elbow_joint`.
        if tail in RANK and words[k] not in ("joint", "jnt") and not _QUALIFIERS & {*words[:k]}:
            return _name(tail, parts[:-1], joint="_".join(words[:k]), unit=unit)
    for k in range(len(words) - 1, 0, -1):
        head = "_".join(words[:k])
        if head in RANK and not words[k].isdecimal() and not _QUALIFIERS & {*words[k:]}:
            return _name(head, parts[:-1], joint="_".join(words[k:]), unit=unit)
    return None


def _plain(text: str) -> str:
    name = _CAMEL.sub("_", text.strip().strip("\"'\ufeff").strip()).lower()
    return _SUNRISE.sub("", name)


def _joined(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", name).strip("_")


def _known_joint(parts: list[str], joints: Sequence[str]) -> tuple[str, list[str]] | None:
    """The robot's joint that a path names, and the path without it."""
    for joint in sorted(joints, key=len, reverse=True):
        words = _joined(_plain(joint))
        for k, part in enumerate(parts):
            text = _joined(part)
            if match := re.search(rf"(?:^|_){re.escape(words)}(?:_|$)", text):
                rest = _joined(f"{text[: match.start()]}_{text[match.end() :]}")
                return words, [*parts[:k], *([rest] if rest else []), *parts[k + 1 :]]
    return None


def _index(name: str) -> tuple[str, int | None]:
    """A name without its number, and the number."""
    if first := _INDEX_FIRST.match(name):
        return first.group(2), int(first.group(1))
    if within := _INDEX_WITHIN.match(name):
        base = _joined(f"{within.group(1)}_{within.group(3)}")
        if base in RANK or _unit_at_the_end(Name(base=base)).unit:
            return base, int(within.group(2))
    if (last := _INDEX_LAST.match(name)) and last.group(1):
        return last.group(1), int(last.group(2))
    return name, None


def _unit_at_the_end(name: Name) -> Name:
    words = name.base.split("_")
    if name.base in RANK:
        return name
    for count in (3, 2, 1):
        stem, tail = "_".join(words[:-count]), "_".join(words[-count:])
        meaning = RANK.get(stem) or _by_words(stem)
        if meaning is None or (len(tail) == 1 and _ONE_LETTER.get(tail) != meaning[0]):
            continue
        if factor_of(meaning[0], tail) is not None:
            return replace(name, base=stem, unit=tail)
    return name


def _by_words(base: str) -> tuple[str, int] | None:
    """The meaning of a name with words around it: `robot_actual_q`, `desired_joint_speed`."""
    words = base.split("_")
    target = any(word in TARGET for word in words[1:]) or (words[0] in TARGET and len(words) > 1)
    core = [word for word in words if word not in TARGET]
    while core and "_".join(core) not in RANK and core[0] in PLAIN:
        core = core[1:]
    while core and "_".join(core) not in RANK and core[-1] in PLAIN:
        core = core[:-1]
    found = RANK.get("_".join(core)) if core and len(core) < len(words) else None
    if found is None:
        return None
    quantity, rank = found
    if target:
        return (TARGET_OF[quantity], rank + 200) if quantity in TARGET_OF else None
    return quantity, rank + 100
