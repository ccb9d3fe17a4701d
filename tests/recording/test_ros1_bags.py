from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np
import pytest
from recorded_motions import ALPHABETICAL, UR_JOINTS, Motion, write_mcap
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from dynid.core import RecordError
from dynid.recording import read_recording
from dynid.recording.bagfiles import Catalog, ros1_messages
from dynid.robot import load_robot

STORE = get_typestore(Stores.ROS1_NOETIC)
TYPE = "sensor_msgs/msg/JointState"
MOTION = Motion(samples=400)


def write_bag(
    path: Path,
    motion: Motion = MOTION,
    *,
    names=ALPHABETICAL,
    stamped: bool = True,
    compression: str | None = None,
    topic: str = "/joint_states",
) -> Path:
    """The motion as a ROS 1 bag, written by the rosbags library; a second topic beside it."""
    t = motion.t
    place = [UR_JOINTS.index(name) for name in names]
    state, header = STORE.types[TYPE], STORE.types["std_msgs/msg/Header"]
    time = STORE.types["builtin_interfaces/msg/Time"]
    columns = [
        np.ascontiguousarray(f(t)[:, place])
        for f in (motion.position, motion.velocity, motion.current)
    ]
    path.unlink(missing_ok=True)
    writer = Writer(path)
    if compression:
        writer.set_compression(getattr(Writer.CompressionFormat, compression))
    with writer:
        joints = writer.add_connection(topic, TYPE, typestore=STORE)
        other = writer.add_connection("/text", "std_msgs/msg/String", typestore=STORE)
        for k, stamp in enumerate(np.round(t * 1e9).astype(int).tolist()):
            seconds, nanoseconds = divmod(stamp if stamped else 0, 10**9)
            message = state(
                header=header(seq=k, stamp=time(sec=seconds, nanosec=nanoseconds), frame_id="x"),
                name=list(names),
                position=columns[0][k],
                velocity=columns[1][k],
                effort=columns[2][k],
            )
            writer.write(joints, stamp + 150_000, STORE.serialize_ros1(message, TYPE))
            text = STORE.types["std_msgs/msg/String"](data="x" * k)
            writer.write(other, stamp, STORE.serialize_ros1(text, "std_msgs/msg/String"))
    return path


@pytest.mark.parametrize("compression", [None, "BZ2", "LZ4"])
@pytest.mark.parametrize("robot", [None, "ur5"])
def test_ros1_bag(tmp_path: Path, compression: str | None, robot: str | None) -> None:
    path = write_bag(tmp_path / "run.bag", compression=compression)
    record = read_recording(path, robot=load_robot(robot) if robot else None)
    assert record.problems == ()
    assert (record.metadata.format, record.metadata.clock) == ("rosbag", "header")
    assert record.metadata.joint_names == UR_JOINTS
    np.testing.assert_array_equal(record.signals["q"], MOTION.position(MOTION.t))
    np.testing.assert_array_equal(record.signals["effort"], MOTION.current(MOTION.t))
    np.testing.assert_allclose(record.t, MOTION.t - MOTION.t[0], atol=1e-9)


def test_empty_headers_and_a_folder(tmp_path: Path) -> None:
    write_bag(tmp_path / "run.bag", stamped=False)
    record = read_recording(tmp_path)
    assert record.metadata.clock == "receive"
    np.testing.assert_allclose(record.t, MOTION.t - MOTION.t[0], atol=1e-9)


@pytest.mark.parametrize(
    ("samples", "least", "compression"),
    [
        (8000, 1000, None),
        pytest.param(8000, 1000, "BZ2", marks=pytest.mark.long),
        (1500, 700, None),
        (1500, 700, "LZ4"),
    ],
)
def test_a_bag_that_was_cut_off(
    tmp_path: Path, samples: int, least: int, compression: str | None
) -> None:
    """Among its chunks, or in its only one."""
    motion = Motion(samples=samples)
    path = write_bag(tmp_path / "run.bag", motion, compression=compression)
    data = path.read_bytes()
    path.write_bytes(data[: int(0.6 * len(data))])
    record = read_recording(path)
    assert [problem.code for problem in record.problems] == ["truncated_file"]
    assert least < record.samples < samples
    np.testing.assert_array_equal(record.signals["q"], motion.position(motion.t)[: record.samples])


@pytest.mark.parametrize("damages", [25, pytest.param(60, marks=pytest.mark.long)])
def test_damaged_bags_are_read_or_refused_in_words(damages: int, tmp_path: Path) -> None:
    path = write_bag(tmp_path / "run.bag")
    data = path.read_bytes()
    rng = np.random.default_rng(5)
    read = 0
    for _ in range(damages):
        broken = bytearray(data)
        for place in rng.integers(13, len(data), 30).tolist():
            broken[place] = int(rng.integers(256))
        path.write_bytes(bytes(broken))
        with contextlib.suppress(RecordError):
            record = read_recording(path)
            assert record.samples == MOTION.samples or record.problems
            read += 1
    assert read > 0


def test_a_bag_without_joint_states_names_what_it_has(tmp_path: Path) -> None:
    with Writer(tmp_path / "x.bag") as writer:
        other = writer.add_connection("/text", "std_msgs/msg/String", typestore=STORE)
        text = STORE.types["std_msgs/msg/String"](data="x")
        writer.write(other, 1, STORE.serialize_ros1(text, "std_msgs/msg/String"))
    with pytest.raises(RecordError, match=r"/text \(std_msgs/String\)"):
        read_recording(tmp_path / "x.bag")


def test_what_ros1_wrote_in_an_mcap_file(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run.bag")
    stream = [(receive, data) for _, receive, data in ros1_messages(bag, Catalog())]
    record = read_recording(
        write_mcap(MOTION, tmp_path / "run.mcap", stream=stream, encoding="ros1")
    )
    assert record.problems == ()
    np.testing.assert_array_equal(record.signals["q"], MOTION.position(MOTION.t))


def test_states_go_before_commands(tmp_path: Path) -> None:
    """A topic of commands may have more messages, and be first by letter."""
    states = write_bag(tmp_path / "states.bag")
    ahead = Motion(samples=500, seed=3)
    commands = write_bag(tmp_path / "commands.bag", ahead, topic="/joint_commands")
    record = read_recording([commands, states])
    assert record.metadata.extra["topic"] == "/joint_states"
    np.testing.assert_array_equal(record.signals["q"], MOTION.position(MOTION.t))
    asked = read_recording([commands, states], topic="/joint_commands")
    np.testing.assert_array_equal(asked.signals["q"], ahead.position(ahead.t))
