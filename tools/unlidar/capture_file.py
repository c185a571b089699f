"""The packets in a file of tcpdump or Wireshark, pcap or pcapng.

The formats: draft-ietf-opsawg-pcap and draft-ietf-opsawg-pcapng. Damage and the end of a file that
is cut off are told by the byte and by the number of whole packets before.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, NoReturn

from unlidar.errors import InputError, reason
from unlidar.limits import BoundedFile
from unlidar.stamps import MOST_STAMP_NS, NS_PER_S

_MOST_PACKET = 1 << 18  # bytes; tcpdump's bound for one packet
_MOST_UNITS = 64  # of 2: times count at most 2**64 in a second
# By the first bytes of a pcap: order of bytes, ns in a unit of time, bytes of a packet's head.
_PCAP = {
    b"\xd4\xc3\xb2\xa1": ("<", 1000, 16),
    b"\xa1\xb2\xc3\xd4": (">", 1000, 16),
    b"\x4d\x3c\xb2\xa1": ("<", 1, 16),
    b"\xa1\xb2\x3c\x4d": (">", 1, 16),
    b"\x34\xcd\xb2\xa1": ("<", 1000, 24),  # of Kuznetzov's tcpdump
    b"\xa1\xb2\xcd\x34": (">", 1000, 24),
}
_PCAP_REST = 20  # bytes of its header behind these
_SECTION = b"\x0a\x0d\x0d\x0a"  # the first bytes of a pcapng, and its type of block
_INTERFACE, _OLD_PACKET, _PACKET = 1, 2, 6  # types of blocks
_ORDERS = {b"\x4d\x3c\x2b\x1a": "<", b"\x1a\x2b\x3c\x4d": ">"}
_BLOCK_ENDS = 12  # bytes of a block before and after its body
_INTERFACE_HEAD, _PACKET_HEAD = 8, 20  # bytes of their bodies before options and data
_RESOLUTION, _OFFSET = 9, 14  # options of an interface


class CutOffError(InputError):
    """A capture ends where a packet, or its header, has more."""


class Captured(NamedTuple):
    """A packet as it was on the network."""

    time_ns: int  # Unix time
    link: int  # LINKTYPE of its network
    data: bytes


@dataclass(frozen=True)
class _Interface:
    link: int
    units_per_s: int = 1_000_000
    offset_s: int = 0


def captured_packets(path: Path) -> Iterator[Captured]:
    """The packets in the order of the file.

    CutOffError where the file ends within one or within a header, wherever that is, and InputError
    where it is damaged or no capture, after the packets before.
    """
    try:
        with BoundedFile(path) as file:
            yield from _Capture(path, file).packets()
    except (OSError, ValueError, struct.error) as error:
        raise InputError(f"{path}: not a readable capture: {reason(error)}") from error


class _Capture:
    def __init__(self, path: Path, file: BoundedFile) -> None:
        self._path, self._file = path, file
        self._whole = 0  # packets so far

    def packets(self) -> Iterator[Captured]:
        magic = self._file.read(4)
        if not any(known.startswith(magic) for known in (*_PCAP, _SECTION)):
            raise ValueError("begins as neither pcap nor pcapng does")
        magic += self._read(4 - len(magic))
        for packet in self._blocks() if magic == _SECTION else self._records(magic):
            if not packet.data:  # never on a network, but a sparse file reads as empty packets
                self._damaged("a packet of 0 bytes")
            if not 0 <= packet.time_ns <= MOST_STAMP_NS:
                seconds = packet.time_ns // NS_PER_S
                self._damaged(f"a packet of {seconds:.4g} s, expected Unix time")
            self._whole += 1
            yield packet

    def _records(self, magic: bytes) -> Iterator[Captured]:
        """Of a pcap: heads of packets, each with its data behind it."""
        order, unit_ns, size = _PCAP[magic]
        (link,) = struct.unpack(order + "16xI", self._read(_PCAP_REST))
        link &= 0xFFFF  # above it the length of checksums
        while head := self._read(size, may_end=True):
            seconds, units, kept = struct.unpack_from(order + "III", head)
            if kept > _MOST_PACKET:
                self._damaged(f"a packet of {kept:,} bytes, expected at most {_MOST_PACKET:,}")
            yield Captured(seconds * NS_PER_S + units * unit_ns, link, self._read(kept))

    def _blocks(self) -> Iterator[Captured]:
        """Of a pcapng, whose first four bytes have been read."""
        self._file.seek(0)
        order, interfaces = "<", []
        while head := self._read(8, may_end=True):
            if head[:4] == _SECTION:
                magic = self._read(4)
                if magic not in _ORDERS:
                    self._damaged("a section of unknown byte order")
                order, interfaces = _ORDERS[magic], []
                self._body(order, head, len(magic))
                continue
            (kind,) = struct.unpack_from(order + "I", head)
            body = self._body(order, head)
            if kind == _INTERFACE:
                self._check_whole(body, _INTERFACE_HEAD, "an interface")
                interfaces.append(_interface(order, body))
            elif kind in (_PACKET, _OLD_PACKET):
                self._check_whole(body, _PACKET_HEAD, "a packet")
                number = struct.unpack_from(order + ("I" if kind == _PACKET else "H"), body)[0]
                if number >= len(interfaces):
                    self._damaged(f"a packet of interface {number}, there are {len(interfaces)}")
                yield self._packet(order, interfaces[number], body)

    def _body(self, order: str, head: bytes, read: int = 0) -> bytes:
        """The rest of a block whose head and so many bytes more have been read."""
        (length,) = struct.unpack_from(order + "I", head, 4)
        if length % 4 or length < len(head) + read + 4:
            self._damaged(f"a block of {length:,} bytes")
        body = self._read(length - len(head) - read)
        if body[-4:] != head[4:]:
            self._damaged("a block whose end has another length than its head")
        return body[:-4]

    def _packet(self, order: str, interface: _Interface, body: bytes) -> Captured:
        high, low, kept = struct.unpack_from(order + "4xIII", body)
        data = body[_PACKET_HEAD : _PACKET_HEAD + kept]
        if len(data) < kept:
            self._damaged(f"a packet of {kept:,} bytes in a block of {len(body) + _BLOCK_ENDS:,}")
        time_ns = (high << 32 | low) * NS_PER_S // interface.units_per_s
        return Captured(time_ns + interface.offset_s * NS_PER_S, interface.link, data)

    def _check_whole(self, body: bytes, least: int, what: str) -> None:
        if len(body) < least:
            whole = _BLOCK_ENDS + least
            found = len(body) + _BLOCK_ENDS
            self._damaged(f"{what} in a block of {found} bytes, expected at least {whole}")

    def _read(self, size: int, may_end: bool = False) -> bytes:
        data = self._file.read(size)
        if len(data) < size and not (may_end and not data):
            raise CutOffError(
                f"{self._path}: is cut off at byte {self._file.tell():,}, after packet "
                f"{self._whole:,}"
            )
        return data

    def _damaged(self, why: str) -> NoReturn:
        raise InputError(
            f"{self._path}: damaged before byte {self._file.tell():,}, after packet "
            f"{self._whole:,}: {why}"
        )


def _interface(order: str, body: bytes) -> _Interface:
    (link,) = struct.unpack_from(order + "H", body)
    at, units_per_s, offset_s = _INTERFACE_HEAD, _Interface.units_per_s, _Interface.offset_s
    while at + 4 <= len(body):
        option, length = struct.unpack_from(order + "HH", body, at)
        value = body[at + 4 : at + 4 + length]
        if option == _RESOLUTION and len(value) == 1:
            # The highest bit: a power of 2 instead of 10.
            units_per_s = (2 if value[0] & 0x80 else 10) ** min(value[0] & 0x7F, _MOST_UNITS)
        elif option == _OFFSET and len(value) == 8:
            (offset_s,) = struct.unpack(order + "q", value)
        elif option == 0:
            break
        at += 4 + length + -length % 4
    return _Interface(link, units_per_s, offset_s)
