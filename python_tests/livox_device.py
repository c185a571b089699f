"""The commands of a Livox LiDAR of the tests' own, written from the vendor's description."""

from __future__ import annotations

import socket
import struct
import threading
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field

SAMPLING, IDLE, STARTING = 1, 2, 6


def crc16(data: bytes) -> int:
    """CCITT with the polynomial 0x1021 and the start 0xffff, bit by bit."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
    return crc


def answer(command: int, number: int, data: bytes) -> bytes:
    head = struct.pack("<BBHIHBB6x", 0xAA, 0, 24 + len(data), number, command, 1, 1)
    return head + struct.pack("<HI", crc16(head), zlib.crc32(data)) + data


@dataclass
class Device:
    """Listens for who looks for it and for commands, until it is closed.

    `spoil` may change an answer, or swallow it; `refuse` is the code for settings.
    """

    address: str = "127.0.0.2"
    model: int = 9
    refuse: int = 0
    never_starts: bool = False
    spoil: Callable[[int, bytes], bytes | None] = lambda _, data: data
    settings: dict[int, bytes] = field(default_factory=dict)
    requests: list[int] = field(default_factory=list)
    wrong: list[bytes] = field(default_factory=list)
    mode: int = IDLE
    _inquiries: int = 0

    def __enter__(self) -> Device:
        self._discovery, self._command = (socket.socket(type=socket.SOCK_DGRAM) for _ in range(2))
        self._discovery.bind((self.address, 0))
        self._command.bind((self.address, 0))
        self.discovery_port = self._discovery.getsockname()[1]
        self._threads = [
            threading.Thread(target=self._serve, args=(channel, is_discovery), daemon=True)
            for channel, is_discovery in ((self._discovery, True), (self._command, False))
        ]
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        for channel, thread in zip((self._discovery, self._command), self._threads, strict=True):
            with socket.socket(type=socket.SOCK_DGRAM) as last:
                last.sendto(b"end", channel.getsockname())
            thread.join(10)
            channel.close()

    def _serve(self, channel: socket.socket, is_discovery: bool) -> None:
        while (request := channel.recvfrom(2048))[0] != b"end":
            data, sender = request
            reply = self._reply(data, is_discovery)
            if reply is not None:
                reply = self.spoil(len(self.requests), reply)
            if reply is not None:
                channel.sendto(reply, sender)

    def _reply(self, message: bytes, is_discovery: bool) -> bytes | None:
        sof, version, length, number, command, kind, sender = struct.unpack_from(
            "<BBHIHBB", message
        )
        crc_head, crc_data = struct.unpack_from("<HI", message, 18)
        data = message[24:]
        right = (sof, version, length, kind, sender) == (0xAA, 0, len(message), 0, 0)
        right &= crc_head == crc16(message[:18]) and crc_data == (zlib.crc32(data) if data else 0)
        if not right or is_discovery != (command == 0):
            self.wrong.append(message)
            return None
        self.requests.append(command)
        if command == 0:
            port = self._command.getsockname()[1]
            place = socket.inet_aton(self.address) + struct.pack("<H", port)
            return answer(0, number, bytes([0, self.model]) + b"47MDK9DF710030\0\0" + place)
        if command == 0x0100:
            return answer(command, number, self._configure(data))
        if command == 0x0101:
            return answer(command, number, self._inquire(data))
        self.wrong.append(message)
        return None

    def _configure(self, data: bytes) -> bytes:
        count, at = struct.unpack_from("<H", data)[0], 4
        for _ in range(count):
            key, length = struct.unpack_from("<HH", data, at)
            if self.refuse:
                return struct.pack("<BH", self.refuse, key)
            self.settings[key] = data[at + 4 : at + 4 + length]
            at += 4 + length
        if 0x001A in self.settings:
            self.mode = STARTING if self.never_starts else self.settings[0x001A][0]
            self._inquiries = 0
        return struct.pack("<BH", 0, 0)

    def _inquire(self, data: bytes) -> bytes:
        count = struct.unpack_from("<H", data)[0]
        keys = struct.unpack_from(f"<{count}H", data, 4)
        self._inquiries += 1
        mode = STARTING if self._inquiries < 3 else self.mode
        known = {0x8006: bytes([mode]), 0x800C: b"\1", 0x8000: b"47MDK9DF710030\0\0"}
        values = b"".join(struct.pack("<HH", k, len(known[k])) + known[k] for k in keys)
        return struct.pack("<BH", 0, count) + values
