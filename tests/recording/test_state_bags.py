"""Bags without JointState: messages that the bag itself defines, written by another library."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded_motions import ALPHABETICAL, UR_JOINTS, Motion
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from dynid.core import RecordError
from dynid.recording import MessageDecoder, MessageError, read_recording
from dynid.recording.bagfiles import Topic
from dynid.robot import load_robot

ARM7 = Motion(samples=150, joints=7, rate=1000.0)
MOTION = Motion(samples=150)
FRANKA = """std_msgs/Header header
float64[6] cartesian_collision
float64[7] q
float64[7] q_d
float64[7] dq
float64[7] dq_d
float64[7] theta
float64[7] dtheta
float64[7] tau_J
float64[7] dtau_J
float64[7] tau_J_d
float64[7] tau_ext_hat_filtered
float64 m_ee
float64[9] I_ee
float64 time
uint8 ROBOT_MODE_OTHER=0
uint8 ROBOT_MODE_MOVE=2
uint8 robot_mode
franka_msgs/Errors current_errors
franka_msgs/Errors last_motion_errors
"""
ERRORS = "bool joint_position_limits_violation\nbool joint_reflex\n"
ROBOT_STATE = """# Default parts of the message
std_msgs/Header header
CollisionIndicators collision_indicators
sensor_msgs/JointState measured_joint_state
sensor_msgs/JointState desired_joint_state
sensor_msgs/JointState measured_joint_motor_state
float64[7] ddq_d
float64[7] dtau_j
sensor_msgs/JointState tau_ext_hat_filtered
float64 time
uint8 ROBOT_MODE_OTHER=0
uint8 robot_mode
"""
INDICATORS = "bool is_cartesian_linear_collision\nfloat64 strength 1.0 # a default\n"
CONTROLLER = """std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint reference
trajectory_msgs/JointTrajectoryPoint feedback
trajectory_msgs/JointTrajectoryPoint error
trajectory_msgs/JointTrajectoryPoint output
"""
INTERFACES = "string[] interface_names\nfloat64[] values\n"
DYNAMIC = (
    "std_msgs/Header header\nstring[] joint_names\ncontrol_msgs/InterfaceValue[] interface_values\n"
)
KORTEX = "uint32 frame_id\nkortex_driver/ActuatorFeedback[] actuators\n"
ACTUATOR = "uint32 id\nfloat32 position\nfloat32 velocity\nfloat32 torque\nfloat32 current_motor\n"


def store(kind: Stores, **types: str) -> Any:
    """A typestore that knows these messages; double underscores stand for slashes."""
    known = get_typestore(kind)
    found: dict[str, Any] = {}
    for name, text in types.items():
        found.update(get_types_from_msg(text, name.replace("__", "/msg/")))
    known.register(found)
    return known


def header(known: Any, stamp: int, ros1: bool) -> Any:
    time = known.types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    extra = {"seq": 0} if ros1 else {}
    return known.types["std_msgs/msg/Header"](stamp=time, frame_id="base", **extra)


def franka_bag(path: Path, motion: Motion = ARM7) -> Path:
    """A ROS 1 bag of the state and of the gripper's two fingers."""
    known = store(Stores.ROS1_NOETIC, franka_msgs__Errors=ERRORS, franka_msgs__FrankaState=FRANKA)
    state, errors = (known.types[f"franka_msgs/msg/{x}"] for x in ("FrankaState", "Errors"))
    q, qd, tau = motion.position(motion.t), motion.velocity(motion.t), motion.current(motion.t)
    fine = errors(joint_position_limits_violation=False, joint_reflex=False)
    fingers = known.types["sensor_msgs/msg/JointState"]
    with Writer1(path) as writer:
        kind = "franka_msgs/msg/FrankaState"
        topic = writer.add_connection("/franka_states", kind, typestore=known)
        grip = writer.add_connection(
            "/franka_gripper/joint_states", "sensor_msgs/msg/JointState", typestore=known
        )
        for k, stamp in enumerate(np.round(motion.t * 1e9).astype(int).tolist()):
            message = state(
                header=header(known, stamp, ros1=True),
                cartesian_collision=np.zeros(6),
                q=q[k],
                q_d=q[k] + 0.1,
                dq=qd[k],
                dq_d=qd[k] + 0.1,
                theta=q[k] + 0.01,
                dtheta=qd[k] + 0.01,
                tau_J=tau[k],
                dtau_J=tau[k] * 9,
                tau_J_d=tau[k] * 0.1,
                tau_ext_hat_filtered=tau[k] * 0.2,
                m_ee=0.7,
                I_ee=np.zeros(9),
                time=0.001 * k,
                robot_mode=2,
                current_errors=fine,
                last_motion_errors=fine,
                ROBOT_MODE_OTHER=0,
                ROBOT_MODE_MOVE=2,
            )
            writer.write(topic, stamp + 150_000, known.serialize_ros1(message, kind))
            if k % 10 == 0:
                finger = fingers(
                    header=header(known, stamp, ros1=True),
                    name=["finger1", "finger2"],
                    position=np.zeros(2),
                    velocity=np.zeros(2),
                    effort=np.zeros(2),
                )
                data = known.serialize_ros1(finger, "sensor_msgs/msg/JointState")
                writer.write(grip, stamp, data)
    return path


def assert_true(record: Any, motion: Motion, torque: str = "effort") -> None:
    np.testing.assert_allclose(record.t, motion.t - motion.t[0], atol=1e-9)
    np.testing.assert_array_equal(record.signals["q"], motion.position(motion.t))
    np.testing.assert_array_equal(record.signals["qd"], motion.velocity(motion.t))
    np.testing.assert_array_equal(record.signals[torque], motion.current(motion.t))


def test_franka_state(tmp_path: Path) -> None:
    """Neither commanded, external, motor's nor derived values are taken for measured ones."""
    path = franka_bag(tmp_path / "run.bag")
    panda = load_robot(Path(__file__).parents[2] / "examples" / "robots" / "panda.toml")
    record = read_recording(path, robot=panda)
    assert record.problems == ()
    assert record.metadata.clock == "header"
    assert record.metadata.extra["topic"] == "/franka_states"
    assert_true(record, ARM7)
    asked = read_recording(path, topic="/franka_states", columns="q=theta,qd=dtheta,effort=tau_J")
    np.testing.assert_array_equal(asked.signals["q"], ARM7.position(ARM7.t) + 0.01)


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_franka_robot_state(tmp_path: Path, storage: StoragePlugin) -> None:
    known = store(
        Stores.ROS2_HUMBLE,
        franka_msgs__CollisionIndicators=INDICATORS,
        franka_msgs__FrankaRobotState=ROBOT_STATE,
    )
    kind = "franka_msgs/msg/FrankaRobotState"
    names = [f"fr3_joint{k}" for k in range(1, 8)]
    motion, t = ARM7, ARM7.t
    q, qd, tau = motion.position(t), motion.velocity(t), motion.current(t)
    joint_state = known.types["sensor_msgs/msg/JointState"]
    indicators = known.types["franka_msgs/msg/CollisionIndicators"]
    with Writer2(tmp_path / "bag", version=9, storage_plugin=storage) as writer:
        topic = writer.add_connection("/franka/robot_state", kind, typestore=known)
        for k, stamp in enumerate(np.round(t * 1e9).astype(int).tolist()):
            head = header(known, stamp, ros1=False)
            # Headers within may be filled at another time, or not at all.
            empty = header(known, 0, ros1=False)

            def part(position: Any, velocity: Any, effort: Any, head: Any = empty) -> Any:
                lists = {"position": position, "velocity": velocity, "effort": effort}
                return joint_state(header=head, name=names, **lists)

            message = known.types[kind](
                header=head,
                collision_indicators=indicators(is_cartesian_linear_collision=True, strength=1.0),
                measured_joint_state=part(q[k], qd[k], tau[k]),
                desired_joint_state=part(q[k] + 0.1, qd[k] + 0.1, tau[k] * 0.1),
                measured_joint_motor_state=part(q[k] + 0.2, qd[k] + 0.2, np.zeros(0)),
                ddq_d=qd[k],
                dtau_j=tau[k],
                tau_ext_hat_filtered=part(np.zeros(0), np.zeros(0), tau[k] * 0.2),
                time=0.001 * k,
                robot_mode=2,
                ROBOT_MODE_OTHER=0,
            )
            writer.write(topic, stamp + 150_000, known.serialize_cdr(message, kind))
    record = read_recording(tmp_path / "bag")
    assert record.problems == ()
    assert record.metadata.joint_names == tuple(names)
    assert record.metadata.clock == "header"
    assert_true(record, motion)
    if storage is StoragePlugin.SQLITE3:
        # ROS 2 Humble writes no definitions: then nothing can be decoded, and it says so.
        (path,) = (tmp_path / "bag").glob("*.db3")
        with sqlite3.connect(path) as database:
            database.execute("DROP TABLE message_definitions")
        database.close()
        with pytest.raises(RecordError, match=r"FrankaRobotState.*ros2 topic echo --csv"):
            read_recording(tmp_path / "bag")


def write_controller(folder: Path, motion: Motion, efforts: bool, copies: int = 1) -> Path:
    known = store(Stores.ROS2_HUMBLE, control_msgs__JointTrajectoryControllerState=CONTROLLER)
    kind = "control_msgs/msg/JointTrajectoryControllerState"
    point = known.types["trajectory_msgs/msg/JointTrajectoryPoint"]
    rest = known.types["builtin_interfaces/msg/Duration"](sec=0, nanosec=0)
    place = [UR_JOINTS.index(name) for name in ALPHABETICAL]
    t = motion.t
    q, qd, tau = (
        np.ascontiguousarray(f(t)[:, place])
        for f in (motion.position, motion.velocity, motion.current)
    )

    def at(*lists: Any) -> Any:
        fields = ("positions", "velocities", "accelerations", "effort")
        return point(**dict(zip(fields, lists, strict=True)), time_from_start=rest)

    none = np.zeros(0)
    with Writer2(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = [
            writer.add_connection(f"/controller{n}/state", kind, typestore=known)
            for n in range(copies)
        ]
        for k, stamp in enumerate(np.round(t * 1e9).astype(int).tolist()):
            message = known.types[kind](
                header=header(known, stamp, ros1=False),
                joint_names=list(ALPHABETICAL),
                reference=at(q[k] + 0.1, qd[k], none, none),
                feedback=at(q[k], qd[k], none, tau[k] if efforts else none),
                error=at(q[k] * 0 + 0.1, qd[k] * 0, none, none),
                output=at(none, none, none, tau[k] * 0.5),
            )
            for topic in topics:
                writer.write(topic, stamp, known.serialize_cdr(message, kind))
    return folder


def test_controller_state_by_joint_names(tmp_path: Path) -> None:
    record = read_recording(write_controller(tmp_path / "a", MOTION, True), robot=load_robot("ur5"))
    assert record.problems == ()
    assert_true(record, MOTION)
    with pytest.raises(RecordError, match="neither current nor effort"):
        read_recording(write_controller(tmp_path / "b", MOTION, False))
    with pytest.raises(RecordError, match=r"b.mcap: topic /controller0/state: .*'nothing'"):
        read_recording(tmp_path / "b", topic="/controller0/state", columns="q=nothing")
    two = write_controller(tmp_path / "c", MOTION, True, copies=2)
    with pytest.raises(RecordError, match=r"2 topics can be.*topic /controller0/state"):
        read_recording(two)
    assert_true(read_recording(two, topic="/controller1/state", robot=load_robot("ur5")), MOTION)


def test_dynamic_joint_state(tmp_path: Path) -> None:
    known = store(
        Stores.ROS2_HUMBLE,
        control_msgs__InterfaceValue=INTERFACES,
        control_msgs__DynamicJointState=DYNAMIC,
    )
    kind = "control_msgs/msg/DynamicJointState"
    value = known.types["control_msgs/msg/InterfaceValue"]
    t = MOTION.t
    q, qd, tau = MOTION.position(t), MOTION.velocity(t), MOTION.current(t)
    with Writer2(tmp_path / "bag", version=9) as writer:
        topic = writer.add_connection("/dynamic_joint_states", kind, typestore=known)
        for k, stamp in enumerate(np.round(t * 1e9).astype(int).tolist()):
            of = [UR_JOINTS.index(name) for name in ALPHABETICAL]
            message = known.types[kind](
                header=header(known, stamp, ros1=False),
                joint_names=[*ALPHABETICAL, "gpio"],
                interface_values=[
                    *(
                        value(
                            interface_names=["effort", "position", "velocity"],
                            values=np.array([tau[k, j], q[k, j], qd[k, j]]),
                        )
                        for j in of
                    ),
                    value(interface_names=["analog"], values=np.array([1.0])),
                ],
            )
            writer.write(topic, stamp, known.serialize_cdr(message, kind))
    record = read_recording(tmp_path / "bag", robot=load_robot("ur5"))
    assert record.problems == ()
    assert_true(record, MOTION)


def test_arrays_of_messages(tmp_path: Path) -> None:
    """Kinova's drivers send one message a joint within another, in degrees."""
    known = store(
        Stores.ROS1_NOETIC,
        kortex_driver__ActuatorFeedback=ACTUATOR,
        kortex_driver__BaseCyclic_Feedback=KORTEX,
    )
    kind = "kortex_driver/msg/BaseCyclic_Feedback"
    actuator = known.types["kortex_driver/msg/ActuatorFeedback"]
    t = MOTION.t
    q, qd, tau = MOTION.position(t), MOTION.velocity(t), MOTION.current(t)
    with Writer1(tmp_path / "run.bag") as writer:
        topic = writer.add_connection("/gen3/base_feedback", kind, typestore=known)
        for k, stamp in enumerate(np.round(t * 1e9).astype(int).tolist()):
            message = known.types[kind](
                frame_id=k,
                actuators=[
                    actuator(
                        id=j,
                        position=np.degrees(q[k, j]),
                        velocity=np.degrees(qd[k, j]),
                        torque=tau[k, j],
                        current_motor=0.1 * tau[k, j],
                    )
                    for j in range(6)
                ],
            )
            writer.write(topic, stamp, known.serialize_ros1(message, kind))
    with pytest.raises(RecordError, match="degrees=True"):
        read_recording(tmp_path / "run.bag", robot=load_robot("ur5"))
    record = read_recording(tmp_path / "run.bag", robot=load_robot("ur5"), degrees=True)
    assert record.metadata.clock == "receive"
    np.testing.assert_allclose(record.signals["q"], q, atol=1e-5)
    np.testing.assert_allclose(record.signals["effort"], tau, atol=1e-6)
    np.testing.assert_allclose(record.signals["current"], 0.1 * tau, atol=1e-6)


@pytest.mark.parametrize("damages", [25, pytest.param(60, marks=pytest.mark.long)])
def test_damaged_state_bags_are_read_or_refused_in_words(damages: int, tmp_path: Path) -> None:
    data = franka_bag(tmp_path / "run.bag", Motion(samples=40, joints=7)).read_bytes()
    rng = np.random.default_rng(4)
    read = 0
    for _ in range(damages):
        broken = bytearray(data)
        for place in rng.integers(13, len(data), 30).tolist():
            broken[place] = int(rng.integers(256))
        (tmp_path / "run.bag").write_bytes(bytes(broken))
        try:
            record = read_recording(tmp_path / "run.bag", topic="/franka_states")
        except RecordError:
            continue
        assert record.samples == 40 or record.problems
        read += 1
    assert read > 0


@pytest.mark.parametrize("encoding", ["ros1", "cdr"])
def test_every_cut_message_is_refused(encoding: str) -> None:
    kind = "x_msgs/State"
    definition = "string[] names\nfloat64[] q\nbool moving\nint8[3] marks\nfloat64 last\n"
    if encoding == "ros1":
        known = store(Stores.ROS1_NOETIC, x_msgs__State=definition)
    else:
        known = store(Stores.ROS2_HUMBLE, x_msgs__State=definition)
    message = known.types["x_msgs/msg/State"](
        names=["a", "bcd"],
        q=np.array([1.5, 2.5]),
        moving=True,
        marks=np.array([1, 2, 3], dtype=np.int8),
        last=4.5,
    )
    write = known.serialize_ros1 if encoding == "ros1" else known.serialize_cdr
    data = bytes(write(message, "x_msgs/msg/State"))
    decoder = MessageDecoder(Topic(name="/x", kind=kind, encoding=encoding, definition=definition))
    decoded = decoder.decode(data)
    assert decoded.names() == ("q['a']", "q[bcd]", "last")
    assert decoded.values == [1.5, 2.5, 4.5]
    for length in range(len(data)):
        with pytest.raises(MessageError):
            decoder.decode(data[:length])
    with pytest.raises(MessageError):
        decoder.decode(data + bytes(8))


def test_texts_that_change_cost_no_message(tmp_path: Path) -> None:
    known = store(
        Stores.ROS2_HUMBLE,
        x_msgs__State="string mode\nfloat64[] q\nfloat64[] qd\nfloat64[] tau\n",
    )
    kind, t = "x_msgs/msg/State", MOTION.t
    q, qd, tau = MOTION.position(t), MOTION.velocity(t), MOTION.current(t)
    with Writer2(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/state", kind, typestore=known)
        for k, stamp in enumerate(np.round(t * 1e9).astype(int).tolist()):
            mode = ("ready", "moving")[k % 2]
            message = known.types[kind](mode=mode, q=q[k], qd=qd[k], tau=tau[k])
            writer.write(topic, stamp, known.serialize_cdr(message, kind))
    record = read_recording(tmp_path / "bag")
    assert record.problems == ()
    assert_true(record, MOTION)
