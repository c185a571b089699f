"""Time of a stream of events, and validation of its stamps.

A stamp is accepted if it agrees with this computer's clock. Streams of another time (a recording
that is played, a LiDAR without PTP) are consistent with themselves instead. A stamp that agrees
with neither is rejected until several such stamps agree, however far ahead it is.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

AHEAD_S = 10.0  # largest lead over this computer's clock, and of a row over its event
BEHIND_S = 7 * 86400.0  # covers a file read from its begin, or a quiet week
_LIVE_S = 60.0  # stamps this near to the clock mark a live stream
_HOLDS_S = 30.0  # after a live stamp the stream cannot change to another time for so long
_NIGHT_S = 86400.0  # largest gap in a stream of another time: a pause, or a clock set back
_GOES_ON_S = 5.0  # tolerance for a live stream at the edge of AHEAD_S
_AGREE_S, _AGREE = 60.0, 3  # a new time needs _AGREE consecutive stamps, each this near to the last
_STEP_S = 10.0  # largest ageing by a single stamp


@dataclass
class Progress:
    """Time that has passed by the stamps of one or several streams."""

    seconds: float = 0.0


@dataclass(frozen=True)
class Heard:
    """Reception time of something, for `StreamClock.age_s`."""

    machine_s: float
    progress_s: float
    live: bool


class StreamClock:
    """The time of one stream. A single stamp ages nothing by more than 10 s."""

    def __init__(
        self,
        wall_s: Callable[[], float] = time.time,
        machine_s: Callable[[], float] = time.monotonic,
        progress: Progress | None = None,
    ) -> None:
        """`progress`: shared by streams with common ageing. The clocks are for tests."""
        self._wall_s, self._machine_s = wall_s, machine_s
        self._progress = Progress() if progress is None else progress
        self._own_s = self._progress.seconds  # shared progress at the start of this stream
        self.newest_ns = 0  # newest accepted stamp; steps back with the stream
        self._newest_heard_s: float | None = None
        self._borne_out_s: float | None = None
        self._other_ns, self._others = 0, 0

    def believes(self, stamp_ns: int) -> bool:
        """True if a stamp is accepted; updates the stream's time."""
        machine_s = self._machine_s()
        if self._is_borne_out(stamp_ns):
            self._borne_out_s = machine_s
        elif not (self._is_of_stream(stamp_ns, machine_s) or self._is_agreed(stamp_ns, machine_s)):
            return False
        self._others = 0
        if self._newest_heard_s is not None:
            self._own_s += min(max(0.0, (stamp_ns - self.newest_ns) * 1e-9), _STEP_S)
            self._progress.seconds = max(self._progress.seconds, self._own_s)
        self.newest_ns, self._newest_heard_s = stamp_ns, machine_s
        return True

    def now_ns(self) -> int:
        """The stream's time in ns, extrapolated while it is silent; 0 before its first stamp."""
        if self._newest_heard_s is None:
            return 0
        if self._is_borne_out(self.newest_ns):
            return round(self._wall_s() * 1e9)
        return self.newest_ns + round((self._machine_s() - self._newest_heard_s) * 1e9)

    def heard(self, stamp_ns: int) -> Heard:
        """The reception mark of something with this stamp, received now."""
        live = abs(self._wall_s() - stamp_ns * 1e-9) <= _LIVE_S
        return Heard(self._machine_s(), self._progress.seconds, live)

    def age_s(self, heard: Heard) -> float:
        """Age in s by this computer's clock; for a stream of another time also by its stamps."""
        passed_s = self._machine_s() - heard.machine_s
        return passed_s if heard.live else max(passed_s, self._progress.seconds - heard.progress_s)

    def _is_borne_out(self, stamp_ns: int) -> bool:
        return -BEHIND_S <= stamp_ns * 1e-9 - self._wall_s() <= AHEAD_S

    def _is_of_stream(self, stamp_ns: int, machine_s: float) -> bool:
        """True if a stamp is near the stream's last one."""
        if self._newest_heard_s is None:
            return True
        apart_s = _GOES_ON_S if self._holds(machine_s) else _NIGHT_S
        passed_s = machine_s - self._newest_heard_s
        return -apart_s <= (stamp_ns - self.newest_ns) * 1e-9 <= apart_s + passed_s

    def _is_agreed(self, stamp_ns: int, machine_s: float) -> bool:
        near = self._others and abs(stamp_ns - self._other_ns) <= _AGREE_S * 1e9
        self._others = self._others + 1 if near else 1
        self._other_ns = stamp_ns
        return self._others >= _AGREE and not self._holds(machine_s)

    def _holds(self, machine_s: float) -> bool:
        return self._borne_out_s is not None and machine_s - self._borne_out_s < _HOLDS_S
