"""Current picture for pages that open later: tracks with tails, LiDARs, alarms.

All parts are bounded and have an age, the time since they were last heard.
"""

import json
import threading
import time
from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

from unlidar.events.clock import AHEAD_S, BEHIND_S, Heard, StreamClock
from unlidar.events.event import (
    EngineState,
    Event,
    Now,
    Row,
    SensorState,
    TrackBegins,
    TrackEnds,
    extended,
)
from unlidar.events.station import ALARM, RAISED, Message
from unlidar.limits import MOST_STATIONS
from unlidar.reporting import RateLimitedNote

TAIL_S = 60.0
FORGET_S = 600.0  # tracks, with their alarms, are dropped after this silence
MOST_TRACKS = 256
_MOST_ROWS = 20_000  # of all tails; thinned beyond
_MOST_ALARMS = 256
_MOST_SENSORS = 16  # per station, so that none displaces another's
_MOST_TEXT = 1000  # characters of a state; longer ones are cut to the page's keys
_TAIL_STEP_NS = 100_000_000
_MS_NS = 1_000_000


@dataclass
class _Course:
    station: str
    number: int
    heard: Heard
    drone: float | None = None
    tail: deque[tuple[int, str]] = field(default_factory=deque)  # stamps, and rows as JSON


@dataclass
class _Told:
    """The newest message on a subject."""

    text: str
    heard: Heard
    event: Event | None


@dataclass(frozen=True)
class Census:
    """The numbers of a picture, by station."""

    heard_s: dict[str, float]  # ages
    tracks: dict[str, int]
    alarms: dict[str, int]
    engines: dict[str, EngineState]
    sensors: list[tuple[str, SensorState]]
    newest_s: float
    is_crowded: bool


class Sky:
    """The newest state of everything; thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._courses: dict[tuple[str, int], _Course] = {}
        self._sensors: dict[str, dict[str, _Told]] = {}
        self._engines: dict[str, _Told] = {}
        self._alarms: dict[tuple[str, int, str], _Told] = {}
        self._stations: dict[str, Heard] = {}  # by station
        self._clock = StreamClock()
        self._clock_of: str | None = None  # station that drives the clock
        self._crowded_s: float | None = None
        self._too_many = RateLimitedNote("more goes on than pages can show, the oldest is left out")

    def take(self, message: Message, shown: bool = True, old: bool = False) -> None:
        """Updates the picture; if not `shown`, only marks the station as heard.

        An `old` message is dated by its stamp, as far as this computer's clock allows.
        """
        with self._lock:
            heard = self._hear(message, old)
            if by_itself(message):
                _keep(self._stations, message.station, heard, MOST_STATIONS)
            if shown:
                self._take(message, heard)

    def _take(self, message: Message, heard: Heard) -> None:
        event, station = message.event, message.station
        match event:
            case TrackBegins():
                self._course(station, event.track, heard).drone = event.drone
            case Now():
                self._course(station, event.track, heard)
            case Row():
                self._row(self._course(station, event.track, heard), event)
            case TrackEnds():
                self._courses.pop((station, event.track), None)
                for key in [key for key in self._alarms if key[:2] == (station, event.track)]:
                    del self._alarms[key]
            case SensorState():
                if station in self._sensors or len(self._sensors) < MOST_STATIONS:
                    sensors = self._sensors.setdefault(station, {})
                    told = _Told(_brief(message), heard, event)
                    self._crowded(_keep(sensors, event.name, told, _MOST_SENSORS))
            case EngineState():
                told = _Told(_brief(message), heard, event)
                _keep(self._engines, station, told, MOST_STATIONS)
        if message.kind == ALARM and message.alarm is not None:
            key = station, message.alarm.track, message.alarm.zone
            if message.alarm_state == RAISED:
                told = _Told(message.text, heard, None)
                self._crowded(_keep(self._alarms, key, told, _MOST_ALARMS))
            else:
                self._alarms.pop(key, None)

    def _hear(self, message: Message, old: bool) -> Heard:
        """The reception mark: now, or by the stamp. Accepted stamps drive the clock.

        A station with stamps of another time never takes the clock over from a live one.
        """
        behind_s = time.time() - message.at_ns * 1e-9
        is_borne_out = -AHEAD_S <= behind_s <= BEHIND_S
        may_lead = is_borne_out or self._clock_of in (None, message.station)
        if may_lead and self._clock.believes(message.at_ns):
            self._clock_of = message.station
        heard = self._clock.heard(message.at_ns)
        if old and is_borne_out:
            heard = replace(heard, machine_s=heard.machine_s - max(0.0, behind_s), live=True)
        return heard

    def now_s(self) -> float:
        """The station's time in s, extrapolated while it is silent; 0 before its first message."""
        return self._clock.now_ns() * 1e-9

    def snapshot(self) -> str:
        """JSON: tracks with tails as rows of numbers, and the newest events of everything else.

        Each has `age_s`, the time since it was last heard; `heard`: the ages of stations.
        `crowded`: something was left out recently.
        """
        with self._lock:
            self._forget()
            age_s = self._clock.age_s
            tracks = [
                f'{{"station":{json.dumps(c.station)},"track":{c.number},'
                f'"drone":{json.dumps(c.drone)},"age_s":{age_s(c.heard):.1f},'
                f'"rows":[{",".join(text for _, text in c.tail)}]}}'
                for c in self._courses.values()
                if c.tail
            ]
            sensors = (told for known in self._sensors.values() for told in known.values())
            events = [*sensors, *self._engines.values(), *self._alarms.values()]
            heard = {name: round(age_s(heard), 1) for name, heard in self._stations.items()}
            texts = [extended(told.text, {"age_s": round(age_s(told.heard), 1)}) for told in events]
            return (
                f'{{{self.times()},"tracks":[{",".join(tracks)}],"events":[{",".join(texts)}],'
                f'"heard":{json.dumps(heard)},"crowded":{json.dumps(self._is_crowded())}}}'
            )

    def census(self) -> Census:
        """The numbers of the snapshot."""
        with self._lock:
            self._forget()
            tracks = Counter(c.station for c in self._courses.values() if c.tail)
            sensors = [
                (station, told.event)
                for station, known in self._sensors.items()
                for told in known.values()
                if isinstance(told.event, SensorState)
            ]
            engines = {
                station: told.event
                for station, told in self._engines.items()
                if isinstance(told.event, EngineState)
            }
            return Census(
                {name: self._clock.age_s(heard) for name, heard in self._stations.items()},
                dict(tracks),
                dict(Counter(station for station, _, _ in self._alarms)),
                engines,
                sensors,
                self._clock.newest_ns * 1e-9,
                self._is_crowded(),
            )

    def times(self) -> str:
        """Members of a JSON object: the stations' time, their newest stamp, the server's clock."""
        return (
            f'"now":{self.now_s():.3f},"at":{self._clock.newest_ns * 1e-9:.3f},'
            f'"clock":{time.monotonic():.3f}'
        )

    def _forget(self) -> None:
        def over(heard: Iterable[tuple[object, Heard]]) -> list:
            return [key for key, at in heard if self._clock.age_s(at) >= FORGET_S]

        for key in over((key, course.heard) for key, course in self._courses.items()):
            del self._courses[key]
        alive = {key: course.heard for key, course in self._courses.items()}
        for key in over((key, alive.get(key[:2], t.heard)) for key, t in self._alarms.items()):
            del self._alarms[key]

    def _course(self, station: str, number: int, heard: Heard) -> _Course:
        course = self._courses.pop((station, number), None)
        if course is None:
            if len(self._courses) >= MOST_TRACKS:
                self._forget()
            while len(self._courses) >= MOST_TRACKS:
                # Tracks of a single row are dropped before longer ones.
                least = min(self._courses, key=lambda key: len(self._courses[key].tail) > 1)
                del self._courses[least]
                self._crowded(True)
            course = _Course(station, number, heard)
        course.heard = heard
        self._courses[station, number] = course  # moved to the end: order of reception
        return course

    def _row(self, course: _Course, row: Row) -> None:
        if row.drone is not None:
            course.drone = row.drone
        tail, stamp_ns = course.tail, row.timestamp
        if tail and stamp_ns <= tail[-1][0]:
            if stamp_ns > tail[-1][0] - TAIL_S * 1e9:
                return  # repeated row
            tail.clear()  # the clock was set back: restart the tail
        step_ns = max(_TAIL_STEP_NS, round(TAIL_S * 1e9) * len(self._courses) // _MOST_ROWS)
        if len(tail) > 1 and tail[-1][0] - tail[-2][0] < step_ns - _MS_NS:
            tail.pop()  # thins all but the newest part
        tail.append((stamp_ns, compact(row)))
        while tail[0][0] < stamp_ns - TAIL_S * 1e9:
            tail.popleft()

    def _crowded(self, is_full: bool) -> None:
        if is_full:
            self._crowded_s = time.monotonic()
            self._too_many(f"{MOST_TRACKS} tracks and alarms, {_MOST_SENSORS} LiDARs of a station")

    def _is_crowded(self) -> bool:
        return self._crowded_s is not None and time.monotonic() - self._crowded_s < TAIL_S


def by_itself(message: Message) -> bool:
    """True if the station itself spoke; ends and alarms also result from timeouts."""
    return message.event is not None and not isinstance(message.event, TrackEnds)


def _keep(of: dict, key: object, value: object, most: int) -> bool:
    """Inserts as the newest of a bounded set; True if the oldest was dropped."""
    of.pop(key, None)
    of[key] = value
    if len(of) <= most:
        return False
    del of[next(iter(of))]
    return True


def _brief(message: Message) -> str:
    """The event's text, cut to the keys of the page if it is too long."""
    event = message.event
    if len(message.text) <= _MOST_TEXT or not isinstance(event, SensorState | EngineState):
        return message.text
    told = {"event": event.event, "at": event.at / 1e9, "station": message.station}
    names = (
        ("name", "state", "clock")
        if isinstance(event, SensorState)
        else ("state", "frames", "dropped")
    )
    return json.dumps(told | {name: getattr(event, name) for name in names})


def compact(row: Row) -> str:
    """JSON: seconds, metres, m/s, metres, returns; to the millimetre."""
    numbers = (
        *(row.x, row.y, row.z, row.vx, row.vy, row.vz),
        *(row.sigma_x, row.sigma_y, row.sigma_z, row.support),
    )
    return json.dumps([row.timestamp / 1e9, *(round(value, 3) for value in numbers)])
