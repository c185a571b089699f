"""The topics of a bag: its clouds and its ground truth."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from rosbags.interfaces import Connection

from unlidar.conversion.clouds import CLOUD_TYPES
from unlidar.conversion.message_types import ROS1_ENCODING, ROS2_ENCODING, encoding_of
from unlidar.conversion.positions import POSITION_TYPES, says_truth
from unlidar.conversion.source import Options
from unlidar.conversion.transforms import (
    AT_REST,
    ODOMETRY,
    POSE_TYPES,
    TRANSFORM_TYPES,
    is_static_topic,
)
from unlidar.errors import InputError, UsageError, listed

_REFUSED = {
    "sensor_msgs/msg/LaserScan": "a scan of one plane, which cannot tell where a drone is in 3-D",
    "sensor_msgs/msg/MultiEchoLaserScan": "a scan of one plane, no cloud",
}
_MMAUD_TRUTH = "/leica/point/relative"


@dataclass(frozen=True)
class Topic:
    """Name, type and size of a topic."""

    name: str
    msgtype: str  # with the encoding appended if that is not ROS
    messages: int

    @property
    def type(self) -> str:
        """The type as `package/msg/Name` for both versions of ROS."""
        return self.msgtype.replace("/msg/", "/")

    @property
    def is_radar(self) -> bool:
        """True if the name says radar: radars publish clouds, too."""
        return "radar" in self.name.lower()

    @property
    def is_static(self) -> bool:
        """True if it holds static transforms."""
        return is_static_topic(self.name, self.msgtype)


class BagTopics:
    """All topics by name, with the choice of clouds and truth by the options."""

    def __init__(self, path: Path, connections: Iterable[Connection], options: Options) -> None:
        """UsageError or InputError for a topic option that is unknown or of another type."""
        self._path, self._options = path, options
        found: dict[str, Topic] = {}
        for c in connections:
            before = found.get(c.topic)
            messages = c.msgcount + (before.messages if before else 0)
            found[c.topic] = Topic(c.topic, _type_of(c), messages)
        self.all = dict(sorted(found.items()))
        self.clouds = [name for name, t in self.all.items() if t.msgtype in CLOUD_TYPES]
        self._positions = {
            name: t for name, t in self.all.items() if t.msgtype in POSITION_TYPES and t.messages
        }
        self.truths, self._why_truth = self._choose_truth()  # the topics, each a target
        self.poses_topic = options.poses_topic
        if self.poses_topic not in (None, AT_REST):
            self._check(self.poses_topic, POSE_TYPES, "tells of no pose")

    def named_clouds(self) -> list[str]:
        """The clouds among `--topic`, which may also name truth."""
        for name in self._options.topics:
            self._check(name, (*CLOUD_TYPES, *POSITION_TYPES), "neither a cloud nor a position")
        return [name for name in self._options.topics if name in self.clouds]

    def truth_notes(self) -> list[str]:
        """Notes on the choice of truth topics, or the reason for none."""
        others = listed(name for name in self._positions if name not in self.truths)
        if self.truths:
            note = f"truth is {listed(self.truths)} ({self._why_truth})"
            return [f"{note} and not {others}: --truth for another" if others else note]
        if others:
            return [f"no truth: no name of {others} says that it is, --truth takes one"]
        return []

    def becomes(self, topic: Topic, sensors: list[str]) -> str:
        """The column `becomes` of --list: the result of conversion, or the reason for none."""
        if sensors:
            return f"frames of {', '.join(sensors)}{', only if named' * topic.is_radar}"
        if topic.name in self.truths:
            return "ground_truth.csv"
        if topic.msgtype == ODOMETRY:
            return "poses where it moves a LiDAR; ground_truth.csv, only if named"
        if topic.msgtype in POSITION_TYPES:
            return "ground_truth.csv, only if named"
        if topic.is_static:
            return "station.yaml"
        if topic.msgtype in TRANSFORM_TYPES:
            return "poses where it moves a LiDAR"
        return f"refused: {_REFUSED[topic.msgtype]}" if topic.msgtype in _REFUSED else ""

    def why_no_clouds(self) -> str:
        """The message if a bag has no clouds: lists the types it holds."""
        topics = sorted(self.all.values(), key=lambda topic: not topic.messages)
        held = listed(f"{t.name} ({t.type}{'' if t.messages else ', no messages'})" for t in topics)
        refused = {t.type: _REFUSED[t.msgtype] for t in topics if t.msgtype in _REFUSED}
        why = "".join(f"; {name} is {text}" for name, text in refused.items())
        return f"{self._path}: has no topic with clouds, it holds {held or 'no topic'}{why}"

    def _choose_truth(self) -> tuple[list[str], str]:
        """Truth topics: those of the options, a target each; else MMAUD's; else one by name."""
        for name in self._options.truths:
            self._check(name, POSITION_TYPES, "no position")
        asked = (*self._options.truths, *self._options.topics)
        named = [name for name in dict.fromkeys(asked) if name in self._positions]
        if named:
            return named, "as asked for"
        if _MMAUD_TRUTH in self._positions:
            return [_MMAUD_TRUTH], "MMAUD's"
        named_as_truth = sorted(
            filter(says_truth, self._positions),
            key=lambda name: POSITION_TYPES.index(self._positions[name].msgtype),
        )
        return named_as_truth[:1], "by its name"

    def _check(self, name: str, types: tuple[str, ...], otherwise: str) -> None:
        topic = self.all.get(name)
        if topic is None:
            raise UsageError(f"{self._path}: has no topic '{name}', it holds {listed(self.all)}")
        if topic.msgtype not in types:
            why = _REFUSED.get(topic.msgtype, otherwise)
            raise InputError(f"{self._path}: {name} is {topic.type}: {why}")
        if not topic.messages:
            raise InputError(f"{self._path}: {name} has no messages")


def _type_of(connection: Connection) -> str:
    """The type, with the encoding appended if that is not ROS: then the type is meaningless."""
    encoding = encoding_of(connection)
    is_ros = encoding in (ROS1_ENCODING, ROS2_ENCODING)
    return connection.msgtype if is_ros else f"{connection.msgtype} in {encoding}, not of ROS"
