"""Files of Livox Viewer 2: blocks of packets, each with a header of its own."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from unlidar_tools import livox
from unlidar_tools.errors import InputError, reason
from unlidar_tools.names import folder_names
from unlidar_tools.printable import printable

_HEAD = struct.Struct("<16s4sIIB")  # signature, version, magic, duration of a block, LiDARs
_SIGNATURE, _MAJOR, _MAGIC = b"livox_tech", 2, 0xAC0EA767
_LIDAR = struct.Struct("<16s16sIBBB6f")  # serial number, that of a hub, id, types, pose
_BLOCK = struct.Struct("<QQQ")  # where it begins, where the next one begins, its number
_PACKET = struct.Struct("<BIBBQHBIB4x")  # version, id, types, time, counter, type, length, frame
_MOST = 1 << 16  # bytes of a packet's points


def lvx2_packets(path: Path) -> Iterator[tuple[str, livox.Packet]]:
    """Name of the LiDAR and packet, in the order of the file; InputError where it is broken."""
    try:
        with path.open("rb") as file:
            names = _lidars(path, file)
            begin, end = file.tell(), path.stat().st_size
            while begin < end:
                at, after, _ = _read(path, file, _BLOCK)
                if at != begin or not begin < (after or end) <= end:
                    raise InputError(f"{path}: at byte {begin}: expected the begin of a block")
                begin = after or end  # the last one has no next
                while file.tell() < begin:
                    packet = _packet(path, file, names)
                    if packet is not None:
                        yield packet
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from error


def _lidars(path: Path, file: BinaryIO) -> dict[int, str]:
    signature, version, magic, _, count = _read(path, file, _HEAD)
    if (signature.rstrip(b"\0"), version[0], magic) != (_SIGNATURE, _MAJOR, _MAGIC):
        raise InputError(
            f"{path}: begins with '{printable(signature.decode('latin-1'))}', version "
            f"{version[0]}, expected 'livox_tech', version 2"
        )
    lidars = [_read(path, file, _LIDAR) for _ in range(count)]
    serials = (row[0].rstrip(b"\0").decode("ascii", "replace") for row in lidars)
    return dict(zip((row[2] for row in lidars), folder_names(serials), strict=True))


def _packet(path: Path, file: BinaryIO, names: dict[int, str]) -> tuple[str, livox.Packet] | None:
    at = file.tell()
    _, lidar, _, clock, stamp_ns, counter, kind, length, _ = _read(path, file, _PACKET)
    if lidar not in names or length > _MOST:
        raise InputError(f"{path}: at byte {at}: expected a packet of {', '.join(names.values())}")
    points = file.read(length)
    if len(points) < length:
        raise InputError(f"{path}: ends within a packet")
    packet = livox.parse_points(points, kind, counter, clock != 0, stamp_ns)
    return None if packet is None else (names[lidar], packet)


def _read(path: Path, file: BinaryIO, layout: struct.Struct) -> tuple:
    data = file.read(layout.size)
    if len(data) < layout.size:
        raise InputError(f"{path}: ends after {file.tell()} bytes, within a header")
    return layout.unpack(data)
