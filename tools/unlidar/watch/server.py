"""The web server. Every request is a GET that reads what is in memory or in the store.

No request names a file, writes or executes anything. The server has a thread and event loop of its
own, so that neither the processing of events nor a wait for the store delays a page.
"""

import asyncio
import contextlib
import json
import math
import threading
from collections.abc import Iterator, Sequence
from functools import partial
from importlib.resources import files

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp

from unlidar.addresses import LAST_WORDS_S
from unlidar.events.site import Site, Zone
from unlidar.history.timeline import Archive, Question, UnansweredError, rows, spans
from unlidar.reporting import limit_logging
from unlidar.watch.connections import Connections, Listener, Protocol
from unlidar.watch.gate import Gate
from unlidar.watch.metrics import CONTENT_TYPE, Metrics
from unlidar.watch.outlines import drawable
from unlidar.watch.pages import Pages
from unlidar.watch.sky import FORGET_S, MOST_TRACKS, Sky

_LONGEST_S = 1800.0  # longest time span of an answer with rows
_SPANS_S = 86_400.0
_KINDS = {
    "/": ("page.html", "text/html"),
    "/page.css": ("page.css", "text/css"),
    "/page.js": ("page.js", "text/javascript"),
    "/draw.js": ("draw.js", "text/javascript"),
    "/live.js": ("live.js", "text/javascript"),
    "/returns.js": ("returns.js", "text/javascript"),
    "/eye.js": ("eye.js", "text/javascript"),
}


def make_app(
    sky: Sky,
    pages: Pages,
    archive: Archive,
    site: Site,
    zones: Sequence[Zone],
    token: str | None,
    station: str | None,
    metrics: Metrics,
) -> ASGIApp:
    """The application. `station`: whose tracks the history shows; None: all."""
    folder = files("unlidar.watch") / "page"
    begin = _begin(site, zones)

    def fixed(path: str) -> Route:
        name, kind = _KINDS[path]
        content = (folder / name).read_bytes()
        return Route(path, lambda _request: Response(content, media_type=kind), methods=["GET"])

    async def live(request: Request) -> Response:
        if request.method == "HEAD":  # no body is read, so no page is opened
            return Response(media_type="text/event-stream")
        if pages.full:
            return PlainTextResponse("too many pages are open\n", 503)
        return StreamingResponse(pages.told(begin), media_type="text/event-stream")

    async def asked(question: Question, since_s: float, until_s: float) -> Response:
        try:
            since_ns, until_ns = round(since_s * 1e9), round(until_s * 1e9)
            answer = await archive.ask(question, since_ns, until_ns, station)
        except UnansweredError as error:
            return PlainTextResponse(f"{error}\n", 503)
        return Response(answer, media_type="application/json")

    async def last_day(_request: Request) -> Response:
        # Rounded to the cache's period, so that simultaneous pages share a query.
        until_s = math.ceil(sky.now_s() / 2) * 2.0
        return await asked(spans, until_s - _SPANS_S, until_s)

    async def history(request: Request) -> Response:
        try:
            since_s, until_s = (float(request.query_params[key]) for key in ("since", "until"))
        except (KeyError, ValueError):
            since_s = until_s = math.nan
        if not (abs(since_s) < 9e9 and 0 <= until_s - since_s <= _LONGEST_S):
            return PlainTextResponse(
                f"expected since and until, seconds, at most {_LONGEST_S:g} apart\n", 400
            )
        return await asked(rows, since_s, until_s)

    async def measured(_request: Request) -> Response:
        return Response(metrics.text(), headers={"Content-Type": CONTENT_TYPE})

    routes = [
        *(fixed(path) for path in _KINDS),
        Route("/live", live, methods=["GET"]),
        Route("/spans", last_day, methods=["GET"]),
        Route("/history", history, methods=["GET"]),
        Route("/metrics", measured, methods=["GET"]),
    ]
    return Gate(Starlette(routes=routes), token)


class _Server(uvicorn.Server):
    """uvicorn's server in our loop, with our signal handling."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leaves signals alone."""
        yield


class Serving:
    """Serves the pages from a thread of its own."""

    def __init__(
        self,
        app: ASGIApp,
        pages: Pages,
        connections: Connections,
        certificate: str | None,
        key: str | None,
    ):
        """OSError or ValueError if certificate or key are invalid."""
        self.connections = connections
        self._pages = pages
        self._server = _Server(
            uvicorn.Config(
                app,
                loop="asyncio",
                http=partial(Protocol, self.connections),  # type: ignore[arg-type]
                ws="none",
                lifespan="off",
                log_config=None,
                access_log=False,
                server_header=False,
                timeout_keep_alive=30,
                timeout_graceful_shutdown=1,
                ssl_certfile=certificate,
                ssl_keyfile=key,
            )
        )
        self._server.config.load()
        self._thread: threading.Thread | None = None
        self._stop: tuple[asyncio.AbstractEventLoop, asyncio.Event] | None = None

    def start(self, listener: Listener) -> asyncio.Future[None]:
        """Starts the thread; the future completes when it ends, with its error if any."""
        loop = asyncio.get_running_loop()
        done: asyncio.Future[None] = loop.create_future()

        def run() -> None:
            error: BaseException | None = None
            try:
                asyncio.run(self._serve(listener))
            except BaseException as failed:
                error = failed
            with contextlib.suppress(RuntimeError):  # the loop is closed
                loop.call_soon_threadsafe(_settle, done, error)

        limit_logging("the page's server", "uvicorn", "asyncio")
        self._thread = threading.Thread(target=run, name="pages", daemon=True)
        self._thread.start()
        return done

    def stop(self) -> None:
        """Closes all pages and stops."""
        if self._thread is not None:
            if self._stop is not None:
                loop, event = self._stop
                with contextlib.suppress(RuntimeError):  # already stopped
                    loop.call_soon_threadsafe(event.set)
            self._thread.join(LAST_WORDS_S)

    async def _serve(self, listener: Listener) -> None:
        stopped = asyncio.Event()
        self._stop = asyncio.get_running_loop(), stopped
        serving = asyncio.ensure_future(self._server.serve(sockets=[listener]))
        works = stopped.wait(), self._pages.run(), self.connections.run()
        tasks = [serving, *(asyncio.ensure_future(work) for work in works)]
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        self._pages.close()
        self._server.should_exit = True
        await asyncio.gather(serving, return_exceptions=True)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for task in done:
            task.result()


def _settle(done: asyncio.Future[None], error: BaseException | None) -> None:
    if done.done():
        return
    if error is None:
        done.set_result(None)
    else:
        done.set_exception(error)


def _begin(site: Site, zones: Sequence[Zone]) -> str:
    """The constant part of a page."""
    shown = []
    for zone, rings in zip(zones, drawable(zones), strict=True):
        low, high = (v if math.isfinite(v) else None for v in (zone.low_m, zone.high_m))
        shown.append({"name": zone.name, "rings": rings, "low": low, "high": high})
    heading = site.origin.heading_deg if site.origin else None
    bounds = {"forget_s": FORGET_S, "most_tracks": MOST_TRACKS}
    return json.dumps({"station": site.station, "heading": heading, "zones": shown} | bounds)
