"""The readers of rosbags with the size bounds of `limits`."""

from collections import defaultdict
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import ClassVar

import apsw
from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Connection
from rosbags.rosbag1.reader import Chunk, IndexData, decompressors
from rosbags.rosbag2.reader import DirectoryReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from unlidar.conversion.clouds import CLOUD_TYPES
from unlidar.conversion.mcap import McapFile
from unlidar.conversion.positions import POSITION_TYPES
from unlidar.conversion.scans import open_sqlite, unpacked_chunk1, widest
from unlidar.conversion.transforms import POSE_TYPES
from unlidar.limits import MEGABYTE, MOST_RECORD, BoundedPath, TooLargeError

_MOST_INDEX = 16 * MEGABYTE  # bytes of a topic's index in one chunk: a million messages


class Reader1(rosbag1.Reader):
    """Reader of ROS 1 that indexes only convertible topics: an IMU has millions of entries."""

    def __init__(self, path: Path) -> None:
        super().__init__(BoundedPath(path))

    def read_index_data(self, pos: int, indexes: dict[int, list[IndexData]]) -> None:
        """The index entries of one topic in one chunk; a topic that is not converted gets one."""
        begin = self.bio.tell()
        size = int.from_bytes(self.bio.read(55)[-4:], "little")
        if size > _MOST_INDEX:
            raise TooLargeError("the index of a chunk", size, _MOST_INDEX)
        self.bio.seek(begin)
        useful = {c.id for c in self.connections if _is_useful(c)}
        found: dict[int, list[IndexData]] = defaultdict(list)
        super().read_index_data(pos, found)
        for number, entries in found.items():
            index = indexes[number]
            index += entries if number in useful else [(index or entries)[0]] * len(entries)

    def spans_ns(self) -> dict[str, tuple[int, int]]:
        """First and last log time by topic; accurate to a chunk for topics that are not indexed."""
        return widest(
            (c.topic, span)
            for c in self.connections
            for span in [
                *((i.time, i.time) for i in (self.indexes[c.id][:1] + self.indexes[c.id][-1:])),
                *(
                    (chunk.start_time, chunk.end_time - 1)
                    for chunk in self.chunk_infos
                    if not _is_useful(c) and chunk.connection_counts.get(c.id)
                ),
            ]
        )

    def read_chunk(self) -> Chunk:
        """The position of a chunk, and a bounded decompressor for it."""
        chunk = super().read_chunk()
        kind = next(name for name, given in decompressors.items() if given is chunk.decompressor)
        return chunk._replace(decompressor=lambda packed: unpacked_chunk1(kind, packed))


def _is_useful(connection: Connection) -> bool:
    kind = connection.msgtype
    return kind in (*CLOUD_TYPES, *POSITION_TYPES, *POSE_TYPES)


class SqliteFile(Sqlite3Reader):
    """A database of ROS 2."""

    def open(self) -> None:
        """Opens the database; ValueError if its tables are views or virtual."""
        with closing(open_sqlite(self.path)):
            pass
        super().open()
        self.dbconn.limit(apsw.SQLITE_LIMIT_LENGTH, MOST_RECORD)

    def spans_ns(self) -> dict[str, tuple[int, int]]:
        """First and last log time by topic."""
        return widest(
            (topic, (first, last))
            for topic, first, last in self.dbconn.execute(
                "SELECT name, min(timestamp), max(timestamp) FROM messages "
                "JOIN topics ON topics.id = topic_id GROUP BY topic_id"
            )
        )


class _Folder(DirectoryReader):
    """The files of a folder as its metadata.yaml describes them."""

    STORAGE_PLUGINS: ClassVar[Mapping[str, type]] = {"mcap": McapFile, "sqlite3": SqliteFile}

    def __init__(self, path: Path) -> None:
        super().__init__(BoundedPath(path))

    def open(self) -> None:
        """Opens the files; messages that were compressed singly stay so."""
        super().open()
        self.metadata = self.metadata._replace(compression_mode=None)

    def spans_ns(self) -> dict[str, tuple[int, int]]:
        """First and last log time by topic."""
        return widest(item for file in self.storages for item in file.spans_ns().items())


class Reader2(rosbag2.Reader):
    """Reader of ROS 2: a folder, or one file."""

    STORAGE_PLUGINS: ClassVar[Mapping[str, type]] = {
        "dir": _Folder,
        ".mcap": McapFile,
        ".db3": SqliteFile,
    }

    def spans_ns(self) -> dict[str, tuple[int, int]]:
        """First and last log time by topic."""
        return self.storage.spans_ns()
