"""Playback of captured packets of Livox LiDARs."""

import ipaddress
import math
import socket
import time
from contextlib import ExitStack
from pathlib import Path

from unlidar import livox
from unlidar.capture import datagrams
from unlidar.errors import InputError, OutputError, UsageError, reason
from unlidar.play import Played

_SOCKETS = Path("/proc/net/udp")
_AT_ONCE = 32  # packets that fit any socket buffer


def play_packets(path: Path, host: str, port: int, rate: float, anywhere: bool = False) -> Played:
    """Sends the packets of points, `rate` times as fast as they came; inf: as fast as is taken.

    Within this computer each LiDAR keeps an address of its own: 192.168.1.12 becomes 127.168.1.12.
    """
    address = _address(host)
    if not address.is_loopback and not anywhere:
        raise UsageError(
            f"--to {host}:{port}: is not this computer, expected 127.0.0.1, or --anywhere"
        )
    begin, first_ns, count, most_behind_s = time.monotonic(), None, 0, 0.0
    with ExitStack() as open_sockets:
        senders: dict[str, socket.socket] = {}
        for datagram in datagrams(path):
            if not livox.holds_points(datagram.payload):
                continue
            if datagram.source not in senders:
                sender = open_sockets.enter_context(socket.socket(type=socket.SOCK_DGRAM))
                if address.is_loopback:
                    sender.bind(("127." + datagram.source.partition(".")[2], 0))
                senders[datagram.source] = sender
            first_ns = datagram.time_ns if first_ns is None else first_ns
            if math.isfinite(rate):
                due_s = (datagram.time_ns - first_ns) * 1e-9 / rate
                behind_s = time.monotonic() - begin - due_s
                most_behind_s = max(most_behind_s, behind_s)
                if behind_s < 0:
                    time.sleep(-behind_s)
            elif count % _AT_ONCE == 0:
                _wait_for_room(port)
            try:
                senders[datagram.source].sendto(datagram.payload, (str(address), port))
            except ConnectionRefusedError:  # no listener
                pass
            except OSError as error:
                raise OutputError(f"{host}:{port}: cannot be sent to: {reason(error)}") from error
            count += 1
    if count == 0:
        raise InputError(f"{path}: holds no points of a Livox LiDAR, expected {livox.EXPECTED}")
    return Played(count, time.monotonic() - begin, most_behind_s)


def _address(host: str) -> ipaddress.IPv4Address:
    try:
        return ipaddress.IPv4Address("127.0.0.1" if host == "localhost" else host)
    except ValueError as error:
        raise UsageError(f"--to {host}: expected an IPv4 address") from error


def _wait_for_room(port: int) -> None:
    """Waits while a local socket at the port has unread packets."""
    while any(
        int(words[1].rpartition(":")[2], 16) == port and int(words[4].partition(":")[2], 16) > 0
        for words in (line.split() for line in _SOCKETS.read_text().splitlines()[1:])
    ):
        time.sleep(0.0005)
