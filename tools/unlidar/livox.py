"""Point packets of Livox LiDARs, both protocols: docs/livox.md has their layouts."""

import zlib
from calendar import timegm
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

EXPECTED = "packets of a Mid-360, Mid-360S, HAP, Avia, Avia 2, Mid-40, Mid-70, Horizon or Tele-15"

# By data type: rays per packet (None: in the header) and the little-endian layout of a ray.
_TAIL = [("reflectivity", "u1"), ("tag", "u1")]
_MM = [("xyz", "<i4", 3)]
_CM = [("xyz", "<i2", 3)]
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


class Points(NamedTuple):
    """The returns of a packet."""

    ray: np.ndarray  # (N,) index of the ray
    xyz_m: np.ndarray  # (N, 3), zeros where nothing came back
    noise: int  # number removed by tag


@dataclass(frozen=True)
class Packet:
    """The measurements of consecutive rays of a sensor."""

    rows: np.ndarray  # (rays,)
    worst_tag: int
    part: str  # of a hub's LiDARs, else empty
    counter: int | None  # of packets, modulo 2**16; protocol 1 has none
    synchronised: bool  # False: the clock counts from power-on
    stamp_ns: int  # of the first ray
    span_ns: int | None  # from first to last ray; None in protocol 1

    def points(self) -> Points:
        """Decodes the returns, which takes ten times as long as the header."""
        rows = self.rows
        returns = rows["returns"] if "returns" in _names(rows) else rows[:, None]
        xyz_m = _positions(rows, returns)
        kept = np.ones(returns.shape, bool)
        if "tag" in _names(returns):
            tag = returns["tag"]
            kept = ((tag & 3) != self.worst_tag) & ((tag >> 2 & 3) != self.worst_tag)
        ray = np.broadcast_to(np.arange(len(rows))[:, None], kept.shape)
        return Points(ray[kept], xyz_m[kept], int(kept.size - kept.sum()))


def parse(payload: bytes) -> Packet | None:
    """The packet of a payload; None for other payloads, and for accelerations."""
    return _possible(_read(payload))


def holds_points(payload: bytes) -> bool:
    """True if header and length are those of a point packet, whatever its time and its angles."""
    return _read(payload) is not None


def _read(payload: bytes) -> Packet | None:
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


def _first(payload: bytes) -> Packet | None:
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
    return Packet(rows, _SURELY_NOISE, part, None, payload[8] != 0, stamp, None)


def _second(payload: bytes) -> Packet | None:
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
    return Packet(rows, _LOW_CONFIDENCE, "", counter, payload[11] != 0, stamp, interval * 100)


def _possible(packet: Packet | None) -> Packet | None:
    """None for a time or angles that no sensor tells."""
    if packet is None or packet.stamp_ns > _MAX_STAMP_NS:
        return None
    rows = packet.rows
    if "zenith" in _names(rows) and (rows["zenith"].max() > 18000 or rows["azimuth"].max() > 36000):
        return None
    return packet


def _names(rows: np.ndarray) -> tuple[str, ...]:
    return rows.dtype.names or ()


def _positions(rows: np.ndarray, returns: np.ndarray) -> np.ndarray:
    """(rays, returns of a ray, 3) in m."""
    if "xyz" in _names(returns):
        return returns["xyz"] * (1e-3 if returns.dtype["xyz"].base.itemsize == 4 else 1e-2)
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
    return _possible(Packet(rows, _LOW_CONFIDENCE, "", counter, synchronised, stamp_ns, None))


def name_of(address: str, packet: Packet) -> str:
    """The name of a packet's sensor, as the program has it: 192-168-1-12."""
    return address.replace(".", "-") + packet.part
