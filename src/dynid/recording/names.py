"""The words that recorders use for signals, and names of columns taken apart."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from dynid.core import RecordError, printable
from dynid.recording.cells import factor_of, is_unit

UR_JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
"""Joint names of Universal Robots' ROS drivers, base to tip; their messages sort them by letter."""
# The first that a file has wins; words around them, as in `actual_joint_position`, need no entry.
_SYNONYMS: dict[str, str] = {
    "t": (
        "t time timestamp time_stamp stamp timestamps times sec secs second seconds elapsed "
        "elapsed_time time_s t_s rostime controller_time rec_time time_cont rosbag_timestamp "
        "datetime date_time zeit zeitstempel tempo ipoc x_value ros_time current_time ts "
        "sample_time"
    ),
    "q": (
        "q position positions pos jointpos angle angles theta qpos axisqmsr axis_act ai_pos aipos "
        "jpos q_mes qs current_position current_positions current_joint_position "
        "current_joint_positions current_q current_angle current_angles current_joint_angles "
        "qactual f_act_position winkel gelenkwinkel ang istposition istwinkel "
        "angular_position q_current th"
    ),
    "qd": (
        "qd dq qdot q_dot velocity velocities vel speed dtheta qvel omega qp qdots q_dots jvel "
        "speeds dotq dot_q angular_velocity vels current_velocity current_velocities "
        "current_joint_velocity current_joint_velocities current_qd current_dq current_speed "
        "qdactual act_velo f_act_velocity drehzahl geschwindigkeit istgeschwindigkeit istdrehzahl "
        "vitesse theta_dot thetadot qv dq_current dth"
    ),
    "qdd": (
        "qdd ddq qddot q_ddot acc acceleration accelerations qacc qpp accel theta_ddot thetaddot"
    ),
    "current": (
        "current currents cur motor_current motor_currents i i_q iq motor_iq ma_cur macur "
        "current_motor current_motors curr iactual inst_current strom motorstrom iststrom courant"
    ),
    "effort": (
        "tau_j effort efforts torque torques tau trq actual_current_as_torque jtor jtorque "
        "tau_mes taus moment moments sensor_torque torque_sensor motor_torque motor_torques "
        "tor f_act_torque drehmoment eff istmoment istdrehmoment couple tq"
    ),
    "target_q": "q_d as_pos aspos ipo_jnt_pos axisqcmd axisqcmdt1m",
    "target_qd": "dq_d",
    "target_qdd": "ddq_d",
    "target_current": "i_d",
    "target_moment": "m_target tau_d tau_j_d",
    "temperature": (
        "temperature temperatures temp temps motor_temperature motor_temperatures motor_temp "
        "temperature_degc temperature_motor"
    ),
}
RANK = {
    word: (quantity, 100 * place)
    for quantity, words in _SYNONYMS.items()
    for place, word in enumerate(words.split())
}
"""Normalised name to its quantity and its rank among the names of that quantity."""


NAMES_OF_JOINTS = frozenset({"name", "names", "joint_name", "joint_names"})
"""What the joints' own names are called where they stand beside the numbers."""


def holds_names(path: str) -> bool:
    """Whether what stands at a path (`msg.name`, `/joint_states/joint_names`) is joint names."""
    return re.split(r"[/.]", path.lower())[-1] in NAMES_OF_JOINTS


def one_order(rows: Sequence[Sequence[str]], path: str) -> tuple[str, ...]:
    """The joint names that every row gives; none where they are not one a joint.

    Raises:
        RecordError: Rows give different ones.
    """
    found = {tuple(row) for row in rows}
    if len(found) > 1:
        first, second = sorted(found)[:2]
        raise RecordError(
            "the joint names change from row to row",
            where=path,
            value=f"{printable(', '.join(first), 100)}; {printable(', '.join(second), 100)}",
            next_step="Keep the rows of one publisher, whose names stay.",
        )
    names = next(iter(found), ())
    return names if len({*names}) == len(names) else ()


def words_of(text: str) -> frozenset[str]:
    """The words of a text."""
    return frozenset(text.split())


_AROUND = (
    "actual measured act meas msr joint joints jnt link axis arm robot state states feedback fb "
    "fbk sensed present inst enc encoder real field log logged logs data history recorded ist axe "
    "achse gelenk value values"
)
_PLACES = {word: place for place, word in enumerate(_AROUND.split())}
MEASURED = words_of("actual measured act meas msr present")
"""Words that tell a measured quantity from others of its kind."""
PLAIN = frozenset(_PLACES)
"""Words around a quantity's name that do not change what it is; the first are the surest."""
TARGET = words_of(
    "target targets desired des cmd command commands commanded ref reference references setpoint "
    "setpoints goal planned nominal soll consigne"
)
"""Words that turn a measured quantity into what was asked for."""
OTHER = words_of(
    "error errors err output outputs estimated external ext tcp tool ee cartesian multi_dof"
)
"""Words that make something else of a quantity."""
CONTENT = words_of("data value values signals")
"""Last words of paths that only say that here are the numbers."""
_RANK_BY_UNIT = 30_000
"""Behind every name that says what it is."""
TARGET_OF = {
    **{name: f"target_{name}" for name in ("q", "qd", "qdd", "current")},
    "effort": "target_moment",
}
"""A measured quantity to what was asked for."""


_CAMEL = re.compile(r"(?<=[a-z])(?<![^a-zA-Z][mk](?=Nm))(?=[A-Z][a-z])")
_BRACKET = re.compile(r"[\[({]([^\[\](){}]*)[\])}]\s*$")
_UNIT_BEFORE_INDEX = re.compile(
    r"\s*[\[({]([^\[\](){}]*)[\])}]"
    r"(?=[^a-z\d]*(?:joint|jnt|axis|achse|axe|gelenk|motor|j|a|m)?[^a-z\d]*\d{1,3}\W?$)"
)
_UNITS_LAST = tuple(
    re.compile(form)
    for form in (
        r"(?:\s+/\s*|\s*,\s*)([^,]+)$",
        r"(?:[\s_]+in)?[\s_]+([^\s_]*[/.·*][^\s_]*|1_min)$",
        r"(?<=[\])}])[\s_]*(?:in[\s_]+)?([^\[\](){}]+)$",
        r"\.((?!n?secs?$|nanosecs?$|min$)[a-z][a-z_]+)$",
    )
)
"""`q1 / deg`; `qd1 deg/s`, and no path; `q[1]_deg`; `q1.deg`."""
_DOTS = re.compile(r"[/.](?![^\[({]*[\])}])")
"""What is between the parts of a path, and not between those of a unit."""
_INDEX_LAST = re.compile(
    r"^(.*?)[\s_\-]*(?:(?<![a-z])(?:joint|jnt|axis|achse|axe|gelenk|j|a))?[\s_\-]*(\d{1,3})$"
)
_INDEX_FIRST = re.compile(
    r"^(?:joint|jnt|axis|achse|axe|gelenk|motor|j|a)?[\s_\-]*(\d{1,3})[\s_\-:]*(\D.*)$"
)
_INDEX_WITHIN = re.compile(
    r"^([a-z][a-z_\s\-]*?)[\s_\-]*(?:(?<![a-z])(?:joint|jnt|axis|achse|axe|gelenk|j|a))?"
    r"[\s_\-:#]*(\d{1,3})[\s_\-]+([a-z][a-z_\s\-]*)$"
)
_INDEX_ALONE = re.compile(r"(?:joint|jnt|axis|achse|axe|gelenk|motor|j|a)?[\s_\-]*(\d{1,3})")
_INDEX_PATH = re.compile(r"^(.*?)[\[(]?(?<![a-z\d])(\d{1,3})[\])]?$")
_SIGNS = str.maketrans({"τ": "tau", "θ": "theta", "ω": "omega", "°": " deg"})
_DEGREES = re.compile(r"(^|_)(deg|degs|degree|degrees)(_|$)")
_SECONDS = frozenset({"sec", "secs"})
_NANOSECONDS = frozenset({"nanosec", "nanosecs", "nsec", "nsecs"})
_NO_JOINT = PLAIN | TARGET | OTHER | {"header", "stamp", "time", "current", "previous"}
_QUALIFIERS = (TARGET | OTHER | CONTENT) | words_of(
    "raw filtered filt smooth sim simulated model mean std var min max rms init start end"
)
_SUNRISE = re.compile(r"_lbr_[a-z]+_\d+_r\d+(_\d+)?")
"""KUKA's DataRecorder writes the robot's name into each column's."""
_ONE_LETTER = {"a": "current", "c": "temperature", "s": "t"}
_OF_A_JOINT = MEASURED | TARGET | words_of("joint joints jnt axis axe achse gelenk motor ist")
"""Words beside a joint's number or name that leave it to the unit what the column holds."""
_BY_UNIT = ("q", "qd", "qdd", "effort", "current", "temperature")
"""Quantities of which a unit is asked in turn whether it is one of theirs."""


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
        if words[-1] in _SECONDS and (len(words) == 1 or "stamp" in words):
            return "sec"
        return "stamp" if words[-1] == "stamp" and "header" in words else ""

    @property
    def quantity(self) -> str:
        """The quantity; empty for anything else."""
        return self.meaning[0] if self.meaning else ""

    @property
    def meaning(self) -> tuple[str, int] | None:
        """The quantity and the name's rank among its names; None for anything else.

        Words of the path count: `desired/positions` are target positions.
        """
        around = {word for part in self.scope.split(".") for word in part.split("_")}
        if around & OTHER:
            return None
        # `Temps` is French for time; with a number it is a temperature.
        french = self.base == "temps" and self.index is None
        found = RANK["t"] if french else quantity_of(self.base) or self._by_unit
        if found and around & TARGET and found[0] in TARGET_OF:
            return TARGET_OF[found[0]], found[1]
        return found

    @property
    def _by_unit(self) -> tuple[str, int] | None:
        """The meaning of `J1 [deg]`: a joint, and nothing else that says what its column holds."""
        words = {word for word in self.base.split("_") if word}
        if not words <= _OF_A_JOINT or not (self.joint or self.index is not None):
            return None
        if not any(map(str.isalpha, self.unit)):
            return None
        fits = (quantity for quantity in _BY_UNIT if factor_of(quantity, self.unit) is not None)
        if (quantity := next(fits, "")) and words & TARGET:
            quantity = TARGET_OF.get(quantity, "")
        return (quantity, _RANK_BY_UNIT) if quantity else None


def says_degrees(name: str) -> bool:
    """Whether a name has the word `deg` in it, as `act_pos_mot_deg` does."""
    return bool(_DEGREES.search(re.sub(r"[^a-z0-9]+", "_", name.lower())))


def parse_name(text: str, joints: Sequence[str] = ()) -> Name:
    """Take a column name apart: `actual_q_3`, `tau [Nm] 2`, `/states/elbow_joint/position`.

    Args:
        text: The name as the file has it.
        joints: Names of the robot's joints, which are then found wherever they stand.
    """
    parts, index, unit, inside = _brackets(_plain(text))
    known = _known_joint([*parts, inside] if inside else parts, joints)
    if known is not None:
        joint, parts = known
        last = parts.pop() if parts else ""
        while parts and plainly(last) in CONTENT:
            last = parts.pop()
        return _unit_at_the_end(_name(last, parts, joint=joint, unit=unit))
    last = ""
    while parts and (not last or plainly(last) in CONTENT):
        last = parts.pop()
        if index is None:
            if parts and (match := _INDEX_ALONE.fullmatch(last)):
                # `position.3`, `AIPos.A1`
                index, last = int(match.group(1)), parts.pop()
            else:
                last, index = _index(last)
    if index is None and not parts and (match := _INDEX_ALONE.fullmatch(last)):
        # `J1 [deg]`, `joint_1`
        index, last = int(match.group(1)), ""
    if index is None and not inside and parts and (match := _INDEX_PATH.match(parts[-1])):
        index, parts[-1] = int(match.group(2)), match.group(1)
    if index is None and not inside and parts and (match := _INDEX_ALONE.fullmatch(parts[-1])):
        # `Axis1.ActPos`: a number as much as `ActPos1`.
        index, _ = int(match.group(1)), parts.pop()
    joint = ""
    if index is None and inside:
        # `position[elbow_joint]`; it is a unit after all where all columns have the same.
        joint, unit = plainly(inside), unit or inside
    elif index is not None:
        unit = unit or inside
    elif parts and not set(plainly(parts[-1]).split("_")) <= _NO_JOINT:
        joint = plainly(parts.pop())
    return _unit_at_the_end(_name(last, parts, joint=joint, unit=unit, index=index))


def _brackets(name: str) -> tuple[list[str], int | None, str, str]:
    """The parts of a path without its brackets; the number, the unit, other text in them."""
    index, unit, inside = None, "", ""
    if (match := _UNIT_BEFORE_INDEX.search(name)) and is_unit(match.group(1)):
        # `vel [deg/s] 1`
        unit, name = match.group(1).strip(), f"{name[: match.start()]} {name[match.end() :]}"
    for form in () if unit else _UNITS_LAST:
        # Of minutes and minima nobody can tell.
        if (match := form.search(name)) and is_unit(match.group(1)):
            unit, name = match.group(1).strip(), name[: match.start()]
            break
    while match := _BRACKET.search(name):
        text = match.group(1).strip()
        if text.isdecimal() and len(text) <= 3:
            # `q[0][3]`: of the robot and the joint
            index = int(text) if index is None else index
        elif is_unit(text):
            unit = text
        else:
            inside = text
        name = name[: match.start()].strip().rstrip("_-:")
    return [part for part in _DOTS.split(name) if part.strip()], index, unit, inside


def _name(
    last: str, parts: Sequence[str], *, joint: str, unit: str, index: int | None = None
) -> Name:
    scope = ".".join(filter(None, map(plainly, parts)))
    return Name(base=plainly(last), index=index, joint=joint, unit=unit, scope=scope)


def split_joint(text: str) -> Name | None:
    """A name whose first or last words are a joint's: `elbow_joint_position`, `tau_elbow`.

    None where no words of it are a quantity's.
    """
    parts, _, unit, _ = _brackets(_plain(text))
    words = plainly(parts[-1]).split("_") if parts else []
    count = len(words)
    splits = [(words[k:], words[:k], words[k]) for k in range(1, count)]
    splits += [(words[:k], words[k:], words[k - 1]) for k in range(count - 1, 0, -1)]
    for said, joint, beside in splits:
        # `elbow_joint_position` is the position of `elbow_joint`.
        own = beside in PLAIN - MEASURED or joint[0].isdecimal() or _QUALIFIERS & {*joint}
        if not own and quantity_of("_".join(said)):
            return _name("_".join(said), parts[:-1], joint="_".join(joint), unit=unit)
    return None


def _plain(text: str) -> str:
    name = _CAMEL.sub("_", text.strip().strip("\"'\ufeff").strip()).lower()
    return _SUNRISE.sub("", name.translate(_SIGNS))


def _known_joint(parts: list[str], joints: Sequence[str]) -> tuple[str, list[str]] | None:
    """The robot's joint that a path names, and the path without it."""
    for joint in sorted(joints, key=len, reverse=True):
        words = plainly(_plain(joint))
        for k, part in enumerate(parts):
            text = plainly(part)
            if match := re.search(rf"(?:^|_){re.escape(words)}(?:_|$)", text):
                rest = plainly(f"{text[: match.start()]}_{text[match.end() :]}")
                return words, [*parts[:k], *([rest] if rest else []), *parts[k + 1 :]]
    return None


def _index(name: str) -> tuple[str, int | None]:
    """A name without its number, and the number."""
    if first := _INDEX_FIRST.match(name):
        return first.group(2), int(first.group(1))
    if within := _INDEX_WITHIN.match(name):
        base = plainly(f"{within.group(1)}_{within.group(3)}")
        known = quantity_of(base) or quantity_of(plainly(within.group(1)))
        if known or _unit_at_the_end(Name(base=base)).unit:
            return base, int(within.group(2))
    if (last := _INDEX_LAST.match(name)) and last.group(1):
        return last.group(1), int(last.group(2))
    return name, None


def _unit_at_the_end(name: Name) -> Name:
    words = name.base.split("_")
    if quantity_of(name.base):
        return name
    for count in (3, 2, 1):
        stem, tail = "_".join(words[:-count]).removesuffix("_in"), "_".join(words[-count:])
        meaning = quantity_of(stem)
        if meaning is None and len(tail) > 1 and not name.unit:
            # `J1_deg`
            meaning = replace(name, base=stem, unit=tail).meaning
        if meaning is None or (len(tail) == 1 and _ONE_LETTER.get(tail) != meaning[0]):
            continue
        if factor_of(meaning[0], tail) is not None:
            # What stands in brackets may be the joint.
            return replace(name, base=stem, unit=tail if name.joint else name.unit or tail)
    return name


def quantity_of(base: str) -> tuple[str, int] | None:
    """The quantity of a name and its rank among the names of it, the smallest being the surest.

    Words may stand around it: `robot_actual_q`, `desired_joint_speed`. None for anything else.
    """
    if base in RANK:
        return RANK[base]
    words = base.split("_")
    target = any(word in TARGET for word in words[1:]) or (words[0] in TARGET and len(words) > 1)
    core = [word for word in words if word not in TARGET]
    while core and "_".join(core) not in RANK and core[0] in PLAIN:
        core = core[1:]
    while core and "_".join(core) not in RANK and core[-1] in PLAIN:
        core = core[:-1]
    found = RANK.get("_".join(core)) if core and len(core) < len(words) else None
    if found is None:
        # `plc_timestamp`, behind every clock that is known
        return ("t", _RANK_BY_UNIT) if words[-1] == "timestamp" else None
    quantity, rank = found
    if target:
        return (TARGET_OF[quantity], rank + 20_000) if quantity in TARGET_OF else None
    # `actual_torque` goes before `torque`, and that before `joint_torque` and `link_torque`.
    around = sum(_PLACES.get(word, 0) for word in words)
    return quantity, rank + around + (-50 if MEASURED & {*words} else 1)


def places_of(wanted: Sequence[str], names: Sequence[str]) -> list[int]:
    """Where each wanted joint stands among names that may all have one more prefix.

    `panda_joint1` to `panda_joint7` are `joint1` to `joint7`, whatever `panda_finger_joint1`
    is; of `left_joint1` and `right_joint1` nobody can tell. Empty where they are not all there.
    """
    joints, there = [plainly(joint) for joint in wanted], [plainly(name) for name in names]
    if not joints or len(set(there)) != len(there):
        return []
    prefixes = [{x.removesuffix(joint) for x in there if x.endswith(joint)} for joint in joints]
    common = sorted(prefixes[0].intersection(*prefixes))
    if len(common) != 1 and "" not in common:
        return []
    prefix = common[0]
    return [there.index(prefix + joint) for joint in joints]


def said_of_others(names: Sequence[str], wanted: Sequence[str], taken: str) -> str:
    """What to tell of joint names that are not the wanted ones; `taken` is how they are taken."""
    return (
        f"the joints are called {printable(', '.join(names), 200)} and not "
        f"{printable(', '.join(wanted), 200)}; they are taken {taken}: check it, or give the order "
        "to dynid import --joint-order"
    )


def plainly(name: str) -> str:
    """A name in lower case, its words joined by underscores."""
    return re.sub(r"[^a-z0-9]+", "_", name.strip().lower()).strip("_")
