"""What time it is for a stream of events, and which of its stamps are to be believed.

A stamp is believed where this computer's clock bears it out. A stream may also be of another time
(a recording that is played, a LiDAR without PTP): then its own stamps bear each other out. A stamp
that neither bears out is not believed until several agree, however far ahead of all others it is.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

AHEAD_S = 10.0  # of this computer's clock, at most; and a row's stamp of its event's
BEHIND_S = 7 * 86400.0  # a file that is read from its begin, a quiet week
_LIVE_S = 60.0  # a stamp so near to this computer's clock is of a stream that runs now
_HOLDS_S = 30.0  # for so long a stamp that was borne out keeps the stream from another time
_NIGHT_S = 86400.0  # in a stream of another time: a pause, or a clock that was set back
_GOES_ON_S = 5.0  # of a stream of now whose clock is at the edge of what is borne out
_AGREE_S, _AGREE = 60.0, 3  # so many stamps in a row, each so near to the one before
_STEP_S = 10.0  # one stamp makes things older by so much at most


@dataclass
class Progress:
    """How much time the stamps of one or several streams say has passed."""

    seconds: float = 0.0


@dataclass(frozen=True)
class Heard:
    """When something was heard: `StreamClock.age_s` tells how long ago that is."""

    machine_s: float
    progress_s: float
    live: bool


class StreamClock:
    """The time of one stream. One stamp, whatever it says, makes nothing older than 10 s."""

    def __init__(
        self,
        wall_s: Callable[[], float] = time.time,
        machine_s: Callable[[], float] = time.monotonic,
        progress: Progress | None = None,
    ) -> None:
        """`progress`: shared by streams that grow old together. The clocks are for tests only."""
        self._wall_s, self._machine_s = wall_s, machine_s
        self._progress = Progress() if progress is None else progress
        self._own_s = self._progress.seconds  # of the fastest of all, at the begin
        self.newest_ns = 0  # of the newest stamp that was believed; also goes back with the stream
        self._newest_heard_s: float | None = None
        self._borne_out_s: float | None = None
        self._other_ns, self._others = 0, 0

    def believes(self, stamp_ns: int) -> bool:
        """Whether what has this stamp is to be taken in; the stream's time follows."""
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
        """What time it is for the stream, also while it says nothing; 0 before its first stamp."""
        if self._newest_heard_s is None:
            return 0
        if self._is_borne_out(self.newest_ns):
            return round(self._wall_s() * 1e9)
        return self.newest_ns + round((self._machine_s() - self._newest_heard_s) * 1e9)

    def heard(self, stamp_ns: int) -> Heard:
        """That something with this stamp was heard just now, to be kept with what grows old."""
        live = abs(self._wall_s() - stamp_ns * 1e-9) <= _LIVE_S
        return Heard(self._machine_s(), self._progress.seconds, live)

    def age_s(self, heard: Heard) -> float:
        """By this computer's clock; of a stream of another time also by its stamps."""
        passed_s = self._machine_s() - heard.machine_s
        return passed_s if heard.live else max(passed_s, self._progress.seconds - heard.progress_s)

    def _is_borne_out(self, stamp_ns: int) -> bool:
        return -BEHIND_S <= stamp_ns * 1e-9 - self._wall_s() <= AHEAD_S

    def _is_of_stream(self, stamp_ns: int, machine_s: float) -> bool:
        """Not far from what was said last."""
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
