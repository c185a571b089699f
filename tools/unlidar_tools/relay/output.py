"""A queue before somebody who may be away: order is kept, room is bounded, losses are counted."""

import asyncio
import contextlib
import random
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Generic, Protocol, TypeVar

from unlidar_tools.errors import reason
from unlidar_tools.reporting import RateLimitedNote, note

T = TypeVar("T")

_WAIT_S = 0.5, 30.0  # between two attempts, the first and the longest
_SHARE = 64  # so many messages are handed over at once; when connected one, then twice as many
# A message is left out when so many trials in a row showed that others get through where it does
# not. In a trial up to so many others go before it: a link that breaks by itself, when and however
# often it likes, would have to do so at a place drawn by lot, each time: once in 16**6 messages.
_TRIALS, _MOST_BEFORE = 6, 16
_LOSSES = 4  # before another one is sent out of turn, where none has arrived that could be again
_SHOWN = 80  # characters of such a message


class Sender(Protocol[T]):
    """A way to somebody.

    Every method may throw OSError, or ValueError: then it is closed and connected again.
    """

    reach: str  # of a message that is counted as sent: how far it came

    async def connect(self) -> None:
        """Ready to send when it returns."""

    async def send(self, messages: Sequence[T], arrived: Callable[[], None]) -> None:
        """Returns when the other side has them, as far as the protocol tells.

        `arrived` is called for each, in their order, also before those behind it have.
        """

    async def lost(self) -> None:
        """Returns or throws OSError when the other side has left; else never."""

    async def close(self) -> None:
        """Throws nothing."""


class Output(Generic[T]):
    """Sends what is offered, in this order, however often the way is lost.

    What had not arrived when it was lost is sent again: it may arrive twice, and not in another
    order. A message is left out only where others get through and it does not.
    """

    def __init__(self, name: str, sender: Sender[T], room: int, probe: T | None = None) -> None:
        """`probe`: a message that does no harm whenever and however often it comes."""
        self.name = name
        self._sender = sender
        self._room = room
        self._queue: deque[_Waiting[T]] = deque()
        self._in_flight = 0  # so many at its front are being sent
        self._share = 1
        self._last = probe  # that has arrived
        self._passed = 0  # so many got through, also those that had before
        self._filled = asyncio.Event()
        self._emptied = asyncio.Event()
        self._emptied.set()
        self._drop = RateLimitedNote(f"{name}: queue full, the oldest is left out")
        self._refuse = RateLimitedNote(f"{name}: a message is left out, others get through")
        self._away = False
        self.sent = 0

    @property
    def dropped(self) -> int:
        """So many were left out."""
        return self._drop.count + self._refuse.count

    @property
    def reach(self) -> str:
        """How far a message that was sent has come."""
        return self._sender.reach

    @property
    def waiting(self) -> int:
        """So many were neither sent nor left out."""
        return len(self._queue)

    def offer(self, message: T, spare: bool) -> None:
        """Never waits. Where there is no room the oldest that one can `spare` goes."""
        self._queue.append(_Waiting(message, spare))
        while self.waiting - self._in_flight > self._room:  # what is being sent may have arrived
            rest = enumerate(islice(self._queue, self._in_flight, None), self._in_flight)
            del self._queue[next((i for i, entry in rest if entry.spare), self._in_flight)]
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
                passed, self._share = self._passed, 1
                try:
                    await self._send_all()
                finally:
                    if self._passed > passed:
                        wait_s = _WAIT_S[0]
            except (OSError, ValueError) as error:
                if not self._away:
                    note(f"{self.name}: {reason(error)}; it is tried again")
                self._away = True
            finally:
                await self._sender.close()
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
                if self._queue:
                    await self._send_some()
                if not self._queue:
                    self._filled.clear()
                    self._emptied.set()
        finally:
            lost.cancel()
            await asyncio.wait({lost})  # itself may be cancelled, which must not pass for its end
            lost.cancelled() or lost.exception()  # it was seen

    async def _send_some(self) -> None:
        """A share; of one that the way was lost with, its first message by itself."""
        first = self._queue[0]
        self._in_flight = min(self._share, self.waiting)
        try:
            if first.losses % 2 and (other := self._other(first.losses)) is not None:
                await self._try(first, other)
            else:
                messages = [waiting.message for waiting in islice(self._queue, self._in_flight)]
                await self._sender.send(messages, self._arrived)
        except (OSError, ValueError):
            if self._queue and self._queue[0] is first:
                first.losses += self._in_flight == 1
            raise
        else:
            self._share = min(2 * self._share, _SHARE)
        finally:
            self._in_flight = 0

    def _other(self, losses: int) -> T | None:
        """The newest that has arrived, else the probe or, out of turn, the next."""
        if self._last is not None:
            return self._last
        may_be_next = losses > _LOSSES and self.waiting > 1
        return self._queue[1].message if may_be_next else None

    async def _try(self, first: "_Waiting[T]", other: T) -> None:
        """Whether it is the first message or the way: one that may arrive twice goes before it."""
        doubts, first.doubts = first.doubts, 0
        for _ in range(random.randint(1, _MOST_BEFORE)):
            await self._sender.send([other], self._pass)
        try:
            await self._sender.send([first.message], self._arrived)
        except (OSError, ValueError) as error:
            first.doubts = doubts + 1
            if first.doubts >= _TRIALS:
                self._queue.popleft()
                self._refuse(f"{reason(error)}: {str(first.message)[:_SHOWN]}")
            raise

    def _arrived(self) -> None:
        self._last = self._queue.popleft().message
        self._in_flight -= 1
        self.sent += 1
        self._pass()

    def _pass(self) -> None:
        self._passed += 1


@dataclass(eq=False)
class _Waiting(Generic[T]):
    message: T
    spare: bool  # may be left out
    losses: int = 0  # so often the way was lost with it alone; each second time in a trial
    doubts: int = 0  # so many trials in a row it did not get through, and others did
