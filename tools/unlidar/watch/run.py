"""Runs `unlidar watch`: from a source of events to pages."""

import asyncio
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from unlidar.errors import ConfigError, OutputError, reason
from unlidar.events.event import Returns
from unlidar.events.lines import QUIET_S, SKY, Line
from unlidar.events.many import Many, Told
from unlidar.events.site import Site, Zone, load_zones
from unlidar.events.source import Source
from unlidar.events.station import Station
from unlidar.history.keeper import Keeper
from unlidar.history.timeline import Archive
from unlidar.relay.run import until_signal
from unlidar.reporting import note
from unlidar.watch.connections import Connections, Listener
from unlidar.watch.metrics import Metrics, Taken
from unlidar.watch.pages import Pages
from unlidar.watch.server import Serving, make_app
from unlidar.watch.sky import Sky

_WAIT_S = 0.01


@dataclass(frozen=True)
class Served:
    """Settings of the server and of the store."""

    address: str
    port: int
    token_file: Path | None
    token: str | None
    certificate: str | None
    key: str | None
    store: Path | None  # None: in memory
    days: float
    megabytes: float


async def watch(source: Source, returns: Source | None, site: Site, served: Served) -> None:
    """Serves until a signal, also after the end of the source, as pages still show the past.

    `returns`: where what the LiDARs see comes from, if not from `source`.

    OutputError if the address cannot be served, or the store is invalid.
    """
    zones = load_zones(site)
    keeper = Keeper(served.store, served.days, served.megabytes)
    archive = Archive(keeper.location)
    try:
        sky = Sky()
        pages = Pages(sky)
        only = SKY if source.many else None
        connections, taken = Connections(), Taken()
        metrics = Metrics(sky, pages, connections, taken)
        app = make_app(sky, pages, archive, site, zones, served.token, only, metrics)
        serving = _serving(app, pages, connections, served)
        outs = _Outs(keeper, pages, serving, taken)
        await _watch(source, returns, site, zones, served, outs)
    finally:
        archive.close()
        keeper.close()


@dataclass(frozen=True)
class _Outs:
    keeper: Keeper
    pages: Pages
    serving: Serving
    taken: Taken


async def _watch(
    source: Source,
    returns: Source | None,
    site: Site,
    zones: Sequence[Zone],
    served: Served,
    outs: _Outs,
) -> None:
    listener = _listen(served, outs.serving)
    serving = outs.serving.start(listener)
    tasks = [asyncio.ensure_future(_take(source, site, zones, outs))]
    if returns is not None:
        tasks.append(asyncio.ensure_future(_show(returns, site, outs.pages)))
    try:
        # After the signal handlers are set, as readers of this line may send a signal.
        asyncio.get_running_loop().call_soon(_say_where, served, listener.getsockname()[1])
        await until_signal([*tasks, serving])
        for task in tasks:
            if task.done():
                task.result()
    finally:
        outs.serving.stop()
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _take(source: Source, site: Site, zones: Sequence[Zone], outs: _Outs) -> None:
    decoder, told_of = _decoder(source, site, zones)
    placed = set()

    def take(line: Line) -> None:
        refused = decoder.bad.count
        messages = told_of(line.data)
        if decoder.bad.count > refused:
            outs.taken.refused += 1
        elif line.data:
            outs.taken.events += 1
        for told in messages:
            message = told.message
            if message.station not in placed:  # all stations share one frame
                placed.add(message.station)
                outs.keeper.place(message.station, site.origin)
            outs.keeper(message)
            outs.pages.take(message, told.shown, line.old)

    async for line in source.lines():
        take(line)
        while line.old and outs.keeper.is_behind:
            await asyncio.sleep(_WAIT_S)  # throttles a file, so that all of it is stored
    note(f"{source.name}: has ended; the page stays")
    while True:  # tracks without an end time out
        await asyncio.sleep(QUIET_S)
        take(Line(b"", old=False))


async def _show(returns: Source, site: Site, pages: Pages) -> None:
    """Shows returns; their stamps say nothing of those of the events, which may come later."""
    station = Station(site, (), returns.name, places=False)
    async for line in returns.lines():
        for message in station.take(line.data):
            if isinstance(message.event, Returns):
                pages.take(message, old=line.old)


def _decoder(
    source: Source, site: Site, zones: Sequence[Zone]
) -> tuple[Many | Station, Callable[[bytes], Sequence[Told]]]:
    """The decoder of lines, for many stations with a broker, else for one, and its messages."""
    if source.many:
        many = Many(site, zones, source.name)
        return many, many.take
    station = Station(site, zones, source.name, places=False)
    return station, lambda line: [Told(message, shown=True) for message in station.take(line)]


def _serving(app: Callable, pages: Pages, connections: Connections, served: Served) -> Serving:
    try:
        return Serving(app, pages, connections, served.certificate, served.key)
    except (OSError, ValueError) as error:
        raise ConfigError(f"{served.certificate}: certificate or key: {reason(error)}") from error


def _listen(served: Served, serving: Serving) -> Listener:
    try:
        return Listener.at(served.address, served.port, serving.connections)
    except OSError as error:
        where = f"{served.address}:{served.port}"
        raise OutputError(f"{where}: cannot be served: {reason(error)}") from error


def _say_where(served: Served, port: int) -> None:
    """Reports the address without the token, which journals would keep."""
    scheme = "https" if served.certificate else "http"
    host = f"[{served.address}]" if ":" in served.address else served.address
    if served.token_file is not None:
        note(f"a browser is let in once with ?token= and the content of {served.token_file}")
    print(f"{scheme}://{host}:{port}/", flush=True, file=sys.stdout)
