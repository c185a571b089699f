"""UDP, TCP and TLS for Cursor on Target, which has no acknowledgements."""

import asyncio
import contextlib
import fcntl
import ipaddress
import os
import select
import socket
import ssl
import struct
import termios
from collections.abc import Callable, Sequence

from unlidar.addresses import DIAL_S
from unlidar.relay.deadline import deadline

_LOOK_S = 0.005
# Data acknowledged by TCP may be unread by the program; a reset within this time reveals that.
_SETTLE_S = 0.1
_MULTICAST_HOPS = 4
# States of a connection: reset, or closed by the other side.
_RESET = select.POLLERR | select.POLLHUP
_LEFT = _RESET | select.POLLRDHUP


class UdpSender:
    """One event a datagram, to one host, a broadcast address or a multicast group."""

    reach = "handed to the network"

    def __init__(self, host: str, port: int) -> None:
        self._host, self._port = host, port
        self._transport: asyncio.DatagramTransport | None = None

    async def connect(self) -> None:
        """Resolves the name. OSError if unknown."""
        loop = asyncio.get_running_loop()
        found = await loop.getaddrinfo(self._host, self._port, type=socket.SOCK_DGRAM)
        family, *_, address = found[0]
        # With the zone of a link-local address of IPv6.
        host, _ = socket.getnameinfo(address, socket.NI_NUMERICHOST | socket.NI_NUMERICSERV)
        # Unconnected socket: ICMP errors of earlier datagrams are no lost connection.
        self._transport, _ = await loop.create_datagram_endpoint(
            asyncio.DatagramProtocol,
            remote_addr=(host, self._port),
            family=family,
            allow_broadcast=True,
        )
        if ipaddress.ip_address(host).is_multicast:
            own = self._transport.get_extra_info("socket")
            if family == socket.AF_INET6:
                own.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_MULTICAST_HOPS, _MULTICAST_HOPS)
            else:
                own.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, _MULTICAST_HOPS)

    async def send(self, messages: Sequence[bytes], arrived: Callable[[], None]) -> None:
        """Sends datagrams; their arrival is unknown."""
        assert self._transport is not None
        for message in messages:
            if self._transport.is_closing():
                raise ConnectionError("the socket was closed")
            self._transport.sendto(message)
            arrived()

    async def lost(self) -> None:
        """Never returns."""
        await asyncio.Event().wait()

    async def close(self) -> None:
        """Closes the socket after sent data has left."""
        if self._transport is not None:
            self._transport.close()
        self._transport = None


class StreamSender:
    """Concatenated events by TCP or TLS, as TAK servers accept them."""

    reach = "acknowledged by the other machine, by no program"

    def __init__(self, host: str, port: int, tls: ssl.SSLContext | None) -> None:
        self._host, self._port, self._tls = host, port, tls
        self._reader: asyncio.StreamReader | None = None
        self._writer: asyncio.StreamWriter | None = None
        self._wire: int | None = None  # socket descriptor, valid also after TLS has closed

    async def connect(self) -> None:
        """Connects. OSError, also for TLS."""
        dial = asyncio.open_connection(self._host, self._port, ssl=self._tls)
        async with deadline(DIAL_S, "no answer within"):
            self._reader, self._writer = await dial
        # Not 0: the low mark of TLS would be negative.
        self._writer.transport.set_write_buffer_limits(high=1)
        self._wire = os.dup(self._writer.get_extra_info("socket").fileno())

    async def send(self, messages: Sequence[bytes], arrived: Callable[[], None]) -> None:
        """Sends events; returns when the peer's TCP has acknowledged them without a later reset.

        TCP offers no stronger guarantee.
        """
        assert self._writer is not None and self._wire is not None
        if _look(self._wire) & _LEFT:
            raise ConnectionError("the connection was closed")
        for message in messages:
            self._writer.write(message)
            async with deadline(DIAL_S, "took nothing for"):
                await self._writer.drain()
        await self._acknowledged(self._wire)
        for _ in messages:
            arrived()

    async def _acknowledged(self, wire: int) -> None:
        """OSError if the peer reset the connection, that is, has not read everything."""
        clock = asyncio.get_running_loop().time
        moved_s, left = clock(), 0
        while not (seen := _look(wire)) & _RESET:
            before, left = left, _unacknowledged(wire)
            if left != before:
                moved_s = clock()
            still_s = clock() - moved_s
            # A close without reset means that all was read.
            if not left and (still_s > _SETTLE_S or seen & _LEFT):
                return
            if still_s > DIAL_S:
                raise ConnectionError(f"took nothing for {DIAL_S:g} s")
            await asyncio.sleep(_LOOK_S)
        raise ConnectionResetError("the connection was reset")

    async def lost(self) -> None:
        """Discards incoming data until the server closes."""
        assert self._reader is not None
        while await self._reader.read(65536):
            pass

    async def close(self) -> None:
        """Closes the connection."""
        writer, wire = self._writer, self._wire
        self._reader = self._writer = self._wire = None
        if wire is not None:
            os.close(wire)
        if writer is not None:
            writer.close()
            with contextlib.suppress(OSError, TimeoutError):
                async with asyncio.timeout(1.0):
                    await writer.wait_closed()


def _look(wire: int) -> int:
    """State of a connection by the system, independent of the event loop's progress."""
    poll = select.poll()
    poll.register(wire, select.POLLRDHUP)
    return next((events for _, events in poll.poll(0)), 0)


def _unacknowledged(wire: int) -> int:
    """Unacknowledged bytes, TLS overhead included."""
    return struct.unpack("i", fcntl.ioctl(wire, termios.TIOCOUTQ, b"\0" * 4))[0]
