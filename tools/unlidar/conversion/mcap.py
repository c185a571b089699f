"""MCAP files, read one chunk at a time with bounded decompression.

rosbags reads the index; by itself it would decompress all chunks that overlap in time at once,
without a bound.
"""

import struct
import zlib
from array import array
from collections.abc import Collection, Container, Generator, Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import numpy as np
from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2.storage_mcap import ChunkInfo, McapReader, Statistics

from unlidar.conversion.scans import (
    DEFINITIONS,
    NO_SCHEMA,
    RawMessage,
    ScanReader,
    connection2,
    widest,
)
from unlidar.conversion.unpacking import unpacked
from unlidar.limits import BoundedFile, BoundedPath

_MAGIC = b"\x89MCAP0\r\n"
_INVALID, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0, 3, 4, 5, 6, 15
_HEAD = struct.Struct("<BQ")  # kind and length of a record
_CHUNK_HEAD = struct.Struct("<QQQI")  # begin, end, size when unpacked, checksum


class McapFile(McapReader):
    """A file of ROS 2, read by its index if it has one."""

    def __init__(self, path: Path) -> None:
        super().__init__(BoundedPath(path))
        self._scanned: ScanReader | None = None

    def meta_scan(self) -> None:
        """Scans a file without an index."""
        self._scanned = ScanReader(self.path, scan_mcap)
        self.connections = list(self._scanned.connections)
        counts = {c.id: c.msgcount for c in self.connections}
        span = self._scanned.start_time, self._scanned.end_time - 1
        self.statistics = Statistics(sum(counts.values()), 0, len(counts), 0, 0, 0, *span, counts)

    def messages(
        self, connections: Collection[Connection], start: int | None = None, stop: int | None = None
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Messages chunk by chunk by begin, sorted by time within a chunk."""
        if self._scanned is not None:
            yield from self._scanned.messages(connections, start, stop)
            return
        known = {connection.id: connection for connection in connections}
        for chunk in sorted(self.chunks):
            before = stop is not None and chunk.message_start_time >= stop
            after = start is not None and chunk.message_end_time < start
            if before or after or not any(chunk.channel_count.get(number) for number in known):
                continue
            for number, time_ns, data in _in_order(self._plain(chunk), known):
                if (start is None or time_ns >= start) and (stop is None or time_ns < stop):
                    yield known[number], time_ns, data

    def spans_ns(self) -> dict[str, tuple[int, int]]:
        """First and last log time by topic, accurate to a chunk."""
        if self._scanned is not None:
            return self._scanned.spans_ns()
        return widest(
            (c.topic, (chunk.message_start_time, chunk.message_end_time))
            for c in self.connections
            for chunk in self.chunks
            if chunk.channel_count.get(c.id)
        )

    def _plain(self, chunk: ChunkInfo) -> bytes:
        self.bio.seek(chunk.chunk_start_offset)
        kind, size = _HEAD.unpack(self.bio.read(_HEAD.size))
        body = self.bio.read(size)
        if kind != _CHUNK or len(body) < size:
            raise ValueError(f"at byte {chunk.chunk_start_offset}: expected a chunk")
        plain, whole = _unpacked_chunk(body)
        if not whole:
            raise ValueError("a chunk of it is damaged")
        return plain


def scan_mcap(path: Path) -> Iterator[Connection | RawMessage]:
    """Scans a file of any profile; messages of non-ROS encodings are passed on unchanged."""
    with BoundedFile(path) as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            raise ValueError("it does not begin as MCAP does")
        if not (yield from _records(file, {})):
            raise ValueError("it ends before its data do")


def _unpacked_chunk(body: bytes) -> tuple[bytes, bool]:
    """The decompressed part of a chunk, and True if it is complete."""
    *_, plain_size, crc = _CHUNK_HEAD.unpack_from(body)
    (length,) = struct.unpack_from("<I", body, _CHUNK_HEAD.size)
    begin = _CHUNK_HEAD.size + 4
    compression = body[begin : begin + length].decode(errors="replace")
    packed = memoryview(body)[begin + length + 8 :]  # behind its length
    plain = unpacked(compression, packed, plain_size) if compression else bytes(packed)
    return plain, len(plain) == plain_size and (not crc or zlib.crc32(plain) == crc)


def _in_order(plain: bytes, channels: Container[int]) -> Iterator[RawMessage]:
    """The messages of these channels by time; without an object each, as there may be millions."""
    times_ns, begins, ends = array("Q"), array("Q"), array("Q")
    at = 0
    while at + _HEAD.size <= len(plain):
        kind, size = _HEAD.unpack_from(plain, at)
        begin, at = at + _HEAD.size, at + _HEAD.size + size
        if kind == _INVALID or at > len(plain):
            raise ValueError("a chunk of it is damaged")
        if kind == _MESSAGE and int.from_bytes(plain[begin : begin + 2], "little") in channels:
            times_ns.append(int.from_bytes(plain[begin + 6 : begin + 14], "little"))
            begins.append(begin)
            ends.append(at)
    for i in np.argsort(np.asarray(times_ns), kind="stable"):
        begin = begins[i]
        number = int.from_bytes(plain[begin : begin + 2], "little")
        yield number, times_ns[i], plain[begin + 22 : ends[i]]


def _records(
    stream: BinaryIO, schemas: dict[int, tuple[str, MessageDefinition]], in_chunk: bool = False
) -> Generator[Connection | RawMessage, None, bool]:
    """Yields records; returns True at the data end record, False at the end of the stream."""
    while len(head := stream.read(_HEAD.size)) == _HEAD.size:
        kind, size = _HEAD.unpack(head)
        if kind == _DATA_END:
            return True
        if kind == _INVALID or (kind == _CHUNK and in_chunk):
            raise ValueError(f"it has a record of kind {kind} where none can be")
        if kind not in (_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK):
            stream.seek(size, 1)
            continue
        body = stream.read(size)
        whole = len(body) == size
        if kind == _CHUNK:
            plain, intact = _unpacked_chunk(body)
            yield from _records(BytesIO(plain), schemas, in_chunk=True)
            if not intact:
                raise ValueError("a chunk of it is damaged")
        if not whole:
            raise ValueError("it ends within a record")
        if kind == _MESSAGE:
            times = int.from_bytes(body[6:14], "little")
            yield int.from_bytes(body[:2], "little"), times, body[22:]
        elif kind == _SCHEMA:
            record = BytesIO(body[2:])
            name, encoding = _text(record), _text(record)
            form = DEFINITIONS.get(encoding, MessageDefinitionFormat.NONE)
            definition = MessageDefinition(form, _text(record))
            schemas[int.from_bytes(body[:2], "little")] = (name, definition)
        elif kind == _CHANNEL:
            schema = int.from_bytes(body[2:4], "little")
            name, definition = schemas[schema] if schema else NO_SCHEMA
            record = BytesIO(body[4:])
            topic, encoding = _text(record), _text(record)
            number = int.from_bytes(body[:2], "little")
            yield connection2(number, topic, name, definition, encoding)
    return False


def _text(record: BinaryIO) -> str:
    return record.read(int.from_bytes(record.read(4), "little")).decode(errors="replace")
