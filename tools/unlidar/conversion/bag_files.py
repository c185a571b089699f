"""Opening of ROS recordings: single files, folders of ROS 2, folders of split bags."""

import re
from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Protocol

from rosbags.interfaces import Connection

from unlidar.conversion.bag_readers import Reader1, Reader2
from unlidar.conversion.mcap import scan_mcap
from unlidar.conversion.scans import (
    DAMAGE,
    RawMessage,
    Scan,
    ScanReader,
    scan_rosbag1,
    scan_sqlite,
    storage_suffix,
    write_ahead_log,
)
from unlidar.conversion.unpacking import ZstdError, unpack_file
from unlidar.errors import InputError, reason

_SUFFIXES = (".bag", ".db3", ".mcap")
_METADATA = "metadata.yaml"
_PACKED = ".zstd"  # suffix of files that the recorder compressed as a whole
_SCANS: dict[str, Scan] = {".bag": scan_rosbag1, ".mcap": scan_mcap, ".db3": scan_sqlite}
# The date and number that recorders append to the file names of a split bag.
_NUMBER = re.compile(r"(_?\d{4}(-\d\d){5})?(_\d+)?$")


class Reader(Protocol):
    """Reads one file, or a folder of ROS 2."""

    connections: list[Connection]
    start_time: int
    end_time: int

    def spans_ns(self) -> dict[str, tuple[int, int]]:
        """Log times of the first and the last message by topic, without reading messages."""
        ...

    def messages(
        self, connections: Collection[Connection], start: int | None, stop: int | None
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """The messages of the connections with log times in [start, stop)."""
        ...

    def close(self) -> None:
        """Closes the file."""
        ...


@dataclass(frozen=True)
class Opened:
    """The readers of all files in order of time, their damage, and notes for the user."""

    parts: list[Reader]
    flaw: str | None
    notes: list[str] = field(default_factory=list)
    scratch: TemporaryDirectory | None = None  # holds decompressed files

    def close(self) -> None:
        """Closes the files."""
        for part in self.parts:
            part.close()
        if self.scratch is not None:
            self.scratch.cleanup()


def is_bag(path: Path) -> bool:
    """True if it is a file of ROS or a folder that holds some."""
    if path.is_dir():
        return (path / _METADATA).is_file() or _is_split(_bag_files(path))
    return storage_suffix(path) in _SUFFIXES


def open_bag(path: Path) -> Opened:
    """Opens a recording, or what is readable of a damaged one. InputError if nothing is."""
    files, flaw = _bag_files(path) if path.is_dir() else [path], None
    scratch = None
    if path.is_dir() and (packed := sorted(path.glob(f"*{_PACKED}"))):
        scratch = TemporaryDirectory(prefix="unlidar-")
        files = [_unpacked(file, Path(scratch.name)) for file in packed]
    elif path.is_dir() and (path / _METADATA).is_file() and not any(map(_is_to_be_scanned, files)):
        try:
            return Opened([_opened(Reader2(path))], None)
        except Exception as error:  # damaged files raise anything in the parser
            flaw = _flaw(path / _METADATA, error)
        if not files:
            raise InputError(flaw)
    parts: list[Reader] = []
    for file in files:
        try:
            parts.append(_open_whole(file))
        except Exception as error:  # as above
            # A file's damage is more informative than that of metadata.yaml.
            flaw = _flaw(file, error)
            parts.append(_salvage(file))
    if flaw and not any(part.connections for part in parts):
        raise InputError(flaw)
    logs = [log for file in files if (log := write_ahead_log(file))]
    notes = [
        f"{log}: rows that were not yet worked into the database are read, too" for log in logs
    ]
    return Opened(sorted(parts, key=lambda part: part.start_time), flaw, notes, scratch)


def _open_whole(path: Path) -> Reader:
    if _is_to_be_scanned(path):
        return ScanReader(path, scan_sqlite)
    match storage_suffix(path):
        case ".bag":
            return _opened(Reader1(path))
        case ".mcap":
            try:
                return _opened(Reader2(path))
            except Exception:  # damaged, or unknown to rosbags: ROS 1 in MCAP, unordered
                return ScanReader(path, scan_mcap)
    return _opened(Reader2(path))


def _is_to_be_scanned(path: Path) -> bool:
    """True if rosbags would miss rows in a write-ahead log or misread the file name as a URI."""
    odd = any(sign in str(path) for sign in "%?#")
    return path.suffix == ".db3" and (odd or write_ahead_log(path) is not None)


def _opened(reader: Reader1 | Reader2) -> Reader:
    reader.open()
    return reader


def _salvage(path: Path) -> Reader:
    """Scans a damaged file up to the damage."""
    scan = _SCANS[storage_suffix(path)]

    def up_to_damage(path: Path) -> Iterator[Connection | RawMessage]:
        with suppress(*DAMAGE):
            yield from scan(path)

    try:
        return ScanReader(path, up_to_damage)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from error


def _unpacked(packed: Path, folder: Path) -> Path:
    """Decompresses a file that was compressed as a whole."""
    file = folder / packed.stem
    try:
        unpack_file(packed, file)
    except (OSError, ValueError, EOFError, ZstdError) as error:
        raise InputError(f"{packed}: cannot be unpacked: {reason(error)}") from error
    return file


def _bag_files(directory: Path) -> list[Path]:
    return sorted(p for p in directory.iterdir() if storage_suffix(p) in _SUFFIXES and p.is_file())


def _is_split(files: list[Path]) -> bool:
    """True for a single file, or files that the recorder numbered from 0 on."""
    names = {_NUMBER.sub("", file.stem) for file in files}
    return len(files) == 1 or (len(names) == 1 and any(f.stem.endswith("_0") for f in files))


def _flaw(path: Path, error: Exception) -> str:
    said = reason(error)
    if "Storage plugin ''" in said:
        return f"{path}: storage_identifier is blank, expected sqlite3 or mcap"
    return f"{path}: damaged or not closed by its recorder: {said}"
