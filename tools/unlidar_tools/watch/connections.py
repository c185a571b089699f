"""Who is connected to the page's server, and who has to make way for others.

A connection that says nothing, or does not read what it asked for, costs nobody else anything: it
is closed in time, and at once where there are too many. All of it is counted where connections are
accepted, so that those that never end a handshake of TLS are among them.
"""

import asyncio
import contextlib
import socket
import time
from collections import Counter
from dataclasses import dataclass

from uvicorn.protocols.http.h11_impl import H11Protocol

SILENT_S = 10.0  # without a whole request
STUCK_S = 10.0  # nothing of an answer is read
_SLOW_S = 60.0  # an answer is read ever so slowly
_MOST = 256
_MOST_OF_ONE = 64  # of an address
_SEND_BUFFER = 1 << 18  # the kernel's, of each
_LOOK_S = 1.0


@dataclass(eq=False)
class Guest:
    """A connection."""

    socket: socket.socket
    address: str
    silent_since_s: float | None  # None while an answer is given
    transport: asyncio.Transport | None = None
    stuck_since_s: float | None = None
    slow_since_s: float = 0.0
    unsent: int = 0
    is_sent_away: bool = False

    @property
    def is_gone(self) -> bool:
        """Whether it is closed on our side, or will be when the loop comes to it."""
        return self.is_sent_away or self.socket.fileno() < 0

    def close(self) -> None:
        """At once, with what is not sent."""
        self.is_sent_away = True
        if self.transport is not None:
            self.transport.abort()
        else:
            with contextlib.suppress(OSError):
                self.socket.shutdown(socket.SHUT_RDWR)


class Connections:
    """All of them. Of the thread that serves."""

    def __init__(self) -> None:
        self._guests: dict[int, Guest] = {}  # by file descriptor, the oldest first

    def came(self, connection: socket.socket, address: str) -> None:
        """A new one; where there are too many, the one that has said nothing for longest goes."""
        with contextlib.suppress(OSError, AttributeError):  # Linux alone has the timeout
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 30_000)
        guest = Guest(connection, address, time.monotonic())
        if len(self._guests) >= _MOST_OF_ONE and not self._has_room(address):
            guest.close()
        self._guests[connection.fileno()] = guest

    def guest(self, transport: asyncio.Transport) -> Guest:
        """The one of a transport, which it has from now on."""
        connection = transport.get_extra_info("socket")
        guest = self._guests[connection.fileno()]
        guest.transport = transport
        return guest

    async def run(self) -> None:
        """For ever."""
        while True:
            await asyncio.sleep(_LOOK_S)
            self.look()

    def look(self) -> None:
        """Closes those that are silent or stuck for too long."""
        now_s = time.monotonic()
        for number, guest in list(self._guests.items()):
            if guest.socket.fileno() < 0:
                del self._guests[number]
            elif guest.is_sent_away:
                continue
            elif guest.silent_since_s is not None and now_s - guest.silent_since_s > SILENT_S:
                guest.close()
            elif guest.stuck_since_s is not None and guest.transport is not None:
                unsent = guest.transport.get_write_buffer_size()
                if unsent < guest.unsent:
                    guest.stuck_since_s = now_s
                guest.unsent = unsent
                if now_s - guest.stuck_since_s > STUCK_S or now_s - guest.slow_since_s > _SLOW_S:
                    guest.close()

    def _has_room(self, address: str) -> bool:
        """Also where somebody makes way: of the same address, or of the one that has most."""
        there = [guest for guest in self._guests.values() if not guest.is_gone]
        count = Counter(guest.address for guest in there)
        if count[address] >= _MOST_OF_ONE:
            crowd = address
        elif len(there) >= _MOST:
            crowd = count.most_common(1)[0][0]
        else:
            return True
        silent = [g for g in there if g.address == crowd and g.silent_since_s is not None]
        if silent:
            min(silent, key=lambda guest: guest.silent_since_s or 0.0).close()
        return bool(silent)


class Listener(socket.socket):
    """Where connections are accepted, and counted."""

    connections: Connections

    @classmethod
    def at(cls, address: str, port: int, connections: Connections) -> "Listener":
        """OSError where the address is not ours or taken."""
        family = socket.AF_INET6 if ":" in address else socket.AF_INET
        plain = socket.create_server((address, port), family=family, backlog=512)
        listener = cls(fileno=plain.detach())
        listener.connections = connections
        return listener

    def accept(self) -> tuple[socket.socket, tuple]:
        """As every socket does."""
        connection, address = super().accept()
        self.connections.came(connection, address[0])
        return connection, address


class Protocol(H11Protocol):
    """uvicorn's, which tells what its connection does."""

    def __init__(self, connections: Connections, **more: object) -> None:
        super().__init__(**more)  # type: ignore[arg-type]
        self._connections = connections

    def connection_made(self, transport: asyncio.Transport) -> None:
        """Counts it."""
        self._guest = self._connections.guest(transport)
        super().connection_made(transport)

    def data_received(self, data: bytes) -> None:
        """Only a whole request is more than silence."""
        super().data_received(data)
        self._answers()

    def on_response_complete(self) -> None:
        """It is silent until it asks again."""
        self._guest.silent_since_s = time.monotonic()
        super().on_response_complete()
        self._answers()

    def pause_writing(self) -> None:
        """What it asked for is not read."""
        super().pause_writing()
        now_s = time.monotonic()
        self._guest.stuck_since_s = self._guest.slow_since_s = now_s
        self._guest.unsent = self.transport.get_write_buffer_size()

    def resume_writing(self) -> None:
        """It is."""
        super().resume_writing()
        self._guest.stuck_since_s = None

    def _answers(self) -> None:
        if self.cycle is not None and not self.cycle.response_complete:
            self._guest.silent_since_s = None
