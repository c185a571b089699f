"""How long something has been kept, whatever this computer's clock is set to.

A store has a time of its own. While it is written it goes as a clock that nobody can set; how
long the computer was off, or nobody wrote, is taken from the one that can be: only after that has
gone on evenly for an hour, and only where not all that is kept would be too old by it.
"""

import time
from collections.abc import Callable

from unlidar_tools.reporting import note

_APART_NS = 600_000_000_000  # more between two looks: the clock was set
_AGREE_NS = 3_600_000_000_000  # for so long the two agree before it is believed
_MOST_NS = 1 << 62  # SQLite holds twice as much


def _steady_ns() -> int:
    """Also while the computer sleeps, where the system has such a clock."""
    return time.clock_gettime_ns(getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC))


Mark = tuple[int, int]  # a store's time, and the date then as far as it is known


class Ageing:
    """The time of a store, however often it is opened anew."""

    def __init__(
        self,
        clock_ns: Callable[[], int] = time.time_ns,
        steady_ns: Callable[[], int] = _steady_ns,
    ) -> None:
        """The clock that may be set, and one that may not."""
        self._clock_ns, self._steady_ns = clock_ns, steady_ns
        self._wall_ns, self._looked_ns = clock_ns(), steady_ns()  # at the last look
        self._even_since_ns = self._looked_ns
        # What the store's time and the date are ahead of the steady clock.
        self._time_ns = self._date_ns = self._wall_ns - self._looked_ns
        self._most_ns: int | None = None
        self._is_counted = True  # how long it was off

    def begin(self, kept: Mark | None, most_ns: int) -> None:
        """`kept`: the newest mark in the store, which keeps for `most_ns`.

        A store that was replaced, or written by others, may be ahead of this time.
        """
        is_first, self._most_ns = self._most_ns is None, most_ns
        if kept is None or not all(type(value) is int and 0 <= value < _MOST_NS for value in kept):
            return
        if is_first:
            self._time_ns, self._date_ns = (value - self._looked_ns for value in kept)
            self._is_counted = False
        self._time_ns = max(self._time_ns, kept[0] - self._looked_ns)

    def now_ns(self) -> int:
        """The store's time, which never goes back."""
        return self.mark()[0]

    def mark(self) -> Mark:
        """What the store is to know of this moment. To be asked again and again."""
        wall_ns, steady_ns = self._clock_ns(), self._steady_ns()
        apart_ns = (wall_ns - self._wall_ns) - (steady_ns - self._looked_ns)
        self._wall_ns, self._looked_ns = wall_ns, steady_ns
        if abs(apart_ns) > _APART_NS:
            self._even_since_ns = steady_ns
        if steady_ns - self._even_since_ns >= _AGREE_NS:
            if not self._is_counted:
                self._count(wall_ns - steady_ns - self._date_ns)
            self._date_ns = wall_ns - steady_ns
        return steady_ns + self._time_ns, steady_ns + self._date_ns

    def _count(self, off_ns: int) -> None:
        """How long nobody wrote."""
        self._is_counted = True
        if 0 <= off_ns < (self._most_ns or 0):
            self._time_ns += off_ns
        elif off_ns > 0:
            note(
                f"by this computer's clock nothing was kept for {off_ns / 86400e9:.0f} days: as it "
                "may be wrong they do not count, what was kept before stays longer"
            )
