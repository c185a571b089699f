"""UDP packets captured from a network: files of tcpdump and Wireshark (`.pcap`, `.pcapng`).

Also folders of files that follow each other, as --record-packets and Wireshark's ring buffer write
them: NAME_NUMBER_TIME.pcap.
"""

import re
import socket
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

from unlidar.capture_file import CutOffError, captured_packets
from unlidar.errors import InputError
from unlidar.extras import load_extra

SUFFIXES = (".pcap", ".pcapng")
_MOST_OPEN = 64  # incomplete packets kept for reassembly
_END = 1 << 16  # bytes; beyond any fragment and any packet
_OF_SERIES = re.compile(r"(?P<name>.+)_(?P<number>\d+)_\d{8}T?\d{6}Z?\.pcap(ng)?", re.IGNORECASE)


@dataclass(frozen=True)
class Datagram:
    """The payload of one UDP packet over IPv4."""

    time_ns: int  # capture time, Unix
    source: str  # address of its sender
    payload: bytes

    @property
    def sensor(self) -> str:
        """The address as the name of a sensor."""
        return self.source.replace(".", "-")


def is_capture(path: Path) -> bool:
    """True for a file with the suffix of a capture, or a folder whose captures are a series."""
    return (_has_suffix(path) and path.is_file()) or (path.is_dir() and bool(_series(path)))


def datagrams(path: Path) -> Iterator[Datagram]:
    """The UDP packets of a capture in the order of its file or files; others are skipped.

    InputError if a file is no capture, of an unknown link type, damaged or cut off, after the
    packets before. In a series the next file goes on where one is cut off: its recorder was stopped
    and started.
    """
    files = _series(path) if path.is_dir() else [path]
    for file in files[:-1]:
        with suppress(CutOffError):
            yield from _datagrams_of(file)
    for file in files[-1:]:
        yield from _datagrams_of(file)


def _has_suffix(path: Path) -> bool:
    return path.suffix.lower() in SUFFIXES


def missing_captures(path: Path) -> list[str]:
    """A note on numbers that are missing within a series; empty where none is."""
    numbers = sorted({number for number, _ in _numbered(path)}) if path.is_dir() else []
    before = [one for one, next_one in pairwise(numbers) if next_one > one + 1]
    if not before:
        return []
    count = numbers[-1] - numbers[0] + 1 - len(numbers)
    return [f"{count} of its captures are missing, the first is number {before[0] + 1}"]


def _series(folder: Path) -> list[Path]:
    """Those of a folder's captures that hold something, in the order of their numbers."""
    # A recorder that was killed may have left one without a first byte.
    return [path for _, path in _numbered(folder) if path.stat().st_size > 0]


def _numbered(folder: Path) -> list[tuple[int, Path]]:
    """The captures of a folder with their numbers, in order; empty if they are no one series."""
    try:
        captures = [path for path in folder.iterdir() if _has_suffix(path) and path.is_file()]
    except OSError:  # reported by the kind of recording that it may be
        return []
    found = [_OF_SERIES.fullmatch(path.name) for path in captures]
    if None in found or len({match["name"] for match in found if match}) != 1:
        return []
    return sorted((int(match["number"]), path) for match, path in zip(found, captures, strict=True))


def _datagrams_of(path: Path) -> Iterator[Datagram]:
    dpkt = _dpkt(path)
    links, pieces = _links(dpkt), _FragmentAssembler()
    for time_ns, link, frame in captured_packets(path):
        if link not in links:
            raise InputError(
                f"{path}: captured from a network of kind {link}, expected Ethernet, Linux cooked "
                "or raw IP"
            )
        packet = _udp_over_ip(dpkt, links[link], frame, pieces)
        if packet is not None:
            yield Datagram(time_ns, *packet)


def _dpkt(path: Path) -> ModuleType:
    return load_extra("dpkt", "packets", f"{path}: captures need the Python package dpkt")


def _links(dpkt: ModuleType) -> dict[int, type]:
    return {
        dpkt.pcap.DLT_EN10MB: dpkt.ethernet.Ethernet,
        dpkt.pcap.DLT_LINUX_SLL: dpkt.sll.SLL,
        dpkt.pcap.DLT_LINUX_SLL2: dpkt.sll2.SLL2,
        dpkt.pcap.DLT_NULL: dpkt.loopback.Loopback,
        dpkt.pcap.DLT_RAW: dpkt.ip.IP,
        101: dpkt.ip.IP,  # DLT_RAW as most files number it
    }


class _FragmentAssembler:
    """Reassembles IPv4 packets from fragments, which arrive in any order."""

    def __init__(self) -> None:
        self._open: dict[tuple[bytes, bytes, int], dict[int, bytes]] = {}

    def add(self, ip: Any) -> bytes | None:
        """The payload of the packet that this fragment completes; None while some are missing."""
        if ip.offset == 0 and not ip.mf:
            return bytes(ip.data)
        key = ip.src, ip.dst, ip.id
        found = self._open.get(key, {})
        if ip.offset * 8 in found:  # identification reused: the earlier packet is lost
            found = {}
        found[ip.offset * 8] = bytes(ip.data)
        if sum(map(len, found.values())) > _END:  # more data than any packet has
            self._open.pop(key, None)
            return None
        if not ip.mf:
            found[_END] = b""
        self._open[key] = found
        while len(self._open) > _MOST_OPEN:
            del self._open[next(iter(self._open))]
        whole = _joined(found)
        if whole is not None:
            del self._open[key]
        return whole


def _joined(pieces: dict[int, bytes]) -> bytes | None:
    *parts, (at, _) = sorted(pieces.items())
    if at != _END:
        return None
    whole = b""
    for begin, part in parts:
        if begin != len(whole):
            return None
        whole += part
    return whole


def _udp_over_ip(
    dpkt: ModuleType, link: type, frame: bytes, pieces: _FragmentAssembler
) -> tuple[str, bytes] | None:
    try:
        packet = link(frame)
        ip = packet if isinstance(packet, dpkt.ip.IP) else packet.data
        if not isinstance(ip, dpkt.ip.IP) or ip.p != dpkt.ip.IP_PROTO_UDP:
            return None
        whole = pieces.add(ip)
        if whole is None:
            return None
        udp = dpkt.udp.UDP(whole)
        if len(udp.data) != udp.ulen - 8:  # cut off by the capture
            return None
        return socket.inet_ntoa(ip.src), bytes(udp.data)
    except (dpkt.Error, IndexError, ValueError):  # truncated packet
        return None
