"""What a middleware is told of a station: where its tracks are now, its health, its alarms.

Only the newest counts: whoever was away is told of now, and nothing piles up.
"""

import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

from sapient_msg.bsi_flex_335_v2_0.status_report_pb2 import StatusReport

from unlidar.events.alarms import Alarm
from unlidar.events.event import (
    EngineState,
    Now,
    Row,
    SensorState,
    TrackBegins,
    TrackEnds,
)
from unlidar.events.station import ALARM, MOST_TRACKS, RAISED, SILENT_S, WARMING_UP, Message, Place
from unlidar.relay.sapient.ids import lasting_ulid

_OLDEST_S = 4.0  # of a position that is predicted to now; late rows are older
_MOST_LAG_S = 1.0  # of this computer's clock behind the newest stamp, where both are of one time
_LIVE_S = 60.0
_PREFERS_NOW_S = 2.0  # after an event `now` rows tell no position for so long
_MOST_ALARMS = 1000
_UNSURE_S = 30.0  # a connection that is lost may have taken what was told for so long in vain
_OK, _OVERLOADED = "ok", "overloaded"
_CLOCK_LOST = "lost"
_WARNING, _ERROR = StatusReport.SYSTEM_WARNING, StatusReport.SYSTEM_ERROR


@dataclass
class Track:
    """An active track, or one that has just ended."""

    number: int
    object_id: str
    state: Row | Now | None = None
    heard_s: float = 0.0  # monotonic time at which the state was its event's newest stamp
    drone: float | None = None
    bird_like: float | None = None
    is_fresh: bool = False  # not yet told

    def age_s(self, now_s: float) -> float:
        """Time since the state's stamp."""
        assert self.state is not None
        return max(0.0, now_s - self.heard_s + (self.state.at - self.state.timestamp) * 1e-9)


@dataclass(frozen=True)
class Alert:
    """An alarm that began or has ended."""

    alert_id: str
    object_id: str
    alarm: Alarm
    place: Place | None
    is_active: bool


class Status(NamedTuple):
    """One line of a status report."""

    level: int
    kind: int
    text: str


class Health(NamedTuple):
    """State of the station as a node."""

    system: int
    told: tuple[Status, ...]


class Picture:
    """The newest of everything; all parts are bounded."""

    def __init__(self, node_id: str, monotonic_s: Callable[[], float] = time.monotonic) -> None:
        self._node_id = node_id
        self._monotonic_s = monotonic_s
        self._tracks: dict[int, Track] = {}
        self._lost: deque[Track] = deque(maxlen=MOST_TRACKS)
        self._alarms: dict[tuple[int, str], Alert] = {}
        self._alerts: deque[Alert] = deque(maxlen=_MOST_ALARMS)
        # Ends that were told, with the time: nothing that goes on would tell them again.
        self._told: deque[tuple[float, Track | Alert]] = deque(maxlen=MOST_TRACKS + _MOST_ALARMS)
        self._is_learning = False
        self._sensors: dict[str, SensorState] = {}
        self._engine: str | None = None
        self._heard_s: float | None = None
        self._now_s = -_PREFERS_NOW_S

    def learn(self, message: Message) -> None:
        """Takes in what was told before the start, which is not told, but for the latest ends.

        A relay that was killed may have left a track and an alert that nobody else ends.
        """
        self._is_learning = True
        self.take(message)
        is_live = abs(time.time() - message.at_ns * 1e-9) <= _LIVE_S
        if isinstance(message.event, Row | Now):
            track = self._tracks[message.event.track]
            track.is_fresh = False
            if not is_live:
                track.state = None
        self.take_lost()
        self.take_alerts()
        if not is_live:
            self._told.clear()
            self._heard_s = None

    def learned(self) -> None:
        """Ends the learning: who is there already is told of what goes on."""
        self._is_learning = False
        self.tell_again()

    def take(self, message: Message) -> bool:
        """Takes in an event or an alarm; True if it tells a position."""
        event = message.event
        if message.kind == ALARM:
            self._take_alarm(message)
            return False
        if not isinstance(event, TrackEnds):  # these also follow from silence
            self._heard_s = self._monotonic_s()
        match event:
            case TrackBegins():
                self._track(event.track, event.first_evidence)
                self._judge(event)
            case Row() | Now():
                self._track(event.track, event.timestamp)
                self._judge(event)
                return self._move(event)
            case TrackEnds():
                track = self._tracks.pop(event.track, None)
                if track is not None and track.state is not None:
                    self._lost.append(track)
            case SensorState():
                self._sensors[event.name] = event
            case EngineState():
                self._engine = event.state
                if event.state == WARMING_UP:  # it may have other LiDARs than before
                    self._sensors = {n: s for n, s in self._sensors.items() if s.state == _OK}
        return False

    def take_fresh(self) -> list[Track]:
        """The tracks whose position is new; each once."""
        now_s = self._monotonic_s()
        fresh = [track for track in self._tracks.values() if track.is_fresh]
        for track in fresh:
            track.is_fresh = False
        return [track for track in fresh if track.age_s(now_s) <= _OLDEST_S]

    def take_lost(self) -> list[Track]:
        """The tracks that have ended; each once in a connection."""
        lost = list(self._lost)
        self._lost.clear()
        self._keep(lost)
        return lost

    def take_alerts(self) -> list[Alert]:
        """The alarms that have begun or ended; each once in a connection."""
        alerts = list(self._alerts)
        self._alerts.clear()
        self._keep([alert for alert in alerts if not alert.is_active])
        return alerts

    def tell_again(self) -> None:
        """Marks all that goes on, and the latest ends, as new, for one who comes anew."""
        if self._is_learning:
            return
        ends = [end for _, end in self._told]
        self._told.clear()
        self._lost.extendleft(end for end in reversed(ends) if isinstance(end, Track))
        ended = [end for end in ends if isinstance(end, Alert)]
        ended += [alert for alert in self._alerts if not alert.is_active]
        self._alerts.clear()
        self._alerts.extend((*ended, *self._alarms.values()))

    @property
    def waiting(self) -> int:
        """Number of things that are not yet told."""
        fresh = sum(track.is_fresh for track in self._tracks.values())
        return fresh + len(self._lost) + len(self._alerts)

    @property
    def has_positions(self) -> bool:
        """True if a position is not yet told."""
        return bool(self._lost) or any(track.is_fresh for track in self._tracks.values())

    def health(self) -> Health:
        """What the operator must know: LiDARs that do not see, an engine that is behind or away."""
        if self._is_learning:
            text = "what the engine told before the start is being read"
            return Health(_WARNING, (_warning(StatusReport.STATUS_TYPE_NOT_DETECTING, text),))
        told, system = self._engine_health()
        away = {name: s.state for name, s in self._sensors.items() if s.state != _OK}
        is_blind = len(away) == len(self._sensors) > 0
        for name, state in sorted(away.items()):
            # Fog, a cover or a turned LiDAR are external; silence is a cable, power or the LiDAR.
            kind = (
                StatusReport.STATUS_TYPE_INTERNAL_FAULT
                if state == "silent"
                else StatusReport.STATUS_TYPE_EXTERNAL_FAULT
            )
            level = (
                StatusReport.STATUS_LEVEL_ERROR_STATUS
                if is_blind
                else StatusReport.STATUS_LEVEL_WARNING_STATUS
            )
            told.append(Status(level, kind, f"LiDAR {name} {state}"))
        if is_blind:
            text = "no LiDAR sees what it should: nothing that flies is found"
            told.append(_error(StatusReport.STATUS_TYPE_NOT_DETECTING, text))
        adrift = sorted(name for name, s in self._sensors.items() if s.clock == _CLOCK_LOST)
        for name in adrift:
            text = f"LiDAR {name} has lost its time synchronisation"
            told.append(_warning(StatusReport.STATUS_TYPE_EXTERNAL_FAULT, text))
        if away or adrift:
            system = max(system, _ERROR if is_blind else _WARNING)
        return Health(system, tuple(told))

    def _engine_health(self) -> tuple[list[Status], int]:
        if self._heard_s is None:
            text = "nothing was heard of the engine yet"
            return [_warning(StatusReport.STATUS_TYPE_NOT_DETECTING, text)], _WARNING
        if self._monotonic_s() - self._heard_s > SILENT_S:
            text = f"nothing was heard of the engine for {SILENT_S:g} s"
            return [_error(StatusReport.STATUS_TYPE_INTERNAL_FAULT, text)], _ERROR
        if self._engine == WARMING_UP:
            text = "the engine learns its scene"
            return [_warning(StatusReport.STATUS_TYPE_NOT_DETECTING, text)], _WARNING
        if self._engine == _OVERLOADED:
            text = "the engine is overloaded: weak drones may be missed"
            return [_warning(StatusReport.STATUS_TYPE_INTERNAL_FAULT, text)], _WARNING
        return [], StatusReport.SYSTEM_OK

    def _keep(self, ends: Iterable[Track | Alert]) -> None:
        now_s = self._monotonic_s()
        while self._told and now_s - self._told[0][0] > _UNSURE_S:
            self._told.popleft()
        self._told.extend((now_s, end) for end in ends)

    def _track(self, number: int, first_ns: int) -> Track:
        track = self._tracks.get(number)
        if track is None:
            track = Track(number, lasting_ulid(first_ns, self._node_id, number, first_ns))
            self._tracks[number] = track
        return track

    def _judge(self, event: TrackBegins | Row | Now) -> None:
        track = self._tracks[event.track]
        if event.drone is not None:
            track.drone, track.bird_like = event.drone, event.bird_like

    def _move(self, event: Row | Now) -> bool:
        now_s = self._monotonic_s()
        if isinstance(event, Now):
            self._now_s = now_s
        elif event.late or now_s - self._now_s < _PREFERS_NOW_S:
            return False
        track = self._tracks[event.track]
        # Of a stream by this computer's time it is known for how long the event was under way.
        lag_s = time.time() - event.at * 1e-9
        track.state = event
        track.heard_s = now_s - (lag_s if abs(lag_s) <= _MOST_LAG_S else 0.0)
        track.is_fresh = True
        return True

    def _take_alarm(self, message: Message) -> None:
        alarm = message.alarm
        assert alarm is not None
        key = alarm.track, alarm.zone
        alert = self._alarms.pop(key, None)
        if message.alarm_state == RAISED:
            track = self._track(alarm.track, alarm.row.timestamp)
            alert_id = lasting_ulid(alarm.raised_ns, track.object_id, alarm.zone)
            self._alarms[key] = Alert(alert_id, track.object_id, alarm, message.place, True)
            self._alerts.append(self._alarms[key])
            if len(self._alarms) > _MOST_ALARMS:
                del self._alarms[next(iter(self._alarms))]
        elif alert is not None:
            self._alerts.append(replace(alert, place=message.place, is_active=False))


def _warning(kind: int, text: str) -> Status:
    return Status(StatusReport.STATUS_LEVEL_WARNING_STATUS, kind, text)


def _error(kind: int, text: str) -> Status:
    return Status(StatusReport.STATUS_LEVEL_ERROR_STATUS, kind, text)
