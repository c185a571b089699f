"""Recordings read record by record, in the order of their files.

These scans cover what rosbags cannot read: bags without an index or an end, as a crashed
recorder or a full disk leaves them; databases with rows in their write-ahead log; MCAP files that
are not of ROS 2 alone. All three formats yield `Connection`s as they become known and messages as
(id of the connection, log time in ns, data). A scan raises one of `DAMAGE` where its file is
broken.
"""

import struct
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import closing, suppress
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import apsw
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
)
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1 import ReaderError
from rosbags.rosbag1.reader import Header, RecordType, read_bytes, read_uint32

from unlidar.conversion.message_types import ROS1_ENCODING
from unlidar.conversion.unpacking import unpacked
from unlidar.limits import MOST_RECORD, BoundedFile

RawMessage = tuple[int, int, bytes]
Scan = Callable[[Path], Iterator[Connection | RawMessage]]

_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"  # no message of ROS 2 begins like this
# Exceptions of a parser in damaged bytes.
DAMAGE = (
    ReaderError, ValueError, LookupError, OverflowError, struct.error, AssertionError, apsw.Error,
)  # fmt: skip
DEFINITIONS = {
    "ros1msg": MessageDefinitionFormat.MSG,
    "ros2msg": MessageDefinitionFormat.MSG,
    "ros2idl": MessageDefinitionFormat.IDL,
    "omgidl": MessageDefinitionFormat.IDL,
}
_TABLES = ("messages", "topics", "message_definitions", "schema")
NO_SCHEMA = ("", MessageDefinition(MessageDefinitionFormat.NONE, ""))


def storage_suffix(path: Path) -> str:
    """The suffix of the format; a crashed `rosbag record` leaves `flight.bag.active`."""
    return Path(path.name.removesuffix(".active")).suffix


def write_ahead_log(path: Path) -> Path | None:
    """The write-ahead log of a database, if it holds rows."""
    log = path.with_name(f"{path.name}-wal")
    return log if path.suffix == ".db3" and log.is_file() and log.stat().st_size else None


class ScanReader:
    """Reads a file by scanning it, with the interface of the rosbags readers."""

    def __init__(self, path: Path, scan: Scan) -> None:
        """Scans the file once for its topics and times."""
        self._path, self._scan = path, scan
        known: dict[int, Connection] = {}
        counts: dict[int, int] = {}
        self._spans_ns: dict[int, tuple[int, int]] = {}
        self.start_time, self.end_time = 2**63 - 1, 0
        for item in scan(path):
            if isinstance(item, Connection):
                known.setdefault(item.id, item)
                continue
            counts[item[0]] = counts.get(item[0], 0) + 1
            first, last = self._spans_ns.get(item[0], (item[1], item[1]))
            self._spans_ns[item[0]] = min(first, item[1]), max(last, item[1])
            self.start_time = min(self.start_time, item[1])
            self.end_time = max(self.end_time, item[1] + 1)
        self.connections = [c._replace(msgcount=counts.get(c.id, 0)) for c in known.values()]

    def spans_ns(self) -> dict[str, tuple[int, int]]:
        """First and last log time by topic, from the first scan."""
        return widest((c.topic, self._spans_ns.get(c.id)) for c in self.connections)

    def messages(
        self, connections: Collection[Connection], start: int | None, stop: int | None
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Messages as from the readers of rosbags."""
        wanted = {connection.id: connection for connection in connections}
        for item in self._scan(self._path):
            if isinstance(item, Connection) or item[0] not in wanted:
                continue
            if (start is None or item[1] >= start) and (stop is None or item[1] < stop):
                yield wanted[item[0]], item[1], item[2]

    def close(self) -> None:
        """Does nothing: no file stays open."""


def widest(spans: Iterable[tuple[str, tuple[int, int] | None]]) -> dict[str, tuple[int, int]]:
    """Merges spans: first and last time of each topic."""
    found: dict[str, tuple[int, int]] = {}
    for topic, span in spans:
        if span is not None:
            first, last = found.get(topic, span)
            found[topic] = min(first, span[0]), max(last, span[1])
    return found


def scan_rosbag1(path: Path) -> Iterator[Connection | RawMessage]:
    """Record by record, into its chunks."""
    with BoundedFile(path) as file:
        file.readline()
        yield from _records_rosbag1(path, file)


def _records_rosbag1(
    path: Path, stream: BinaryIO, in_chunk: bool = False
) -> Iterator[Connection | RawMessage]:
    """Yields records until a ReaderError at the end of the stream or in a truncated record."""
    while True:
        begin = stream.tell()
        header = Header.read(stream)
        match header.get_uint8("op"):
            case RecordType.CONNECTION:
                stream.seek(begin)
                reader = Reader1(path)
                reader.bio = stream
                yield reader.read_connection()
            case RecordType.CHUNK if not in_chunk:
                packed = stream.read(read_uint32(stream))
                plain = unpacked_chunk1(header.get_string("compression"), packed)
                with suppress(*DAMAGE):
                    yield from _records_rosbag1(path, BytesIO(plain), in_chunk=True)
            case RecordType.MSGDATA:
                data = read_bytes(stream, read_uint32(stream))
                yield header.get_uint32("conn"), header.get_time("time"), data
            case _:
                read_bytes(stream, read_uint32(stream))


def unpacked_chunk1(compression: str, packed: bytes) -> bytes:
    """As `unpacked`, for a chunk of ROS 1, which may be stored without compression."""
    return packed if compression in ("", "none") else unpacked(compression, packed)


def unpacked_message(data: bytes) -> bytes:
    """A message of ROS 2, decompressed if its recorder compressed it."""
    return unpacked("zstd", data) if data.startswith(_ZSTD_MAGIC) else data


def scan_sqlite(path: Path) -> Iterator[Connection | RawMessage]:
    """Yields rows in the order written, without the index over times, which may be damaged."""
    with closing(open_sqlite(path)) as database:
        definitions: dict[str, MessageDefinition] = {}
        with suppress(apsw.Error):  # bags before Iron lack this table
            for name, encoding, text in database.execute(
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            ):
                form = DEFINITIONS.get(encoding, MessageDefinitionFormat.NONE)
                definitions[name] = MessageDefinition(form, text)
        for number, topic, name, encoding in database.execute(
            "SELECT id, name, type, serialization_format FROM topics"
        ):
            definition = definitions.get(name, NO_SCHEMA[1])
            yield connection2(number, topic, name, definition, encoding)
        yield from database.execute("SELECT topic_id, timestamp, data FROM messages NOT INDEXED")


def open_sqlite(path: Path) -> apsw.Connection:
    """Opens a database read-only, without touching or creating its write-ahead log.

    ValueError for a view or virtual table, which may generate rows without end.
    """
    database = _opened_sqlite(path)
    database.limit(apsw.SQLITE_LIMIT_LENGTH, MOST_RECORD)
    # Accept a file that is shorter than its header declares.
    database.execute("PRAGMA writable_schema=ON")
    views = database.execute("SELECT name FROM sqlite_master WHERE type = 'view'").fetchall()
    made_up = {name for (name,) in views if str(name).lower() in _TABLES}
    if made_up:
        database.close()
        raise ValueError(f"{min(made_up)} is a view, expected a table")
    return database


def _opened_sqlite(path: Path) -> apsw.Connection:
    flags = apsw.SQLITE_OPEN_READONLY | apsw.SQLITE_OPEN_URI
    uri = path.resolve().as_uri()
    if write_ahead_log(path) is None:
        return apsw.Connection(f"{uri}?mode=ro&immutable=1", flags=flags)
    if not path.stat().st_size:  # SQLite would delete the log of an empty database
        raise ValueError("it is empty but for its write-ahead log")
    # Exclusive, lock-free access: the index of the log stays in memory and closing does not
    # checkpoint the log.
    database = apsw.Connection(f"{uri}?mode=ro&vfs=unix-none", flags=flags)
    database.config(apsw.SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1)
    database.execute("PRAGMA locking_mode=EXCLUSIVE")
    return database


def connection2(
    number: int, topic: str, msgtype: str, definition: MessageDefinition, encoding: str
) -> Connection:
    """The connection of a ROS 2 topic, or of a ROS 1 topic in an MCAP file."""
    if encoding == ROS1_ENCODING and msgtype.count("/") == 1:
        msgtype = msgtype.replace("/", "/msg/")  # as rosbags calls types of both versions
    return Connection(
        number, topic, msgtype, definition, "", 0, ConnectionExtRosbag2(encoding, []), None
    )
