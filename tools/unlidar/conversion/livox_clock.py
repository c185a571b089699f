"""Unix time of the packets of a recorded Livox LiDAR."""

from collections import deque
from statistics import median_low

from unlidar import livox
from unlidar.stamps import MOST_STAMP_NS

_MAX_STEP_NS = 1_000_000_000  # a larger step is a restart or a pause, no drift
_MAX_LEAD_NS = 60_000_000_000  # over the capture, of few packets; TAI is 37 s ahead
_MAX_SLEW = 5000  # a frame by this part of it: 200 ppm, more than two crystals ever differ by
_LAST_PACKETS = 21  # whose median is followed, and which are believed if they agree


class LivoxClock:
    """The clock of one sensor, by the rules of `unlidar_track --livox`.

    Synchronised stamps are Unix time. One that is more than a second from those before, and from
    where the capture's clock has gone since, is astray, until so many in a row agree. Others count
    from power-on, or go on from a synchronisation that was lost: their clock is set to the
    capture's, and slewed to follow it, between frames. It is set anew where no packet was captured
    for a second and where the stamps jump. Where a synchronisation is lost it goes on where the
    stamps do, else it is set to the capture's. Never back, but from a time that few packets had.

    Without a capture stamps are the time, and one that jumps is astray.
    """

    def __init__(self, frame_ns: int) -> None:
        """`frame_ns`: frame k covers [k, k + 1) * frame_ns."""
        self._frame_ns = frame_ns
        self._zero_ns: int | None = None  # Unix time at which the stamps were 0; None: to be set
        self._before_ns = 0  # the same for stamps before _turned_at_ns
        self._turned_at_ns = 0
        self._newest_ns = 0
        self._captured_ns = 0  # time of capture of the last packet that was not astray
        self._followed = 0  # the frame
        self._lags_ns: deque[int] = deque(maxlen=_LAST_PACKETS)
        # Of the last packets that were not astray: their times, and by how much the capture's
        # clock was ahead.
        self._times_ns: deque[int] = deque(maxlen=_LAST_PACKETS)
        self._behind_ns: deque[int] = deque(maxlen=_LAST_PACKETS)
        self._astray_ns, self._astray_in_a_row = 0, 0

    @property
    def now_ns(self) -> int:
        """The time of the sensor, which neither reordered packets nor a few wrong ones move."""
        return median_low(self._times_ns)

    def time_ns(self, packet: livox.Packet, captured_ns: int | None) -> int | None:
        """The time of the next packet, None if it is astray.

        `captured_ns`: when it was captured; None where that is not known.
        """
        stamp_ns = packet.stamp_ns
        if not packet.synchronised and captured_ns is not None:
            time_ns = self._unix_ns(stamp_ns, captured_ns)
        elif self._is_believed(stamp_ns, captured_ns):
            self._zero_ns, time_ns = None, stamp_ns
        else:
            return None
        self._astray_in_a_row = 0
        self._newest_ns = max(self._newest_ns, time_ns)
        self._times_ns.append(time_ns)
        if captured_ns is not None:
            self._captured_ns = captured_ns
            self._behind_ns.append(captured_ns - time_ns)
            if self._zero_ns is not None:
                self._follow(self._zero_ns, time_ns, captured_ns - stamp_ns)
        return time_ns

    def _is_believed(self, time_ns: int, captured_ns: int | None) -> bool:
        if time_ns > MOST_STAMP_NS:
            return False
        is_near = not self._times_ns or abs(time_ns - self.now_ns) <= _MAX_STEP_NS
        if captured_ns is not None and self._behind_ns:
            expected_ns = captured_ns - median_low(self._behind_ns)
            is_near = is_near or abs(time_ns - expected_ns) <= _MAX_STEP_NS
        if is_near:
            return True
        agrees = abs(time_ns - self._astray_ns) <= _MAX_STEP_NS
        self._astray_in_a_row = self._astray_in_a_row + 1 if agrees else 1
        self._astray_ns = time_ns
        if self._astray_in_a_row < _LAST_PACKETS:
            return False
        self._forget()
        return True

    def _forget(self) -> None:
        self._times_ns.clear()
        self._behind_ns.clear()
        self._newest_ns = 0

    def _unix_ns(self, stamp_ns: int, captured_ns: int) -> int:
        has_paused = captured_ns - self._captured_ns > _MAX_STEP_NS
        if self._zero_ns is None and not has_paused and self._is_near(stamp_ns):
            self._set_zero(0)  # it has lost its synchronisation, and goes on by itself
        elif self._zero_ns is None or has_paused or not self._is_near(stamp_ns + self._zero_ns):
            is_ahead = self._newest_ns > captured_ns + _MAX_LEAD_NS
            if is_ahead and len(self._times_ns) < _LAST_PACKETS:
                self._forget()
            self._set_zero(max(captured_ns, self._newest_ns) - stamp_ns)
        is_before = stamp_ns < self._turned_at_ns
        return stamp_ns + (self._before_ns if is_before else self._zero_ns)

    def _is_near(self, time_ns: int) -> bool:
        return bool(self._times_ns) and abs(time_ns - self._newest_ns) <= _MAX_STEP_NS

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
