"""A Livox LiDAR of the tests' own, written from the vendor's description of the protocols."""

from __future__ import annotations

import os
import select
import socket
import struct
import time
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from live_program import PATIENCE_S, Live
from numpy.typing import NDArray
from synthetic import Flight, write_pcd

FRAME_NS = 100_000_000
BEGIN_NS = 1_706_300_000_100_000_000  # a multiple of it
RAY_NS = 50_000
RAYS = 96  # in a packet


@dataclass(frozen=True)
class Packet:
    """The measurements of consecutive rays of a sensor."""

    number: int
    stamp_ns: int  # of the first ray
    units: NDArray[np.int64]  # (N, 3) in `unit_m`, zeros where nothing came back
    unit_m: float

    @property
    def xyz_m(self) -> NDArray[np.float32]:
        return (self.units * self.unit_m).astype(np.float32)


def sweep(flight: Flight, unit_m: float = 1e-3) -> list[Packet]:
    """The returns of a flight, each on the first free ray after its time."""
    rays = -(-len(flight.clouds) * FRAME_NS // RAY_NS // RAYS) * RAYS
    units = np.zeros((rays, 3), np.int64)
    free = 0
    for k, (cloud, times_s) in enumerate(zip(flight.clouds, flight.times_s, strict=True)):
        for row in np.argsort(times_s):
            free = max(free, int((k * FRAME_NS + times_s[row] * 1e9) // RAY_NS))
            if free < rays:
                units[free] = np.rint(cloud[row] / unit_m)
            free += 1
    return [
        Packet(n, BEGIN_NS + n * RAYS * RAY_NS, units[n * RAYS : (n + 1) * RAYS], unit_m)
        for n in range(rays // RAYS)
    ]


def write_as_frames(directory: Path, packets: Iterable[Packet]) -> Path:
    """The frames that the packets of each tenth of a second make."""
    directory.mkdir(parents=True)
    frames: dict[int, list[Packet]] = {}
    for packet in packets:
        frames.setdefault(packet.stamp_ns // FRAME_NS, []).append(packet)
    for index, parts in frames.items():
        stamp_ns = index * FRAME_NS
        ray_ns = np.arange(RAYS) * RAY_NS
        times_ns = np.concatenate([p.stamp_ns - stamp_ns + ray_ns for p in parts])
        points = np.concatenate([p.xyz_m for p in parts])
        write_pcd(directory / f"{stamp_ns}.pcd", points, t=times_ns.astype(np.uint32))
    return directory


# --- protocol 2: Mid-360, HAP -----------------------------------------------------------------

CARTESIAN_MM, CARTESIAN_CM, SPHERICAL = 1, 2, 3


def spherical(units: NDArray[np.int64], unit_m: float) -> NDArray[np.int64]:
    """(N, 3) depth in mm, zenith and azimuth in hundredths of a degree."""
    x, y, z = (units * unit_m).T
    depth_m = np.sqrt(x * x + y * y + z * z)
    zenith = np.degrees(np.arccos(np.divide(z, depth_m, out=np.ones_like(z), where=depth_m > 0)))
    azimuth = np.degrees(np.arctan2(y, x)) % 360
    return np.rint(np.stack([depth_m * 1e3, zenith * 100, azimuth * 100], axis=1)).astype(np.int64)


def protocol2(
    packet: Packet,
    data_type: int = CARTESIAN_MM,
    *,
    counter: int | None = None,
    time_type: int = 1,
    stamp_ns: int | None = None,
    tags: Sequence[int] | None = None,
) -> bytes:
    formats = {CARTESIAN_MM: "<iiiBB", CARTESIAN_CM: "<hhhBB", SPHERICAL: "<IHHBB"}
    rows = packet.units
    if data_type == SPHERICAL:
        rows = spherical(packet.units, packet.unit_m)
    tags = tags or [0] * len(rows)
    body = struct.pack("<Q", packet.stamp_ns if stamp_ns is None else stamp_ns) + b"".join(
        struct.pack(formats[data_type], *row, 60, tag)
        for row, tag in zip(rows.tolist(), tags, strict=True)
    )
    head = struct.pack(
        "<BHHHHBBB12x",
        0,
        28 + len(body),
        (len(rows) - 1) * RAY_NS // 100,  # from the first ray to the last, in 0.1 us
        len(rows),
        (packet.number if counter is None else counter) % 65536,
        0,  # frames are not counted by a pattern that does not repeat
        data_type,
        time_type,
    )
    return head + struct.pack("<I", zlib.crc32(body)) + body


def accelerations2(number: int) -> bytes:
    body = struct.pack("<Q6f", BEGIN_NS + number, 0, 0, 0, 0, 0, 1)
    head = struct.pack("<BHHHHBBB12x", 0, 28 + len(body), 0, 1, number % 65536, 0, 0, 1)
    return head + struct.pack("<I", zlib.crc32(body)) + body


# --- protocol 1: Avia, Mid-40, Mid-70, Horizon, Tele-15 -----------------------------------------


def protocol1(packet: Packet, *, slot: int = 1, lidar: int = 1, time_type: int = 1) -> bytes:
    """Cartesian points with tags, of which a packet holds 96."""
    head = struct.pack("<BBBxIBBQ", 5, slot, lidar, 0, time_type, 2, packet.stamp_ns)
    return head + b"".join(struct.pack("<iiiBB", *row, 60, 0) for row in packet.units.tolist())


# --- the program that listens -------------------------------------------------------------------


class Listening(Live):
    """`unlidar_track --livox` on a port that the system chose."""

    def __init__(self, *arguments: str | Path) -> None:
        # Packets come as fast as they are read, and a busy machine works them off more slowly.
        patience = ("--set", "live.overload_s=600")
        super().__init__("--livox", "127.0.0.1:0", *patience, *arguments)
        line = self._first_line()
        assert b" listens on 127.0.0.1:" in line, line
        self.port = int(line.rpartition(b":")[2])

    def _first_line(self) -> bytes:
        assert self.process.stderr is not None
        fd, line = self.process.stderr.fileno(), b""
        while not line.endswith(b"\n"):
            assert select.select([fd], [], [], PATIENCE_S)[0], f"no line: {line!r}"
            byte = os.read(fd, 1)  # what follows is for communicate()
            assert byte, f"it has ended: {line!r}"
            line += byte
        return line

    def receive(self, packets: Iterable[bytes], source: str = "127.0.0.1") -> None:
        """Sends them, never more than its socket holds."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.bind((source, 0))
            for k, packet in enumerate(packets):
                sender.sendto(packet, ("127.0.0.1", self.port))
                if k % 32 == 31:
                    wait_until_drained(self.port)
        wait_until_drained(self.port)


def wait_until_drained(port: int) -> None:
    end = time.monotonic() + PATIENCE_S
    while _waiting_bytes(port) > 0:
        assert time.monotonic() < end, f"packets are left at port {port}"
        time.sleep(0.001)


def _waiting_bytes(port: int) -> int:
    """Of the socket at this port, as the system tells."""
    for line in Path("/proc/net/udp").read_text().splitlines()[1:]:
        words = line.split()
        if int(words[1].rpartition(":")[2], 16) == port:
            return int(words[4].partition(":")[2], 16)
    return 0


def renumbered(packets: Iterable[Packet]) -> list[Packet]:
    return [replace(packet, number=n) for n, packet in enumerate(packets)]
