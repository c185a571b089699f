"""When an alarm is raised: a track that may be a drone stays in a zone."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from unlidar_tools.events.event import Row
from unlidar_tools.events.site import Zone


@dataclass(frozen=True)
class Alarm:
    """One track in one zone, from the moment the rule held until the track ends."""

    zone: str
    track: int
    since_ns: int  # it came into the zone
    raised_ns: int  # stamp of the row by which the rule held
    row: Row


@dataclass
class _Course:
    """What is known of a track that goes on."""

    probability: float = 1.0
    newest_ns: int | None = None
    inside_since_ns: dict[str, int] = field(default_factory=dict)
    alarms: dict[str, Alarm] = field(default_factory=dict)


class Watchman:
    """The rules of one station. Time is that of the rows, however fast they come."""

    def __init__(self, zones: Sequence[Zone]) -> None:
        self._zones = zones
        self._courses: dict[int, _Course] = {}

    def known(self, track: int, probability: float | None) -> None:
        """How likely a track is a drone, as of now; None where nothing was told."""
        if probability is not None:
            self._course(track).probability = probability

    def take(self, row: Row) -> list[Alarm]:
        """The alarms that this row raises: for each track and zone one at most."""
        self.known(row.track, row.drone)
        course = self._course(row.track)
        if course.newest_ns is not None and row.timestamp <= course.newest_ns:
            return []  # told before
        course.newest_ns = row.timestamp
        raised = []
        for zone in self._zones:
            if not zone.holds(row.x, row.y, row.z):
                course.inside_since_ns.pop(zone.name, None)
                continue
            since_ns = course.inside_since_ns.setdefault(zone.name, row.timestamp)
            if (
                zone.name not in course.alarms
                and row.timestamp - since_ns >= round(zone.rule.min_stay_s * 1e9)
                and course.probability >= zone.rule.min_probability
            ):
                alarm = Alarm(zone.name, row.track, since_ns, row.timestamp, row)
                course.alarms[zone.name] = alarm
                raised.append(alarm)
        return raised

    def end(self, track: int) -> list[Alarm]:
        """The track has ended, and so have these alarms."""
        course = self._courses.pop(track, None)
        return [] if course is None else list(course.alarms.values())

    def end_all(self) -> list[Alarm]:
        """The engine has begun anew: no track from before goes on."""
        return [alarm for track in list(self._courses) for alarm in self.end(track)]

    def _course(self, track: int) -> _Course:
        return self._courses.setdefault(track, _Course())
