"""A fair queue: no sender can take the room or the turn of another.

Sender names are free to invent. New senders therefore share one first-come queue, the hall: it has
a part of the room and, like each known sender, one turn.
"""

import threading
from collections import OrderedDict, deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")
# Room of all known senders, and of the hall, in units of one sender's room.
_SHARES, _HALL_SHARES = 6, 2
# Capacity of the hall and of the memory of senders heard once, and of those heard again, in units
# of the number of senders.
_NEW, _KNOWN = 64, 4


class FairQueue(Generic[T]):
    """Filled by any thread. A sender beyond its room delays and loses only its own items."""

    def __init__(
        self,
        most_senders: int,
        most_items: int,
        most_bytes: int,
        lost: Callable[[str], object] = lambda sender: None,
    ) -> None:
        """`most_items`, `most_bytes`: bounds of one sender; eight times the bytes for all.

        `lost`: called with the sender of each item that is dropped for lack of room.
        """
        self._most_new, self._most_known = _NEW * most_senders, _KNOWN * most_senders
        self._most_items, self._most_bytes = most_items, most_bytes
        self._lost = lost
        self._lock = threading.Lock()
        self._queues: dict[str, deque[tuple[T, int]]] = {}
        self._bytes: dict[str, int] = {}
        # In order of turns; None is the hall.
        self._turns: OrderedDict[str | None, None] = OrderedDict()
        self._hall: OrderedDict[str, None] = OrderedDict()
        self._known_bytes = self._hall_bytes = 0
        # Two classes, so that a flood of names cannot displace senders that were heard repeatedly.
        self._once: OrderedDict[str, None] = OrderedDict()
        self._often: OrderedDict[str, None] = OrderedDict()

    def put(self, sender: str, item: T, size: int) -> bool:
        """Adds an item; False if there is no room for it.

        If all is full, the known sender with the most bytes gives way to other known ones.
        """
        losers: list[str] = []
        with self._lock:
            is_new = self._is_new(sender)
            has_room = self._make_room(sender, size, is_new, losers)
            if has_room:
                self._queues.setdefault(sender, deque()).append((item, size))
                self._count(sender, size, is_new)
                if is_new:
                    self._hall[sender] = self._turns[None] = None
                else:
                    self._turns[sender] = None
            else:
                losers.append(sender)
        for loser in losers:
            self._lost(loser)
        return has_room

    def take(self, most: int) -> list[T]:
        """At most `most` items, one of each sender in turn."""
        taken = []
        with self._lock:
            while self._turns and len(taken) < most:
                turn, _ = self._turns.popitem(last=False)
                sender = self._next_new() if turn is None else turn
                item, size = self._queues[sender].popleft()
                taken.append(item)
                self._count(sender, -size, is_new=False)
                if self._queues[sender]:
                    self._turns[sender] = None
                else:
                    del self._queues[sender], self._bytes[sender]
        return taken

    def _next_new(self) -> str:
        """The first item of the hall, whose sender becomes known."""
        sender, _ = self._hall.popitem(last=False)
        self._hall_bytes -= self._bytes[sender]
        self._known_bytes += self._bytes[sender]
        if self._hall:
            self._turns[None] = None
        _remember(self._once, sender, self._most_new)
        return sender

    def _is_new(self, sender: str) -> bool:
        """True if a sender belongs into the hall. A sender heard again is marked as such."""
        if sender in self._once or sender in self._often:
            self._once.pop(sender, None)
            _remember(self._often, sender, self._most_known)
            return False
        return sender in self._hall or sender not in self._queues

    def _make_room(self, sender: str, size: int, is_new: bool, losers: list[str]) -> bool:
        """Drops items of others, added to `losers`; False if the sender exceeds its share."""
        own = self._bytes.get(sender, 0) + size
        if len(self._queues.get(sender, ())) >= self._most_items or own > self._most_bytes:
            return False
        if is_new:
            has_place = sender in self._hall or len(self._hall) < self._most_new
            return has_place and self._hall_bytes + size <= _HALL_SHARES * self._most_bytes
        while self._known_bytes + size > _SHARES * self._most_bytes:
            fullest = max((s for s in self._turns if s is not None), key=self._bytes.__getitem__)
            if self._bytes[fullest] <= own:
                return False
            self._drop_newest(fullest)
            losers.append(fullest)
        return True

    def _drop_newest(self, sender: str) -> None:
        self._count(sender, -self._queues[sender].pop()[1], is_new=False)
        if not self._queues[sender]:
            del self._queues[sender], self._bytes[sender], self._turns[sender]

    def _count(self, sender: str, size: int, is_new: bool) -> None:
        self._bytes[sender] = self._bytes.get(sender, 0) + size
        if is_new:
            self._hall_bytes += size
        else:
            self._known_bytes += size


def _remember(names: OrderedDict[str, None], name: str, most: int) -> None:
    """Inserts a name as the newest of a bounded set."""
    names[name] = None
    names.move_to_end(name)
    if len(names) > most:
        names.popitem(last=False)
