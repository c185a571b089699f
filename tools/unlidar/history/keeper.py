"""Store writer: a thread of its own, so that callers never wait."""

import sqlite3
import threading
import time
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from itertools import islice
from pathlib import Path

from unlidar.addresses import LAST_WORDS_S
from unlidar.errors import reason
from unlidar.events.event import Returns
from unlidar.events.site import Place, Site
from unlidar.events.station import Message
from unlidar.history import DAYS, MEGABYTES, MEMORY_MEGABYTES
from unlidar.history.ageing import Ageing
from unlidar.history.schema import Location, is_damage, set_aside
from unlidar.history.store import Placed, Store
from unlidar.reporting import RateLimitedNote, note

_WRITE_S = 0.5  # write interval, the largest loss at a power cut
_TIDY_S = 60.0
_AT_A_TIME = 2000  # messages per transaction
_MOST_WAITING, _MOST_BYTES = 20_000, 8_000_000  # while the store cannot be written
_SLOW_S = 0.5


class Keeper:
    """Writes to a store with a bounded queue; failures are reported and retried."""

    def __init__(self, path: Path | None, days: float = DAYS, megabytes: float = MEGABYTES) -> None:
        """`path` None: in memory, with a smaller bound. OutputError if the file is no store."""
        if path is None:
            megabytes = min(megabytes, MEMORY_MEGABYTES)
        ageing = Ageing()
        self._open = lambda: Store(path, days, megabytes, ageing)
        self._waiting: deque[Message | Placed] = deque()
        self._bytes = 0
        self._lock = threading.Lock()
        self._failed = RateLimitedNote(f"{path or 'memory'}: cannot be written, it is tried again")
        self._left_out = RateLimitedNote(
            f"{path or 'memory'}: too much waits, a message is not kept"
        )
        self._damaged = 0  # consecutive failures by damage
        self._is_failing = False
        self._began_s: float | None = None  # begin of the current write
        self._ended = threading.Event()
        self._until_s = 0.0
        self._store: Store | None = None
        try:
            self._store = self._open()
        except (sqlite3.Error, OSError) as error:
            self._fail(error)
        self.location: Location = self._store.location if self._store else Location.of(path)
        self._thread = threading.Thread(target=self._run, name="keeper", daemon=True)
        self._thread.start()

    def __call__(self, message: Message | Placed) -> None:
        """Queues a message for storage; returns are for the eye alone."""
        if isinstance(message, Message) and isinstance(message.event, Returns):
            return
        size = len(message.text) if isinstance(message, Message) else 0
        with self._lock:
            if len(self._waiting) < _MOST_WAITING and self._bytes + size <= _MOST_BYTES:
                self._waiting.append(message)
                self._bytes += size
                return
        self._left_out(f"{_MOST_WAITING} messages or {_MOST_BYTES // 10**6} MB wait")

    def place(self, station: str, place: Place | None) -> None:
        """Queues a station's place for storage."""
        self(Placed(station, place))

    @property
    def is_behind(self) -> bool:
        """True while a working store is busy; file sources then slow down."""
        began_s = self._began_s
        stuck = began_s is not None and time.monotonic() - began_s > _SLOW_S
        much = len(self._waiting) > _MOST_WAITING // 2 or self._bytes > _MOST_BYTES // 2
        return much and not self._is_failing and not stuck

    def close(self) -> None:
        """Stops the writer after a few seconds for the queue."""
        self._until_s = time.monotonic() + LAST_WORDS_S
        self._ended.set()
        self._thread.join(2 * LAST_WORDS_S)
        if self._waiting:
            note(f"{self.location}: {len(self._waiting)} messages were not kept")

    def _run(self) -> None:
        tidied_s = -_TIDY_S
        while True:
            ended = self._ended.wait(_WRITE_S)
            done = self._attempt(self._write)
            if done and (ended or time.monotonic() - tidied_s >= _TIDY_S):
                tidied_s = time.monotonic()
                self._attempt(Store.tidy)
            if ended and (done or time.monotonic() > self._until_s):
                break
            if ended:
                time.sleep(_WRITE_S)
        if self._store is not None:
            self._store.close()

    def _attempt(self, work: Callable[[Store], None]) -> bool:
        """One write; False if it failed, after which the store is reopened."""
        self._began_s = time.monotonic()
        try:
            if self._store is None:
                if self._damaged > 1:
                    set_aside(self.location)
                self._store = self._open()
            work(self._store)
        except Exception as error:  # the thread must survive, as its end would go unnoticed
            self._fail(error)
            return False
        finally:
            self._began_s = None
        self._is_failing, self._damaged = False, 0
        return True

    def _write(self, store: Store) -> None:
        while True:
            with self._lock:
                batch = list(islice(self._waiting, _AT_A_TIME))
            if not batch:
                return
            self._began_s = time.monotonic()
            store.take(batch)
            with self._lock:
                for _ in batch:
                    message = self._waiting.popleft()
                    self._bytes -= len(message.text) if isinstance(message, Message) else 0

    def _fail(self, error: Exception) -> None:
        self._is_failing = True
        self._failed(reason(error))
        if isinstance(error, sqlite3.Error):
            self._damaged = self._damaged + 1 if is_damage(error) else 0
        if self._store is not None and self._store.location.path is not None:
            self._store.close()
            self._store = None


@asynccontextmanager
async def keeping(
    path: Path | None, site: Site, days: float = DAYS, megabytes: float = MEGABYTES
) -> AsyncIterator[Callable[[Message], None]]:
    """Yields a consumer that stores messages; without a path it discards them."""
    if path is None:
        yield lambda _message: None
        return
    keeper = Keeper(path, days, megabytes)
    keeper.place(site.station, site.origin)
    try:
        yield keeper
    finally:
        keeper.close()
