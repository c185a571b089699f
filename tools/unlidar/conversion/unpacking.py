"""Decompression within the bounds of `limits`."""

import bz2
from collections.abc import Callable
from pathlib import Path
from typing import Any

import lz4.frame

from unlidar.limits import (
    ALWAYS_UNPACKED,
    MEGABYTE,
    MOST_RATIO,
    MOST_RECORD,
    TooLargeError,
)

try:
    from compression import zstd
except ImportError:  # before Python 3.14
    from backports import zstd

ZstdError = zstd.ZstdError
_STEP = 4 * MEGABYTE
_DECOMPRESSORS: dict[str, Callable[[], Any]] = {
    "bz2": bz2.BZ2Decompressor,
    "lz4": lz4.frame.LZ4FrameDecompressor,
    "zstd": zstd.ZstdDecompressor,
}


def unpacked(compression: str, packed: bytes | memoryview, most: int = MOST_RECORD) -> bytes:
    """Decompressed bytes, also of a truncated stream; TooLargeError beyond `most` bytes.

    Damaged data gives empty bytes. ValueError for an unknown compression.
    """
    if most > MOST_RECORD:
        raise TooLargeError("a chunk, unpacked,", most, MOST_RECORD)
    if compression not in _DECOMPRESSORS:
        raise ValueError(f"compression '{compression[:20]}', expected {', '.join(_DECOMPRESSORS)}")
    start, parts, left = _DECOMPRESSORS[compression], [], most
    try:
        while len(packed):  # several streams may be concatenated
            stream = start()
            parts.append(stream.decompress(packed, left + 1))
            left -= len(parts[-1])
            if left < 0:
                raise TooLargeError("a chunk, unpacked,", None, most)
            packed = (stream.unused_data or b"") if stream.eof else b""
    except (OSError, RuntimeError, EOFError, ZstdError):
        return b""
    return b"".join(parts)


def unpack_file(packed: Path, out: Path) -> None:
    """Decompresses a whole file of zstd; TooLargeError beyond the expansion bound."""
    most = max(ALWAYS_UNPACKED, MOST_RATIO * packed.stat().st_size)
    written = 0
    with zstd.open(packed, "rb") as source, out.open("wb") as file:
        while part := source.read(_STEP):
            written += len(part)
            if written > most:
                raise TooLargeError("it, unpacked,", None, most)
            file.write(part)
