"""The words that recorders use for signals, and the quantities they mean."""

from __future__ import annotations

UR_JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
"""Joint names of Universal Robots' ROS drivers, base to tip; their messages sort them by letter."""
# The first that a file has wins.
_SYNONYMS: dict[str, str] = {
    "t": (
        "t time timestamp time_stamp stamp timestamps times sec secs second seconds elapsed "
        "elapsed_time time_s t_s robot_time rostime controller_time rec_time time_cont "
        "rosbag_timestamp datetime date_time zeit zeitstempel tempo temps ipoc"
    ),
    "q": (
        "actual_q q q_act q_actual act_q q_meas q_measured measured_q actual_position "
        "actual_positions measured_position pos_meas act_pos pos position positions "
        "joint_position joint_positions jointpos joint_pos joint_angle joint_angles angle "
        "angles theta qpos measured_joint_position measured_joint_positions "
        "joint_position_measured joint_position_actual msr_jnt_pos axisqmsr axis_act ai_pos aipos "
        "act_joint_pos act_jpos jpos joints_position joints_positions link_position q_msr q_mes "
        "pos_act pos_actual position_actual actual_pos actual_joint_position "
        "actual_joint_positions actual_angle actual_angles joints_angle qs q_joint "
        "current_position current_positions current_joint_position current_joint_positions "
        "current_q current_angle current_angles current_joint_angles qactual f_act_position "
        "winkel gelenkwinkel"
    ),
    "qd": (
        "actual_qd qd dq qdot q_dot qd_act qd_actual act_qd dq_act dq_meas qd_meas "
        "actual_velocity actual_velocities measured_velocity vel_meas act_vel vel velocity "
        "velocities joint_velocity joint_velocities joint_vel speed joint_speed dtheta qvel "
        "omega measured_joint_velocity measured_joint_velocities joint_velocity_measured "
        "joint_velocity_actual qp qdots q_dots jvel joints_velocity joints_velocities "
        "velocity_actual vel_actual actual_vel actual_joint_velocity actual_joint_velocities "
        "joint_speeds speeds "
        "vel_msr dq_msr qdot_measured dotq dot_q qd_measured dq_measured dq_actual qdot_meas "
        "angular_velocity joint_angular_velocity vels "
        "current_velocity current_velocities current_joint_velocity current_joint_velocities "
        "current_qd current_dq current_speed qdactual act_velo f_act_velocity geschwindigkeit"
    ),
    "qdd": (
        "qdd ddq qddot q_ddot acc acceleration accelerations joint_acceleration "
        "joint_accelerations qacc qpp qdd_meas ddq_meas accel acc_act joint_acc"
    ),
    "current": (
        "actual_current current currents cur motor_current motor_currents joint_current "
        "joint_currents act_current i_act i_meas i i_q current_act current_measured "
        "motor_current_measured measured_current ma_cur macur current_motor current_motors "
        "cur_act actual_currents actual_motor_current curr_act curr i_actual iactual inst_current "
        "strom motorstrom"
    ),
    "effort": (
        "tau_j effort efforts torque torques tau joint_torque joint_torques joint_effort "
        "tau_meas tau_measured tau_act actual_torque actual_torques measured_torque "
        "measured_torques trq actual_current_as_torque act_torque "
        "measured_joint_torque measured_joint_torques joint_torque_measured "
        "joint_effort_measured torque_measured torque_act msr_jnt_trq axis_tau_msr jtor jtorque "
        "joints_torque joints_torques actual_joint_torque actual_joint_torques actual_effort "
        "torque_actual trq_act actual_trq tau_msr tau_mes joint_torque_actual taus moment moments "
        "link_torque link_torques sensor_torque torque_sensor motor_torque motor_torques "
        "joint_tor f_act_torque drehmoment"
    ),
    "target_q": (
        "target_q q_target q_d q_des q_desired desired_q q_ref ref_q q_cmd cmd_q position_cmd "
        "pos_cmd target_position pos_ref ref_pos desired_position commanded_position "
        "position_command commanded_joint_position cmd_jnt_pos joint_position_command as_pos aspos "
        "ipo_jnt_pos joint_position_commanded axisqcmd axisqcmdt1m"
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
        "motor_temperature motor_temperatures motor_temp temperature_degc temperature_motor"
    ),
}
RANK: dict[str, tuple[str, int]] = {
    word: (quantity, rank)
    for quantity, words in _SYNONYMS.items()
    for rank, word in enumerate(words.split())
}
"""Normalised name to its quantity and its rank among the names of that quantity."""

# Words that say nothing of their own, and words that make a target of a measured quantity.
PLAIN = frozenset(
    [
        "actual",
        "act",
        "measured",
        "meas",
        "msr",
        "joint",
        "joints",
        "jnt",
        "arm",
        "robot",
        "state",
        "states",
        "link",
        "axis",
        "feedback",
        "fb",
        "sensed",
        "real",
        "field",
        "log",
        "logged",
        "logs",
        "data",
        "history",
        "recorded",
    ]
)
"""Words around a quantity's name that do not change what it is."""
TARGET = frozenset(
    [
        "target",
        "targets",
        "desired",
        "des",
        "cmd",
        "command",
        "commands",
        "commanded",
        "ref",
        "reference",
        "references",
        "setpoint",
        "setpoints",
        "goal",
        "planned",
        "nominal",
    ]
)
"""Words that turn a measured quantity into what was asked for."""
OTHER = frozenset(
    [
        "error",
        "errors",
        "err",
        "output",
        "outputs",
        "estimated",
        "external",
        "ext",
        "tcp",
        "tool",
        "ee",
        "cartesian",
        "multi_dof",
    ]
)
"""Words that make something else of a quantity."""
CONTENT = frozenset(["data", "value", "values", "signals"])
"""Last words of paths that only say that here are the numbers."""
TARGET_OF = {
    "q": "target_q",
    "qd": "target_qd",
    "qdd": "target_qdd",
    "current": "target_current",
    "effort": "target_moment",
}
"""A measured quantity to what was asked for."""
