"""When an alarm is raised: a track that may be a drone stays in a zone."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from unlidar_tools.events.event import BACK_NS, Row
from unlidar_tools.events.site import Zone, Zones

# Time outside of a zone takes so many times its length off the stay: noise at an edge delays an
# alarm, and who is outside for a fifth of the time has not stayed.
_OUTSIDE = 4


@dataclass(frozen=True)
class Alarm:
    """One track in one zone, from the moment the rule held until the track ends."""

    zone: str
    track: int
    since_ns: int  # it came into the zone
    raised_ns: int  # stamp of the row by which the rule held
    row: Row


@dataclass
class _Stay:
    """Of a track in a zone."""

    since_ns: int
    stayed_ns: int = 0  # inside, less what was outside
    is_inside: bool = True


@dataclass
class _Course:
    """What is known of a track that goes on."""

    probability: float = 1.0
    newest_ns: int | None = None
    stays: dict[str, _Stay] = field(default_factory=dict)
    alarms: dict[str, Alarm] = field(default_factory=dict)


class Watchman:
    """The rules of one station. Time is that of the rows, however fast they come."""

    def __init__(self, zones: Sequence[Zone]) -> None:
        self._zones = Zones(zones)
        self._courses: dict[int, _Course] = {}

    def known(self, track: int, probability: float | None) -> None:
        """How likely a track is a drone, as of now; None where nothing was told."""
        if probability is not None:
            self._course(track).probability = probability

    def take(self, row: Row) -> list[Alarm]:
        """The alarms that this row raises: for each track and zone one at most."""
        self.known(row.track, row.drone)
        course = self._course(row.track)
        passed_ns = row.timestamp - course.newest_ns if course.newest_ns is not None else 0
        if course.newest_ns is not None and -BACK_NS <= passed_ns <= 0:
            return []  # told before
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
            # Between a row outside and one inside it was in neither for all of the time.
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
        """The track has ended, and so have these alarms."""
        course = self._courses.pop(track, None)
        return [] if course is None else list(course.alarms.values())

    def _course(self, track: int) -> _Course:
        return self._courses.setdefault(track, _Course())
