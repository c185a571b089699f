"""Packets captured from a network: files of tcpdump and Wireshark (`.pcap`, `.pcapng`)."""

import socket
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from unlidar_tools.errors import InputError, reason
from unlidar_tools.extras import load_extra

SUFFIXES = (".pcap", ".pcapng")


@dataclass(frozen=True)
class Datagram:
    """The payload of one UDP packet over IPv4."""

    time_s: float  # when it was captured
    source: str  # address of its sender
    payload: bytes


def is_capture(path: Path) -> bool:
    """Whether the name says so."""
    return path.suffix.lower() in SUFFIXES and path.is_file()


def datagrams(path: Path) -> Iterator[Datagram]:
    """The UDP packets of a capture in the order of the file; others are passed over.

    InputError for a file that is none, or of a kind of network that is not known.
    """
    dpkt = _dpkt(path)
    try:
        with path.open("rb") as file:
            reader = dpkt.pcap.UniversalReader(file)
            link = _links(dpkt).get(reader.datalink())
            if link is None:
                raise InputError(
                    f"{path}: captured from a network of kind {reader.datalink()}, expected "
                    "Ethernet, Linux cooked or raw IP"
                )
            for time_s, frame in reader:
                packet = _udp_over_ip(dpkt, link, frame)
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


def _udp_over_ip(dpkt: ModuleType, link: type, frame: bytes) -> tuple[str, bytes] | None:
    try:
        packet = link(frame)
        ip = packet if isinstance(packet, dpkt.ip.IP) else packet.data
        if not isinstance(ip, dpkt.ip.IP) or not isinstance(ip.data, dpkt.udp.UDP):
            return None
        udp = ip.data
        if len(udp.data) != udp.ulen - 8:  # cut off by the capture
            return None
        return socket.inet_ntoa(ip.src), bytes(udp.data)
    except (dpkt.Error, IndexError, ValueError):  # no whole packet
        return None
