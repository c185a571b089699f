"""A queue before somebody who may be away: order is kept, room is bounded, losses are counted."""

import asyncio
import contextlib
import random
from collections import deque
from collections.abc import Sequence
from typing import Generic, Protocol, TypeVar

from unlidar_tools.errors import reason
from unlidar_tools.telling import Often, note

T = TypeVar("T")

_WAIT_S = 0.5, 30.0  # between two attempts, the first and the longest
_SHARE = 64  # so many messages are handed over at once


class Sender(Protocol[T]):
    """A way to somebody. Every method may throw OSError: then it is closed and connected again."""

    async def connect(self) -> None:
        """Ready to send when it returns."""

    async def send(self, messages: Sequence[T]) -> None:
        """Returns when the other side has them, as far as the protocol tells."""

    async def lost(self) -> None:
        """Returns or throws OSError when the other side has left; else never."""

    async def close(self) -> None:
        """Throws nothing."""


class Output(Generic[T]):
    """Sends what is offered, in this order, however often the way is lost.

    What was sent when it was lost is sent again: it may arrive twice, and not in another order.
    """

    def __init__(self, name: str, sender: Sender[T], room: int) -> None:
        self.name = name
        self._sender = sender
        self._room = room
        self._queue: deque[tuple[T, bool]] = deque()  # with whether it may be left out
        self._in_flight: list[tuple[T, bool]] = []
        self._filled = asyncio.Event()
        self._emptied = asyncio.Event()
        self._emptied.set()
        self._drop = Often(f"{name}: queue full, the oldest is left out")
        self._away = False
        self.sent = 0

    @property
    def dropped(self) -> int:
        """So many were left out."""
        return self._drop.count

    @property
    def waiting(self) -> int:
        """So many were neither sent nor left out."""
        return len(self._queue) + len(self._in_flight)

    def offer(self, message: T, spare: bool) -> None:
        """Never waits. Where there is no room the oldest that one can `spare` goes."""
        self._queue.append((message, spare))
        if self.waiting > self._room:
            oldest = next((i for i, entry in enumerate(self._queue) if entry[1]), 0)
            del self._queue[oldest]
            self._drop(f"{self._room} messages wait")
        self._filled.set()
        self._emptied.clear()

    async def run(self) -> None:
        """For ever."""
        wait_s = _WAIT_S[0]
        while True:
            try:
                await self._sender.connect()
                if self._away:
                    note(f"{self.name}: is there again, {self.waiting} messages wait")
                self._away = False
                begun = self.sent
                try:
                    await self._send_all()
                finally:
                    if self.sent > begun:
                        wait_s = _WAIT_S[0]
            except OSError as error:
                if not self._away:
                    note(f"{self.name}: {reason(error)}; it is tried again")
                self._away = True
            finally:
                await self._sender.close()
                self._queue.extendleft(reversed(self._in_flight))
                self._in_flight = []
            await asyncio.sleep(wait_s * random.uniform(0.75, 1.25))
            wait_s = min(2 * wait_s, _WAIT_S[1])

    async def drain(self, seconds: float) -> None:
        """Waits so long at most until everything is sent; not for somebody who is away."""
        if self._away:
            return
        with contextlib.suppress(asyncio.TimeoutError):
            await asyncio.wait_for(self._emptied.wait(), seconds)

    async def _send_all(self) -> None:
        lost = asyncio.ensure_future(self._sender.lost())
        try:
            while True:
                filled = asyncio.ensure_future(self._filled.wait())
                await asyncio.wait({filled, lost}, return_when=asyncio.FIRST_COMPLETED)
                filled.cancel()
                if lost.done():
                    lost.result()
                    raise ConnectionError("the connection was closed")
                while self._queue:
                    count = min(_SHARE, len(self._queue))
                    self._in_flight = [self._queue.popleft() for _ in range(count)]
                    await self._sender.send([message for message, _ in self._in_flight])
                    self.sent += count
                    self._in_flight = []
                self._filled.clear()
                self._emptied.set()
        finally:
            lost.cancel()
            with contextlib.suppress(asyncio.CancelledError, OSError):
                await lost
