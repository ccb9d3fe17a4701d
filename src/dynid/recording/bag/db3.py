"""ROS 2 bags in SQLite (`.db3`): messages, also from a damaged file.

Python's own sqlite3 reads them in a stream: no metadata.yaml is needed, and what precedes
or follows a damaged page is still had.
"""

from __future__ import annotations

import shutil
import sqlite3
import struct
import tempfile
from collections.abc import Generator, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

from dynid.core import RecordError
from dynid.recording.bag.catalog import Catalog, Message, Topic

_MOST_RESUMES = 60


def db3_messages(path: Path, catalog: Catalog) -> Iterator[Message]:
    """The wanted messages in the order in which they were written.

    Args:
        path: The `.db3` file.
        catalog: Says which topics are wanted; gets all topics, and a notice for each kind of
            damage.

    Yields:
        Topic, receive time [ns] and bytes.

    Raises:
        RecordError: No SQLite database, or no bag.
    """
    with _connection(path) as database:
        topics = _topics(database, path, catalog)
        last, resumes, step = -1, 0, 1
        while True:
            try:
                query = (
                    "SELECT id, topic_id, timestamp, data FROM messages WHERE id > ? ORDER BY id"
                )
                for row_id, topic_id, stamp, data in database.execute(query, (last,)):
                    last, step = row_id, 1
                    if topic_id in topics and isinstance(stamp, int) and isinstance(data, bytes):
                        yield topics[topic_id], stamp, data
                break
            except (sqlite3.Error, OverflowError):
                # A damaged page hides some rows; those after it can often still be read.
                resumes += 1
                if resumes > _MOST_RESUMES or step > 1 << 24:
                    break
                last, step = last + step, step * 2
        if resumes or _is_short(path):
            catalog.report(
                "truncated_file",
                f"{path.name} is damaged or cut off; the messages that can be read are taken",
            )


def _topics(database: sqlite3.Connection, path: Path, catalog: Catalog) -> dict[int, str]:
    """Number to name of each topic that is wanted."""
    definitions = _definitions(database)
    try:
        rows = database.execute("SELECT id, name, type FROM topics").fetchall()
    except (sqlite3.Error, OverflowError) as error:
        raise RecordError(
            "this is no readable ROS 2 bag",
            where=path.name,
            value=str(error),
            next_step="Give the .db3 file or the folder that `ros2 bag record` wrote.",
        ) from error
    wanted: dict[int, str] = {}
    for number, name, kind in rows:
        text = definitions.get(str(kind), "")
        topic = Topic(name=str(name), kind=str(kind), encoding="cdr", definition=text)
        if catalog.add(topic) and isinstance(number, int):
            wanted[number] = topic.name
    return wanted


def _definitions(database: sqlite3.Connection) -> dict[str, str]:
    """Type to definition; bags before ROS 2 Iron have none."""
    query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
    with suppress(sqlite3.Error, OverflowError):
        rows = database.execute(query).fetchall()
        return {str(kind): str(text) for kind, encoding, text in rows if encoding == "ros2msg"}
    return {}


@contextmanager
def _connection(path: Path) -> Generator[sqlite3.Connection]:
    """The database, opened so that neither it nor its folder is written to."""
    log = path.with_name(path.name + "-wal")
    with tempfile.TemporaryDirectory(prefix="dynid-") as folder:
        try:
            if log.is_file() and log.stat().st_size:
                # A killed recorder leaves its last messages in the log: merge them in a copy.
                copy = Path(folder) / "bag.db3"
                shutil.copyfile(path, copy)
                shutil.copyfile(log, Path(folder) / "bag.db3-wal")
                uri = f"{copy.as_uri()}"
            else:
                uri = f"{path.resolve().as_uri()}?mode=ro&immutable=1"
            database = sqlite3.connect(uri, uri=True)
        except (OSError, sqlite3.Error) as error:
            raise RecordError(
                "the bag cannot be opened", where=path.name, value=str(error)
            ) from error
        with closing(database):
            # Damaged text must not raise in the middle of a row.
            database.text_factory = lambda raw: raw.decode(errors="replace")  # pyright: ignore[reportUnknownLambdaType, reportUnknownMemberType]
            # Only so does SQLite open a file that is shorter than its header says.
            with suppress(sqlite3.Error):
                database.execute("PRAGMA writable_schema=ON")
            yield database


def _is_short(path: Path) -> bool:
    """Whether pages are missing at the end of the file."""
    with path.open("rb") as stream:
        head = stream.read(32)
    if len(head) < 32:
        return True
    size, pages = struct.unpack_from(">H", head, 16)[0], struct.unpack_from(">I", head, 28)[0]
    return path.stat().st_size < pages * (65536 if size == 1 else size)
