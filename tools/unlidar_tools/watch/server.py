"""The web server. Every request is a GET that reads what is in memory or in the store.

No request names a file, writes or runs anything. Pages of other sites learn nothing: a browser that
is told to call this machine by another name is refused, and nothing is shared across origins.
"""

import asyncio
import contextlib
import hashlib
import hmac
import json
import math
import socket
from collections.abc import AsyncIterator, Iterator, Sequence
from importlib.resources import files

import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import PlainTextResponse, RedirectResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send

from unlidar_tools.events.site import Site, Zone
from unlidar_tools.events.station import Message
from unlidar_tools.history.store import Reader
from unlidar_tools.watch.sky import Sky

LOCAL = ("localhost", "127.0.0.1", "::1")
FRAME_S = 0.05  # pages are told so often at most
_SIGN_OF_LIFE_S = 2.0
_MOST_PAGES = 32
_MOST_WAITING = 200  # batches, ten seconds: who is slower is sent away and comes back
_MOST_ROWS = 3000  # of a track in an answer; more are thinned
_LONGEST_S = 1800.0  # of an answer with rows
_COOKIE = "unlidar"
_KINDS = {
    "/": ("page.html", "text/html"),
    "/page.css": ("page.css", "text/css"),
    "/page.js": ("page.js", "text/javascript"),
    "/draw.js": ("draw.js", "text/javascript"),
}
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "connect-src 'self'; img-src data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class Pages:
    """All pages that are open: messages go to each, many at once."""

    def __init__(self, sky: Sky) -> None:
        self._sky = sky
        self._fresh: list[str] = []
        self._queues: set[asyncio.Queue[str | None]] = set()
        self._closed = False

    def take(self, message: Message) -> None:
        """Goes out with the next batch."""
        self._sky.take(message)
        if self._queues:
            self._fresh.append(message.text)

    async def run(self) -> None:
        """For ever."""
        quiet_s = 0.0
        while True:
            await asyncio.sleep(FRAME_S)
            quiet_s += FRAME_S
            if self._fresh or quiet_s >= _SIGN_OF_LIFE_S:
                quiet_s = 0.0
                self._send()

    def close(self) -> None:
        """Every page is told good-bye, and will come back if there is somebody again."""
        self._closed = True
        for queue in self._queues:
            with contextlib.suppress(asyncio.QueueFull):
                queue.put_nowait(None)

    @property
    def full(self) -> bool:
        """Whether no further page can be open."""
        return len(self._queues) >= _MOST_PAGES

    async def told(self, begin: str) -> AsyncIterator[str]:
        """Server-sent events for one page: everything, then what is new."""
        queue: asyncio.Queue[str | None] = asyncio.Queue(_MOST_WAITING)
        self._send()  # what came until now is in the snapshot
        self._queues.add(queue)
        try:
            yield f"retry: 1000\nevent: begin\ndata: {begin}\n\n"
            yield f"event: snapshot\ndata: {self._sky.snapshot()}\n\n"
            while not self._closed and (batch := await queue.get()) is not None:
                yield batch
        finally:
            self._queues.discard(queue)

    def _send(self) -> None:
        fresh, self._fresh = self._fresh, []
        now, at = f"{self._sky.now_s():.3f}", f"{self._sky.at_ns / 1e9:.3f}"
        batch = f'data: {{"now":{now},"at":{at},"events":[{",".join(fresh)}]}}\n\n'
        for queue in list(self._queues):
            try:
                queue.put_nowait(batch)
            except asyncio.QueueFull:
                self._queues.discard(queue)
                while not queue.empty():
                    queue.get_nowait()
                queue.put_nowait(None)


def make_app(
    pages: Pages,
    reader: Reader,
    site: Site,
    zones: Sequence[Zone],
    token: str | None,
    station: str | None,
) -> ASGIApp:
    """The application. Without a token only names of this machine itself are answered.

    The past shows the tracks of one station, or of all (None).
    """
    folder = files("unlidar_tools.watch") / "page"
    begin = _begin(site, zones)

    def fixed(path: str) -> Route:
        name, kind = _KINDS[path]
        content = (folder / name).read_bytes()
        return Route(path, lambda _request: Response(content, media_type=kind), methods=["GET"])

    async def live(_request: Request) -> Response:
        if pages.full:
            return PlainTextResponse("too many pages are open\n", 503)
        return StreamingResponse(pages.told(begin), media_type="text/event-stream")

    async def spans(_request: Request) -> Response:
        found = [
            [name, number, begin_ns / 1e9, end_ns / 1e9]
            for name, number, begin_ns, end_ns in reader.spans()
            if station in (None, name)
        ]
        alarms = [json.loads(text) for text in reader.alarms(0, (1 << 63) - 1)]
        raised = [[a["station"], a["zone"], a["raised"]] for a in alarms if a["state"] == "raised"]
        return _json({"spans": found, "alarms": raised})

    async def history(request: Request) -> Response:
        try:
            since_s, until_s = (float(request.query_params[key]) for key in ("since", "until"))
        except (KeyError, ValueError):
            since_s = until_s = math.nan
        if not (abs(since_s) < 9e9 and 0 <= until_s - since_s <= _LONGEST_S):
            return PlainTextResponse(
                f"expected since and until, seconds, at most {_LONGEST_S:g} apart\n", 400
            )
        tracks = []
        for track in reader.tracks(round(since_s * 1e9), round(until_s * 1e9), station):
            step = -(-len(track.rows) // _MOST_ROWS)
            rows = [
                (row[0] / 1e9, *(round(value, 3) for value in row[1:11]))
                for row in track.rows[::step]
            ]
            tracks.append(
                {
                    "station": track.station,
                    "track": track.number,
                    "drone": track.rows[-1][11],
                    "rows": rows,
                }
            )
        return _json({"tracks": tracks})

    routes = [
        *(fixed(path) for path in _KINDS),
        Route("/live", live, methods=["GET"]),
        Route("/spans", spans, methods=["GET"]),
        Route("/history", history, methods=["GET"]),
    ]
    return _Gate(Starlette(routes=routes), token)


class _Gate:
    """Who may come in, and the headers of every answer."""

    def __init__(self, app: ASGIApp, token: str | None) -> None:
        self._app, self._token = app, token
        # What the browser keeps is not the token itself.
        self._pass = hashlib.sha256(f"unlidar:{token}".encode()).hexdigest()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return

        async def with_headers(message: dict) -> None:
            if message["type"] == "http.response.start":
                own = [(k.lower().encode(), v.encode()) for k, v in _HEADERS.items()]
                message = message | {"headers": [*message["headers"], *own]}
            await send(message)

        await (self._answer(scope) or self._app)(scope, receive, with_headers)

    def _answer(self, scope: Scope) -> Response | None:
        """What is said instead of letting in."""
        request = Request(scope)
        if scope["method"] not in ("GET", "HEAD"):
            return PlainTextResponse("only GET\n", 405)
        if self._token is None:
            if _host(request.headers) in LOCAL:
                return None
            return PlainTextResponse("call this machine localhost\n", 421)
        given = request.query_params.get("token")
        if given is not None and hmac.compare_digest(given.encode(), self._token.encode()):
            # Out of the address, lest it stays in a history.
            answer = RedirectResponse("/", 303)
            secure = scope["scheme"] == "https"
            answer.set_cookie(
                _COOKIE, self._pass, max_age=30 * 86400, httponly=True, secure=secure,
                samesite="strict",
            )  # fmt: skip
            return answer
        if hmac.compare_digest(request.cookies.get(_COOKIE, "").encode(), self._pass.encode()):
            return None
        return PlainTextResponse("add ?token=... to the address\n", 401)


class Server(uvicorn.Server):
    """In our loop, which has its own way with signals."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """None of its own."""
        yield


def make_server(app: ASGIApp, certificate: str | None, key: str | None) -> Server:
    """For `serve(sockets=[...])`."""
    return Server(
        uvicorn.Config(
            app,
            loop="asyncio",
            http="h11",
            ws="none",
            lifespan="off",
            log_config=None,
            access_log=False,
            server_header=False,
            timeout_keep_alive=30,
            timeout_graceful_shutdown=1,
            limit_concurrency=200,
            ssl_certfile=certificate,
            ssl_keyfile=key,
        )
    )


def listen(address: str, port: int) -> socket.socket:
    """OSError where the address is not ours or taken."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    return socket.create_server((address, port), family=family, backlog=128)


def _host(headers: Headers) -> str:
    host = headers.get("host", "")
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.partition(":")[0].lower()


def _begin(site: Site, zones: Sequence[Zone]) -> str:
    """What does not change while the server runs."""
    import shapely

    shown = []
    for zone in zones:
        rings = [
            [[round(x, 2), round(y, 2)] for x, y in shapely.get_coordinates(ring).tolist()]
            for polygon in shapely.get_parts(zone.polygon)
            for ring in shapely.get_rings(polygon)
        ]
        low, high = (v if math.isfinite(v) else None for v in (zone.low_m, zone.high_m))
        shown.append({"name": zone.name, "rings": rings, "low": low, "high": high})
    heading = site.origin.heading_deg if site.origin else None
    return json.dumps({"station": site.station, "heading": heading, "zones": shown})


def _json(value: object) -> Response:
    return Response(json.dumps(value, separators=(",", ":")), media_type="application/json")
