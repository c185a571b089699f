"""Connection limits of the page's server.

Connections that are silent, or do not read their answer, are closed after a timeout, and at once
if there are too many. They are counted on accept, which includes those that never finish a TLS
handshake.
"""

import asyncio
import contextlib
import socket
import time
from collections import Counter
from dataclasses import dataclass

from uvicorn.protocols.http.h11_impl import H11Protocol

SILENT_S = 10.0  # without a whole request
STUCK_S = 10.0  # without progress of an answer
_SLOW_S = 60.0  # for a whole answer at any pace
_MOST = 256
_MOST_OF_ONE = 64  # connections per address
_SEND_BUFFER = 1 << 18  # kernel buffer per connection
_LOOK_S = 1.0


@dataclass(eq=False)
class Guest:
    """A connection."""

    socket: socket.socket
    address: str
    silent_since_s: float | None  # None during an answer
    transport: asyncio.Transport | None = None
    stuck_since_s: float | None = None
    slow_since_s: float = 0.0
    unsent: int = 0
    is_sent_away: bool = False

    @property
    def is_gone(self) -> bool:
        """True if closed on our side, or about to be."""
        return self.is_sent_away or self.socket.fileno() < 0

    def close(self) -> None:
        """Closes at once, discarding unsent data."""
        self.is_sent_away = True
        if self.transport is not None:
            self.transport.abort()
        else:
            with contextlib.suppress(OSError):
                self.socket.shutdown(socket.SHUT_RDWR)


class Connections:
    """All connections; used by the serving thread only."""

    def __init__(self) -> None:
        self._guests: dict[int, Guest] = {}  # by file descriptor, the oldest first

    def came(self, connection: socket.socket, address: str) -> None:
        """Adds a connection; beyond the limit the longest silent one is closed."""
        with contextlib.suppress(OSError, AttributeError):  # the timeout exists on Linux only
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 30_000)
        guest = Guest(connection, address, time.monotonic())
        if len(self._guests) >= _MOST_OF_ONE and not self._has_room(address):
            guest.close()
        self._guests[connection.fileno()] = guest

    def guest(self, transport: asyncio.Transport) -> Guest:
        """The guest of a transport, bound to it from now on."""
        connection = transport.get_extra_info("socket")
        guest = self._guests[connection.fileno()]
        guest.transport = transport
        return guest

    @property
    def count(self) -> int:
        """Number of open connections."""
        return sum(not guest.is_gone for guest in self._guests.values())

    async def run(self) -> None:
        """Checks the connections for ever."""
        while True:
            await asyncio.sleep(_LOOK_S)
            self.look()

    def look(self) -> None:
        """Closes connections that are silent or stuck for too long."""
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
        """Makes room by closing one of the same address, or of the address with the most."""
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
    """A listening socket that counts accepted connections."""

    connections: Connections

    @classmethod
    def at(cls, address: str, port: int, connections: Connections) -> "Listener":
        """Binds. OSError if the address is not local or in use."""
        family = socket.AF_INET6 if ":" in address else socket.AF_INET
        plain = socket.create_server((address, port), family=family, backlog=512)
        listener = cls(fileno=plain.detach())
        listener.connections = connections
        return listener

    def accept(self) -> tuple[socket.socket, tuple]:
        """Accepts and counts a connection."""
        connection, address = super().accept()
        self.connections.came(connection, address[0])
        return connection, address


class Protocol(H11Protocol):
    """uvicorn's protocol, reporting the activity of its connection."""

    def __init__(self, connections: Connections, **more: object) -> None:
        super().__init__(**more)  # type: ignore[arg-type]
        self._connections = connections

    def connection_made(self, transport: asyncio.Transport) -> None:
        """Registers the connection."""
        self._guest = self._connections.guest(transport)
        super().connection_made(transport)

    def data_received(self, data: bytes) -> None:
        """Counts as activity only with a complete request."""
        super().data_received(data)
        self._answers()

    def on_response_complete(self) -> None:
        """Starts the silence timeout until the next request."""
        self._guest.silent_since_s = time.monotonic()
        super().on_response_complete()
        self._answers()

    def pause_writing(self) -> None:
        """Starts the stuck timeout: the answer is not read."""
        super().pause_writing()
        now_s = time.monotonic()
        self._guest.stuck_since_s = self._guest.slow_since_s = now_s
        self._guest.unsent = self.transport.get_write_buffer_size()

    def resume_writing(self) -> None:
        """Ends the stuck timeout."""
        super().resume_writing()
        self._guest.stuck_since_s = None

    def _answers(self) -> None:
        if self.cycle is not None and not self.cycle.response_complete:
            self._guest.silent_since_s = None
