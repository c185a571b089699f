"""Packets captured from a network: files of tcpdump and Wireshark (`.pcap`, `.pcapng`)."""

import socket
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from unlidar_tools.errors import InputError, reason
from unlidar_tools.extras import load_extra
from unlidar_tools.limits import BoundedFile

SUFFIXES = (".pcap", ".pcapng")
_MOST_OPEN = 64  # packets of which pieces are waited for
_END = 1 << 16  # behind every piece, and longer than any packet


@dataclass(frozen=True)
class Datagram:
    """The payload of one UDP packet over IPv4."""

    time_s: float  # when it was captured
    source: str  # address of its sender
    payload: bytes

    @property
    def sensor(self) -> str:
        """The address as the name of a sensor."""
        return self.source.replace(".", "-")


def is_capture(path: Path) -> bool:
    """Whether the name says so."""
    return path.suffix.lower() in SUFFIXES and path.is_file()


def datagrams(path: Path) -> Iterator[Datagram]:
    """The UDP packets of a capture in the order of the file; others are passed over.

    InputError for a file that is none, or of a kind of network that is not known.
    """
    dpkt = _dpkt(path)
    try:
        with BoundedFile(path) as file:
            reader = dpkt.pcap.UniversalReader(file)
            link = _links(dpkt).get(reader.datalink())
            if link is None:
                raise InputError(
                    f"{path}: captured from a network of kind {reader.datalink()}, expected "
                    "Ethernet, Linux cooked or raw IP"
                )
            pieces = _FragmentAssembler()
            for time_s, frame in reader:
                if not frame:  # no network has such; a sparse file is full of them
                    raise InputError(f"{path}: damaged: a packet of 0 bytes")
                packet = _udp_over_ip(dpkt, link, frame, pieces)
                if packet is not None:
                    yield Datagram(float(time_s), *packet)
    except (OSError, ValueError, dpkt.Error) as error:
        raise InputError(f"{path}: not a readable capture: {reason(error)}") from error


def _dpkt(path: Path) -> ModuleType:
    return load_extra("dpkt", "packets", f"{path}: captures need the Python package dpkt")


def _links(dpkt: ModuleType) -> dict[int, type]:
    return {
        dpkt.pcap.DLT_EN10MB: dpkt.ethernet.Ethernet,
        dpkt.pcap.DLT_LINUX_SLL: dpkt.sll.SLL,
        dpkt.pcap.DLT_LINUX_SLL2: dpkt.sll2.SLL2,
        dpkt.pcap.DLT_NULL: dpkt.loopback.Loopback,
        dpkt.pcap.DLT_RAW: dpkt.ip.IP,
        101: dpkt.ip.IP,  # raw IP as most files number it
    }


class _FragmentAssembler:
    """Packets that are longer than their network takes come in pieces, in any order."""

    def __init__(self) -> None:
        self._open: dict[tuple[bytes, bytes, int], dict[int, bytes]] = {}

    def add(self, ip: Any) -> bytes | None:
        """The whole data of the packet that this piece completes."""
        if ip.offset == 0 and not ip.mf:
            return bytes(ip.data)
        key = ip.src, ip.dst, ip.id
        found = self._open.get(key, {})
        if ip.offset * 8 in found:  # numbers come again: that one was never completed
            found = {}
        found[ip.offset * 8] = bytes(ip.data)
        if sum(map(len, found.values())) > _END:  # pieces of no packet
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
    except (dpkt.Error, IndexError, ValueError):  # no whole packet
        return None
