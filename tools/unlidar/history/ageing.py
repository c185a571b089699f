"""Age of stored data for retention, robust against changes of the system clock.

A store has a time base of its own. While it is written, this follows a steady clock. Time without
a writer is taken from the system clock, but only after both clocks have agreed for an hour, and
only if that would not expire everything in the store.
"""

import time
from collections.abc import Callable

from unlidar.reporting import note

_APART_NS = 600_000_000_000  # a larger change between two readings: the clock was set
_AGREE_NS = 3_600_000_000_000  # agreement required before the system clock is trusted
_MOST_NS = 1 << 62  # half of SQLite's range


def _steady_ns() -> int:
    """A steady clock in ns that includes suspend, if the system has one."""
    return time.clock_gettime_ns(getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC))


Mark = tuple[int, int]  # store time and, if known, system time


class Ageing:
    """The time base of a store, across reopening."""

    def __init__(
        self,
        clock_ns: Callable[[], int] = time.time_ns,
        steady_ns: Callable[[], int] = _steady_ns,
    ) -> None:
        """`clock_ns`: the system clock; `steady_ns`: one that cannot be set."""
        self._clock_ns, self._steady_ns = clock_ns, steady_ns
        self._wall_ns, self._looked_ns = clock_ns(), steady_ns()  # at the last reading
        self._even_since_ns = self._looked_ns
        # Offsets of store time and system time from the steady clock.
        self._time_ns = self._date_ns = self._wall_ns - self._looked_ns
        self._most_ns: int | None = None
        self._is_counted = True  # True once the time without a writer was added

    def begin(self, kept: Mark | None, most_ns: int) -> None:
        """`kept`: the newest mark in the store; `most_ns`: its retention.

        A replaced store, or one written by another process, may be ahead of this time base.
        """
        is_first, self._most_ns = self._most_ns is None, most_ns
        if kept is None or not all(type(value) is int and 0 <= value < _MOST_NS for value in kept):
            return
        if is_first:
            self._time_ns, self._date_ns = (value - self._looked_ns for value in kept)
            self._is_counted = False
        self._time_ns = max(self._time_ns, kept[0] - self._looked_ns)

    def now_ns(self) -> int:
        """The store time, which is monotonic."""
        return self.mark()[0]

    def mark(self) -> Mark:
        """The current mark, to be stored regularly."""
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
        """Adds the time without a writer."""
        self._is_counted = True
        if 0 <= off_ns < (self._most_ns or 0):
            self._time_ns += off_ns
        elif off_ns > 0:
            note(
                f"by this computer's clock nothing was kept for {off_ns / 86400e9:.0f} days: as it "
                "may be wrong they do not count, what was kept before stays longer"
            )
