"""Bags without an index or an end, as a crashed recorder or a full disk leaves them.

They are read record by record up to the point where they break. All three formats give
`Connection`s as they become known and messages as (id of the connection, log time in ns, data).
"""

import bz2
import sqlite3
import struct
from collections.abc import Callable, Collection, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import lz4.frame
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
)
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1 import ReaderError
from rosbags.rosbag1.reader import Header, RecordType, read_bytes, read_uint32

try:
    from compression import zstd
except ImportError:  # before Python 3.14
    from backports import zstd

RawMessage = tuple[int, int, bytes]
_Scan = Callable[[Path], Iterator[Connection | RawMessage]]

_MCAP_MAGIC = b"\x89MCAP0\r\n"
_MCAP_SCHEMA, _MCAP_CHANNEL, _MCAP_MESSAGE, _MCAP_CHUNK, _MCAP_DATA_END = 3, 4, 5, 6, 15
# What a parser meets in bytes that are not what they should be.
_DAMAGE = (ReaderError, ValueError, LookupError, OverflowError, struct.error, AssertionError)
_DEFINITIONS = {
    "ros2msg": MessageDefinitionFormat.MSG,
    "ros2idl": MessageDefinitionFormat.IDL,
}


def storage_suffix(path: Path) -> str:
    """The ending that tells the format; a crashed `rosbag record` leaves `flight.bag.active`."""
    return Path(path.name.removesuffix(".active")).suffix


@dataclass
class SalvageReader:
    """Reads what is left of one file, in the order of the file."""

    path: Path

    def __post_init__(self) -> None:
        """Goes through the file once to know its topics and times."""
        self._scan = _SCANS[storage_suffix(self.path)]
        known: dict[int, Connection] = {}
        counts: dict[int, int] = {}
        self.start_time, self.end_time = 2**63 - 1, 0
        for item in self._scan(self.path):
            if isinstance(item, Connection):
                known.setdefault(item.id, item)
                continue
            counts[item[0]] = counts.get(item[0], 0) + 1
            self.start_time = min(self.start_time, item[1])
            self.end_time = max(self.end_time, item[1] + 1)
        self.connections = [c._replace(msgcount=counts.get(c.id, 0)) for c in known.values()]

    def messages(
        self, connections: Collection[Connection], start: int | None, stop: int | None
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """As the readers of rosbags."""
        wanted = {connection.id: connection for connection in connections}
        for item in self._scan(self.path):
            if isinstance(item, Connection) or item[0] not in wanted:
                continue
            if (start is None or item[1] >= start) and (stop is None or item[1] < stop):
                yield wanted[item[0]], item[1], item[2]

    def close(self) -> None:
        """Holds no file open between calls."""


def _scan_rosbag1(path: Path) -> Iterator[Connection | RawMessage]:
    with path.open("rb") as file:
        file.readline()
        with suppress(*_DAMAGE):
            yield from _records_rosbag1(path, file)


def _records_rosbag1(path: Path, stream: BinaryIO) -> Iterator[Connection | RawMessage]:
    """Ends with a ReaderError at the end of the stream or where a record is cut off."""
    while True:
        begin = stream.tell()
        header = Header.read(stream)
        match header.get_uint8("op"):
            case RecordType.CONNECTION:
                stream.seek(begin)
                reader = Reader1(path)
                reader.bio = stream
                yield reader.read_connection()
            case RecordType.CHUNK:
                packed = stream.read(read_uint32(stream))
                plain = _unpacked(header.get_string("compression"), packed)
                with suppress(*_DAMAGE):
                    yield from _records_rosbag1(path, BytesIO(plain))
            case RecordType.MSGDATA:
                data = read_bytes(stream, read_uint32(stream))
                yield header.get_uint32("conn"), header.get_time("time"), data
            case _:
                read_bytes(stream, read_uint32(stream))


def _unpacked(compression: str, packed: bytes) -> bytes:
    """As much of a chunk as its bytes give; nothing of one that is damaged."""
    with suppress(OSError, RuntimeError, EOFError, zstd.ZstdError):
        match compression:
            case "" | "none":
                return packed
            case "bz2":
                return bz2.BZ2Decompressor().decompress(packed)
            case "lz4":
                return lz4.frame.LZ4FrameDecompressor().decompress(packed)
            case "zstd":
                return zstd.ZstdDecompressor().decompress(packed)
    return b""


def _scan_mcap(path: Path) -> Iterator[Connection | RawMessage]:
    with path.open("rb") as file:
        if file.read(len(_MCAP_MAGIC)) == _MCAP_MAGIC:
            with suppress(*_DAMAGE):
                yield from _records_mcap(file, {})


def _records_mcap(
    stream: BinaryIO, schemas: dict[int, tuple[str, MessageDefinition]]
) -> Iterator[Connection | RawMessage]:
    """Ends at the end of the stream, of its data, or where a record is cut off."""
    while len(head := stream.read(9)) == 9:
        kind, size = head[0], int.from_bytes(head[1:], "little")
        if kind == _MCAP_DATA_END:
            return
        if kind not in (_MCAP_SCHEMA, _MCAP_CHANNEL, _MCAP_MESSAGE, _MCAP_CHUNK):
            stream.seek(size, 1)
            continue
        body = stream.read(size)
        whole = len(body) == size
        if kind == _MCAP_CHUNK:
            record = BytesIO(body[28:])
            compression = _mcap_text(record)
            yield from _records_mcap(BytesIO(_unpacked(compression, record.read()[8:])), schemas)
        if not whole:
            return
        if kind == _MCAP_MESSAGE:
            times = int.from_bytes(body[6:14], "little")
            yield int.from_bytes(body[:2], "little"), times, body[22:]
        elif kind == _MCAP_SCHEMA:
            record = BytesIO(body[2:])
            name, encoding = _mcap_text(record), _mcap_text(record)
            form = _DEFINITIONS.get(encoding, MessageDefinitionFormat.NONE)
            definition = MessageDefinition(form, _mcap_text(record))
            schemas[int.from_bytes(body[:2], "little")] = (name, definition)
        elif kind == _MCAP_CHANNEL:
            name, definition = schemas[int.from_bytes(body[2:4], "little")]
            topic = _mcap_text(BytesIO(body[4:]))
            yield _connection2(int.from_bytes(body[:2], "little"), topic, name, definition)


def _mcap_text(record: BinaryIO) -> str:
    return record.read(int.from_bytes(record.read(4), "little")).decode(errors="replace")


def _scan_sqlite(path: Path) -> Iterator[Connection | RawMessage]:
    """Row by row as they were written; the index over their times may be lost."""
    with suppress(sqlite3.Error), closing(_open_sqlite(path)) as database:
        # Else SQLite refuses a file that is shorter than its header says.
        database.execute("PRAGMA writable_schema=ON")
        definitions: dict[str, MessageDefinition] = {}
        with suppress(sqlite3.Error):  # a table that bags before Iron have not
            for name, encoding, text in database.execute(
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            ):
                form = _DEFINITIONS.get(encoding, MessageDefinitionFormat.NONE)
                definitions[name] = MessageDefinition(form, text)
        unknown = MessageDefinition(MessageDefinitionFormat.NONE, "")
        for number, topic, name in database.execute("SELECT id, name, type FROM topics"):
            yield _connection2(number, topic, name, definitions.get(name, unknown))
        yield from database.execute("SELECT topic_id, timestamp, data FROM messages NOT INDEXED")


def _open_sqlite(path: Path) -> sqlite3.Connection:
    return sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)


def _connection2(
    number: int, topic: str, msgtype: str, definition: MessageDefinition
) -> Connection:
    return Connection(
        number, topic, msgtype, definition, "", 0, ConnectionExtRosbag2("cdr", []), None
    )


_SCANS: dict[str, _Scan] = {".bag": _scan_rosbag1, ".mcap": _scan_mcap, ".db3": _scan_sqlite}
