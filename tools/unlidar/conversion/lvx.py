"""Files of Livox Viewer: the LiDARs, then blocks of packets. docs/livox.md has the layouts."""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from scipy.spatial.transform import Rotation

from unlidar import livox
from unlidar.errors import InputError, listed, reason
from unlidar.names import folder_names
from unlidar.sanitize import printable
from unlidar.station import Pose

_HEAD = struct.Struct("<16s4sI")  # signature, version, magic
_SIGNATURE, _MAGIC = b"livox_tech", 0xAC0EA767
_MOST = 1 << 16  # bytes of points per packet
# In a .lvx2 packets have a header of this file: version, LiDAR, its type, type of the time, time,
# counter, type of the points, their length, frame. In a .lvx it is that of protocol 1.
_PACKET2 = struct.Struct("<BIBBQHBIB4x")


@dataclass(frozen=True)
class Lidar:
    """One of the LiDARs of a file."""

    name: str  # its serial number
    pose: Pose
    is_pose_off: bool  # the file has a pose but marks it as unused


@dataclass(frozen=True)
class _Layout:
    """Structures of one version of the format."""

    head: struct.Struct  # the last value is the number of LiDARs
    lidar: struct.Struct  # serial number, that of a hub, key, ..., pose
    tells_use: bool  # the value before the pose is its flag
    block: struct.Struct  # offsets of this block and the next, ...
    packet: Callable[[Path, BinaryIO], tuple[int, livox.Packet | None]]


def lidars(path: Path) -> list[Lidar]:
    """The LiDARs of a file; InputError if it is not of this format."""
    try:
        with path.open("rb") as file:
            return list(_lidars(path, file, _layout(path, file)).values())
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from error


def packets(path: Path) -> Iterator[tuple[str, livox.Packet]]:
    """(LiDAR name, packet) in the order of the file; InputError at damage."""
    try:
        with path.open("rb") as file:
            layout = _layout(path, file)
            known = _lidars(path, file, layout)
            begin, end = file.tell(), path.stat().st_size
            while begin < end:
                at, after, *_ = _read(path, file, layout.block)
                if at != begin or not begin < (after or end) <= end:
                    raise InputError(f"{path}: at byte {begin}: expected the begin of a block")
                begin = after or end  # the last block may have no successor
                while file.tell() < begin:
                    at = file.tell()
                    lidar, packet = layout.packet(path, file)
                    if lidar not in known:
                        names = listed(one.name for one in known.values())
                        raise InputError(f"{path}: at byte {at}: expected a packet of {names}")
                    if packet is not None:
                        yield known[lidar].name, packet
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from error


def _layout(path: Path, file: BinaryIO) -> _Layout:
    signature, version, magic = _read(path, file, _HEAD)
    signature = signature.rstrip(b"\0")
    layout = _LAYOUTS.get(tuple(version[:2])) or _LAYOUTS.get((version[0],))
    if signature != _SIGNATURE or magic != _MAGIC or layout is None:
        raise InputError(
            f"{path}: begins with '{printable(signature.decode('latin-1'))}', version "
            f"{version[0]}.{version[1]}, expected 'livox_tech', version 1.0, 1.1 or 2"
        )
    return layout


def _lidars(path: Path, file: BinaryIO, layout: _Layout) -> dict[int, Lidar]:
    count = _read(path, file, layout.head)[-1]
    rows = [_read(path, file, layout.lidar) for _ in range(count)]
    names = folder_names(row[0].rstrip(b"\0").decode("ascii", "replace") for row in rows)
    found = {}
    for name, row in zip(names, rows, strict=True):
        pose = _pose(path, name, row[-6:])
        is_off = layout.tells_use and row[-7] == 0
        found[row[2]] = Lidar(name, Pose() if is_off else pose, is_off and pose != Pose())
    return found


def _pose(path: Path, name: str, values: tuple[float, ...]) -> Pose:
    """The pose from roll, pitch, yaw in degrees (fixed axes, in this order) and metres."""
    if not np.isfinite(values).all():
        raise InputError(f"{path}: pose {values} of {name}, expected finite numbers")
    if not any(values):
        return Pose()
    rotation = Rotation.from_euler("xyz", values[:3], degrees=True).as_quat()
    x, y, z, w = (float(v) for v in rotation)
    return Pose((values[3], values[4], values[5]), (x, y, z, w))


def _packet1(path: Path, file: BinaryIO) -> tuple[int, livox.Packet | None]:
    at = file.tell()
    (lidar,) = _bytes(path, file, 1)
    head = _bytes(path, file, livox.HEAD_FIRST)
    length = livox.length_first(head)
    if length is None:
        raise InputError(f"{path}: at byte {at}: expected a packet with points of a known type")
    return lidar, livox.parse(head + _bytes(path, file, length - len(head)))


def _packet2(path: Path, file: BinaryIO) -> tuple[int, livox.Packet | None]:
    at = file.tell()
    _, lidar, _, clock, stamp_ns, counter, kind, length, _ = _read(path, file, _PACKET2)
    if length > _MOST:
        raise InputError(f"{path}: at byte {at}: expected a packet of at most {_MOST} bytes")
    points = _bytes(path, file, length)
    return lidar, livox.parse_points(points, kind, counter, clock != 0, stamp_ns)


def _read(path: Path, file: BinaryIO, layout: struct.Struct) -> tuple:
    return layout.unpack(_bytes(path, file, layout.size))


def _bytes(path: Path, file: BinaryIO, size: int) -> bytes:
    data = file.read(size)
    if len(data) < size:
        raise InputError(f"{path}: ends after {file.tell()} bytes, within a header or a packet")
    return data


_LAYOUTS: dict[tuple[int, ...], _Layout] = {
    (1, 0): _Layout(
        head=struct.Struct("<B"),
        lidar=struct.Struct("<16s16sBB6f"),
        tells_use=False,
        block=struct.Struct("<QQQQ"),
        packet=_packet1,
    ),
    (1, 1): _Layout(
        head=struct.Struct("<IB"),  # duration of a block in ms, LiDARs
        lidar=struct.Struct("<16s16sBBB6f"),
        tells_use=True,
        block=struct.Struct("<QQQ"),
        packet=_packet1,
    ),
    (2,): _Layout(
        head=struct.Struct("<IB"),
        lidar=struct.Struct("<16s16sIBBB6f"),
        tells_use=True,
        block=struct.Struct("<QQQ"),
        packet=_packet2,
    ),
}
