from __future__ import annotations

import os
import shutil
import sqlite3
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from recorded_motions import (
    ALPHABETICAL,
    UR_JOINTS,
    Motion,
    joint_state,
    messages,
    write_db3,
    write_mcap,
    write_rtde_csv,
)

from dynid.core import RecordError
from dynid.recording import MessageDecoder, MessageError, read_recording
from dynid.recording.bagfiles import Topic
from dynid.robot import load_robot


def codes(record) -> list[str]:
    return [problem.code for problem in record.problems]


def assert_true_to(record, motion: Motion) -> None:
    t = record.t + float(record.metadata.extra["t0"])
    np.testing.assert_allclose(record.signals["q"], motion.position(t), atol=1e-6)
    np.testing.assert_allclose(record.signals["qd"], motion.velocity(t), atol=1e-6)
    # Between samples the roughness of the currents is not known.
    np.testing.assert_allclose(record.signals["effort"], motion.current(t), atol=1e-2)


@pytest.mark.parametrize("robot", [None, "ur5"])
@pytest.mark.parametrize("names", [UR_JOINTS, ALPHABETICAL])
def test_joints_are_matched_by_name(tmp_path: Path, names, robot) -> None:
    motion = Motion()
    path = write_db3(motion, tmp_path / "bag.db3", messages(motion, names))
    record = read_recording(path, robot=load_robot(robot) if robot else None)
    assert record.metadata.format == "rosbag"
    assert record.metadata.clock == "header"
    assert record.metadata.joint_names == UR_JOINTS
    assert record.metadata.extra["topic"] == "/joint_states"
    assert [c for c in codes(record) if c != "unit_suspect"] == []
    assert record.samples == motion.samples
    assert_true_to(record, motion)


@pytest.mark.parametrize("compression", ["", "zstd", "lz4"])
def test_mcap(tmp_path: Path, compression) -> None:
    motion = Motion()
    record = read_recording(write_mcap(motion, tmp_path / "x.mcap", compression))
    assert record.metadata.format == "mcap"
    assert record.problems == ()
    assert_true_to(record, motion)


def test_what_a_library_did_is_told(tmp_path: Path) -> None:
    """As of a version that takes other arguments: no damage, and no lack of memory."""
    library = tmp_path / "mcap"
    library.mkdir()
    for name, text in (
        ("__init__", ""),
        ("exceptions", "class McapError(Exception): ..."),
        ("stream_reader", "def StreamReader(stream): ..."),
    ):
        (library / f"{name}.py").write_text(text)
    path = write_mcap(Motion(), tmp_path / "x.mcap")
    done = subprocess.run(
        [sys.executable, "-m", "dynid", "import", path, "-o", tmp_path / "x.parquet"],
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "x.mcap" in done.stderr
    assert "TypeError: StreamReader()" in done.stderr


def test_mcap_written_by_its_own_library(tmp_path: Path) -> None:
    writer_module = pytest.importorskip("mcap.writer")
    motion = Motion()
    for compression in writer_module.CompressionType:
        path = tmp_path / f"{compression.name}.mcap"
        with path.open("wb") as file:
            writer = writer_module.Writer(file, chunk_size=20_000, compression=compression)
            writer.start(profile="ros2", library="test")
            schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", b"")
            channel = writer.register_channel("/joint_states", "cdr", schema)
            for stamp, data in messages(motion):
                writer.add_message(channel, log_time=stamp, data=data, publish_time=stamp)
            writer.finish()
        record = read_recording(path)
        assert record.problems == ()
        assert_true_to(record, motion)


def test_bag_written_by_rosbags(tmp_path: Path) -> None:
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    motion = Motion(samples=60)
    for storage in (rosbag2.StoragePlugin.SQLITE3, rosbag2.StoragePlugin.MCAP):
        folder = tmp_path / storage.name
        with rosbag2.Writer(folder, version=9, storage_plugin=storage) as writer:
            from rosbags.typesys import Stores, get_typestore

            store = get_typestore(Stores.ROS2_HUMBLE)
            topic = writer.add_connection(
                "/joint_states", "sensor_msgs/msg/JointState", typestore=store
            )
            for stamp, data in messages(motion):
                writer.write(topic, stamp, data)
        record = read_recording(folder)
        assert record.problems == ()
        assert record.samples == 60
        assert_true_to(record, motion)


def test_every_cut_message_is_refused() -> None:
    data = joint_state(1, ("a", "bcd"), [1.5, 2.5], [1, 2], [3, 4])
    decoder = MessageDecoder(Topic(name="/x", kind="sensor_msgs/msg/JointState", encoding="cdr"))
    assert decoder.message(data).name == ["a", "bcd"]
    for length in range(len(data)):
        with pytest.raises(MessageError):
            decoder.message(data[:length])


def test_names_may_change_order_and_lack_joints(tmp_path: Path) -> None:
    motion = Motion()
    mixed = zip(messages(motion, UR_JOINTS), messages(motion, ALPHABETICAL), strict=True)
    stream = [pair[k % 2] for k, pair in enumerate(mixed)]
    gripper = [(s + 1, joint_state(s + 1, ("finger",), [0.1], [0.0], [0.0])) for s, _ in stream]
    both = [x for pair in zip(stream, gripper[::2] * 2, strict=True) for x in pair]
    path = write_db3(motion, tmp_path / "bag.db3", both)
    record = read_recording(path, robot=load_robot("ur5"))
    assert "dropped_rows" in codes(record)
    assert record.metadata.dropped_rows == len(gripper)
    assert_true_to(record, motion)


def test_joints_beyond_the_robots_are_left_out(tmp_path: Path) -> None:
    motion = Motion()
    t = motion.t
    q = motion.position(t)
    stream = [
        (
            int(s * 1e9),
            joint_state(int(s * 1e9), ("finger", *UR_JOINTS), [9, *q[k]], [], [1, *q[k]]),
        )
        for k, s in enumerate(t)
    ]
    path = write_db3(motion, tmp_path / "bag.db3", stream)
    record = read_recording(path, robot=load_robot("ur5"))
    np.testing.assert_array_equal(record.signals["q"], q)
    assert "qd" not in record.signals


def test_velocities_of_another_length_than_the_names_are_left_out(tmp_path: Path) -> None:
    motion = Motion()
    q, qd, c = (of(motion.t) for of in (motion.position, motion.velocity, motion.current))
    stamps = [int(s * 1e9) for s in motion.t]
    stream = [(s, joint_state(s, UR_JOINTS, q[k], qd[k, :3], c[k])) for k, s in enumerate(stamps)]
    record = read_recording(write_db3(motion, tmp_path / "bag.db3", stream))
    assert record.problems == ()
    assert set(record.signals) == {"q", "effort"}
    np.testing.assert_array_equal(record.signals["effort"], c)


def test_joints_that_are_called_as_units(tmp_path: Path) -> None:
    motion, names = Motion(), ("x", "y", "z", "a", "b", "c")
    q, c = motion.position(motion.t), motion.current(motion.t)
    stream: list[tuple[int, bytes]] = []
    for k, s in enumerate(motion.t):
        # Every other message names them in another order.
        turn = slice(None, None, -1 if k % 2 else 1)
        stamp = int(s * 1e9)
        stream.append((stamp, joint_state(stamp, names[turn], q[k, turn], [], c[k, turn])))
    record = read_recording(write_db3(motion, tmp_path / "bag.db3", stream))
    assert record.problems == ()
    place = [names.index(name) for name in record.metadata.joint_names]
    np.testing.assert_array_equal(record.signals["q"], q[:, place])
    np.testing.assert_array_equal(record.signals["effort"], c[:, place])


def test_prefixed_names_are_matched(tmp_path: Path) -> None:
    motion = Motion()
    t = motion.t
    names = tuple(f"left_{name}" for name in ALPHABETICAL)
    place = [UR_JOINTS.index(name) for name in ALPHABETICAL]
    q, c = motion.position(t)[:, place], motion.current(t)[:, place]
    stream = [
        (int(s * 1e9), joint_state(int(s * 1e9), names, q[k], [], c[k])) for k, s in enumerate(t)
    ]
    path = write_db3(motion, tmp_path / "bag.db3", stream)
    for robot in (None, load_robot("ur5")):
        record = read_recording(path, robot=robot)
        np.testing.assert_allclose(record.signals["q"], motion.position(t))


def test_strange_names_are_taken_in_their_order_and_reported(tmp_path: Path) -> None:
    motion = Motion()
    t = motion.t
    names = tuple(f"axis{k}" for k in range(6))
    stream = [
        (
            int(s * 1e9),
            joint_state(int(s * 1e9), names, motion.position(t)[k], [], motion.current(t)[k]),
        )
        for k, s in enumerate(t)
    ]
    path = write_db3(motion, tmp_path / "bag.db3", stream)
    assert read_recording(path).metadata.joint_names == names
    record = read_recording(path, robot=load_robot("ur5"))
    assert "axis0" in record.problems[0].message
    turned = read_recording(path, joint_order=names[::-1])
    np.testing.assert_array_equal(turned.signals["q"], record.signals["q"][:, ::-1])
    with pytest.raises(RecordError, match="joint order names something else"):
        read_recording(path, joint_order=["nobody"] * 6)


def test_an_order_that_is_given_goes_before_that_of_known_names(tmp_path: Path) -> None:
    path = write_db3(Motion(), tmp_path / "bag.db3")
    assert read_recording(path).metadata.joint_names == UR_JOINTS
    assert read_recording(path, joint_order=ALPHABETICAL).metadata.joint_names == ALPHABETICAL


def test_receive_times_where_headers_are_empty(tmp_path: Path) -> None:
    motion = Motion()
    path = write_db3(motion, tmp_path / "bag.db3", messages(motion, stamped=False))
    record = read_recording(path)
    assert record.metadata.clock == "receive"
    np.testing.assert_allclose(record.t, motion.t - motion.start, atol=1e-6)


def test_efforts_may_be_mapped_to_currents(tmp_path: Path) -> None:
    motion = Motion()
    path = write_db3(motion, tmp_path / "bag.db3")
    record = read_recording(path, columns="q=position,qd=velocity,current=effort")
    assert set(record.signals) == {"q", "qd", "current"}
    with pytest.raises(RecordError, match="no column of the header"):
        read_recording(path, columns="q=pos")


def test_small_efforts_are_suspected_to_be_currents(tmp_path: Path) -> None:
    motion = Motion()
    path = write_db3(motion, tmp_path / "bag.db3")
    assert codes(read_recording(path, robot=load_robot("ur10"))) == ["unit_suspect"]


def test_topic_with_most_messages_or_the_one_asked_for(tmp_path: Path) -> None:
    motion = Motion(samples=100)
    path = write_db3(motion, tmp_path / "bag.db3")
    with sqlite3.connect(path) as database:
        database.execute(
            "INSERT INTO topics VALUES (3, '/few', 'sensor_msgs/msg/JointState', 'cdr', '')"
        )
        for stamp, data in list(messages(motion))[:30]:
            database.execute(
                "INSERT INTO messages(topic_id, timestamp, data) VALUES (3, ?, ?)", (stamp, data)
            )
    database.close()
    assert read_recording(path).samples == 100
    assert read_recording(path, topic="/few").samples == 30
    with pytest.raises(RecordError, match="/few"):
        read_recording(path, topic="/none")


def add_topic(path: Path, name: str, motion: Motion, names=ALPHABETICAL) -> None:
    with sqlite3.connect(path) as database:
        database.execute(
            "INSERT INTO topics VALUES (3, ?, 'sensor_msgs/msg/JointState', 'cdr', '')", (name,)
        )
        database.executemany(
            "INSERT INTO messages(topic_id, timestamp, data) VALUES (3, ?, ?)",
            list(messages(motion, names)),
        )
    database.close()


def test_two_arms_on_topics_of_their_own_are_refused(tmp_path: Path) -> None:
    left, right = Motion(samples=100), Motion(samples=101, seed=5)
    path = write_db3(left, tmp_path / "bag.db3", topic="/left/joint_states")
    add_topic(path, "/right/joint_states", right)
    with pytest.raises(RecordError, match=r"2 topics can be.*topic /right/joint_states"):
        read_recording(path)
    assert_true_to(read_recording(path, topic="/left/joint_states"), left)


def test_two_arms_on_one_topic_are_refused_unless_named(tmp_path: Path) -> None:
    arms = {"left": Motion(samples=100), "right": Motion(samples=100, seed=5)}
    stream, joints = [], []
    for name, arm in arms.items():
        joints = [f"{name}_{joint}" for joint in UR_JOINTS]
        values = [x(arm.t).tolist() for x in (arm.position, arm.velocity, arm.current)]
        for t, *row in zip(np.round(arm.t * 1e9).astype(int).tolist(), *values, strict=True):
            stream.append((t, joint_state(t, joints, *row)))
    path = write_db3(arms["left"], tmp_path / "bag.db3", sorted(stream))
    for robot in (None, "ur5"):
        with pytest.raises(RecordError, match=r"different joints.*joint_order"):
            read_recording(path, robot=robot)
        record = read_recording(path, robot=robot, joint_order=joints)
        assert_true_to(record, arms["right"])


@pytest.mark.parametrize("clock_set", [False, True])
def test_messages_in_another_order_than_sent(tmp_path: Path, clock_set) -> None:
    motion = Motion()
    stream = list(messages(motion))
    order = np.random.default_rng(0).permutation(len(stream))
    if clock_set:
        # That of the recorder: what was written is in order.
        order = np.arange(len(stream))
        stream = [(stamp - 10**9 * (k > 200), data) for k, (stamp, data) in enumerate(stream)]
    path = write_mcap(motion, tmp_path / "x.mcap", "zstd", [stream[k] for k in order])
    record = read_recording(path)
    assert (record.samples, record.problems) == (motion.samples, ())
    assert_true_to(record, motion)


def test_more_messages_of_a_gripper_are_no_robot(tmp_path: Path) -> None:
    motion = Motion(samples=100)
    path = write_db3(motion, tmp_path / "bag.db3", topic="/arm/joint_states")
    add_topic(path, "/gripper/joint_states", Motion(samples=400), UR_JOINTS[:2])
    assert_true_to(read_recording(path, robot=load_robot("ur5")), motion)


def test_a_bag_folder_packed_file_by_file(tmp_path: Path) -> None:
    zstd = pytest.importorskip("backports.zstd")
    motion = Motion(samples=100)
    plain = write_db3(motion, tmp_path / "x.db3")
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "bag_0.db3.zstd").write_bytes(zstd.compress(plain.read_bytes()))
    (tmp_path / "bag" / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    assert_true_to(read_recording(tmp_path / "bag"), motion)


def test_killed_recorder_leaves_its_log(tmp_path: Path) -> None:
    motion = Motion(samples=100)
    path = write_db3(motion, tmp_path / "bag.db3")
    database = sqlite3.connect(path)
    database.execute("PRAGMA journal_mode=WAL")
    database.execute("DELETE FROM messages WHERE id > 50")
    database.commit()
    killed = tmp_path / "killed"
    killed.mkdir()
    shutil.copy(path, killed)
    shutil.copy(f"{path}-wal", killed)
    database.close()
    assert read_recording(killed / "bag.db3").samples == 50
    assert sorted(x.name for x in killed.iterdir()) == ["bag.db3", "bag.db3-wal"]


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9, 0.98])
@pytest.mark.parametrize("write", [write_db3, write_mcap])
def test_cut_bags_give_what_precedes_the_cut(tmp_path: Path, write, share: float) -> None:
    motion = Motion()
    path = write(motion, tmp_path / "bag")
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    record = read_recording(path)
    assert "truncated_file" in codes(record)
    assert record.samples > 0.5 * share * motion.samples
    assert_true_to(record, motion)


@pytest.mark.parametrize("compression", ["", "zstd", "lz4"])
def test_of_the_chunk_that_is_cut_what_is_there_is_read(tmp_path: Path, compression: str) -> None:
    motion = Motion(samples=50)  # one chunk
    path = write_mcap(motion, tmp_path / "x.mcap", compression)
    data = path.read_bytes()
    path.write_bytes(data[: int(0.8 * len(data))])
    if compression:
        # Compressed in one block: nothing of it comes out.
        with pytest.raises(RecordError, match=r"no message in it can be read.*is cut off"):
            read_recording(path)
        return
    record = read_recording(path)
    assert codes(record) == ["truncated_file"]
    assert 25 < record.samples < 50
    assert_true_to(record, motion)


def test_damaged_chunk_is_left_out_and_reported(tmp_path: Path) -> None:
    motion = Motion()
    path = write_mcap(motion, tmp_path / "x.mcap")
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    record = read_recording(path)
    assert "corrupt_rows" in codes(record)
    assert 0.8 * motion.samples < record.samples < motion.samples
    assert_true_to(record, motion)


def test_bag_without_joint_states(tmp_path: Path) -> None:
    path = write_db3(Motion(samples=10), tmp_path / "bag.db3")
    with sqlite3.connect(path) as database:
        database.execute("DELETE FROM topics WHERE id = 1")
    database.close()
    with pytest.raises(RecordError, match="no readable sensor_msgs/JointState"):
        read_recording(path)


def test_database_that_is_no_bag(tmp_path: Path) -> None:
    path = tmp_path / "x.db3"
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE x(a)")
    database.close()
    with pytest.raises(RecordError, match="no readable ROS 2 bag"):
        read_recording(path)


def test_text_named_as_a_bag_is_read_as_text(tmp_path: Path) -> None:
    motion = Motion()
    path = write_rtde_csv(motion, tmp_path / "x.db3")
    assert read_recording(path).samples == motion.samples


def test_split_bag_is_joined(tmp_path: Path) -> None:
    motion = Motion()
    stream = list(messages(motion))
    folder = tmp_path / "bag"
    folder.mkdir()
    for k, part in enumerate((stream[:200], stream[200:])):
        write_db3(motion, folder / f"bag_{k}.db3", part)
    (folder / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    record = read_recording(folder)
    assert record.samples == motion.samples
    assert record.problems == ()


def test_efforts_that_are_not_numbers_are_no_torque(tmp_path: Path) -> None:
    motion = Motion()
    t = motion.t
    stream = [
        (
            int(s * 1e9),
            joint_state(int(s * 1e9), UR_JOINTS, motion.position(t)[k], [], [float("nan")] * 6),
        )
        for k, s in enumerate(t)
    ]
    path = write_db3(motion, tmp_path / "bag.db3", stream)
    with pytest.raises(RecordError, match="neither current nor effort"):
        read_recording(path)


def test_efforts_that_are_missing_name_the_other_topics(tmp_path: Path) -> None:
    motion = Motion(samples=60)
    stream = [
        (int(s * 1e9), joint_state(int(s * 1e9), UR_JOINTS, motion.position(motion.t)[k], [], []))
        for k, s in enumerate(motion.t)
    ]
    path = write_db3(motion, tmp_path / "bag.db3", stream)
    add_topic(path, "/driver/states", motion)
    with pytest.raises(RecordError, match=r"effort.*topic, of /driver/states") as refused:
        read_recording(path)
    assert "current=13:19" not in str(refused.value)
    assert_true_to(read_recording(path, topic="/driver/states"), motion)
