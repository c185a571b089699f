"""One station: its events in, messages out, with places, its name and the alarms added."""

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from unlidar_tools.events.alarms import Alarm, Watchman
from unlidar_tools.events.event import (
    EngineState,
    Event,
    Row,
    TrackBegins,
    TrackEnds,
    decode,
    extended,
)
from unlidar_tools.events.site import Site, Zone
from unlidar_tools.geodesy import Origin, to_geodetic
from unlidar_tools.stamps import format_stamp_ns
from unlidar_tools.telling import Often

ALARM = "alarm"
RAISED, ENDED = "raised", "ended"
WARMING_UP = "warming_up"


@dataclass(frozen=True)
class Message:
    """What is sent on: an event with what was added, or an alarm."""

    kind: str  # that of an event, or "alarm"
    station: str
    at_ns: int
    text: str  # JSON, one line
    event: Event | None  # None of an alarm
    place: tuple[float, float, float] | None = None  # degrees north and east, metres; of rows
    alarm: Alarm | None = None
    alarm_state: str = ""


class Station:
    """Takes lines of events in. One that cannot be understood is counted, said and left out."""

    def __init__(
        self, site: Site, zones: Sequence[Zone] = (), source: str = "events", places: bool = True
    ) -> None:
        """`places`: work out where on the globe each row is, which takes most of the time."""
        self._name = site.station
        self._origin = site.origin.origin() if site.origin is not None and places else None
        self._watchman = Watchman(zones)
        self._tracks: dict[int, Row | None] = {}  # that go on, with their newest rows
        self.bad = Often(f"{source}: a line is left out")

    def take(self, line: bytes | str) -> list[Message]:
        """What follows from a line, in the order in which it is to be told."""
        try:
            event, text = decode(line)
        except ValueError as error:
            self.bad(" ".join(str(error).split())[:200])
            return []
        place = None
        if isinstance(event, Row):
            place = self._place(event)
        message = self._message(event, text, place)
        match event:
            case TrackBegins():
                self._tracks.setdefault(event.track, None)
                self._watchman.known(event.track, event.drone)
                return [message]
            case Row():
                self._tracks[event.track] = event
                raised = self._watchman.take(event)
                return [message, *(self._alarm(a, RAISED, event.at) for a in raised)]
            case TrackEnds():
                self._tracks.pop(event.track, None)
                over = self._watchman.end(event.track)
                return [message, *(self._alarm(a, ENDED, event.at) for a in over)]
            case EngineState(state=state) if state == WARMING_UP:
                return [*self._begin_anew(event.at), message]
        return [message]

    def lost(self, at_ns: int) -> list[Message]:
        """Nothing comes from it any more: its tracks and alarms have ended."""
        return self._begin_anew(at_ns)

    def _begin_anew(self, at_ns: int) -> list[Message]:
        """A killed engine has not ended its tracks."""
        over = self._watchman.end_all()
        ends = []
        for track, row in self._tracks.items():
            event, text = decode(
                f'{{"event":"end","at":{format_stamp_ns(at_ns)},"track":{track},'
                f'"timestamp":{format_stamp_ns(row.timestamp if row else at_ns)}}}'
            )
            ends.append(self._message(event, text, None))
        self._tracks.clear()
        return [*ends, *(self._alarm(alarm, ENDED, at_ns) for alarm in over)]

    def _message(self, event: Event, text: str, place: tuple | None) -> Message:
        more: dict = {} if '"station":' in text else {"station": self._name}
        if place is not None:
            more |= _place_keys(place)
        return Message(event.event, self._name, event.at, extended(text, more), event, place)

    def _place(self, row: Row) -> tuple[float, float, float] | None:
        if self._origin is None:
            return None
        return place_of(self._origin, row)

    def _alarm(self, alarm: Alarm, state: str, at_ns: int) -> Message:
        row = self._tracks.get(alarm.track) or alarm.row
        place = self._place(row)
        text = (
            f'{{"event":"{ALARM}","at":{format_stamp_ns(at_ns)},"state":"{state}",'
            f'"track":{alarm.track},"zone":{json.dumps(alarm.zone)},'
            f'"since":{format_stamp_ns(alarm.since_ns)},'
            f'"raised":{format_stamp_ns(alarm.raised_ns)},'
            f'"timestamp":{format_stamp_ns(row.timestamp)},'
            f'"x":{row.x},"y":{row.y},"z":{row.z}}}'
        )
        more = {"station": self._name} | (_place_keys(place) if place else {})
        return Message(ALARM, self._name, at_ns, extended(text, more), None, place, alarm, state)


def place_of(origin: Origin, row: Row) -> tuple[float, float, float]:
    """Degrees north and east, metres above the ellipsoid."""
    lat, lon, height = to_geodetic(origin, np.array([[row.x, row.y, row.z]]))[0]
    return float(lat), float(lon), float(height)


def _place_keys(place: tuple[float, float, float]) -> dict[str, float]:
    return {
        "latitude_deg": round(place[0], 8),
        "longitude_deg": round(place[1], 8),
        "height_m": round(place[2], 3),
    }
