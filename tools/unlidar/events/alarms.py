"""Alarms: raised when a track that may be a drone dwells in a zone."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from unlidar.events.event import BACK_NS, Row
from unlidar.events.site import Zone, Zones

# Time outside is subtracted from the dwell with this factor: noise at an edge delays an alarm but
# does not prevent it, while a track outside for a fifth of the time never dwells.
_OUTSIDE = 4


@dataclass(frozen=True)
class Alarm:
    """An alarm for one track in one zone; lasts until the track ends."""

    zone: str
    track: int
    since_ns: int  # entry into the zone
    raised_ns: int  # stamp of the row that fulfilled the rule
    row: Row


@dataclass
class _Stay:
    """Dwell of a track in a zone."""

    since_ns: int
    stayed_ns: int = 0  # time inside less the weighted time outside
    is_inside: bool = True


@dataclass
class _Course:
    """State of an active track."""

    probability: float = 1.0
    newest_ns: int | None = None
    stays: dict[str, _Stay] = field(default_factory=dict)
    alarms: dict[str, Alarm] = field(default_factory=dict)


class Watchman:
    """Applies the rules of one station. Time is that of the rows' stamps, not of their arrival."""

    def __init__(self, zones: Sequence[Zone]) -> None:
        self._zones = Zones(zones)
        self._courses: dict[int, _Course] = {}

    def known(self, track: int, probability: float | None) -> None:
        """Sets the probability that a track is a drone; None leaves it as it is."""
        if probability is not None:
            self._course(track).probability = probability

    def take(self, row: Row) -> list[Alarm]:
        """The alarms that this row raises, at most one for each track and zone."""
        self.known(row.track, row.drone)
        course = self._course(row.track)
        passed_ns = row.timestamp - course.newest_ns if course.newest_ns is not None else 0
        if course.newest_ns is not None and -BACK_NS <= passed_ns <= 0:
            return []  # repeated row
        course.newest_ns, passed_ns = row.timestamp, max(0, passed_ns)
        inside = {zone.name: zone for zone in self._zones.around(row.x, row.y, row.z)}
        for name in [name for name in course.stays if name not in inside]:
            stay = course.stays[name]
            stay.is_inside = False
            stay.stayed_ns -= _OUTSIDE * passed_ns
            if stay.stayed_ns <= 0:
                del course.stays[name]
        raised = []
        for name, zone in inside.items():
            stay = course.stays.setdefault(name, _Stay(row.timestamp))
            # An interval between a row outside and one inside counts for neither.
            stay.stayed_ns += passed_ns if stay.is_inside and row.timestamp > stay.since_ns else 0
            stay.is_inside = True
            if (
                name not in course.alarms
                and stay.stayed_ns >= round(zone.rule.min_stay_s * 1e9)
                and course.probability >= zone.rule.min_probability
            ):
                alarm = Alarm(name, row.track, stay.since_ns, row.timestamp, row)
                course.alarms[name] = alarm
                raised.append(alarm)
        return raised

    def end(self, track: int) -> list[Alarm]:
        """Removes an ended track; returns its alarms, which end with it."""
        course = self._courses.pop(track, None)
        return [] if course is None else list(course.alarms.values())

    def _course(self, track: int) -> _Course:
        return self._courses.setdefault(track, _Course())
