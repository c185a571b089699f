"""Several stations as one picture: rows in a common frame, tracks fused into drones."""

import json
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from unlidar.events.clock import Heard, Progress, StreamClock
from unlidar.events.event import (
    BACK_NS,
    Digits,
    Event,
    Now,
    Row,
    SensorState,
    Tokens,
    TrackEnds,
    joined,
    parse,
    token,
    track_ends,
    understand,
)
from unlidar.events.fusion import Estimate, Fused, Fusion, Key
from unlidar.events.lines import QUIET_S, SKY, Published, check_station
from unlidar.events.site import Place, Site, Zone
from unlidar.events.station import INSTANCE, SILENT_S, Message, Station
from unlidar.geodesy import from_geodetic, turn_between
from unlidar.limits import MOST_STATIONS
from unlidar.names import check_name
from unlidar.reporting import RateLimitedNote
from unlidar.stamps import format_stamp_ns

_SURVEY_SIGMA_M = 0.5
_STEP_NS = 50_000_000  # shortest interval of a drone's rows, for any number of stations
_PLACE = TypeAdapter(Place)
_PLACE_KEYS = "latitude_deg", "longitude_deg", "height_m", "heading_deg"
_MOST_NAMES = 16_384  # remembered sender names, as names are free to invent
_MOST_PLACES = 4096
_MOST_INSTANCES = 8  # remembered relays of a station
_MOST_DRONES = 2048  # exceeds a station's tracks, so that no station fills the picture
_TWIN_ROWS = 4  # consecutive jumps of a track that mean two senders of one name
_COLUMNS = "x", "y", "z", "vx", "vy", "vz", "sigma_x", "sigma_y", "sigma_z"

Relay = tuple[str, str | None]  # station name, instance among relays with this name


@dataclass
class _Known:
    """One station, or one of several relays with the same name."""

    station: Station
    topic: str  # station name, key of its place
    instance: str | None  # of its relay
    heard: Heard
    at_ns: int
    is_gone: bool = False  # by its relay's last will
    speaks_on: bool = False  # its name was heard before


@dataclass(frozen=True)
class Told:
    """A message, with `shown` for pages; the stations' own rows are only stored."""

    message: Message
    shown: bool


class Many:
    """Processes messages of relays. No station can end or hide tracks of another."""

    def __init__(self, site: Site, zones: Sequence[Zone], source: str) -> None:
        """`site.origin`: of the common frame; `zones`: watched for drones."""
        self._site = site
        self._progress = Progress()
        self._clock = StreamClock(progress=self._progress)
        self._looked = self._clock.heard(0)
        self._stations: dict[str, _Known] = {}
        self._names: OrderedDict[str, None] = OrderedDict()  # known senders, newest last
        # By station, then relay; None: the latest.
        self._places: OrderedDict[str, OrderedDict[str | None, Place]] = OrderedDict()
        self._fusion = Fusion(_SURVEY_SIGMA_M)
        sky = replace(site, station=SKY)
        self._sky = Station(
            sky, zones, places=False, progress=self._progress, most_tracks=_MOST_DRONES
        )
        self._drones: dict[int, int] = {}  # stamp of the newest row by drone
        self._kinds: dict[Key, float | None] = {}  # drone probability by track
        self.bad = RateLimitedNote(f"{source}: a message is left out")
        self._twins = RateLimitedNote(f"{source}: two relays have one name, give each its own")
        self._crowded = RateLimitedNote(
            f"{source}: more than {MOST_STATIONS} stations, one is forgotten"
        )

    def take(self, line: bytes | Published) -> list[Told]:
        """The messages that result from a broker message, or from a line that names its station.

        An empty line only advances time.
        """
        told = self._aged(QUIET_S if line else 0.0)
        if not line:
            return told
        try:
            self._take(line, told)
        except (ValueError, TypeError, KeyError, ValidationError) as error:
            self.bad(" ".join(str(error).split())[:200])
        return told

    def _take(self, line: bytes | Published, told: list[Told]) -> None:
        """As `take`, for one message. ValueError and the like if it is invalid."""
        if isinstance(line, Published):
            name = line.station
            values = {"event": "gone"} if line.gone else parse(line.text)
            if line.retained:
                values.pop(INSTANCE, None)  # retained, its relay may be gone
        else:
            values = parse(line)
            name = values.get("station")
        relay = (check_station(name), _instance_of(values))
        match values.get("event"):
            case "site":
                self._put_place(relay, values.get("origin"))
                return
            case "gone":
                told += self._gone(relay[0])
                return
            case "alarm":
                return  # alarms are raised here, in the common frame
        event, tokens = understand(values)
        if isinstance(event, Row | Now):
            event, tokens = self._moved(event, tokens, relay)
        known = self._station_of(*relay, event.at, told)
        known.station.believe(event.at)
        known.speaks_on = self._has_spoken(relay[0])
        known.heard, known.at_ns, known.is_gone = self._clock.heard(event.at), event.at, False
        told += self._told(known.station.follow(event, tokens), shown=False)

    def _aged(self, every_s: float) -> list[Told]:
        """Ends tracks that timed out; checked every `every_s`."""
        if self._clock.age_s(self._looked) < every_s:
            return []
        self._looked = self._clock.heard(0)
        told = []
        for known in self._stations.values():  # a drone ends with its last track
            told += self._told(known.station.aged(), shown=False)
        return told

    def _station_of(self, name: str, instance: str | None, at_ns: int, told: list[Told]) -> _Known:
        """The sender of a name and instance, with the ends that displacing another one causes."""
        known = self._stations.get(name)
        own = name
        if known is not None and instance not in (None, known.instance):
            is_over = known.is_gone or self._clock.age_s(known.heard) > SILENT_S
            if known.instance is None or is_over:
                known.instance = instance
            else:
                self._twins(f"'{name}', {known.instance} and {instance}")
                own = check_name(f"{name}_{instance}")
                known = self._stations.get(own)
        if known is None:
            told += self._make_room()
            site = Site(station=own, origin=self._site.origin)
            station = Station(site, places=False, progress=self._progress)
            known = _Known(station, name, instance, self._clock.heard(at_ns), at_ns)
            self._stations[own] = known
        return known

    def _make_room(self) -> list[Told]:
        """Evicts a station: gone ones first, then silent or trackless ones, then the newest."""
        if len(self._stations) < MOST_STATIONS:
            return []
        names = list(self._stations)

        def rank(name: str) -> tuple[int, float]:
            known = self._stations[name]
            if known.station.has_tracks and known.speaks_on and not known.is_gone:
                return 2, -names.index(name)
            return int(not known.is_gone), -self._clock.age_s(known.heard)

        name = min(names, key=rank)
        self._crowded(f"'{name}'")
        known = self._stations[name]
        told = self._told(known.station.lost(known.at_ns), shown=False)
        del self._stations[name]
        self._fusion.forget(name)
        return told

    def _has_spoken(self, name: str) -> bool:
        """True if the name is among the remembered senders."""
        has_spoken = name in self._names
        self._names[name] = None
        self._names.move_to_end(name)
        if len(self._names) > _MOST_NAMES:
            self._names.popitem(last=False)
        return has_spoken

    def _gone(self, name: str) -> list[Told]:
        """Handles a last will; with two relays of one name it is ambiguous, tracks time out."""
        alike = [k for k in self._stations.values() if k.topic == name and not k.is_gone]
        if len(alike) != 1:
            return []
        alike[0].is_gone = True
        return self._told(alike[0].station.lost(alike[0].at_ns), shown=False)

    def _told(self, messages: list[Message], shown: bool) -> list[Told]:
        told = []
        for message in messages:
            event = message.event
            assert event is not None  # alarms come from the fused picture
            told.append(
                Told(message, shown or isinstance(event, SensorState) or event.event == "state")
            )
            if isinstance(event, Row) and not event.late:
                key = message.station, event.track
                self._kinds[key] = event.drone
                identity = self._fusion.take(key, _estimate(event))
                if self._fusion.cuts(key) >= _TWIN_ROWS:
                    self._twins(f"'{message.station}', whose track {event.track} jumps to and fro")
                told += self._drone(identity, event)
            elif isinstance(event, TrackEnds):
                self._fusion.end((message.station, event.track))
                self._kinds.pop((message.station, event.track), None)
                told += self._ended(event.at)
        return told

    def _drone(self, identity: int, row: Row) -> list[Told]:
        """The fused row of the drone that a row belongs to, and ends of vanished drones."""
        told = self._ended(row.at)
        passed_ns = row.timestamp - self._drones.get(identity, row.timestamp - _STEP_NS)
        if -BACK_NS <= passed_ns < _STEP_NS:
            return told
        begins = identity not in self._drones
        if begins and not self._fusion.is_settled(identity):
            return told
        drone = self._fusion.drone(identity)
        try:
            # The highest probability counts: no station can lower another's.
            kinds = [self._kinds[key] for key in drone.members]
            event, tokens = _row_of(drone, row, None if None in kinds else max(kinds))
        except ValueError as error:  # the prediction exceeds the bounds of rows
            self.bad(f"drone {identity}: {error}"[:200])
            return told
        stamp_ns = drone.estimate.stamp_ns
        self._drones[identity] = stamp_ns
        messages = self._sky.follow(event, tokens)
        if begins:
            messages = self._sky.follow(*_begin_of(identity, row.at, stamp_ns)) + messages
        return told + [Told(message, shown=True) for message in messages]

    def _ended(self, at_ns: int) -> list[Told]:
        alive = self._fusion.identities()
        told = []
        for identity in [i for i in self._drones if i not in alive]:
            over = track_ends(identity, at_ns, self._drones.pop(identity))
            told += [Told(message, shown=True) for message in self._sky.follow(*over)]
        return told

    def _put_place(self, relay: Relay, origin: dict[str, Any] | None) -> None:
        """Stores a station's place, also before any other message of it."""
        place = None
        if origin is not None:
            known = {key: float(origin[key]) for key in _PLACE_KEYS if type(origin[key]) is Digits}
            place = _PLACE.validate_json(json.dumps(known))
        name, instance = relay
        places = self._places.pop(name, OrderedDict())
        for key in dict.fromkeys((instance, None)):
            places.pop(key, None)
            if place is not None:
                places[key] = place  # None is re-inserted last, so it is never evicted
        while len(places) > _MOST_INSTANCES:
            places.popitem(last=False)
        if places:
            self._places[name] = places
        if len(self._places) > _MOST_PLACES:
            heard = {known.topic for known in self._stations.values()}
            del self._places[next(other for other in self._places if other not in heard)]

    def _moved(self, row: Row | Now, tokens: Tokens, relay: Relay) -> tuple[Event, Tokens]:
        """The state in the common frame; unchanged if either origin is unknown."""
        places = self._places.get(relay[0], {})
        known = places.get(relay[1]) or places.get(None)
        given = row.latitude_deg, row.longitude_deg, row.height_m
        if known is None or self._site.origin is None or None in given:
            return row, tokens
        own, common = known.origin(), self._site.origin.origin()
        turn = turn_between(own, common)
        sigma_m2 = np.diag((row.sigma_x, row.sigma_y, row.sigma_z)) ** 2
        return _with_numbers(
            tokens,
            from_geodetic(common, np.array([given]))[0],
            turn @ (row.vx, row.vy, row.vz),
            np.sqrt(np.diag(turn @ sigma_m2 @ turn.T)),
        )


def _instance_of(values: dict[str, Any]) -> str | None:
    instance = values.get(INSTANCE)
    return instance if type(instance) is str and instance.isalnum() else None


def _row_of(drone: Fused, row: Row, kind: float | None) -> tuple[Event, Tokens]:
    """A row of a fused estimate. ValueError if it violates the bounds of rows."""
    estimate = drone.estimate
    values = {"track": drone.identity, "support": row.support, "late": row.late}
    values |= {} if kind is None else {"drone": kind}
    tokens = {
        "event": token("row"),
        "at": format_stamp_ns(row.at),
        "timestamp": format_stamp_ns(estimate.stamp_ns),
        **{key: token(value) for key, value in values.items()},
    }
    sigma_m = np.sqrt(np.diag(estimate.covariance_m2))
    return _with_numbers(tokens, estimate.xyz_m, estimate.velocity_mps, sigma_m)


def _begin_of(track: int, at_ns: int, stamp_ns: int) -> tuple[Event, Tokens]:
    stamps = {"at": at_ns, "first_evidence": stamp_ns}
    values = {key: Digits(format_stamp_ns(value)) for key, value in stamps.items()}
    return understand({"event": "track", "track": Digits(track)} | values)


def _with_numbers(
    tokens: Tokens, xyz_m: np.ndarray, velocity_mps: np.ndarray, sigma_m: np.ndarray
) -> tuple[Event, Tokens]:
    """A state's tokens with new numbers, validated like incoming ones."""
    numbers = np.round((*xyz_m, *velocity_mps, *sigma_m), 6).tolist()
    columns = {key: token(value) for key, value in zip(_COLUMNS, numbers, strict=True)}
    return understand(parse(joined(tokens | columns)))


def _estimate(row: Row) -> Estimate:
    return Estimate(
        row.timestamp,
        np.array([row.x, row.y, row.z]),
        np.array([row.vx, row.vy, row.vz]),
        np.diag([row.sigma_x**2 + 1e-6, row.sigma_y**2 + 1e-6, row.sigma_z**2 + 1e-6]),
    )
