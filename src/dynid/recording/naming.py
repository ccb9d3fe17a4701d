"""Names that recorders give to signals, and the quantities they mean."""

from __future__ import annotations

import re
from dataclasses import dataclass

# The first that a file has wins.
_SYNONYMS: dict[str, str] = {
    "t": (
        "t time timestamp time_stamp stamp timestamps times sec secs second seconds elapsed "
        "elapsed_time time_s t_s robot_time rostime controller_time rec_time time_cont"
    ),
    "q": (
        "actual_q q q_act q_actual act_q q_meas q_measured measured_q actual_position "
        "actual_positions measured_position pos_meas act_pos pos position positions "
        "joint_position joint_positions jointpos joint_pos joint_angle joint_angles angle "
        "angles theta qpos measured_joint_position measured_joint_positions "
        "joint_position_measured joint_position_actual msr_jnt_pos axis_act"
    ),
    "qd": (
        "actual_qd qd dq qdot q_dot qd_act qd_actual act_qd dq_act dq_meas qd_meas "
        "actual_velocity actual_velocities measured_velocity vel_meas act_vel vel velocity "
        "velocities joint_velocity joint_velocities joint_vel speed joint_speed dtheta qvel "
        "omega measured_joint_velocity measured_joint_velocities joint_velocity_measured "
        "joint_velocity_actual"
    ),
    "qdd": (
        "qdd ddq qddot q_ddot acc acceleration accelerations joint_acceleration "
        "joint_accelerations qacc"
    ),
    "current": (
        "actual_current current currents cur motor_current motor_currents joint_current "
        "joint_currents act_current i_act i_meas i i_q current_act current_measured "
        "motor_current_measured measured_current"
    ),
    "effort": (
        "tau_j effort efforts torque torques tau joint_torque joint_torques joint_effort "
        "tau_meas tau_measured tau_act actual_torque actual_torques measured_torque "
        "measured_torques trq motor_torque actual_current_as_torque act_torque "
        "measured_joint_torque measured_joint_torques joint_torque_measured "
        "joint_effort_measured torque_measured torque_act msr_jnt_trq"
    ),
    "target_q": (
        "target_q q_target q_d q_des q_desired desired_q q_ref ref_q q_cmd cmd_q position_cmd "
        "pos_cmd target_position pos_ref ref_pos desired_position commanded_position "
        "position_command commanded_joint_position cmd_jnt_pos joint_position_command"
    ),
    "target_qd": (
        "target_qd qd_target dq_d dq_des qd_des qd_desired dq_ref qd_ref dq_cmd qd_cmd "
        "velocity_cmd vel_cmd target_velocity desired_velocity commanded_velocity"
    ),
    "target_qdd": "target_qdd qdd_target ddq_d ddq_des qdd_des qdd_ref ddq_ref",
    "target_current": "target_current current_target i_des i_d i_ref current_ref",
    "target_moment": (
        "target_moment target_torque tau_des tau_d tau_j_d tau_ref tau_cmd torque_cmd "
        "desired_torque commanded_torque"
    ),
    "temperature": (
        "joint_temperatures joint_temperature temperature temperatures temp temps "
        "motor_temperature motor_temperatures motor_temp temperature_degc"
    ),
}
RANK: dict[str, tuple[str, int]] = {
    word: (quantity, rank)
    for quantity, words in _SYNONYMS.items()
    for rank, word in enumerate(words.split())
}
"""Normalised name to its quantity and its rank among the names of that quantity."""

_TIME_UNITS = {
    "s": 1.0,
    "sec": 1.0,
    "ms": 1e-3,
    "msec": 1e-3,
    "us": 1e-6,
    "usec": 1e-6,
    "ns": 1e-9,
    "nsec": 1e-9,
    "nanosec": 1e-9,
}
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z][a-z])")
_BRACKET = re.compile(r"[\[({]([^\])}]*)[\])}]\s*$")
_INDEX_LAST = re.compile(r"^(.*?)[\s_\-.]*(?:(?<![a-z])(?:joint|jnt|axis|j|a))?[\s_\-.]*(\d{1,3})$")
_INDEX_FIRST = re.compile(r"^(?:joint|jnt|axis|j|a)[\s_\-]*(\d{1,3})[\s_\-./:]+(.+)$")
_DEGREES = re.compile(r"(^|_)(deg|degs|degree|degrees)(_|$)")


@dataclass(frozen=True, slots=True)
class Name:
    """A column name taken apart."""

    base: str
    """Lower case, words joined by underscores, without index and unit."""
    index: int | None
    """The joint's number in the name, as written."""
    joint: str
    """A joint's name, from paths such as `/joint_states/elbow_joint/position`."""
    unit: str
    """The unit in brackets, if any."""

    @property
    def time_scale(self) -> float | None:
        """Seconds per unit, where a time column names its unit."""
        return _TIME_UNITS.get(self.unit)

    @property
    def degrees(self) -> bool:
        """Whether the name says degrees."""
        return self.unit.startswith(("deg", "°")) or says_degrees(self.base)


def says_degrees(name: str) -> bool:
    """Whether a name has the word `deg` in it, as `act_pos_mot_deg` does."""
    return bool(_DEGREES.search(re.sub(r"[^a-z0-9]+", "_", name.lower())))


def parse_name(text: str) -> Name:
    """Take a column name apart: `actual_q_3`, `Position1`, `tau [Nm] 2`, `q[0]`, `j1_pos`."""
    name = _CAMEL.sub("_", text.strip().strip("\"'").strip()).lower()
    unit, index, joint = "", None, ""
    while match := _BRACKET.search(name):
        inside = match.group(1).strip()
        if inside.isdecimal() and len(inside) <= 3:
            index = int(inside)
        else:
            unit = inside
        name = name[: match.start()].strip()
    parts = [part for part in name.split("/") if part]
    if len(parts) > 1:
        joint, name = parts[-2], parts[-1]
    if index is None and (first := _INDEX_FIRST.match(name)):
        index, name = int(first.group(1)), first.group(2)
    elif index is None and (last := _INDEX_LAST.match(name)) and last.group(1):
        index, name = int(last.group(2)), last.group(1)
    base = _joined(name)
    if base not in RANK and _joined(name.rpartition(".")[2]) in RANK:
        # Recorders that flatten structures write `arm.state.q`.
        base = _joined(name.rpartition(".")[2])
    if base not in RANK and not unit:
        stem, _, tail = base.rpartition("_")
        if stem in RANK and (tail in _TIME_UNITS or tail in ("rad", "deg", "nm", "a", "rads")):
            base, unit = stem, tail
    return Name(base, index, joint if index is None else "", unit)


def _joined(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", name).strip("_")
