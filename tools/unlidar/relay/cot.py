"""Cursor on Target, the messages of TAK clients.

Written with Python's XML: pytak warns on import about optional packages, requires a
client certificate even if the server does not, and allows every cipher of TLS.
"""

import math
import time
import xml.etree.ElementTree as Xml
from dataclasses import dataclass
from datetime import UTC, datetime

from unlidar.events.alarms import Alarm
from unlidar.events.event import BACK_NS, Now, Row, TrackEnds
from unlidar.events.site import Place
from unlidar.events.station import ALARM, RAISED, Message
from unlidar.reporting import note
from unlidar.sanitize import printable

DRONE = "a-u-A-M-H-Q"  # of unknown side, air, rotary wing, unmanned
_BREACHED, _CANCELLED = "b-a-g", "b-a-o-can"
_ALARM_STALE_S = 3600
_LEAST_STALE_S = 5.0
# Stamps further from the wall clock are of an unsynchronised clock, or of a recording.
_MOST_APART_S = 60.0
_UNKNOWN = "9999999.0"
_MEASURED = "m-g"  # how: by a machine


@dataclass
class _Known:
    """A track that was told of."""

    newest: Message  # with its position
    told_ns: int | None = None  # stamp of the position that was told last
    now_ns: int | None = None  # stamp of the newest event `now`
    drone: float | None = None


class Encoder:
    """Converts messages to XML: the newest position of each track at intervals, its end, alarms."""

    def __init__(self, place: Place, every_s: float) -> None:
        self._heading_deg = place.heading_deg
        self._every_ns = round(every_s * 1e9)
        self._stale_s = max(_LEAST_STALE_S, 3 * every_s)
        self._tracks: dict[int, _Known] = {}
        self._note_clock = True

    def encode(self, message: Message) -> bytes | None:
        """The XML of a message; None if there is nothing to send."""
        event = message.event
        if isinstance(event, Row | Now):
            return self._position(message, event)
        if isinstance(event, TrackEnds) and event.track in self._tracks:
            known = self._tracks.pop(event.track)
            # Stale at once: clients grey out the last position, then remove it.
            return self._track(known.newest, known.drone, self._time(event.at), 0.0)
        if message.kind == ALARM and message.alarm is not None and message.place is not None:
            return self._alarm(message, message.alarm, self._time(message.at_ns))
        return None

    def _position(self, message: Message, event: Row | Now) -> bytes | None:
        """The newest position of a track, at intervals; rows tell it where no `now` is newer."""
        is_late = isinstance(event, Row) and event.late
        known = self._tracks.get(event.track)
        if known is None:
            if is_late:
                return None
            known = self._tracks[event.track] = _Known(message)
        if event.drone is not None:
            known.drone = event.drone
        if isinstance(event, Now):
            known.now_ns = event.timestamp
        elif known.now_ns is not None and 0 <= known.now_ns - event.timestamp <= BACK_NS:
            return None
        known.newest = message
        passed_ns = None if known.told_ns is None else event.timestamp - known.told_ns
        if is_late or (passed_ns is not None and 0 <= passed_ns < self._every_ns):
            return None
        known.told_ns = event.timestamp
        return self._track(message, known.drone, self._time(event.timestamp), self._stale_s)

    def _track(self, message: Message, drone: float | None, time_s: float, stale_s: float) -> bytes:
        row = message.event
        assert isinstance(row, Row | Now)
        detail = Xml.Element("detail")
        speed = math.hypot(row.vx, row.vy)
        # Mathematical angles are counterclockwise from x, courses clockwise from north.
        course = (self._heading_deg - math.degrees(math.atan2(row.vy, row.vx))) % 360
        Xml.SubElement(detail, "track", course=f"{course:.1f}", speed=f"{speed:.2f}")
        remarks = Xml.SubElement(detail, "remarks")
        remarks.text = f"{row.z:.0f} m above {message.station}, climb {row.vz:+.1f} m/s"
        if drone is not None:
            remarks.text += f", drone {drone:.2f}"
        event = self._event(message, uid_of(message.station, row.track), DRONE, detail)
        name = f"{message.station}-{row.track}"
        return _finished(event, detail, name, time_s, stale_s)

    def _alarm(self, message: Message, alarm: Alarm, time_s: float) -> bytes:
        raised = message.alarm_state == RAISED
        detail = Xml.Element("detail")
        track = uid_of(message.station, alarm.track)
        name = printable(f"{message.station}-{alarm.track} in {alarm.zone}")
        emergency = Xml.SubElement(detail, "emergency")
        emergency.set(*(("type", "Geo-fence Breached") if raised else ("cancel", "true")))
        emergency.text = name
        Xml.SubElement(detail, "link", uid=track, relation="p-p", type=DRONE)
        uid = f"{track}.{printable(alarm.zone)}"
        event = self._event(message, uid, _BREACHED if raised else _CANCELLED, detail)
        return _finished(event, detail, name, time_s, _ALARM_STALE_S if raised else 10.0)

    def _event(self, message: Message, uid: str, kind: str, detail: Xml.Element) -> Xml.Element:
        lat, lon, height = message.place or (0.0, 0.0, 0.0)
        row = message.event
        known = isinstance(row, Row | Now)
        # 1-sigma by the schema of CoT.
        ce = f"{max(row.sigma_x, row.sigma_y):.2f}" if known else _UNKNOWN
        le = f"{row.sigma_z:.2f}" if known else _UNKNOWN
        point = Xml.Element(
            "point", lat=f"{lat:.8f}", lon=f"{lon:.8f}", hae=f"{height:.2f}", ce=ce, le=le
        )
        event = Xml.Element("event", version="2.0", uid=uid, type=kind, how=_MEASURED)
        event.extend((point, detail))
        return event

    def _time(self, stamp_ns: int) -> float:
        now_s, stamp_s = time.time(), stamp_ns * 1e-9
        if abs(now_s - stamp_s) <= _MOST_APART_S:
            return stamp_s
        if self._note_clock:
            note(
                f"stamps are {stamp_s - now_s:+.0f} s from this machine's clock: "
                "Cursor on Target gets the time of sending"
            )
        self._note_clock = False
        return now_s


def uid_of(station: str, track: int) -> str:
    """The uid of a track in TAK."""
    return f"unlidar.{station}.{track}"


def _finished(
    event: Xml.Element, detail: Xml.Element, name: str, time_s: float, stale_s: float
) -> bytes:
    Xml.SubElement(detail, "contact", callsign=name)
    for key, value_s in (("time", time_s), ("start", time_s), ("stale", time_s + stale_s)):
        event.set(key, datetime.fromtimestamp(value_s, UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ"))
    return Xml.tostring(event, encoding="UTF-8", xml_declaration=True)
