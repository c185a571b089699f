"""Captures of UDP packets, written byte by byte."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterable
from pathlib import Path

_MAGIC_US, _ETHERNET = 0xA1B2C3D4, 1


def udp_frame(payload: bytes, source: str, port: int = 56300, to: int = 56301) -> bytes:
    """An Ethernet frame. Checksums are left out, as network cards that compute them show it."""
    udp = struct.pack(">HHHH", port, to, 8 + len(payload), 0) + payload
    addresses = socket.inet_aton(source) + socket.inet_aton("192.168.1.5")
    ip = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0) + addresses
    return bytes(12) + b"\x08\x00" + ip + udp


def write_pcap(path: Path, frames: Iterable[tuple[int, bytes]], link: int = _ETHERNET) -> Path:
    """Each frame with its time in nanoseconds."""
    with path.open("wb") as file:
        file.write(struct.pack("<IHHiIII", _MAGIC_US, 2, 4, 0, 0, 65535, link))
        for time_ns, frame in frames:
            seconds, rest_ns = divmod(time_ns, 10**9)
            file.write(struct.pack("<IIII", seconds, rest_ns // 1000, len(frame), len(frame)))
            file.write(frame)
    return path
