"""A queue of several senders, of which none can take the room or the turn of another.

Names cost whoever invents them nothing. So those that were never heard wait in a hall of their own,
first come first heard: it has a part of the room and, like each sender that was heard, one turn.
"""

import threading
from collections import OrderedDict, deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")
# So many times a sender's room have all who were heard, and has the hall.
_SHARES, _HALL_SHARES = 6, 2
# So many times the senders have a place in the hall, and are remembered as heard once; and so many
# times as heard again.
_NEW, _KNOWN = 64, 4


class FairQueue(Generic[T]):
    """Filled by any thread. Who sends too much waits for himself, and loses what has no room."""

    def __init__(
        self,
        most_senders: int,
        most_items: int,
        most_bytes: int,
        lost: Callable[[str], object] = lambda sender: None,
    ) -> None:
        """`most_items`, `most_bytes`: of one sender. All of them have eight times the bytes.

        `lost`: called with the sender of each item that goes as there is no room.
        """
        self._most_new, self._most_known = _NEW * most_senders, _KNOWN * most_senders
        self._most_items, self._most_bytes = most_items, most_bytes
        self._lost = lost
        self._lock = threading.Lock()
        self._queues: dict[str, deque[tuple[T, int]]] = {}
        self._bytes: dict[str, int] = {}
        # By whose turn it is; None: the hall's.
        self._turns: OrderedDict[str | None, None] = OrderedDict()
        self._hall: OrderedDict[str, None] = OrderedDict()
        self._known_bytes = self._hall_bytes = 0
        # Heard once, and heard again: one flood of names puts nobody out who speaks often.
        self._once: OrderedDict[str, None] = OrderedDict()
        self._often: OrderedDict[str, None] = OrderedDict()

    def put(self, sender: str, item: T, size: int) -> bool:
        """False where there is no room for it.

        Where all is full the fullest sender that was heard gives way to another one that was.
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
        """So many at most, one of each sender in turn."""
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
        """The first of the hall, who is known from now on."""
        sender, _ = self._hall.popitem(last=False)
        self._hall_bytes -= self._bytes[sender]
        self._known_bytes += self._bytes[sender]
        if self._hall:
            self._turns[None] = None
        _remember(self._once, sender, self._most_new)
        return sender

    def _is_new(self, sender: str) -> bool:
        """Whether it belongs into the hall. Who is heard again is remembered so."""
        if sender in self._once or sender in self._often:
            self._once.pop(sender, None)
            _remember(self._often, sender, self._most_known)
            return False
        return sender in self._hall or sender not in self._queues

    def _make_room(self, sender: str, size: int, is_new: bool, losers: list[str]) -> bool:
        """False where the sender has no right to more. Whose items went is added to `losers`."""
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
    """As the newest of at most so many."""
    names[name] = None
    names.move_to_end(name)
    if len(names) > most:
        names.popitem(last=False)
