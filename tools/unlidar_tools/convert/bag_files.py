"""Opening what ROS records: single files, folders of ROS 2, folders of split bags."""

import re
from collections import defaultdict
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1.reader import IndexData
from rosbags.rosbag2 import Reader as Reader2

from unlidar_tools.convert.clouds import CLOUD_TYPES
from unlidar_tools.convert.positions import POSITION_TYPES
from unlidar_tools.convert.salvage import SalvageReader, storage_suffix
from unlidar_tools.errors import InputError, reason

_SUFFIXES = (".bag", ".db3", ".mcap")
_METADATA = "metadata.yaml"
# What recorders append to the names of the files of a split bag: the date and a number.
_NUMBER = re.compile(r"(_?\d{4}(-\d\d){5})?(_\d+)?$")


class _Reader(Protocol):
    connections: list[Connection]
    start_time: int
    end_time: int

    def messages(
        self, connections: Collection[Connection], start: int | None, stop: int | None
    ) -> Iterator[tuple[Connection, int, bytes]]: ...

    def close(self) -> None: ...


@dataclass(frozen=True)
class Part:
    """An opened bag, or one file of a recording that was split."""

    reader: _Reader
    is_ros1: bool


@dataclass(frozen=True)
class Opened:
    """All parts in order of time, and what is broken about them."""

    parts: list[Part]
    flaw: str | None


def is_bag(path: Path) -> bool:
    """Whether it is a file of ROS or a folder that holds some."""
    if path.is_dir():
        return (path / _METADATA).is_file() or _is_split(_bag_files(path))
    return storage_suffix(path) in _SUFFIXES


def open_bag(path: Path) -> Opened:
    """Opens a recording; of a broken one what is left. InputError if nothing is."""
    if path.is_dir() and (path / _METADATA).is_file():
        try:
            return Opened([_open_whole(path)], None)
        except Exception as error:  # whatever a damaged file makes of the parser
            flaw = _flaw(path / _METADATA, error)
        files = _bag_files(path)
        if not files:
            raise InputError(flaw)
    else:
        files, flaw = _bag_files(path) if path.is_dir() else [path], None
    parts = []
    for file in files:
        try:
            parts.append(_open_whole(file))
        except Exception as error:  # as above
            # The damage of a file says more than that of the folder's description.
            flaw = _flaw(file, error)
            parts.append(_salvage(file))
    if flaw and not any(part.reader.connections for part in parts):
        raise InputError(flaw)
    return Opened(sorted(parts, key=lambda part: part.reader.start_time), flaw)


class _Reader1(Reader1):
    """Keeps no index of topics that are of no use here: an IMU sends millions of messages."""

    def read_index_data(self, pos: int, indexes: dict[int, list[IndexData]]) -> None:
        """The entries of one topic in one chunk; of a useless topic one entry stands for all."""
        useful = {c.id for c in self.connections if c.msgtype in (*CLOUD_TYPES, *POSITION_TYPES)}
        found: dict[int, list[IndexData]] = defaultdict(list)
        super().read_index_data(pos, found)
        for number, entries in found.items():
            index = indexes[number]
            index += entries if number in useful else [(index or entries)[0]] * len(entries)


def _open_whole(path: Path) -> Part:
    is_ros1 = storage_suffix(path) == ".bag"
    reader = _Reader1(path) if is_ros1 else Reader2(path)
    reader.open()
    return Part(reader, is_ros1)


def _salvage(path: Path) -> Part:
    try:
        return Part(SalvageReader(path), storage_suffix(path) == ".bag")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from error


def _bag_files(directory: Path) -> list[Path]:
    return sorted(p for p in directory.iterdir() if storage_suffix(p) in _SUFFIXES and p.is_file())


def _is_split(files: list[Path]) -> bool:
    """Whether all are of one recording: a single file, or numbered from 0 on by the recorder."""
    names = {_NUMBER.sub("", file.stem) for file in files}
    return len(files) == 1 or (len(names) == 1 and any(f.stem.endswith("_0") for f in files))


def _flaw(path: Path, error: Exception) -> str:
    said = reason(error)
    if "Storage plugin ''" in said:
        return f"{path}: storage_identifier is blank, expected sqlite3 or mcap"
    return f"{path}: damaged or not closed by its recorder: {said}"
