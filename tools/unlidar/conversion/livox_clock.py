"""Unix time of the packets of a recorded Livox LiDAR."""

from collections import deque
from statistics import median_low

from unlidar import livox

_MAX_STEP_NS = 1_000_000_000  # a larger step is a restart or a pause, no drift
_MAX_SLEW = 5000  # a frame by this part of it: 200 ppm, more than two crystals ever differ by
_LAST_PACKETS = 21  # whose median lag is followed


class LivoxClock:
    """The clock of one sensor, by the rules of `unlidar_track --livox`.

    Synchronised stamps are Unix time. Others count from power-on, or go on from a synchronisation
    that was lost: their clock is set to the capture's, and slewed to follow it, between frames. It
    is set anew, never back, where no packet was captured for a second, where the stamps jump, and
    where a synchronisation is lost once more.
    """

    def __init__(self, frame_ns: int) -> None:
        """`frame_ns`: frame k covers [k, k + 1) * frame_ns."""
        self._frame_ns = frame_ns
        self._zero_ns: int | None = None  # Unix time at which the stamps were 0; None: to be set
        self._before_ns = 0  # the same for stamps before _turned_at_ns
        self._turned_at_ns = 0
        self._newest_ns: int | None = None
        self._captured_ns = 0  # time of capture of the last packet
        self._followed = 0  # the frame
        self._lags_ns: deque[int] = deque(maxlen=_LAST_PACKETS)

    def time_ns(self, packet: livox.Packet, captured_ns: int) -> int:
        """The time of the next packet, which was captured at `captured_ns`."""
        if packet.synchronised:
            self._zero_ns, time_ns = None, packet.stamp_ns
        else:
            time_ns = self._unix_ns(packet.stamp_ns, captured_ns)
        self._newest_ns = time_ns if self._newest_ns is None else max(self._newest_ns, time_ns)
        self._captured_ns = captured_ns
        if self._zero_ns is not None:
            self._follow(self._zero_ns, time_ns, captured_ns - packet.stamp_ns)
        return time_ns

    def _unix_ns(self, stamp_ns: int, captured_ns: int) -> int:
        has_paused = captured_ns - self._captured_ns > _MAX_STEP_NS
        if self._zero_ns is None and not has_paused and self._is_near(stamp_ns):
            self._set_zero(0)  # it has lost its synchronisation, and goes on by itself
        elif self._zero_ns is None or has_paused or not self._is_near(stamp_ns + self._zero_ns):
            newest_ns = captured_ns if self._newest_ns is None else self._newest_ns
            self._set_zero(max(captured_ns, newest_ns) - stamp_ns)
        is_before = stamp_ns < self._turned_at_ns
        return stamp_ns + (self._before_ns if is_before else self._zero_ns)

    def _is_near(self, time_ns: int) -> bool:
        return self._newest_ns is not None and abs(time_ns - self._newest_ns) <= _MAX_STEP_NS

    def _set_zero(self, zero_ns: int) -> None:
        self._zero_ns = self._before_ns = zero_ns
        self._lags_ns.clear()

    def _follow(self, zero_ns: int, time_ns: int, lag_ns: int) -> None:
        self._lags_ns.append(lag_ns)
        frame = time_ns // self._frame_ns
        if frame == self._followed:
            return
        self._followed = frame
        self._before_ns, self._turned_at_ns = zero_ns, (frame + 1) * self._frame_ns - zero_ns
        most_ns = self._frame_ns // _MAX_SLEW
        ahead_ns = median_low(self._lags_ns) - zero_ns
        self._zero_ns = zero_ns + max(-most_ns, min(ahead_ns, most_ns))
