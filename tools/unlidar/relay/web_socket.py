"""WebSocket server that sends every event to all clients as a JSON text message."""

import asyncio
import contextlib
import hmac
import http
import ssl
from collections import deque
from collections.abc import Callable, Sequence
from urllib.parse import parse_qs

from websockets.asyncio.server import Request, Response, Server, ServerConnection, serve
from websockets.exceptions import ConnectionClosed

from unlidar.reporting import RateLimitedNote, limit_logging, stage

_MOST_CLIENTS = 64
_MOST_INCOMING_BYTES = 1024


class WebSocketSender:
    """Listens at an address. Clients get all messages after they connected.

    A slow client loses its own oldest messages and delays no other.
    """

    reach = "told to whoever was there"

    def __init__(
        self, host: str, port: int, room: int, token: str | None, tls: ssl.SSLContext | None
    ) -> None:
        self._host, self._port, self._room = host, port, room
        self._token, self._tls = token, tls
        self._server: Server | None = None
        self._clients: set[_Client] = set()
        self.dropped = RateLimitedNote(
            f"{host}:{port}: a client is slow, its oldest message is left out"
        )

    @property
    def port(self) -> int:
        """The port in use, valid after connect()."""
        assert self._server is not None
        return next(iter(self._server.sockets)).getsockname()[1]

    async def connect(self) -> None:
        """Starts the server. OSError if the address is in use."""
        limit_logging("the WebSocket server", "websockets", "asyncio")
        self._server = await serve(
            self._tell,
            self._host,
            self._port,
            ssl=self._tls,
            process_request=self._check,
            # Pages of other sites must not listen through a user's browser.
            origins=[None],
            max_size=_MOST_INCOMING_BYTES,
            server_header=None,
        )
        stage(f"ws://{self._host}:{self.port} is open")

    async def send(self, messages: Sequence[str], arrived: Callable[[], None]) -> None:
        """Queues messages for all clients without waiting."""
        for message in messages:
            for client in self._clients:
                client.offer(message)
            arrived()

    async def lost(self) -> None:
        """Never returns."""
        await asyncio.Event().wait()

    async def close(self) -> None:
        """Closes all connections."""
        server, self._server = self._server, None
        if server is not None:
            server.close()
            await server.wait_closed()

    def _check(self, connection: ServerConnection, request: Request) -> Response | None:
        given = parse_qs(request.path.partition("?")[2]).get("token", [""])[0]
        if self._token is not None and not hmac.compare_digest(
            given.encode(), self._token.encode()
        ):
            return connection.respond(http.HTTPStatus.UNAUTHORIZED, "token?\n")
        if len(self._clients) >= _MOST_CLIENTS:
            return connection.respond(http.HTTPStatus.SERVICE_UNAVAILABLE, "too many\n")
        return None

    async def _tell(self, connection: ServerConnection) -> None:
        client = _Client(self._room, self.dropped)
        self._clients.add(client)
        sending = asyncio.ensure_future(client.tell(connection))
        try:
            with contextlib.suppress(ConnectionClosed):  # closed without a close frame
                async for _ in connection:
                    pass  # messages of clients are ignored
        finally:
            self._clients.discard(client)
            sending.cancel()


class _Client:
    def __init__(self, room: int, dropped: RateLimitedNote) -> None:
        self._queue: deque[str] = deque()
        self._room, self._dropped = room, dropped
        self._filled = asyncio.Event()

    def offer(self, message: str) -> None:
        self._queue.append(message)
        if len(self._queue) > self._room:
            self._queue.popleft()
            self._dropped(f"{self._room} messages wait")
        self._filled.set()

    async def tell(self, connection: ServerConnection) -> None:
        try:
            while True:
                await self._filled.wait()
                while self._queue:
                    await connection.send(self._queue.popleft())
                self._filled.clear()
        except ConnectionClosed:
            pass
