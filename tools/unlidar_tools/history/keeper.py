"""Messages into a store while they come."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path

from unlidar_tools.events.site import Site
from unlidar_tools.events.station import Message
from unlidar_tools.history import DAYS, MEGABYTES
from unlidar_tools.history.store import Store

_WRITE_S = 0.5  # so much a power cut may take
_MOST_WAITING = 5000
_TIDY_S = 60.0


class Keeper:
    """Collects for a moment, then writes in one transaction."""

    def __init__(self, store: Store) -> None:
        self.store = store
        self._waiting: list[Message] = []

    def __call__(self, message: Message) -> None:
        """Keeps a message."""
        self._waiting.append(message)
        if len(self._waiting) >= _MOST_WAITING:
            self.write()

    def write(self) -> None:
        """What has come so far is kept now."""
        waiting, self._waiting = self._waiting, []
        if waiting:
            self.store.take(waiting)

    async def run(self) -> None:
        """For ever."""
        loop = asyncio.get_running_loop()
        tidied = loop.time() - _TIDY_S
        while True:
            await asyncio.sleep(_WRITE_S)
            self.write()
            if loop.time() - tidied >= _TIDY_S:
                tidied = loop.time()
                self.store.tidy()


@asynccontextmanager
async def keeping(
    path: Path | None, site: Site, days: float = DAYS, megabytes: float = MEGABYTES
) -> AsyncIterator[Callable[[Message], None]]:
    """What takes messages to keep; nothing is kept without a path."""
    if path is None:
        yield lambda _message: None
        return
    store = Store(path, days, megabytes)
    store.place(site.station, site.origin)
    keeper = Keeper(store)
    running = asyncio.ensure_future(keeper.run())
    try:
        yield keeper
    finally:
        running.cancel()
        with suppress(asyncio.CancelledError):
            await running
        keeper.write()
        store.tidy()
        store.close()
