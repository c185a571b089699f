"""What goes on now: tracks with their tails, LiDARs, alarms; for pages that open later."""

import json
import time
from collections import deque
from dataclasses import dataclass, field

from unlidar_tools.events.event import EngineState, Row, SensorState, TrackBegins, TrackEnds
from unlidar_tools.events.station import ALARM, RAISED, Message

TAIL_S = 60.0
_TAIL_STEP_NS = 100_000_000
# A track whose engine said nothing of its end, and nothing else for so long, is over.
_FORGET_NS = 600_000_000_000
# Stamps so far behind the machine's clock, or ahead of it, are of this clock: of a quiet week.
_BEHIND_S, _AHEAD_S = 7 * 86400.0, 10.0


@dataclass
class _Course:
    station: str
    number: int
    drone: float | None = None
    tail: deque[tuple] = field(default_factory=deque)
    newest_ns: int = 0


class Sky:
    """The newest of everything. Memory follows what flies now, not how long it runs."""

    def __init__(self) -> None:
        self._courses: dict[tuple[str, int], _Course] = {}
        self._sensors: dict[tuple[str, str], str] = {}
        self._engines: dict[str, str] = {}
        self._alarms: dict[tuple[str, int, str], str] = {}
        self.at_ns = 0
        self._heard_s = time.monotonic()

    def take(self, message: Message) -> None:
        """What follows from it."""
        if message.at_ns > self.at_ns:
            self.at_ns, self._heard_s = message.at_ns, time.monotonic()
        event, station = message.event, message.station
        match event:
            case TrackBegins():
                self._course(station, event.track).drone = event.drone
            case Row():
                self._row(self._course(station, event.track), event)
            case TrackEnds():
                self._courses.pop((station, event.track), None)
            case SensorState():
                self._sensors[station, event.name] = message.text
            case EngineState():
                self._engines[station] = message.text
        if message.kind == ALARM and message.alarm is not None:
            key = station, message.alarm.track, message.alarm.zone
            if message.alarm_state == RAISED:
                self._alarms[key] = message.text
            else:
                self._alarms.pop(key, None)

    def now_s(self) -> float:
        """What time it is for the station, also while it says nothing; 0 before its first word."""
        if self.at_ns == 0:
            return 0.0
        wall_s, at_s = time.time(), self.at_ns * 1e-9
        if -_AHEAD_S <= wall_s - at_s <= _BEHIND_S:
            return wall_s
        return at_s + time.monotonic() - self._heard_s

    def snapshot(self) -> str:
        """JSON: tracks with tails as rows of numbers, and the newest events of everything else."""
        tracks = [
            {
                "station": c.station,
                "track": c.number,
                "drone": c.drone,
                "rows": list(c.tail),
            }
            for c in self._courses.values()
            if c.tail and self.at_ns - c.newest_ns < _FORGET_NS
        ]
        events = [*self._sensors.values(), *self._engines.values(), *self._alarms.values()]
        return (
            f'{{"now":{self.now_s():.3f},"at":{self.at_ns * 1e-9:.3f},'
            f'"tracks":{json.dumps(tracks, separators=(",", ":"))},"events":[{",".join(events)}]}}'
        )

    def _course(self, station: str, number: int) -> _Course:
        return self._courses.setdefault((station, number), _Course(station, number))

    def _row(self, course: _Course, row: Row) -> None:
        if row.drone is not None:
            course.drone = row.drone
        tail = course.tail
        if len(tail) > 1 and row.timestamp - round(tail[-2][0] * 1e9) < _TAIL_STEP_NS:
            tail.pop()  # the newest stays whole, older ones are thinned
        tail.append(compact(row))
        course.newest_ns = max(course.newest_ns, row.timestamp)
        while tail[0][0] < tail[-1][0] - TAIL_S:
            tail.popleft()


def compact(row: Row) -> tuple:
    """Seconds, metres, m/s, metres, returns; to the millimetre."""
    numbers = (
        *(row.x, row.y, row.z, row.vx, row.vy, row.vz),
        *(row.sigma_x, row.sigma_y, row.sigma_z, row.support),
    )
    return (row.timestamp / 1e9, *(round(value, 3) for value in numbers))
