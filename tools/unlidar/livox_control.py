"""Finds Livox LiDARs of protocol 2, such as the Mid-360, and makes them send: docs/livox.md."""

import binascii
import socket
import struct
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from unlidar.errors import InputError, UsageError, reason
from unlidar.sanitize import printable

DISCOVERY_PORT = 56000
SAMPLING, IDLE = 1, 2

_HEAD = struct.Struct("<BBHIHBB6x")
_HEAD_BYTES = 24  # with both checksums
_SOF = 0xAA
_REQUEST, _ANSWER = 0, 1
_DISCOVER, _CONFIGURE, _INQUIRE = 0x0000, 0x0100, 0x0101
_POINT_TYPE, _POINT_HOST, _TARGET_MODE = 0x0000, 0x0006, 0x001A
_SERIAL, _STATE, _SYNCHRONISATION = 0x8000, 0x8006, 0x800C
_CARTESIAN_MM = 1

_MODELS = {9: "Mid-360", 10: "HAP", 15: "HAP", 16: "PA", 35: "Mid-360S", 40: "Avia 2"}
_POINT_PORT = 56300  # from which a LiDAR sends,
_HAP_POINT_PORTS = {10: 57000, 15: 57000}  # but these models
_CLOCKS = {0: "not synchronised", 1: "synchronised by PTP", 2: "synchronised by GPS"}
_IP_PKTINFO = 8  # of Linux; Python has no name for it before 3.14
_TRIES = 5
_ANSWER_S = 0.6


@dataclass(frozen=True)
class Lidar:
    """A LiDAR that answered the discovery."""

    address: str
    command_port: int
    model: int
    serial: str

    def __str__(self) -> str:
        """Address, model and serial number."""
        model = _MODELS.get(self.model, f"of type {self.model}")
        return f"{self.address}: {model}, serial number {printable(self.serial)}"


@dataclass(frozen=True)
class State:
    """The state reported by a LiDAR."""

    mode: int  # SAMPLING, IDLE or a transition
    clock: str


def pack(command: int, number: int, data: bytes, kind: int = _REQUEST) -> bytes:
    """A message of the host."""
    head = _HEAD.pack(_SOF, 0, _HEAD_BYTES + len(data), number, command, kind, 0)
    crc32 = zlib.crc32(data) if data else 0
    return head + struct.pack("<HI", binascii.crc_hqx(head, 0xFFFF), crc32) + data


def unpack(message: bytes) -> tuple[int, int, bytes] | None:
    """Command, number and data of a LiDAR's answer; None for any other bytes."""
    if len(message) < _HEAD_BYTES:
        return None
    sof, version, length, number, command, kind, sender = _HEAD.unpack_from(message)
    crc16, crc32 = struct.unpack_from("<HI", message, _HEAD.size)
    data = message[_HEAD_BYTES:]
    if (sof, version, length, kind, sender) != (_SOF, 0, len(message), _ANSWER, 1):
        return None
    if crc16 != binascii.crc_hqx(message[: _HEAD.size], 0xFFFF):
        return None
    return None if data and crc32 != zlib.crc32(data) else (command, number, data)


def discover(host: str, to: str = "255.255.255.255", port: int = DISCOVERY_PORT) -> list[Lidar]:
    """Discovers LiDARs at an address, by default the broadcast of the host's network."""
    found: dict[str, Lidar] = {}
    with _socket(host) as channel:
        for number in range(1, _TRIES + 1):
            _send(channel, host, pack(_DISCOVER, number, b""), (to, port))
            for _, data, source in _answers(channel, _DISCOVER):
                if len(data) >= 24 and data[0] == 0:
                    address = socket.inet_ntoa(data[18:22])
                    serial = data[2:18].rstrip(b"\0").decode("ascii", "replace")
                    command_port = int.from_bytes(data[22:24], "little")
                    found[address] = Lidar(address, command_port, data[1], serial)
                    if to == source:
                        return [found[address]]
            if found:
                break
    return list(found.values())


class Control:
    """Commands to one LiDAR. All throw InputError if it does not answer, or refuses."""

    def __init__(self, channel: socket.socket, host: str, lidar: Lidar) -> None:
        self._channel, self._host, self._lidar = channel, host, lidar
        self._number = 100

    def send_points_to(self, port: int) -> None:
        """Configures 32-bit Cartesian points, sent to this port of the host."""
        here = socket.inet_aton(self._host) + struct.pack(
            "<HH", port, _HAP_POINT_PORTS.get(self._lidar.model, _POINT_PORT)
        )
        self._configure({_POINT_TYPE: bytes([_CARTESIAN_MM]), _POINT_HOST: here})

    def set_mode(self, mode: int) -> None:
        """Requests SAMPLING or IDLE; the transition takes seconds."""
        self._configure({_TARGET_MODE: bytes([mode])})

    def state(self) -> State:
        """The current state."""
        keys = (_STATE, _SYNCHRONISATION)
        data = self._ask(_INQUIRE, struct.pack("<HH", len(keys), 0) + struct.pack("<2H", *keys))
        self._check(data[0], "does not tell its state")
        values, at = {}, 3
        while at + 4 <= len(data):
            key, length = struct.unpack_from("<HH", data, at)
            values[key] = data[at + 4 : at + 4 + length]
            at += 4 + length
        mode, clock = values.get(_STATE, b""), values.get(_SYNCHRONISATION, b"")
        if len(mode) != 1 or len(clock) != 1:
            raise InputError(f"{self._lidar.address}: does not tell its state, as a Mid-360 does")
        return State(mode[0], _CLOCKS.get(clock[0], f"synchronised in way {clock[0]}"))

    def _configure(self, values: dict[int, bytes]) -> None:
        rows = b"".join(struct.pack("<HH", k, len(v)) + v for k, v in values.items())
        data = self._ask(_CONFIGURE, struct.pack("<HH", len(values), 0) + rows)
        key = int.from_bytes(data[1:3], "little")
        self._check(data[0], f"refuses the setting 0x{key:04x}")

    def _check(self, code: int, what: str) -> None:
        if code != 0:
            raise InputError(f"{self._lidar.address}: {what}: code {code}, expected 0")

    def _ask(self, command: int, data: bytes) -> bytes:
        to = self._lidar.address, self._lidar.command_port
        self._number += 1  # same number for retries: commands are idempotent
        for _ in range(_TRIES):
            _send(self._channel, self._host, pack(command, self._number, data), to)
            for number, answer, source in _answers(self._channel, command):
                if number == self._number and source == to[0] and answer:
                    return answer
        raise InputError(f"{to[0]}:{to[1]}: gives no answer to command 0x{command:04x}")


@contextmanager
def control(host: str, lidar: Lidar) -> Iterator[Control]:
    """Commands to a LiDAR from an address of this computer."""
    with _socket(host) as channel:
        yield Control(channel, host, lidar)


@contextmanager
def _socket(host: str) -> Iterator[socket.socket]:
    with socket.socket(type=socket.SOCK_DGRAM) as channel:
        channel.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        try:
            with socket.socket(type=socket.SOCK_DGRAM) as here:
                here.bind((host, 0))
            # Discovery answers are broadcast, which a socket bound to one address does not receive.
            channel.bind(("", 0))
        except OSError as error:
            raise UsageError(
                f"--host {host}: expected an address of this computer: {reason(error)}"
            ) from error
        yield channel


def _send(channel: socket.socket, host: str, message: bytes, to: tuple[str, int]) -> None:
    # Bind to the interface of the host's address, else a broadcast leaves by any.
    source = (socket.IPPROTO_IP, _IP_PKTINFO, struct.pack("=i4s4x", 0, socket.inet_aton(host)))
    try:
        channel.sendmsg([message], [source], 0, to)
    except OSError as error:
        raise InputError(f"{to[0]}:{to[1]}: cannot be sent to: {reason(error)}") from error


def _answers(channel: socket.socket, command: int) -> Iterator[tuple[int, bytes, str]]:
    """Number, data and source of the answers to a command, for a while."""
    end = time.monotonic() + _ANSWER_S
    while (left_s := end - time.monotonic()) > 0:
        channel.settimeout(left_s)
        try:
            message, (source, _) = channel.recvfrom(2048)
        except TimeoutError:
            return
        except ConnectionRefusedError:  # ICMP error of an earlier message
            continue
        answer = unpack(message)
        if answer is not None and answer[0] == command:
            yield answer[1], answer[2], source
