"""Size limits on untrusted input, and bounded reading.

A file may declare any size, be sparse or decompress to a thousand times its size. Nothing is read
or decompressed whole before its size is known to be within the limit.
"""

import io
import stat
from pathlib import Path
from typing import Any

from unlidar.errors import InputError, reason

MEGABYTE = 1 << 20
MOST_RECORD = 256 * MEGABYTE  # of a message or a chunk of a recording, packed or not
MOST_FRAME = 256 * MEGABYTE  # of the file of one frame
MOST_TABLE = 256 * MEGABYTE  # of a trajectory, a truth or another table
MOST_TEXT = 16 * MEGABYTE  # of a description: YAML, JSON, a list of times
MOST_LINE = 64 * 1024  # characters of a line of a table
MOST_HEADER = 64 * 1024  # bytes of the header of a frame
MOST_TRACE, MOST_TRACE_LINE = 16384 * MEGABYTE, 16 * MEGABYTE  # of an hour, and of one frame in it
MOST_STATIONS = 64  # in one picture
MOST_YAML_NODES = 1_000_000  # nodes of a YAML file with aliases expanded
# Largest expansion of a recording compressed as a whole file, and the size that is always allowed.
MOST_RATIO, ALWAYS_UNPACKED = 200, 1024 * MEGABYTE


class TooLargeError(ValueError):
    """Input beyond a size limit; the message has both sizes."""

    def __init__(self, what: str, size: int | None, most: int) -> None:
        found = "more" if size is None else f"{size:,} bytes"
        super().__init__(f"{what} has {found}, expected at most {most:,}")


class BoundedFile(io.BufferedReader):
    """A file whose reads are limited to `MOST_RECORD` bytes, whatever length fields declare."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))

    def read(self, size: int | None = -1, /) -> bytes:
        """Reads; TooLargeError beyond `MOST_RECORD` bytes."""
        if size is None or size < 0:
            data = super().read(MOST_RECORD + 1)
            if len(data) > MOST_RECORD:
                raise TooLargeError("the rest of the file", None, MOST_RECORD)
            return data
        if size > MOST_RECORD:
            raise TooLargeError("a record", size, MOST_RECORD)
        return super().read(size)

    def readline(self, size: int | None = -1, /) -> bytes:
        """Reads a line of at most `MOST_LINE` bytes."""
        return super().readline(MOST_LINE if size is None or size < 0 else min(size, MOST_LINE))


class BoundedPath(type(Path())):
    """A path for libraries that open files themselves; opens bounded files."""

    def open(self, mode: str = "r", *arguments: Any, **options: Any) -> Any:
        """A BoundedFile, or a text of at most `MOST_TEXT` bytes."""
        if "b" in mode:
            return BoundedFile(Path(self))
        _check_size(Path(self), MOST_TEXT)
        return super().open(mode, *arguments, **options)


def read_limited(path: Path, most: int) -> bytes:
    """The whole file; ValueError beyond `most` bytes, OSError if it cannot be read."""
    _check_size(path, most)
    with path.open("rb") as file:
        data = file.read(most + 1)
    if len(data) > most:  # a pipe, or a growing file
        raise TooLargeError("it", None, most)
    return data


def read_text(path: Path, most: int = MOST_TEXT) -> str:
    """As `read_limited`, as text in UTF-8, with or without a byte order mark."""
    return read_limited(path, most).decode("utf-8-sig")


def require_file(path: Path) -> None:
    """ValueError unless it is a regular file: opening a pipe blocks until it has a writer."""
    if not stat.S_ISREG(path.stat().st_mode):
        raise ValueError("it is a pipe, a device or a folder, expected a file")


def check_frame_size(path: Path) -> None:
    """InputError if it is no regular file, or too large for one frame."""
    try:
        require_file(path)
        _check_size(path, MOST_FRAME)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: no frame: {reason(error)}") from error


def load_yaml(path: Path) -> Any:
    """The content of a YAML file; ValueError, YAMLError, RecursionError or OSError if unreadable.

    Nodes are counted with aliases expanded before construction; merge keys are refused.
    """
    # Imported here, so that commands without YAML need not load it.
    from ruamel.yaml import YAML

    yaml = YAML(typ="safe", pure=True)
    node = yaml.compose(read_text(path))
    if node is None:
        return None
    _check_yaml(node)
    return yaml.constructor.construct_document(node)


def _check_yaml(root: Any) -> None:
    """ValueError for alias expansion beyond the limit, recursive aliases, and merge keys."""
    sizes: dict[int, int] = {}

    def size_of(node: Any) -> int:
        if not isinstance(node.value, list):
            if node.tag == "tag:yaml.org,2002:merge":
                raise ValueError("'<<' merges keys, expected each key with its own value")
            return 1
        if id(node) not in sizes:
            sizes[id(node)] = MOST_YAML_NODES  # marks a recursive alias as too large
            pairs = (part if isinstance(part, tuple) else (part,) for part in node.value)
            sizes[id(node)] = 1 + sum(size_of(inner) for pair in pairs for inner in pair)
        return sizes[id(node)]

    if size_of(root) > MOST_YAML_NODES:
        raise ValueError(f"its aliases repeat too much, expected at most {MOST_YAML_NODES:,} nodes")


def _check_size(path: Path, most: int) -> None:
    size = path.stat().st_size
    if size > most:
        raise TooLargeError("it", size, most)
