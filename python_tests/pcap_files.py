"""Captures of UDP packets, written byte by byte."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from unlidar.cli import main

_MAGIC_US, _ETHERNET = 0xA1B2C3D4, 1


def udp_frame(payload: bytes, source: str, port: int = 56300, to: int = 56301) -> bytes:
    """An Ethernet frame. Checksums are left out, as network cards that compute them show it."""
    udp = struct.pack(">HHHH", port, to, 8 + len(payload), 0) + payload
    addresses = socket.inet_aton(source) + socket.inet_aton("192.168.1.5")
    ip = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0) + addresses
    return bytes(12) + b"\x08\x00" + ip + udp


def write_pcap(
    path: Path, frames: Iterable[tuple[int, bytes]], link: int = _ETHERNET, order: str = "<"
) -> Path:
    """Each frame with its time in nanoseconds."""
    with path.open("wb") as file:
        file.write(struct.pack(order + "IHHiIII", _MAGIC_US, 2, 4, 0, 0, 65535, link))
        for time_ns, frame in frames:
            seconds, rest_ns = divmod(time_ns, 10**9)
            file.write(
                struct.pack(order + "IIII", seconds, rest_ns // 1000, len(frame), len(frame))
            )
            file.write(frame)
    return path


def pcapng_block(kind: int, body: bytes, order: str = "<") -> bytes:
    """A block, padded to whole words."""
    body += bytes(-len(body) % 4)
    length = struct.pack(order + "I", 12 + len(body))
    return struct.pack(order + "I", kind) + length + body + length


def pcapng_section(order: str = "<") -> bytes:
    """The begin of a section."""
    return pcapng_block(0x0A0D0D0A, struct.pack(order + "IHHq", 0x1A2B3C4D, 1, 0, -1), order)


def pcapng_interface(options: bytes = b"", order: str = "<", link: int = _ETHERNET) -> bytes:
    """An interface, whose times are microseconds unless the options say otherwise."""
    return pcapng_block(1, struct.pack(order + "HHI", link, 0, 65535) + options, order)


def pcapng_packet(units: int, data: bytes, interface: int = 0, order: str = "<") -> bytes:
    """A packet at so many units of time of its interface."""
    head = interface, *divmod(units, 1 << 32), len(data), len(data)
    return pcapng_block(6, struct.pack(order + "IIIII", *head) + data, order)


def write_pcapng(path: Path, frames: Iterable[tuple[int, bytes]], order: str = "<") -> Path:
    """The same as blocks of section, interface and packets."""
    packets = [pcapng_packet(time_ns // 1000, data, 0, order) for time_ns, data in frames]
    path.write_bytes(b"".join([pcapng_section(order), pcapng_interface(b"", order), *packets]))
    return path


def fragments(frame: bytes, number: int, most: int = 1480) -> list[bytes]:
    """An Ethernet frame of udp_frame as a network of 1,500 bytes carries it: in pieces."""
    head, ip, data = frame[:14], frame[14:34], frame[34:]
    pieces = []
    for begin in range(0, len(data), most):
        part = data[begin : begin + most]
        more = 0x2000 if begin + most < len(data) else 0
        fields = struct.pack(">HHH", 20 + len(part), number % (1 << 16), more | begin // 8)
        pieces.append(head + ip[:2] + fields + ip[8:] + part)
    return pieces


def no_damage_gives_more_than_one_line(
    whole: bytes, folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Converts copies of a capture, as folder/b.pcap, of which 200 bytes are others."""
    rng = np.random.default_rng(7)
    for _ in range(20):
        damaged = bytearray(whole)
        for at in rng.integers(0, len(whole), 200):
            damaged[at] = rng.integers(256)
        (folder / "b.pcap").write_bytes(damaged)
        code = main(["convert", str(folder / "b.pcap"), str(folder / "out"), "--force"])
        said = capfd.readouterr().err.splitlines()
        assert code in (0, 4), said
        assert code == 0 or len([line for line in said if line]) == 1, said
