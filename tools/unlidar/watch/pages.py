"""Distribution of messages to all open pages, in batches."""

import asyncio
import contextlib
import json
import threading
import time
from collections.abc import AsyncIterator, Iterable

from unlidar.events.event import Returns
from unlidar.events.station import Message
from unlidar.watch.sky import Sky, by_itself

FRAME_S = 0.05  # shortest interval of updates
_SIGN_OF_LIFE_S = 2.0
_MOST_PAGES = 32
_MOST_WAITING = 200  # batches, ten seconds; slower pages are disconnected and reconnect
# With more messages in a frame pages get a snapshot instead, less often.
_MOST_FRESH, _MOST_BYTES = 1000, 500_000
_SNAPSHOTS_S = 1.0
# Returns of a frame in all, and batches that wait for a page at most: a slow one goes without.
_MOST_RETURNS_BYTES, _MOST_BEFORE_RETURNS = 200_000, 4

_Queue = asyncio.Queue[bytes | None]


class Pages:
    """`take` may be called from any thread, all else from the serving thread."""

    def __init__(self, sky: Sky) -> None:
        self._sky = sky
        self._lock = threading.Lock()
        self._fresh: list[str] = []
        self._bytes = 0
        self._returns: dict[tuple[str, str], str] = {}  # the newest of each LiDAR
        self._heard: set[str] = set()  # stations
        self._is_flooded = False
        self._queues: set[_Queue] = set()
        self._new: set[_Queue] = set()  # waiting for a snapshot
        self._closed = False
        self._told_s = self._snapshot_s = -_SIGN_OF_LIFE_S

    def take(self, message: Message, shown: bool = True, old: bool = False) -> None:
        """Queues a message for the next frame; if not `shown`, only marks its station as heard."""
        self._sky.take(message, shown, old)
        with self._lock:
            if not self._queues:
                return
            if by_itself(message):
                self._heard.add(message.station)
            if isinstance(message.event, Returns):
                if shown and not old:
                    self._take_returns(message, message.event)
                return
            if not shown or self._is_flooded:
                return
            self._fresh.append(message.text)
            self._bytes += len(message.text)
            self._is_flooded = len(self._fresh) > _MOST_FRESH or self._bytes > _MOST_BYTES

    def _take_returns(self, message: Message, returns: Returns) -> None:
        """Instead of those of the LiDAR that wait; left out where all that wait are too many."""
        self._returns.pop((message.station, returns.name), None)
        waiting = sum(map(len, self._returns.values()))
        if waiting + len(message.text) <= _MOST_RETURNS_BYTES:
            self._returns[message.station, returns.name] = message.text

    async def run(self) -> None:
        """Sends frames for ever."""
        while True:
            await asyncio.sleep(FRAME_S)
            self.tell()

    def tell(self) -> None:
        """Sends one frame. Each text is encoded once for all pages."""
        now_s = time.monotonic()
        if self._is_flooded and now_s - self._snapshot_s < _SNAPSHOTS_S:
            return
        with self._lock:
            fresh, self._fresh, self._bytes = self._fresh, [], 0
            returns, self._returns = self._returns, {}
            heard, self._heard = self._heard, set()
            flooded, self._is_flooded = self._is_flooded, False
            self._queues |= self._new  # from now on they get updates
            new, self._new = self._new, set()
        known = self._queues - new
        if flooded:
            new, known = self._queues, set()
        if known and (fresh or heard or now_s - self._told_s >= _SIGN_OF_LIFE_S):
            self._told_s = now_s
            told = f'"heard":{json.dumps(sorted(heard))},"events":[{",".join(fresh)}]'
            self._put(known, f"data: {{{self._sky.times()},{told}}}\n\n")
        quick = [queue for queue in known if queue.qsize() < _MOST_BEFORE_RETURNS]
        if quick and returns:
            self._put(quick, f"event: returns\ndata: [{','.join(returns.values())}]\n\n")
        if new:
            self._snapshot_s = now_s
            self._put(new, f"event: snapshot\ndata: {self._sky.snapshot()}\n\n")

    def close(self) -> None:
        """Closes all pages, which then try to reconnect."""
        self._closed = True
        for queue in self._queues | self._new:
            with contextlib.suppress(asyncio.QueueFull):
                queue.put_nowait(None)

    @property
    def count(self) -> int:
        """Number of open pages."""
        return len(self._queues) + len(self._new)

    @property
    def full(self) -> bool:
        """True if no further page can be opened."""
        return self.count >= _MOST_PAGES

    async def told(self, begin: str) -> AsyncIterator[bytes]:
        """Server-sent events of one page: a snapshot, then updates."""
        queue: _Queue = asyncio.Queue(_MOST_WAITING)
        self._new.add(queue)
        try:
            yield f"retry: 1000\nevent: begin\ndata: {begin}\n\n".encode()
            while not self._closed and (batch := await queue.get()) is not None:
                yield batch
        finally:
            self._new.discard(queue)
            with self._lock:
                self._queues.discard(queue)

    def _put(self, queues: Iterable[_Queue], text: str) -> None:
        batch = text.encode()
        for queue in list(queues):
            try:
                queue.put_nowait(batch)
            except asyncio.QueueFull:
                with self._lock:
                    self._queues.discard(queue)
                while not queue.empty():
                    queue.get_nowait()
                queue.put_nowait(None)
