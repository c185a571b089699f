"""Several stations as one sky: their rows in one frame, their tracks joined into drones."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydantic import TypeAdapter, ValidationError

from unlidar_tools.events.event import Row, SensorState, TrackEnds, decode
from unlidar_tools.events.fusion import Estimate, Fused, Fusion
from unlidar_tools.events.site import Place, Site, Zone
from unlidar_tools.events.station import Message, Station
from unlidar_tools.geodesy import Origin, from_geodetic, turn_between
from unlidar_tools.names import check_name
from unlidar_tools.stamps import format_stamp_ns
from unlidar_tools.telling import Often

SKY = "sky"  # the name of the station that no one is: its tracks are drones of all
_SURVEY_SIGMA_M = 0.5
_STEP_NS = 50_000_000  # a drone's rows are not closer together, however many stations tell of it
_PLACE = TypeAdapter(Place)
_MOST_STATIONS = 64


@dataclass
class _Known:
    """One station."""

    station: Station
    place: Place | None = None
    at_ns: int = 0


@dataclass(frozen=True)
class Told:
    """A message, and whether it is for pages: the stations' own rows are only kept."""

    message: Message
    shown: bool


class Many:
    """Takes in what relays published, as lines that name their stations."""

    def __init__(self, site: Site, zones: Sequence[Zone], source: str) -> None:
        """`site.origin` is that of the common frame; the zones are watched for drones."""
        self._site = site
        self._stations: dict[str, _Known] = {}
        self._fusion = Fusion(_SURVEY_SIGMA_M)
        self._sky = Station(replace(site, station=SKY), zones, source, places=False)
        self._drones: dict[int, int] = {}  # with the stamps of their newest rows
        self.bad = Often(f"{source}: a message is left out")

    def take(self, line: bytes) -> list[Told]:
        """What follows from a line."""
        try:
            values = json.loads(line)
            name = check_name(values["station"])
            known = self._known(name)
            kind = values.get("event")
            if kind == "site":
                known.place = _PLACE.validate_json(json.dumps(values["origin"]))
                return []
            if kind == "gone":
                return self._told(known.station.lost(known.at_ns), shown=False)
            if kind == "alarm":
                return []  # those of the common frame are raised here
            text = line.decode()
            if kind == "row":
                text = self._moved(text, values, known)
        except (ValueError, TypeError, KeyError, RecursionError, ValidationError) as error:
            self.bad(" ".join(str(error).split())[:200])
            return []
        return self._told(known.station.take(text), shown=False)

    def clocks_s(self) -> dict[tuple[str, str], float]:
        """By how much each station's stamps are ahead of each later one's, where that is known."""
        names = sorted(self._stations)
        offsets = {(a, b): self._fusion.clock_offset_s(a, b) for a in names for b in names if a < b}
        return {pair: offset for pair, offset in offsets.items() if offset is not None}

    def _known(self, name: str) -> _Known:
        if name not in self._stations:
            if len(self._stations) >= _MOST_STATIONS or name == SKY:
                raise ValueError(f"station '{name}', expected another name or fewer stations")
            own = Station(Site(station=name, origin=self._site.origin), places=False)
            self._stations[name] = _Known(own)
        return self._stations[name]

    def _told(self, messages: list[Message], shown: bool) -> list[Told]:
        told = []
        for message in messages:
            event = message.event
            known = self._stations[message.station]
            known.at_ns = max(known.at_ns, message.at_ns)
            told.append(
                Told(message, shown or isinstance(event, SensorState) or event.event == "state")
            )
            if isinstance(event, Row) and not event.late:
                told += self._drone(
                    self._fusion.take((message.station, event.track), _estimate(event)), event
                )
            elif isinstance(event, TrackEnds):
                self._fusion.end((message.station, event.track))
                told += self._ended(event.at)
        return told

    def _drone(self, identity: int, row: Row) -> list[Told]:
        """The newest place of the drone that a row is of, and the end of those that are no more."""
        told = self._ended(row.at)
        if row.timestamp - self._drones.get(identity, row.timestamp - _STEP_NS) < _STEP_NS:
            return told
        if identity not in self._drones and not self._fusion.is_settled(identity):
            return told
        drone = self._fusion.drone(identity)
        stamp_ns = drone.estimate.stamp_ns
        begins = identity not in self._drones
        self._drones[identity] = stamp_ns
        lines = [_row_text(drone, row)]
        if begins:
            stamp = format_stamp_ns(stamp_ns)
            at = format_stamp_ns(row.at)
            lines.insert(
                0,
                f'{{"event":"track","at":{at},"track":{identity},"first_evidence":{stamp}}}',
            )
        return told + [Told(m, shown=True) for line in lines for m in self._sky.take(line)]

    def _ended(self, at_ns: int) -> list[Told]:
        alive = self._fusion.identities()
        told = []
        for identity in [i for i in self._drones if i not in alive]:
            stamp = format_stamp_ns(self._drones.pop(identity))
            at = format_stamp_ns(at_ns)
            line = f'{{"event":"end","at":{at},"track":{identity},"timestamp":{stamp}}}'
            told += [Told(message, shown=True) for message in self._sky.take(line)]
        return told

    def _moved(self, text: str, values: dict, known: _Known) -> str:
        """The row in the common frame; as it is where one of the two places is not known."""
        if known.place is None or self._site.origin is None or "latitude_deg" not in values:
            return text
        row, _ = decode(text)
        assert isinstance(row, Row)
        own, common = known.place.origin(), self._site.origin.origin()
        place = np.array([[values[k] for k in ("latitude_deg", "longitude_deg", "height_m")]])
        return _moved_text(row, from_geodetic(common, place.astype(float))[0], own, common)


def _moved_text(row: Row, xyz_m: np.ndarray, own: Origin, common: Origin) -> str:
    turn = turn_between(own, common)
    velocity = turn @ (row.vx, row.vy, row.vz)
    sigma = np.sqrt(np.diag(turn @ np.diag((row.sigma_x, row.sigma_y, row.sigma_z)) ** 2 @ turn.T))
    return _text(row, row.track, row.timestamp, xyz_m, velocity, sigma)


def _row_text(drone: Fused, row: Row) -> str:
    estimate = drone.estimate
    sigma = np.sqrt(np.diag(estimate.covariance_m2))
    return _text(
        row, drone.identity, estimate.stamp_ns, estimate.xyz_m, estimate.velocity_mps, sigma
    )


def _text(
    row: Row, track: int, stamp_ns: int, xyz: np.ndarray, velocity: np.ndarray, sigma: np.ndarray
) -> str:
    columns = ("x", "y", "z", "vx", "vy", "vz", "sigma_x", "sigma_y", "sigma_z")
    numbers = dict(zip(columns, np.round((*xyz, *velocity, *sigma), 6).tolist(), strict=True))
    more = numbers | {"support": row.support, "late": row.late}
    more |= {} if row.drone is None else {"drone": row.drone}
    return (
        f'{{"event":"row","at":{format_stamp_ns(row.at)},"track":{track},'
        f'"timestamp":{format_stamp_ns(stamp_ns)},{json.dumps(more)[1:]}'
    )


def _estimate(row: Row) -> Estimate:
    return Estimate(
        row.timestamp,
        np.array([row.x, row.y, row.z]),
        np.array([row.vx, row.vy, row.vz]),
        np.diag([row.sigma_x**2 + 1e-6, row.sigma_y**2 + 1e-6, row.sigma_z**2 + 1e-6]),
    )
