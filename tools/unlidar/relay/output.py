"""Bounded, ordered queue for a receiver that may be unreachable; losses are counted."""

import asyncio
import contextlib
import random
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Generic, Protocol, TypeVar

from unlidar.errors import reason
from unlidar.reporting import RateLimitedNote, note

T = TypeVar("T")

_WAIT_S = 0.5, 30.0  # retry delay, first and longest
_SHARE = 64  # largest batch; starts at one after connecting and doubles
# A message is dropped after _TRIALS trials in a row in which others got through and it did not.
# Up to _MOST_BEFORE others, a random number, precede it in a trial: a link that breaks by itself
# would have to break at a random position each time, a chance of one in 16**6.
_TRIALS, _MOST_BEFORE = 6, 16
_LOSSES = 4  # before another message is sent out of turn if none has arrived yet
_MOST_REASON = 200
_SHOWN = 80  # characters of a dropped message shown in notes


class Sender(Protocol[T]):
    """Connection to a receiver.

    Every method may throw OSError or ValueError, upon which it is closed and reconnected.
    """

    reach: str  # meaning of "sent" for this protocol

    async def connect(self) -> None:
        """Connects; ready to send on return."""

    async def send(self, messages: Sequence[T], arrived: Callable[[], None]) -> None:
        """Sends messages; returns when the receiver has them, as far as the protocol tells.

        `arrived` is called for each in order, possibly before later ones have arrived.
        """

    async def lost(self) -> None:
        """Returns or throws OSError when the connection is lost; else never."""

    async def close(self) -> None:
        """Closes; throws nothing."""


class Backoff:
    """Pauses between trials to reach a receiver; says when it is away and there again."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._wait_s = _WAIT_S[0]
        self.is_away = False

    def reached(self, waiting: int) -> None:
        """Notes that the receiver is there again, if it was away."""
        if self.is_away:
            note(f"{self._name}: is there again, {waiting} messages wait")
        self.is_away = False

    def failed(self, error: Exception) -> None:
        """Notes that the receiver is away, once."""
        if not self.is_away:
            note(f"{self._name}: {reason(error)[:_MOST_REASON]}; it is tried again")
        self.is_away = True

    def restart(self) -> None:
        """Makes the next pause the shortest, as the receiver has taken something."""
        self._wait_s = _WAIT_S[0]

    async def wait(self) -> None:
        """The pause, twice as long as the one before."""
        await asyncio.sleep(self._wait_s * random.uniform(0.75, 1.25))
        self._wait_s = min(2 * self._wait_s, _WAIT_S[1])


class Output(Generic[T]):
    """Sends offered messages in order, across lost connections.

    Unacknowledged messages are sent again: delivery is at least once and in order. A message is
    dropped only if others get through and it does not.
    """

    def __init__(self, name: str, sender: Sender[T], room: int, probe: T | None = None) -> None:
        """`probe`: a message without side effects at any time and number."""
        self.name = name
        self._sender = sender
        self._room = room
        self._queue: deque[_Waiting[T]] = deque()
        self._in_flight = 0  # number of front messages being sent
        self._share = 1
        self._last = probe  # the last message that arrived
        self._passed = 0  # arrivals, repeated ones included
        self._filled = asyncio.Event()
        self._emptied = asyncio.Event()
        self._emptied.set()
        self._drop = RateLimitedNote(f"{name}: queue full, the oldest is left out")
        self._refuse = RateLimitedNote(f"{name}: a message is left out, others get through")
        self._backoff = Backoff(name)
        self.sent = 0

    @property
    def dropped(self) -> int:
        """Number of dropped messages."""
        return self._drop.count + self._refuse.count

    @property
    def reach(self) -> str:
        """Meaning of "sent" for this output."""
        return self._sender.reach

    @property
    def waiting(self) -> int:
        """Number of queued messages."""
        return len(self._queue)

    def offer(self, message: T, spare: bool) -> None:
        """Queues a message without waiting; if full, drops the oldest that is `spare`."""
        self._queue.append(_Waiting(message, spare))
        while self.waiting - self._in_flight > self._room:  # in flight: kept
            rest = enumerate(islice(self._queue, self._in_flight, None), self._in_flight)
            del self._queue[next((i for i, entry in rest if entry.spare), self._in_flight)]
            self._drop(f"{self._room} messages wait")
        self._filled.set()
        self._emptied.clear()

    async def run(self) -> None:
        """Sends for ever."""
        while True:
            try:
                await self._sender.connect()
                self._backoff.reached(self.waiting)
                passed, self._share = self._passed, 1
                try:
                    await self._send_all()
                finally:
                    if self._passed > passed:
                        self._backoff.restart()
            except (OSError, ValueError) as error:
                self._backoff.failed(error)
            finally:
                await self._sender.close()
            await self._backoff.wait()

    async def drain(self, seconds: float) -> None:
        """Waits until all is sent, at most `seconds`; returns at once if not connected."""
        if self._backoff.is_away:
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
            await asyncio.wait({lost})  # distinguishes its cancellation from ours
            lost.cancelled() or lost.exception()  # it was seen

    async def _send_some(self) -> None:
        """Sends a batch; after a loss the first message of the batch alone."""
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
        """A message for a trial: the newest that has arrived, else the probe, else the next."""
        if self._last is not None:
            return self._last
        may_be_next = losses > _LOSSES and self.waiting > 1
        return self._queue[1].message if may_be_next else None

    async def _try(self, first: "_Waiting[T]", other: T) -> None:
        """Tests if the first message or the connection fails, by a repeatable one before it."""
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
    spare: bool  # may be dropped
    losses: int = 0  # losses with this message alone; each second in a trial
    doubts: int = 0  # consecutive trials in which others got through and it did not
