"""Point packets of Livox LiDARs, both protocols: docs/livox.md has their layouts."""

import zlib
from calendar import timegm
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

EXPECTED = "packets of a Mid-360, Mid-360S, HAP, Avia, Avia 2, Mid-40, Mid-70, Horizon or Tele-15"

# By data type: rays per packet (None: in the header) and the little-endian layout of a ray.
_TAIL = [("reflectivity", "u1"), ("tag", "u1")]
_MM = [(axis, "<i4") for axis in "xyz"]
_CM = [(axis, "<i2") for axis in "xyz"]
_ANGLES = [("zenith", "<u2"), ("azimuth", "<u2")]
_DEPTH = [("depth", "<u4")]
_FIRST = {
    0: (100, np.dtype([*_MM, _TAIL[0]])),
    1: (100, np.dtype([*_DEPTH, *_ANGLES, _TAIL[0]])),
    2: (96, np.dtype([*_MM, *_TAIL])),
    3: (96, np.dtype([*_DEPTH, *_ANGLES, *_TAIL])),
    4: (48, np.dtype([("returns", [*_MM, *_TAIL], 2)])),
    5: (48, np.dtype([*_ANGLES, ("returns", [*_DEPTH, *_TAIL], 2)])),
    6: (1, None),  # accelerations
    7: (30, np.dtype([("returns", [*_MM, *_TAIL], 3)])),
    8: (30, np.dtype([*_ANGLES, ("returns", [*_DEPTH, *_TAIL], 3)])),
}
_SECOND = {
    0: None,  # accelerations
    1: np.dtype([*_MM, *_TAIL]),
    2: np.dtype([*_CM, *_TAIL]),
    3: np.dtype([*_DEPTH, *_ANGLES, *_TAIL]),
    17: np.dtype([("returns", [*_MM, *_TAIL], 2)]),
}
HEAD_FIRST, _HEAD_SECOND = 18, 36
_ACCELERATIONS = 24  # bytes of an acceleration packet
_CHECKED = 28  # protocol 2: offset from which the checksum is computed
_SURELY_NOISE, _LOW_CONFIDENCE = 1, 2  # tags of the two protocols
_MAX_STAMP_NS = 4 * 10**18


class _Read(NamedTuple):
    """A packet with undecoded points."""

    rows: np.ndarray  # (rays,)
    worst_tag: int
    part: str
    counter: int | None
    synchronised: bool
    stamp_ns: int
    span_ns: int | None


@dataclass(frozen=True)
class Packet:
    """The measurements of consecutive rays of a sensor."""

    part: str  # of a hub's LiDARs, else empty
    counter: int | None  # of packets, modulo 2**16; protocol 1 has none
    synchronised: bool  # False: the clock counts from power-on
    stamp_ns: int  # of the first ray
    span_ns: int | None  # from first to last ray; None in protocol 1
    rays: int
    ray: np.ndarray  # (N,) ray index of each point
    xyz_m: np.ndarray  # (N, 3), zeros where nothing came back
    noise_points: int  # number removed by tag


def parse(payload: bytes) -> Packet | None:
    """The packet of a payload; None for other payloads, and for accelerations."""
    read = _read(payload)
    return None if read is None else _packet(read)


def holds_points(payload: bytes) -> bool:
    """True if header and length are those of a point packet; much faster than parse()."""
    return _read(payload) is not None


def _read(payload: bytes) -> _Read | None:
    try:
        if payload[:1] == b"\5":
            return _first(payload)
        return _second(payload) if payload[:1] == b"\0" else None
    except ValueError:
        return None


def length_first(head: bytes) -> int | None:
    """Total length in bytes of a protocol 1 packet with this header; None if it is none."""
    if head[0] != 5 or head[9] not in _FIRST:
        return None
    rays, dtype = _FIRST[head[9]]
    return HEAD_FIRST + (_ACCELERATIONS if dtype is None else rays * dtype.itemsize)


def _first(payload: bytes) -> _Read | None:
    if len(payload) < HEAD_FIRST or payload[9] not in _FIRST:
        return None
    rays, dtype = _FIRST[payload[9]]
    if dtype is None or len(payload) != HEAD_FIRST + rays * dtype.itemsize:
        return None
    stamp = int.from_bytes(payload[10:18], "little")
    if payload[8] == 3:
        year, month, day, hour = payload[10:14]
        stamp_us = int.from_bytes(payload[14:18], "little")
        if not (1 <= month <= 12 and 1 <= day <= 31 and hour < 24 and year < 96):
            return None
        stamp = (timegm((2000 + year, month, day, hour, 0, 0)) * 10**6 + stamp_us) * 1000
    elif payload[8] not in (0, 1):
        return None
    slot, lidar = payload[1], payload[2]
    part = f"-{slot}-{lidar}" if slot > 1 or lidar > 1 else ""
    rows = np.frombuffer(payload, dtype, offset=HEAD_FIRST)
    return _Read(rows, _SURELY_NOISE, part, None, payload[8] != 0, stamp, None)


def _second(payload: bytes) -> _Read | None:
    if len(payload) < _HEAD_SECOND:
        return None
    length, interval, rays, counter = np.frombuffer(payload, "<u2", 4, offset=1).tolist()
    dtype = _SECOND.get(payload[10])
    if dtype is None or payload[11] > 2:
        return None
    if not len(payload) == length == _HEAD_SECOND + rays * dtype.itemsize or rays == 0:
        return None
    told = int.from_bytes(payload[24:28], "little")
    if told not in (0, zlib.crc32(payload[_CHECKED:])):
        return None
    stamp = int.from_bytes(payload[28:36], "little")
    rows = np.frombuffer(payload, dtype, offset=_HEAD_SECOND)
    return _Read(rows, _LOW_CONFIDENCE, "", counter, payload[11] != 0, stamp, interval * 100)


def _packet(read: _Read) -> Packet | None:
    if read.stamp_ns > _MAX_STAMP_NS:
        return None
    rows = read.rows
    names = rows.dtype.names or ()
    returns = rows["returns"] if "returns" in names else rows[:, None]
    xyz_m = _positions(rows, returns)
    if xyz_m is None:
        return None
    kept = np.ones(returns.shape, bool)
    if "tag" in (returns.dtype.names or ()):
        tag = returns["tag"]
        kept = ((tag & 3) != read.worst_tag) & ((tag >> 2 & 3) != read.worst_tag)
    ray = np.broadcast_to(np.arange(len(rows))[:, None], kept.shape)
    noise = int(kept.size - kept.sum())
    return Packet(
        read.part,
        read.counter,
        read.synchronised,
        read.stamp_ns,
        read.span_ns,
        len(rows),
        ray[kept],
        xyz_m[kept],
        noise,
    )


def _positions(rows: np.ndarray, returns: np.ndarray) -> np.ndarray | None:
    """(rays, returns of a ray, 3) in m; None for invalid angles."""
    if "x" in (returns.dtype.names or ()):
        scale_m = 1e-3 if returns.dtype["x"].itemsize == 4 else 1e-2
        return np.stack([returns[axis] * scale_m for axis in "xyz"], axis=-1)
    if rows["zenith"].max() > 18000 or rows["azimuth"].max() > 36000:
        return None
    depth_m = returns["depth"] * 1e-3
    zenith = np.radians(rows["zenith"] * 0.01)[:, None]
    azimuth = np.radians(rows["azimuth"] * 0.01)[:, None]
    across_m = depth_m * np.sin(zenith)
    return np.stack(
        [across_m * np.cos(azimuth), across_m * np.sin(azimuth), depth_m * np.cos(zenith)], axis=-1
    )


def parse_points(
    points: bytes, data_type: int, counter: int, synchronised: bool, stamp_ns: int
) -> Packet | None:
    """The points of a protocol 2 packet with a foreign header; None as for parse()."""
    dtype = _SECOND.get(data_type)
    if dtype is None or not points or len(points) % dtype.itemsize:
        return None
    rows = np.frombuffer(points, dtype)
    return _packet(_Read(rows, _LOW_CONFIDENCE, "", counter, synchronised, stamp_ns, None))


def name_of(address: str, packet: Packet) -> str:
    """The name of a packet's sensor, as the program has it: 192-168-1-12."""
    return address.replace(".", "-") + packet.part
