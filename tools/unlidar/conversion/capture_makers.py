"""Detection of the LiDAR maker of a capture by its first packet of points."""

import struct
from collections.abc import Callable
from pathlib import Path

from unlidar import livox
from unlidar.capture import datagrams, is_capture
from unlidar.errors import InputError, UsageError

_LOOKED_AT = 10_000  # datagrams
_VELODYNE_BYTES = 1206  # 12 blocks, time, return mode, model
_VELODYNE_BLOCKS = (b"\xff\xee", b"\xff\xdd")  # block headers of upper and lower lasers
_HESAI_BEGIN = b"\xee\xff"
_OUSTER_COLUMNS = 16  # per packet, each with its measurement id
# Bytes of packet header and footer by layout; the legacy layout has neither.
_OUSTER_HEADS = (32, 0)
_OUSTER_NUMBER_AT = 8  # offset of the measurement id in a column, after its time
_OUSTER_LEAST_COLUMN = 12 + 16 * 4  # bytes of a column with the smallest layout and 16 beams


def is_velodyne(payload: bytes) -> bool:
    """True if it has the form of a Velodyne's points."""
    return len(payload) == _VELODYNE_BYTES and payload[:2] in _VELODYNE_BLOCKS


def is_ouster(payload: bytes) -> bool:
    """True if the measurement ids are consecutive in one of the layouts."""
    return any(_has_columns(payload, head) for head in _OUSTER_HEADS)


def is_hesai(payload: bytes) -> bool:
    """True for the header of Hesai's point packets; the oldest models have none."""
    return payload[:2] == _HESAI_BEGIN


_MAKERS: dict[str, Callable[[bytes], bool]] = {
    "Velodyne": is_velodyne,
    "Ouster": is_ouster,
    "Hesai": is_hesai,
    "Livox": lambda payload: livox.parse(payload) is not None,
}


def maker_of(path: Path) -> str | None:
    """The maker; None if `path` is no capture or holds no point packets of a known maker."""
    if not is_capture(path):
        return None
    try:
        for _, datagram in zip(range(_LOOKED_AT), datagrams(path), strict=False):
            for maker, is_points in _MAKERS.items():
                if is_points(datagram.payload):
                    return maker
    except (InputError, UsageError):  # reported when the capture is opened
        pass
    return None


def _has_columns(payload: bytes, head: int) -> bool:
    stride, rest = divmod(len(payload) - 2 * head, _OUSTER_COLUMNS)
    if rest or stride < _OUSTER_LEAST_COLUMN:
        return False
    begin = head + _OUSTER_NUMBER_AT
    numbers = [
        struct.unpack_from("<H", payload, begin + column * stride)[0]
        for column in range(_OUSTER_COLUMNS)
    ]
    return numbers == list(range(numbers[0], numbers[0] + _OUSTER_COLUMNS))
