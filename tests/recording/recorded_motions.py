"""A known motion, and that motion written in every format that importers read."""

from __future__ import annotations

import sqlite3
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import scipy.io

UR_JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
ALPHABETICAL = ("elbow_joint", "shoulder_lift_joint", "shoulder_pan_joint", *UR_JOINTS[3:])
JOINT_STATE = "sensor_msgs/msg/JointState"


@dataclass(frozen=True)
class Motion:
    """Six joints in smooth motion; `position(t)` is the truth at any time."""

    samples: int = 500
    rate: float = 125.0
    start: float = 1234.5
    seed: int = 0
    joints: int = 6

    @property
    def t(self) -> np.ndarray:
        return self.start + np.arange(self.samples) / self.rate

    def _terms(self):
        rng = np.random.default_rng(self.seed)
        for k in (1, 2, 3):
            amplitude = rng.uniform(-0.4, 0.4, self.joints) / k
            yield 2 * np.pi * 0.25 * k, amplitude, rng.uniform(0, 6, self.joints)

    def position(self, t: np.ndarray) -> np.ndarray:
        offset = np.array([0.3, -1.2, 1.4, -0.5, -1.5, 0.2, 0.1])[: self.joints]
        return offset + sum(a * np.sin(w * t[:, None] + p) for w, a, p in self._terms())

    def velocity(self, t: np.ndarray) -> np.ndarray:
        return sum(a * w * np.cos(w * t[:, None] + p) for w, a, p in self._terms())

    def current(self, t: np.ndarray) -> np.ndarray:
        # A deterministic roughness, so that the truth is known at every time.
        rough = 0.05 * np.sin(4321.7 * t[:, None] + np.arange(self.joints))
        return 1.5 * np.cos(self.position(t)) + 0.4 * np.tanh(20 * self.velocity(t)) + rough

    def table(self) -> np.ndarray:
        """(N, 1 + 3 n): t, q, qd, current."""
        t = self.t
        columns = (t[:, None], self.position(t), self.velocity(t), self.current(t))
        return np.concatenate(columns, axis=1)

    def header(self, names: tuple[str, ...] = ("actual_q", "actual_qd", "actual_current")):
        return ["timestamp", *(f"{name}_{k}" for name in names for k in range(self.joints))]


def write_ur_csv(motion: Motion, path: Path) -> Path:
    rows = [" ".join(motion.header())]
    rows += [" ".join(repr(float(x)) for x in row) for row in motion.table()]
    path.write_text("\n".join(rows) + "\n")
    return path


def write_rtde_csv(motion: Motion, path: Path) -> Path:
    rows = [",".join(motion.header())]
    rows += [",".join(f"{x:.6f}" for x in row) for row in motion.table()]
    path.write_text("\n".join(rows) + "\n")
    return path


def write_plain_csv(motion: Motion, path: Path, delimiter: str = ",") -> Path:
    """No header, 5 decimals, as MATLAB users write them."""
    rows = [delimiter.join(f"{x:.5f}" for x in row) for row in motion.table()]
    path.write_text("\n".join(rows) + "\n")
    return path


def write_mat(motion: Motion, path: Path, *, compress: bool = False) -> Path:
    t = motion.t
    rec = {
        "time": t[None, :],
        "act_pos": motion.position(t).T,
        "act_vel": motion.velocity(t).T,
        "act_cur": motion.current(t).T,
        "label": "a run",
    }
    scipy.io.savemat(path, {"rec": rec, "rate": motion.rate}, do_compression=compress)
    return path


MAT_COLUMNS = "t=rec.time,q=rec.act_pos,qd=rec.act_vel,current=rec.act_cur"


def write_npz(motion: Motion, path: Path) -> Path:
    t = motion.t
    with path.open("wb") as file:
        np.savez(file, t=t, q=motion.position(t), qd=motion.velocity(t), current=motion.current(t))
    return path


def joint_state(stamp_ns: int, names, position, velocity, effort, order: str = "<") -> bytes:
    """CDR bytes of one sensor_msgs/JointState."""
    out = bytearray(b"\x00\x01\x00\x00" if order == "<" else b"\x00\x00\x00\x00")

    def align(size: int) -> None:
        out.extend(b"\x00" * ((4 - len(out)) % size))

    def text(value: str) -> None:
        align(4)
        raw = value.encode() + b"\x00"
        out.extend(struct.pack(order + "I", len(raw)) + raw)

    out.extend(struct.pack(order + "iI", stamp_ns // 10**9, stamp_ns % 10**9))
    text("base")
    align(4)
    out.extend(struct.pack(order + "I", len(names)))
    for name in names:
        text(name)
    for values in (position, velocity, effort):
        align(4)
        out.extend(struct.pack(order + "I", len(values)))
        if len(values):
            align(8)
            out.extend(struct.pack(f"{order}{len(values)}d", *values))
    return bytes(out)


def messages(motion: Motion, names=ALPHABETICAL, *, stamped: bool = True):
    """Receive time and bytes of each message, joints in the given order."""
    t = motion.t
    place = [UR_JOINTS.index(name) for name in names]
    columns = [f(t)[:, place] for f in (motion.position, motion.velocity, motion.current)]
    for k, stamp in enumerate(np.round(t * 1e9).astype(int).tolist()):
        data = joint_state(stamp if stamped else 0, names, *(c[k].tolist() for c in columns))
        yield stamp + 150_000, data


def write_db3(motion: Motion, path: Path, stream=None, topic: str = "/joint_states") -> Path:
    path.unlink(missing_ok=True)
    with sqlite3.connect(path) as database:
        database.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT,"
            " serialization_format TEXT, offered_qos_profiles TEXT);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER,"
            " timestamp INTEGER, data BLOB);"
            "CREATE INDEX timestamp_idx ON messages (timestamp ASC);"
        )
        database.execute("INSERT INTO topics VALUES (1, ?, ?, 'cdr', '')", (topic, JOINT_STATE))
        database.execute("INSERT INTO topics VALUES (2, '/tf', 'tf2_msgs/msg/TFMessage', 'cdr','')")
        for stamp, data in stream if stream is not None else messages(motion):
            database.execute(
                "INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)", (stamp, data)
            )
    database.close()
    return path


def _packed(data: bytes, compression: str) -> bytes:
    if compression == "zstd":
        return pytest.importorskip("backports.zstd").compress(data)
    if compression == "lz4":
        return pytest.importorskip("lz4.frame").compress(data)
    return data


def write_mcap(
    motion: Motion, path: Path, compression: str = "", stream=None, encoding: str = "cdr"
) -> Path:
    """A plain MCAP file, as https://mcap.dev/spec says: chunks of messages, no summary."""

    def text(value: str) -> bytes:
        return struct.pack("<I", len(value)) + value.encode()

    def record(opcode: int, content: bytes) -> bytes:
        return struct.pack("<BQ", opcode, len(content)) + content

    definitions = record(3, struct.pack("<H", 1) + text(JOINT_STATE) + text("ros2msg") + text(""))
    definitions += record(
        4, struct.pack("<HH", 1, 1) + text("/joint_states") + text(encoding) + struct.pack("<I", 0)
    )
    out = [b"\x89MCAP0\r\n", record(1, text("ros2") + text("test")), definitions]
    chunk, stamps = definitions, []

    def close_chunk() -> None:
        packed = _packed(chunk, compression)
        head = struct.pack("<QQQI", stamps[0], stamps[-1], len(chunk), zlib.crc32(chunk))
        out.append(record(6, head + text(compression) + struct.pack("<Q", len(packed)) + packed))

    for number, (stamp, data) in enumerate(stream if stream is not None else messages(motion)):
        chunk += record(5, struct.pack("<HIQQ", 1, number, stamp, stamp) + data)
        stamps.append(stamp)
        if len(chunk) > 20_000:
            close_chunk()
            chunk, stamps = b"", []
    if stamps:
        close_chunk()
    out += [record(15, bytes(4)), record(2, bytes(20)), b"\x89MCAP0\r\n"]
    path.write_bytes(b"".join(out))
    return path
