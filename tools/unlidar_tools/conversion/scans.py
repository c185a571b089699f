"""Recordings read record by record, in the order of their files.

This takes what the readers of rosbags do not: bags without an index or an end, as a crashed
recorder or a full disk leaves them; databases with rows in their write-ahead log; MCAP files that
are not of ROS 2 alone. All three formats give `Connection`s as they become known and messages as
(id of the connection, log time in ns, data). A scan raises one of `DAMAGE` where its file is
broken.
"""

import bz2
import struct
import zlib
from collections.abc import Callable, Collection, Generator, Iterator
from contextlib import closing, suppress
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import apsw
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

from unlidar_tools.conversion.message_types import ROS1_ENCODING

try:
    from compression import zstd
except ImportError:  # before Python 3.14
    from backports import zstd

RawMessage = tuple[int, int, bytes]
Scan = Callable[[Path], Iterator[Connection | RawMessage]]

_MCAP_MAGIC = b"\x89MCAP0\r\n"
_MCAP_SCHEMA, _MCAP_CHANNEL, _MCAP_MESSAGE, _MCAP_CHUNK, _MCAP_DATA_END = 3, 4, 5, 6, 15
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"  # no message of ROS 2 begins like this
# What a parser meets in bytes that are not what they should be.
DAMAGE = (
    ReaderError, ValueError, LookupError, OverflowError, struct.error, AssertionError, apsw.Error,
)  # fmt: skip
_DEFINITIONS = {
    "ros1msg": MessageDefinitionFormat.MSG,
    "ros2msg": MessageDefinitionFormat.MSG,
    "ros2idl": MessageDefinitionFormat.IDL,
    "omgidl": MessageDefinitionFormat.IDL,
}
_NO_SCHEMA = ("", MessageDefinition(MessageDefinitionFormat.NONE, ""))


def storage_suffix(path: Path) -> str:
    """The ending that tells the format; a crashed `rosbag record` leaves `flight.bag.active`."""
    return Path(path.name.removesuffix(".active")).suffix


def write_ahead_log(path: Path) -> Path | None:
    """The file with rows of a database that are not in it yet, if there are any."""
    log = path.with_name(f"{path.name}-wal")
    return log if path.suffix == ".db3" and log.is_file() and log.stat().st_size else None


class ScanReader:
    """A file of a recording, read as the readers of rosbags are."""

    def __init__(self, path: Path, scan: Scan) -> None:
        """Goes through the file once to know its topics and times."""
        self._path, self._scan = path, scan
        known: dict[int, Connection] = {}
        counts: dict[int, int] = {}
        self.start_time, self.end_time = 2**63 - 1, 0
        for item in scan(path):
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
        for item in self._scan(self._path):
            if isinstance(item, Connection) or item[0] not in wanted:
                continue
            if (start is None or item[1] >= start) and (stop is None or item[1] < stop):
                packed = item[2].startswith(_ZSTD_MAGIC)
                yield wanted[item[0]], item[1], zstd.decompress(item[2]) if packed else item[2]

    def close(self) -> None:
        """Holds no file open between calls."""


def salvage_reader(path: Path) -> ScanReader:
    """What is left of a broken file, up to the point where it breaks."""
    scan = _SCANS[storage_suffix(path)]

    def up_to_damage(path: Path) -> Iterator[Connection | RawMessage]:
        with suppress(*DAMAGE):
            yield from scan(path)

    return ScanReader(path, up_to_damage)


def _scan_rosbag1(path: Path) -> Iterator[Connection | RawMessage]:
    with path.open("rb") as file:
        file.readline()
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
                with suppress(*DAMAGE):
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


def scan_mcap(path: Path) -> Iterator[Connection | RawMessage]:
    """Of any profile; messages of other encodings than ROS's are handed on as they are."""
    with path.open("rb") as file:
        if file.read(len(_MCAP_MAGIC)) != _MCAP_MAGIC:
            raise ValueError("it does not begin as MCAP does")
        if not (yield from _records_mcap(file, {})):
            raise ValueError("it ends before its data do")


def _records_mcap(
    stream: BinaryIO, schemas: dict[int, tuple[str, MessageDefinition]]
) -> Generator[Connection | RawMessage, None, bool]:
    """Up to the end of the data (then True) or of the stream (then False)."""
    while len(head := stream.read(9)) == 9:
        kind, size = head[0], int.from_bytes(head[1:], "little")
        if kind == _MCAP_DATA_END:
            return True
        if kind not in (_MCAP_SCHEMA, _MCAP_CHANNEL, _MCAP_MESSAGE, _MCAP_CHUNK):
            stream.seek(size, 1)
            continue
        body = stream.read(size)
        whole = len(body) == size
        if kind == _MCAP_CHUNK:
            plain_size, crc = struct.unpack_from("<QI", body, 16)
            record = BytesIO(body[28:])
            compression = _mcap_text(record)
            plain = _unpacked(compression, record.read()[8:])
            yield from _records_mcap(BytesIO(plain), schemas)
            if len(plain) != plain_size or (crc and zlib.crc32(plain) != crc):
                raise ValueError("a chunk of it is damaged")
        if not whole:
            raise ValueError("it ends within a record")
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
            schema = int.from_bytes(body[2:4], "little")
            name, definition = schemas[schema] if schema else _NO_SCHEMA
            record = BytesIO(body[4:])
            topic, encoding = _mcap_text(record), _mcap_text(record)
            number = int.from_bytes(body[:2], "little")
            yield _connection2(number, topic, name, definition, encoding)
    return False


def _mcap_text(record: BinaryIO) -> str:
    return record.read(int.from_bytes(record.read(4), "little")).decode(errors="replace")


def scan_sqlite(path: Path) -> Iterator[Connection | RawMessage]:
    """Row by row as they were written; the index over their times may be lost."""
    with closing(_open_sqlite(path)) as database:
        # Else SQLite refuses a file that is shorter than its header says.
        database.execute("PRAGMA writable_schema=ON")
        definitions: dict[str, MessageDefinition] = {}
        with suppress(apsw.Error):  # a table that bags before Iron have not
            for name, encoding, text in database.execute(
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            ):
                form = _DEFINITIONS.get(encoding, MessageDefinitionFormat.NONE)
                definitions[name] = MessageDefinition(form, text)
        for number, topic, name, encoding in database.execute(
            "SELECT id, name, type, serialization_format FROM topics"
        ):
            definition = definitions.get(name, _NO_SCHEMA[1])
            yield _connection2(number, topic, name, definition, encoding)
        yield from database.execute("SELECT topic_id, timestamp, data FROM messages NOT INDEXED")


def _open_sqlite(path: Path) -> apsw.Connection:
    """For reading only: no file changes or appears, the write-ahead log neither."""
    flags = apsw.SQLITE_OPEN_READONLY | apsw.SQLITE_OPEN_URI
    uri = path.resolve().as_uri()
    if write_ahead_log(path) is None:
        return apsw.Connection(f"{uri}?mode=ro&immutable=1", flags=flags)
    if not path.stat().st_size:  # SQLite would remove the log of a database without a page
        raise ValueError("it is empty but for its write-ahead log")
    # Nobody else has a share in it: the index over the log is kept in memory, no lock is taken, and
    # the log is not worked off when it is closed.
    database = apsw.Connection(f"{uri}?mode=ro&vfs=unix-none", flags=flags)
    database.config(apsw.SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1)
    database.execute("PRAGMA locking_mode=EXCLUSIVE")
    return database


def _connection2(
    number: int, topic: str, msgtype: str, definition: MessageDefinition, encoding: str
) -> Connection:
    if encoding == ROS1_ENCODING and msgtype.count("/") == 1:
        msgtype = msgtype.replace("/", "/msg/")  # as rosbags calls types of both versions
    return Connection(
        number, topic, msgtype, definition, "", 0, ConnectionExtRosbag2(encoding, []), None
    )


_SCANS: dict[str, Scan] = {".bag": _scan_rosbag1, ".mcap": scan_mcap, ".db3": scan_sqlite}
