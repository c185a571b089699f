"""One station: events in; messages with positions, station name and alarms out."""

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from unlidar.events.alarms import Alarm, Watchman
from unlidar.events.clock import Heard, Progress, StreamClock
from unlidar.events.event import (
    EngineState,
    Event,
    Now,
    Row,
    SensorState,
    Tokens,
    TrackBegins,
    TrackEnds,
    joined,
    parse,
    token,
    track_ends,
    understand,
)
from unlidar.events.site import Site, Zone
from unlidar.geodesy import Origin, to_geodetic
from unlidar.reporting import RateLimitedNote
from unlidar.stamps import format_stamp_ns

ALARM = "alarm"
RAISED, ENDED = "raised", "ended"
WARMING_UP = "warming_up"
INSTANCE = "instance"  # key with a relay's random id, which distinguishes relays of one name
_OURS = INSTANCE, "age_s"  # reserved keys of relays and of the page's server; dropped from engines
# A track without events for this long has ended, as its end may be lost. The engine deletes tracks
# after `tracking.max_gap_s`, 10 s.
SILENT_S = 60.0
MOST_TRACKS = 256  # of a station at once; the one silent for longest is ended for a new one
_MOST_SENSORS = 64  # the engine's own limit

Place = tuple[float, float, float]  # degrees north and east, metres above the ellipsoid


@dataclass(frozen=True)
class Message:
    """An outgoing message: an augmented event, or an alarm."""

    kind: str  # event name, or "alarm"
    station: str
    at_ns: int
    text: str  # JSON, one line
    event: Event | None  # None for an alarm
    place: Place | None = None  # for positions only
    alarm: Alarm | None = None
    alarm_state: str = ""


@dataclass
class _Track:
    """An active track."""

    heard: Heard
    at_ns: int  # stamp of the last event
    row: Row | None = None  # the newest


class Station:
    """Processes lines of events. Invalid lines are counted, reported and left out."""

    def __init__(
        self,
        site: Site,
        zones: Sequence[Zone] = (),
        source: str = "events",
        places: bool = True,
        progress: Progress | None = None,
        most_tracks: int = MOST_TRACKS,
    ) -> None:
        """`places`: compute geodetic positions, the most expensive step.

        `progress`: shared by all stations of a picture.
        """
        self._most_tracks = most_tracks
        self._name = site.station
        self._origin = site.origin.origin() if site.origin is not None and places else None
        self._watchman = Watchman(zones)
        self._clock = StreamClock(progress=progress)
        self._tracks: OrderedDict[int, _Track] = OrderedDict()  # longest silent first
        self._sensors: set[str] = set()
        self.bad = RateLimitedNote(f"{source}: a line is left out")

    def take(self, line: bytes | str, placed: bool = True) -> list[Message]:
        """The messages that result from a line, in order; `placed`: with the place of positions.

        An empty line only advances time.
        """
        told = self.aged()
        if not line:
            return told
        try:
            event, tokens = understand(parse(line))
            self.believe(event.at)
            told += self.follow(event, tokens, placed)
        except ValueError as error:
            self.bad(" ".join(str(error).split())[:200])
        return told

    def believe(self, at_ns: int) -> None:
        """ValueError if the station's clock rejects the stamp."""
        if not self._clock.believes(at_ns):
            raise ValueError(
                f"at: {format_stamp_ns(at_ns)} is neither of now nor near to what came before"
            )

    def follow(self, event: Event, tokens: Tokens, placed: bool = True) -> list[Message]:
        """The messages that result from an accepted event. ValueError beyond a bound."""
        place = self._place(event) if placed and isinstance(event, Row | Now) else None
        message = self._message(event, tokens, place)
        match event:
            case TrackBegins():
                ended = self._hear(event)
                self._watchman.known(event.track, event.drone)
                return [*ended, message]
            case Row():
                ended = self._hear(event)
                raised = self._watchman.take(event)
                told = (self._alarm(a, RAISED, event.at) for a in raised)
                return [*ended, message, *told]
            case Now():
                return [*self._hear(event), message]
            case TrackEnds():
                self._tracks.pop(event.track, None)
                over = self._watchman.end(event.track)
                return [message, *(self._alarm(a, ENDED, event.at) for a in over)]
            case EngineState(state=state) if state == WARMING_UP:
                return [*self.lost(event.at), message]
            case SensorState(name=name):
                if name not in self._sensors and len(self._sensors) >= _MOST_SENSORS:
                    raise ValueError(f"name: expected at most {_MOST_SENSORS} sensors")
                self._sensors.add(name)
        return [message]

    def aged(self) -> list[Message]:
        """Ends tracks, with their alarms, that were silent for `SILENT_S`."""
        told: list[Message] = []
        while self._tracks:
            track, known = next(iter(self._tracks.items()))
            if self._clock.age_s(known.heard) <= SILENT_S:
                break
            told += self._end(track, known.at_ns + round(SILENT_S * 1e9))
        return told

    def lost(self, at_ns: int) -> list[Message]:
        """Ends all tracks and alarms after the source was lost.

        Also needed for a killed engine, which has not ended its tracks.
        """
        self._sensors.clear()
        told = [message for track in list(self._tracks) for message in self._end(track, at_ns)]
        return sorted(told, key=lambda message: message.kind == ALARM)

    @property
    def has_tracks(self) -> bool:
        """True if any track is active."""
        return bool(self._tracks)

    def _hear(self, event: TrackBegins | Row | Now) -> list[Message]:
        """Marks a track as heard; ends another one beyond the bound."""
        known = _Track(self._clock.heard(event.at), event.at)
        if event.track in self._tracks:
            known.row = self._tracks.pop(event.track).row
        self._tracks[event.track] = known
        if isinstance(event, Row):
            known.row = event
        if len(self._tracks) <= self._most_tracks:
            return []
        oldest, other = next(iter(self._tracks.items()))
        return self._end(oldest, other.at_ns)

    def _end(self, track: int, at_ns: int) -> list[Message]:
        """Ends a track without an event of its own."""
        row = self._tracks.pop(track).row
        event, tokens = track_ends(track, at_ns, at_ns if row is None else row.timestamp)
        over = self._watchman.end(track)
        told = (self._alarm(alarm, ENDED, at_ns) for alarm in over)
        return [self._message(event, tokens, None), *told]

    def _message(self, event: Event, tokens: Tokens, place: Place | None) -> Message:
        own = {"station": token(self._name)} | _place_tokens(place)
        text = joined({k: v for k, v in tokens.items() if k not in _OURS} | own)
        return Message(event.event, self._name, event.at, text, event, place)

    def _place(self, row: Row | Now) -> Place | None:
        return None if self._origin is None else place_of(self._origin, row)

    def _alarm(self, alarm: Alarm, state: str, at_ns: int) -> Message:
        known = self._tracks.get(alarm.track)
        row = alarm.row if known is None or known.row is None else known.row
        place = self._place(row)
        values = {
            "event": token(ALARM),
            "at": format_stamp_ns(at_ns),
            "state": token(state),
            "track": token(alarm.track),
            "zone": token(alarm.zone),
            "since": format_stamp_ns(alarm.since_ns),
            "raised": format_stamp_ns(alarm.raised_ns),
            "timestamp": format_stamp_ns(row.timestamp),
            **{key: token(getattr(row, key)) for key in "xyz"},
            "station": token(self._name),
            **_place_tokens(place),
        }
        return Message(ALARM, self._name, at_ns, joined(values), None, place, alarm, state)


def place_of(origin: Origin, row: Row | Now) -> Place:
    """Degrees north and east, metres above the ellipsoid."""
    lat, lon, height = to_geodetic(origin, np.array([[row.x, row.y, row.z]]))[0]
    return float(lat), float(lon), float(height)


def _place_tokens(place: Place | None) -> Tokens:
    if place is None:
        return {}
    lat, lon, height = place
    return {
        "latitude_deg": token(round(lat, 8)),
        "longitude_deg": token(round(lon, 8)),
        "height_m": token(round(height, 3)),
    }
