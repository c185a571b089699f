"""Clouds out of messages, without copying more than the coordinates.

Rows that are no returns (not finite, or 0, 0, 0) are left out here.
"""

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from rosbags.typesys.store import Typestore

from unlidar.conversion.message_types import LIVOX_CLOUDS, known_types
from unlidar.errors import listed, reason
from unlidar.frames_io import is_return
from unlidar.point_times import TIME_FIELDS
from unlidar.stamps import NS_PER_S

POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
CLOUD_TYPES = (POINT_CLOUD, *LIVOX_CLOUDS)
# sensor_msgs/PointField.msg
_FIELD_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
_LIVOX_POINT = [
    ("offset_time", "u4"), ("x", "f4"), ("y", "f4"), ("z", "f4"),
    ("reflectivity", "u1"), ("tag", "u1"), ("line", "u1"),
]  # fmt: skip


@dataclass(frozen=True)
class Cloud:
    """The returns of one message."""

    header_ns: int
    frame_id: str
    xyz_m: np.ndarray  # (N, 3) float32
    times: np.ndarray | None = None  # (N,) as the driver writes them
    tag: np.ndarray | None = None  # (N,) uint8, Livox's noise and return number


@dataclass(frozen=True)
class Header:
    """A deserialised std_msgs/Header."""

    stamp_ns: int
    frame_id: str
    order: str  # byte order as in struct
    end: int  # where it ends in the message


def read_header(raw: bytes, is_ros1: bool) -> Header:
    """The header at the start of a serialised message; ValueError if it is truncated."""
    view = memoryview(raw)
    try:
        # ROS 1: sequence number. ROS 2: kind of encapsulation.
        order = "<" if is_ros1 or view[1] else ">"
        seconds, ns, length = struct.unpack_from(f"{order}3I", view, 4)
        name = bytes(view[16 : 16 + length])
    except (struct.error, IndexError) as error:
        raise ValueError(f"the message ends within its header: {reason(error)}") from error
    if len(name) < length:
        raise ValueError(f"the message ends within its header: {length} bytes of a frame_id")
    if not is_ros1 and seconds >= 1 << 31:  # seconds are an int32 in ROS 2
        seconds -= 1 << 32
    text = name.rstrip(b"\0").decode(errors="replace")
    return Header(seconds * NS_PER_S + ns, text, order, 16 + length)


def decode_cloud(raw: bytes, msgtype: str, store: Typestore, is_ros1: bool) -> Cloud:
    """The returns of a serialised PointCloud2 or CustomMsg; ValueError for others."""
    if msgtype != POINT_CLOUD:
        return _decode_livox(raw, msgtype, store, is_ros1)
    return _decode_point_cloud(deserialize(raw, msgtype, store, is_ros1))


def deserialize(raw: bytes, msgtype: str, store: Typestore, is_ros1: bool) -> Any:
    """The message as rosbags gives it; arrays are views of `raw`."""
    view = memoryview(raw)
    return (store.deserialize_ros1 if is_ros1 else store.deserialize_cdr)(view, msgtype)


def stamp_ns(message: Any) -> int:
    """The header stamp of a message in ns."""
    return header_ns(message.header)


def header_ns(header: Any) -> int:
    """The stamp of a std_msgs/Header in ns."""
    return int(header.stamp.sec) * NS_PER_S + int(header.stamp.nanosec)


def _decode_point_cloud(message: Any) -> Cloud:
    order = ">" if message.is_bigendian else "<"
    step, width, height = (int(v) for v in (message.point_step, message.width, message.height))
    row_step = max(int(message.row_step), width * step)  # some drivers leave it 0
    if height == 1:
        row_step = width * step
    needed = (height - 1) * row_step + width * step if width and height else 0
    if len(message.data) < needed:
        raise ValueError(
            f"{height} x {width} points of {step} bytes announced, only {len(message.data)} follow"
        )
    fields: dict[str, tuple[str, int]] = {}
    for field in message.fields:
        name, kind = field.name.lower(), _FIELD_TYPES.get(int(field.datatype))
        if name not in ("x", "y", "z", "tag", *TIME_FIELDS):
            continue
        if kind is None or field.offset + np.dtype(kind).itemsize > step:
            raise ValueError(
                f"field {field.name} has type {field.datatype} at byte {field.offset} of {step}"
            )
        fields[name] = (order + kind, int(field.offset))
    missing = [axis for axis in "xyz" if axis not in fields]
    if missing:
        names = listed(field.name for field in message.fields)
        raise ValueError(f"its fields are {names or 'none'}, expected x, y and z")
    if not needed:
        empty = np.zeros((0, 3), dtype=np.float32)
        return Cloud(stamp_ns(message), message.header.frame_id, empty)
    row = np.dtype(
        {
            "names": list(fields),
            "formats": [kind for kind, _ in fields.values()],
            "offsets": [offset for _, offset in fields.values()],
            "itemsize": step,
        }
    )
    rows = np.ndarray((height, width), row, message.data, strides=(row_step, step))
    return _returns(stamp_ns(message), message.header.frame_id, rows)


def _decode_livox(raw: bytes, msgtype: str, store: Typestore, is_ros1: bool) -> Cloud:
    """CustomMsg: header, timebase, point_num, lidar_id, rsvd[3], points.

    Parsed by hand: a Python object per point would be slower than real time.
    """
    package = msgtype.split("/")[0]
    for name in (msgtype, f"{package}/msg/CustomPoint"):
        if store.fielddefs[name][1] != known_types().fielddefs[name][1]:
            raise ValueError(f"the bag defines {name} otherwise than Livox's drivers")
    header = read_header(raw, is_ros1)
    # CDR counts its alignment from behind the four bytes of the encapsulation, and aligns structs.
    stride, start = (19, 0) if is_ros1 else (20, 4)
    at = header.end - start
    if not is_ros1:
        at = -(-at // 8) * 8
    at += 16  # timebase, point_num, lidar_id, rsvd
    view = memoryview(raw)[start:]
    try:
        (count,) = struct.unpack_from(f"{header.order}I", view, at)
    except struct.error as error:
        raise ValueError(f"the message ends before its points: {error}") from error
    at += 4
    if len(view) < at + count * stride - (stride - 19 if count else 0):
        raise ValueError(f"{count} points announced, only {len(view) - at} bytes follow")
    row = np.dtype([(name, header.order + kind) for name, kind in _LIVOX_POINT])
    rows = np.ndarray((1, count), row, view, at, strides=(0, stride))
    return _returns(header.stamp_ns, header.frame_id, rows)


def _returns(header_ns: int, frame_id: str, rows: np.ndarray) -> Cloud:
    xyz_m = np.empty((rows.size, 3), dtype=np.float32)
    with np.errstate(over="ignore"):  # coordinates beyond float32 become inf and are dropped
        for axis, name in enumerate("xyz"):
            xyz_m[:, axis] = rows[name].reshape(-1)
    kept = is_return(xyz_m)
    everything = bool(kept.all())

    def column(name: str) -> np.ndarray:
        values = rows[name].reshape(-1)
        values = values if everything else values[kept]
        return np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("="))

    names = rows.dtype.names or ()
    times = next((column(name) for name in TIME_FIELDS if name in names), None)
    is_livox = "tag" in names and rows.dtype["tag"] == np.uint8  # else no bit field
    tag = column("tag") if is_livox else None
    if not everything:
        xyz_m = xyz_m[kept]
    return Cloud(header_ns, frame_id, xyz_m, times, tag)
