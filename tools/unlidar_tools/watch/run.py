"""Events in, pages out, until a signal."""

import asyncio
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from unlidar_tools.errors import ConfigError, OutputError, reason
from unlidar_tools.events.many import SKY, Many, Told
from unlidar_tools.events.site import Site, Zone, load_zones
from unlidar_tools.events.source import Source
from unlidar_tools.events.station import Station
from unlidar_tools.history.keeper import Keeper
from unlidar_tools.history.store import Store
from unlidar_tools.relay.run import until_signal
from unlidar_tools.telling import note
from unlidar_tools.watch.server import Pages, listen, make_app, make_server
from unlidar_tools.watch.sky import Sky


@dataclass(frozen=True)
class Served:
    """Where pages are served, and what is kept for them."""

    address: str
    port: int
    token: str | None
    certificate: str | None
    key: str | None
    store: Path | None  # None: in memory
    days: float
    megabytes: float


async def watch(source: Source, site: Site, served: Served) -> None:
    """Until a signal. A source that ends does not end it: the page still shows what was.

    OutputError where the address cannot be served or the store not be written.
    """
    zones = load_zones(site)
    store = Store(served.store, served.days, served.megabytes)
    keeper = Keeper(store)
    pages = Pages(Sky())
    app = make_app(pages, store.reader(), site, zones, served.token, SKY if source.many else None)
    try:
        server = make_server(app, served.certificate, served.key)
        server.config.load()
    except (OSError, ValueError) as error:
        raise ConfigError(f"{served.certificate}: certificate or key: {reason(error)}") from error
    try:
        listener = listen(served.address, served.port)
    except OSError as error:
        where = f"{served.address}:{served.port}"
        raise OutputError(f"{where}: cannot be served: {reason(error)}") from error

    async def take() -> None:
        taken = _taker(source, site, zones)
        placed = set()
        async for line in source.lines():
            for told in taken(line.data):
                if told.message.station not in placed:  # everything is in one frame
                    placed.add(told.message.station)
                    store.place(told.message.station, site.origin)
                keeper(told.message)
                if told.shown:
                    pages.take(told.message)
        note(f"{source.name}: has ended; the page stays")
        await asyncio.Event().wait()

    serving = asyncio.ensure_future(server.serve(sockets=[listener]))
    tasks = [asyncio.ensure_future(work) for work in (take(), keeper.run(), pages.run())]
    try:
        print(_address(served, listener.getsockname()[1]), flush=True, file=sys.stdout)
        await until_signal([*tasks, serving])
        tasks[0].result() if tasks[0].done() else None
    finally:
        pages.close()
        server.should_exit = True
        await asyncio.gather(serving, return_exceptions=True)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        keeper.write()
        store.tidy()
        store.close()


def _taker(source: Source, site: Site, zones: Sequence[Zone]) -> Callable[[bytes], Iterable[Told]]:
    """By a broker come many stations, else it is one."""
    if source.many:
        return Many(site, zones, source.name).take
    station = Station(site, zones, source.name, places=False)
    return lambda line: (Told(message, shown=True) for message in station.take(line))


def _address(served: Served, port: int) -> str:
    scheme = "https" if served.certificate else "http"
    host = f"[{served.address}]" if ":" in served.address else served.address
    return f"{scheme}://{host}:{port}/" + (f"?token={served.token}" if served.token else "")
