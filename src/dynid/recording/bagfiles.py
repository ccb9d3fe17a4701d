"""Messages out of bags: SQLite (`.db3`), MCAP and ROS 1 (`.bag`, version 2.0), also cut off.

MCAP is read by its own library. SQLite files are read here by Python's sqlite3, and ROS 1 bags
by this module: rosbags refuses every file that is cut off. All of 40 cut copies of a real `.db3`
recording give their messages here.
"""

import io
import shutil
import struct
import tempfile
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from dynid.core import Finding, RecordError, require
from dynid.recording.content import MAX_BYTES, InflateError, inflate, refused

if TYPE_CHECKING:
    # Python can be built without it.
    import sqlite3

DEFINITION_LANGUAGES = ("ros1msg", "ros2msg", "ros2idl")
JOINT_STATE_TYPES = frozenset({"sensor_msgs/msg/JointState", "sensor_msgs/JointState"})
Message = tuple[str, int, bytes]
"""Topic, receive time [ns], bytes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Topic:
    """One topic of a bag."""

    name: str
    kind: str
    """The type of its messages, as the bag names it."""
    encoding: str
    """How messages are written: `ros1` or `cdr`."""
    definition: str = ""
    """The definition of the type and of all that it needs; empty where the bag has none."""
    language: str = "ros2msg"
    """The language of the definition, one of `DEFINITION_LANGUAGES`."""

    @property
    def is_joint_state(self) -> bool:
        """Whether its messages are `sensor_msgs/JointState`."""
        return self.kind in JOINT_STATE_TYPES


@dataclass(slots=True)
class Catalog:
    """The topics of a bag's files, and what is found while they are read."""

    wanted: Callable[[Topic], bool] = lambda topic: topic.is_joint_state
    """Whose messages are yielded."""
    topics: dict[str, Topic] = field(default_factory=dict[str, Topic])
    findings: list[Finding] = field(default_factory=list[Finding])
    """A notice for each kind of damage."""

    def add(self, topic: Topic) -> bool:
        """Take a topic in; tell whether its messages are wanted."""
        known = self.topics.get(topic.name)
        if known is None or (not known.definition and topic.definition):
            self.topics[topic.name] = topic
        return self.wanted(topic)

    def report(self, kind: str, text: str) -> None:
        """Tell of damage."""
        self.findings.append(Finding(kind, text))


_MOST_RESUMES = 60
_LARGEST_MESSAGE = 1 << 26
_NO_BAG = "Give the .db3 file or the folder that `ros2 bag record` wrote."
MCAP_MAGIC = b"\x89MCAP0\r\n"


def db3_messages(path: Path, catalog: Catalog) -> Iterator[Message]:
    """The wanted messages of a `.db3` file, in the order in which they were written.

    Raises:
        RecordError: No SQLite database, or no bag.
    """
    with _connection(path) as database:
        topics = _topics(database, path, catalog)
        # Messages of other topics, as images, are not even loaded.
        query = (
            "SELECT id, topic_id, timestamp, data FROM messages WHERE id > ? AND topic_id IN "
            f"({','.join(map(str, topics))}) ORDER BY id"
        )
        last, resumes, step = -1, 0, 1
        while topics:
            try:
                for row_id, topic_id, stamp, data in database.execute(query, (last,)):
                    # A page that was cut off reads as zeros: its rows go back to id 0.
                    if row_id <= last:
                        raise database.DatabaseError("ids do not rise")
                    last, step = row_id, 1
                    if isinstance(stamp, int) and isinstance(data, bytes):
                        yield topics[topic_id], stamp, data
                break
            except (database.Error, OverflowError):
                # A damaged page hides some rows; those after it can often still be read.
                resumes += 1
                if resumes > _MOST_RESUMES or step > 1 << 24:
                    break
                last, step = last + step, step * 2
        if resumes or _is_short(path):
            text = f"{path.name} is damaged or cut off; the messages that can be read are taken"
            catalog.report("truncated_file", text)


def _topics(database: "sqlite3.Connection", path: Path, catalog: Catalog) -> dict[int, str]:
    """Number to name of each topic that is wanted."""
    with refused("this is no readable ROS 2 bag", _NO_BAG):
        for table in ("topics", "messages", "message_definitions"):
            _require_table(database, table, path)
        definitions = _definitions(database)
        rows = database.execute("SELECT id, name, type FROM topics").fetchall()
    wanted: dict[int, str] = {}
    for number, name, kind in rows:
        language, text = definitions.get(str(kind), ("", ""))
        topic = Topic(
            name=str(name), kind=str(kind), encoding="cdr", definition=text, language=language
        )
        if catalog.add(topic) and isinstance(number, int):
            wanted[number] = topic.name
    return wanted


def _require_table(database: "sqlite3.Connection", name: str, path: Path) -> None:
    """Refuse a view, a virtual table or computed columns: reading them runs what they say.

    Raises:
        RecordError: The name is one of them.
    """
    kinds = database.execute("SELECT type, sql FROM sqlite_master WHERE name = ?", (name,))
    computed = database.execute(f"SELECT 1 FROM pragma_table_xinfo('{name}') WHERE hidden != 0")
    for kind, sql in kinds:
        if kind != "table" or "VIRTUAL" in str(sql).upper()[:40] or computed.fetchone():
            what = f"'{name}' is no plain table, so this is no ROS 2 bag"
            raise RecordError(what, where=path.name, value=kind, next_step=_NO_BAG)


def _definitions(database: "sqlite3.Connection") -> dict[str, tuple[str, str]]:
    """Type to language and text of its definition; bags before ROS 2 Iron have none."""
    query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
    with suppress(database.Error, OverflowError):
        rows = database.execute(query).fetchall()
        known = [row for row in rows if row[1] in DEFINITION_LANGUAGES]
        return {str(kind): (str(language), str(text)) for kind, language, text in known}
    return {}


@contextmanager
def _connection(path: Path) -> "Generator[sqlite3.Connection]":
    """The database, opened so that neither it nor its folder is written to."""
    sqlite: Any = require("sqlite3")
    log = path.with_name(path.name + "-wal")
    with tempfile.TemporaryDirectory(prefix="dynid-") as folder:
        with refused("the bag cannot be opened"):
            uri = f"{path.resolve().as_uri()}?mode=ro&immutable=1"
            if log.is_file() and log.stat().st_size:
                # A killed recorder leaves its last messages in the log: merge them in a copy.
                copy = Path(folder) / "bag.db3"
                shutil.copyfile(path, copy)
                shutil.copyfile(log, Path(folder) / "bag.db3-wal")
                uri = copy.as_uri()
            database: sqlite3.Connection = sqlite.connect(uri, uri=True)
        with closing(database):
            # Damaged text must not raise in the middle of a row.
            database.setlimit(sqlite.SQLITE_LIMIT_LENGTH, _LARGEST_MESSAGE)
            database.text_factory = lambda raw: raw.decode(errors="replace")  # pyright: ignore[reportUnknownLambdaType, reportUnknownMemberType]
            # Only so does SQLite open a file that is shorter than its header says.
            with suppress(database.Error):
                database.execute("PRAGMA writable_schema=ON")
            yield database


def _is_short(path: Path) -> bool:
    """Whether pages are missing at the end of the file."""
    with path.open("rb") as stream:
        head = stream.read(32)
    size, pages = struct.unpack_from(">H", head, 16)[0], struct.unpack_from(">I", head, 28)[0]
    return path.stat().st_size < pages * (65536 if size == 1 else size)


@dataclass(slots=True)
class _Reading:
    """What was read of an MCAP file or a ROS 1 bag so far."""

    catalog: Catalog
    topics: dict[int, str] = field(default_factory=dict[int, str])
    """Channel or connection to topic; empty where it is not wanted."""
    schemas: dict[int, Any] = field(default_factory=dict[int, Any])
    expected: int = 0
    """Chunks that a bag's own header counts; 0 where the recorder was killed."""
    chunks: int = 0
    damaged: int = 0
    cut: bool = False

    def add(self, number: int, topic: Topic) -> None:
        """Take a channel or connection in."""
        self.topics[number] = topic.name if self.catalog.add(topic) else ""

    def report(self, path: Path) -> None:
        """Tell of damage."""
        if self.damaged:
            text = f"{self.damaged} damaged pieces of {path.name} are left out"
            self.catalog.report("corrupt_rows", text)
        if self.cut:
            text = f"{path.name} is cut off; what precedes the cut is taken"
            self.catalog.report("truncated_file", text)


def _mcap_records(records: Iterable[Any], state: _Reading) -> Iterator[Message]:
    """The wanted messages among records, whose schemas and channels are remembered."""
    for record in records:
        kind = type(record).__name__
        if kind == "Schema":
            state.schemas.setdefault(record.id, record)
        elif kind == "Channel" and record.id not in state.topics:
            schema = state.schemas.get(record.schema_id)
            language = schema.encoding if schema else ""
            known = language in DEFINITION_LANGUAGES
            topic = Topic(
                name=record.topic,
                kind=schema.name if schema else "unknown",
                encoding=record.message_encoding,
                definition=schema.data.decode(errors="replace") if schema and known else "",
                language=language,
            )
            state.add(record.id, topic)
        elif kind == "Message":
            topic = state.topics.get(record.channel_id)
            if topic and record.log_time < 1 << 62:
                yield topic, record.log_time, record.data


def mcap_messages(path: Path, catalog: Catalog) -> Iterator[Message]:
    """The wanted messages of an MCAP file, in the order in which they were written.

    Raises:
        MissingExtraError: Without the `ros` extra.
    """
    library = require("mcap.stream_reader", "ros")
    failures = (require("mcap.exceptions", "ros").McapError, ValueError, struct.error)
    state = _Reading(catalog, cut=True)
    with path.open("rb") as stream:
        reader = library.StreamReader(stream, emit_chunks=True, record_size_limit=MAX_BYTES)
        place = len(MCAP_MAGIC)
        with suppress(*failures):
            for record in reader.records:
                place = stream.tell()
                kind = type(record).__name__
                if kind in ("DataEnd", "Footer"):
                    state.cut = False
                    break
                if kind != "Chunk":
                    yield from _mcap_records([record], state)
                    continue
                try:
                    # Inflated here, where what comes out is bounded.
                    data = inflate(record.data, record.compression, record.uncompressed_size)
                    plain = replace(record, data=data, compression="")
                    inner = library.breakup_chunk(plain, validate_crc=True)
                except (*failures, InflateError):
                    state.damaged += 1
                    continue
                yield from _mcap_records(inner, state)
        if state.cut:
            stream.seek(place)
            with suppress(*failures, InflateError):
                inner = _cut_chunk(stream.read(MAX_BYTES), library)
                yield from _mcap_records(inner, state)
    state.report(path)


def _cut_chunk(data: bytes, library: Any) -> Iterable[Any]:
    """The records of the MCAP chunk in which a file is cut off, of what is there."""
    if not data.startswith(b"\x06"):
        return ()
    # Opcode and length, times, size and checksum, before the name of the compression.
    (named,) = struct.unpack_from("<I", data, 37)
    packed = data[49 + named :]
    plain = inflate(packed, data[41 : 41 + named].decode())
    return library.StreamReader(io.BytesIO(plain), skip_magic=True).records


ROS1_MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _BAG_HEADER, _CHUNK, _CONNECTION = 0x02, 0x03, 0x05, 0x07
_KINDS = (_MESSAGE, _CHUNK, _CONNECTION)


def ros1_messages(path: Path, catalog: Catalog) -> Iterator[Message]:
    """The wanted messages of a `.bag` file, in the order in which they were written.

    Raises:
        MissingExtraError: A bag compressed by lz4 without the decompressor.
    """
    state = _Reading(catalog)
    with path.open("rb") as stream:
        stream.seek(len(ROS1_MAGIC))
        try:
            yield from _records(stream, path.stat().st_size, state)
        except InflateError:
            state.cut = True
    state.cut |= state.chunks < state.expected
    state.report(path)


def _records(
    stream: BinaryIO, size: int, state: _Reading, kinds: tuple[int, ...] = _KINDS
) -> Iterator[Message]:
    """The messages among records, those in chunks too.

    Raises:
        InflateError: The stream ends within a record.
    """
    while start := stream.read(4):
        length = struct.unpack("<I", start)[0] if len(start) == 4 else MAX_BYTES + 1
        header = stream.read(min(length, size))
        tail = stream.read(4)
        if len(header) < length or len(tail) < 4:
            raise InflateError("cut off")
        (count,) = struct.unpack("<I", tail)
        fields = _fields(header)
        kind = fields.get(b"op", b"\x00")[0]
        if count > size - stream.tell():
            if kind == _CHUNK and kind in kinds:
                # Of the chunk in which the file is cut off, what is there.
                state.cut = True
                yield from _record(fields, stream.read(), state)
            raise InflateError("cut off")
        if kind == _BAG_HEADER and len(fields.get(b"chunk_count", b"")) == 4:
            (state.expected,) = struct.unpack("<I", fields[b"chunk_count"])
        if kind in kinds and count <= MAX_BYTES:
            yield from _record(fields, stream.read(count), state)
        else:
            stream.seek(count, 1)


def _record(fields: dict[bytes, bytes], data: bytes, state: _Reading) -> Iterator[Message]:
    operation = fields[b"op"][0]
    try:
        if operation == _CONNECTION:
            (number,) = struct.unpack("<I", fields[b"conn"])
            if number in state.topics:
                return
            inner = _fields(data)
            topic = Topic(
                name=fields[b"topic"].decode(errors="replace"),
                kind=inner.get(b"type", b"").decode(errors="replace"),
                encoding="ros1",
                language="ros1msg",
                definition=inner.get(b"message_definition", b"").decode(errors="replace"),
            )
            state.add(number, topic)
        elif operation == _MESSAGE:
            (number,) = struct.unpack("<I", fields[b"conn"])
            seconds, nanoseconds = struct.unpack("<II", fields[b"time"])
            if topic := state.topics.get(number):
                yield topic, seconds * 1_000_000_000 + nanoseconds, data
        elif operation == _CHUNK:
            state.chunks += 1
            (size,) = struct.unpack("<I", fields[b"size"])
            method = fields[b"compression"].decode(errors="replace").removeprefix("none")
            data = inflate(data, method, None if state.cut else size)
            yield from _records(io.BytesIO(data), len(data), state, (_MESSAGE, _CONNECTION))
    except (KeyError, struct.error, InflateError):
        state.damaged += not state.cut


def _fields(header: bytes) -> dict[bytes, bytes]:
    """The `name=value` fields of a record's header; those before any damage."""
    fields: dict[bytes, bytes] = {}
    offset = 0
    while offset + 4 <= len(header):
        (length,) = struct.unpack_from("<I", header, offset)
        name, equals, value = header[offset + 4 : offset + 4 + length].partition(b"=")
        if not equals or offset + 4 + length > len(header):
            break
        fields[name] = value
        offset += 4 + length
    return fields
