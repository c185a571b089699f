"""Recordings of ROS 1 and ROS 2: clouds and truth out of their topics, one message at a time."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar

from rosbags.interfaces import Connection
from rosbags.serde import SerdeError

from unlidar_tools.convert.bag_files import is_bag, open_bag
from unlidar_tools.convert.bag_sensors import BagSensors
from unlidar_tools.convert.clouds import (
    CLOUD_TYPES,
    POINT_CLOUD,
    decode_cloud,
    deserialize,
    read_header,
    stamp_ns,
)
from unlidar_tools.convert.message_types import (
    ROS1_ENCODING,
    ROS2_ENCODING,
    encoding_of,
    is_ros1,
    types_of,
)
from unlidar_tools.convert.placing import Placing
from unlidar_tools.convert.point_times import OFFSET_FIELD, offsets_ns
from unlidar_tools.convert.positions import FIX, POSITION_TYPES, Positions, says_truth
from unlidar_tools.convert.source import Options, SourceFrame, Stream, TruthRow, Unreadable
from unlidar_tools.convert.stamps_seen import StampsSeen
from unlidar_tools.convert.transforms import StaticTransforms, is_static_topic
from unlidar_tools.errors import InputError, UsageError, reason
from unlidar_tools.stamps import format_stamp_ns
from unlidar_tools.station import Pose

_REFUSED = {
    "sensor_msgs/msg/LaserScan": "a scan of one plane, which cannot tell where a drone is in 3-D",
    "sensor_msgs/msg/MultiEchoLaserScan": "a scan of one plane, no cloud",
}
_MMAUD_TRUTH = "/leica/point/relative"
# So many messages tell which sensors send to a topic: they take turns.
_MESSAGES_OF_A_TOPIC = 50
# What a message whose bytes or definition are wrong makes of its parser.
_UNREADABLE = (ValueError, AttributeError, LookupError, TypeError, OverflowError, SerdeError)


@dataclass(frozen=True)
class _Topic:
    name: str
    msgtype: str  # with its encoding where that is none of ROS
    messages: int

    @property
    def type(self) -> str:
        """As ROS spells it, the same for both versions."""
        return self.msgtype.replace("/msg/", "/")


class RosBag:
    """A .bag, .db3 or .mcap, or the folder of one."""

    kind: ClassVar[str] = "rosbag"
    description: ClassVar[str] = (
        "a ROS 1 or ROS 2 recording (.bag, .db3, .mcap, or a folder of them)"
    )
    keeps_beginning: ClassVar[bool] = True

    def __init__(self, path: Path, options: Options) -> None:
        self._path, self._options = path, options
        opened = open_bag(path)
        self._readers, self._flaw, self._opened_notes = opened.parts, opened.flaw, opened.notes
        self._topics = {
            name: _Topic(name, _type_of(own[0]), sum(c.msgcount for c in own))
            for name, own in sorted(_by_topic(self._connections()).items())
        }
        clouds = [t.name for t in self._topics.values() if t.msgtype in CLOUD_TYPES]
        self._sensors = BagSensors({topic: self._frame_ids(topic) for topic in clouds})
        self.sensors = {
            name: -(-self._topics[topic].messages // len(self._sensors.of_topic(topic)))
            for name, topic in self._sensors.all().items()
        }
        self._truth_topics, self._why_truth = self._choose_truth()
        self.truths = len(self._truth_topics)
        self._positions = Positions(options.origin)
        self._placing = Placing(self._transforms(), {})
        self._stamps: dict[str, StampsSeen] = {}
        self._misfits: dict[str, int] = {}  # messages whose point times fit no reading
        self._read = 0

    @classmethod
    def matches(cls, path: Path) -> bool:
        """By the endings of files, and metadata.yaml."""
        return is_bag(path)

    def lidars(self) -> list[str]:
        """Clouds that hold messages, without radars; those of `--topic` where it names some."""
        named = []
        for name in self._options.topics:
            self._refuse_topic(
                name, (*CLOUD_TYPES, *POSITION_TYPES), "neither a cloud nor a position"
            )
            named += self._sensors.of_topic(name)
        if named:
            return named
        found = [
            sensor
            for sensor, topic in self._sensors.all().items()
            if self._topics[topic].messages and not _is_radar(topic)
        ]
        if not found:
            raise InputError(self._why_nothing())
        return found

    def streams(self) -> list[Stream]:
        """Its topics."""
        return [
            Stream(topic.name, topic.type, topic.messages, self._becomes(topic))
            for topic in self._topics.values()
        ]

    def total(self, sensors: list[str]) -> int:
        """By the share of the time asked for in that of the bag."""
        messages = sum(self.sensors[name] for name in sensors)
        messages += sum(self._topics[name].messages for name in self._truth_topics)
        begin_ns = min(reader.start_time for reader in self._readers)
        end_ns = max(reader.end_time for reader in self._readers)
        window = self._options.window(begin_ns)
        first = window.start_ns or begin_ns
        last = end_ns if window.stop_ns is None else min(end_ns, window.stop_ns)
        return round(messages * min(1.0, max(0, last - first) / max(1, end_ns - begin_ns)))

    def items(self, sensors: list[str]) -> Iterator[SourceFrame | TruthRow | Unreadable]:
        """In the order of the bag. Log times decide what lies in the time asked for."""
        frames = self._sensors.frames()
        self._placing = Placing(self._transforms(), {name: frames[name] for name in sensors})
        left_out = set(frames) - set(sensors)
        wanted = {topic for name, topic in self._sensors.all().items() if name in sensors}
        wanted |= set(self._truth_topics)
        begin_ns = min(reader.start_time for reader in self._readers)
        window = self._options.window(begin_ns)
        for reader in self._readers:
            chosen = [c for c in reader.connections if c.topic in wanted]
            if not chosen:
                continue
            messages = iter(reader.messages(chosen, window.start_ns, window.stop_ns))
            while (message := self._next(messages)) is not None:
                item = self._item(*message, left_out)
                if item is not None:
                    yield item
        if self._flaw:
            raise InputError(self._flaw)

    def station(self) -> dict[str, Pose]:
        """As /tf_static says."""
        return self._placing.poses()

    def notes(self) -> list[str]:
        """What was chosen, could not be related, or differs from what one expects."""
        notes = [*self._opened_notes, *self._sensor_notes(), *self._truth_notes()]
        notes += self._placing.notes()
        found = [stamps.note(topic) for topic, stamps in self._stamps.items()]
        notes += [note for note in found if note]
        for topic, messages in self._misfits.items():
            notes.append(f"{topic}: point times of {messages} messages fit no stamp, left out")
        if origin := self._positions.origin_text():
            given = "as given" if self._positions.origin_given else "the first fix"
            notes.append(
                f"truth is east, north, up of {origin} ({given}; "
                "latitude, longitude, height above the ellipsoid)"
            )
        if self._positions.skipped:
            notes.append(f"{self._positions.skipped} truth messages without a position left out")
        return notes

    def facts(self) -> dict:
        """What was read from which topic."""
        return {
            "topics": self._sensors.all(),
            "frame_ids": self._sensors.frames(),
            "common_frame": self._placing.common,
            "truth_topics": self._truth_topics,
            "stamps": {topic: stamps.facts() for topic, stamps in self._stamps.items()},
            "origin": self._positions.origin_text(),
        }

    def close(self) -> None:
        """Closes the files."""
        for reader in self._readers:
            reader.close()

    def _connections(self) -> list[Connection]:
        return [connection for reader in self._readers for connection in reader.connections]

    def _messages(self, topic: str) -> Iterator[tuple[Connection, bytes]]:
        """Of one topic, up to where the bag is damaged: that is told when all is read."""
        for reader in self._readers:
            chosen = [c for c in reader.connections if c.topic == topic]
            with suppress(Exception):
                for connection, _, raw in reader.messages(chosen, None, None) if chosen else ():
                    yield connection, raw

    def _frame_ids(self, topic: str) -> list[str]:
        """Of the first messages of a topic of clouds."""
        found = []
        for connection, raw in islice(self._messages(topic), _MESSAGES_OF_A_TOPIC):
            with suppress(ValueError):
                found.append(read_header(raw, is_ros1(connection)).frame_id)
        return found

    def _transforms(self) -> StaticTransforms:
        transforms = StaticTransforms()
        for topic in self._topics.values():
            if not is_static_topic(topic.name, topic.msgtype):
                continue
            for connection, raw in self._messages(topic.name):
                try:
                    transforms.add(_parsed(connection, raw))
                except _UNREADABLE:
                    transforms.unusable.append(topic.name)
        return transforms

    def _next(
        self, messages: Iterator[tuple[Connection, int, bytes]]
    ) -> tuple[Connection, int, bytes] | None:
        try:
            message = next(messages, None)
        except Exception as error:  # whatever damaged bytes make of the parser
            raise InputError(
                f"{self._path}: damaged after {self._read} messages: {reason(error)}"
            ) from error
        self._read += 1
        return message

    def _item(
        self, connection: Connection, log_ns: int, raw: bytes, left_out: set[str]
    ) -> SourceFrame | TruthRow | Unreadable | None:
        topic = connection.topic
        try:
            if topic in self._truth_topics:
                return self._truth(connection, log_ns, raw)
            return self._frame(connection, log_ns, raw, left_out)
        except _UNREADABLE as error:
            where = f"{topic} ({connection.msgtype.replace('/msg/', '/')})"
            said = f"{self._path}: {where} at {format_stamp_ns(log_ns)}: {reason(error)}"
            return Unreadable(topic, said)

    def _truth(self, connection: Connection, log_ns: int, raw: bytes) -> TruthRow | None:
        topic = connection.topic
        message = _parsed(connection, raw)
        position = self._positions.read(message, connection.msgtype)
        stamp = self._seen(topic).pick(stamp_ns(message), log_ns)
        if position is None:
            return None
        if connection.msgtype != FIX:  # whose frame is that of the antenna
            position = self._placing.truth(message.header.frame_id, position)
        return TruthRow(format_stamp_ns(stamp), position, self._truth_topics.index(topic))

    def _frame(
        self, connection: Connection, log_ns: int, raw: bytes, left_out: set[str]
    ) -> SourceFrame | None:
        topic = connection.topic
        cloud = decode_cloud(raw, connection.msgtype, types_of(connection), is_ros1(connection))
        others = self._sensors.of_topic(topic)
        sensor = self._sensors.name(topic, cloud.frame_id)
        if sensor not in others and left_out.intersection(others):
            left_out.add(sensor)  # turned up late: it goes with the others of its topic
        if sensor in left_out:
            return None
        self._placing.add_sensor(sensor, cloud.frame_id)
        fields = {}
        if cloud.times is not None:
            if connection.msgtype == POINT_CLOUD:
                offsets = offsets_ns(cloud.times, cloud.header_ns or log_ns)
            else:
                offsets = cloud.times.astype("i8")  # defined as offsets, of any length
            if offsets is None:
                self._misfits[topic] = self._misfits.get(topic, 0) + 1
            else:
                fields[OFFSET_FIELD] = offsets
        if cloud.tag is not None:
            fields["tag"] = cloud.tag
        stamp = format_stamp_ns(self._seen(topic).pick(cloud.header_ns, log_ns))
        return SourceFrame(sensor, stamp, cloud.xyz_m, fields)

    def _seen(self, topic: str) -> StampsSeen:
        return self._stamps.setdefault(topic, StampsSeen(self._options.stamp))

    def _choose_truth(self) -> tuple[list[str], str]:
        """The topics and why: named ones, each a target; else one whose name says that it is."""
        for name in self._options.truths:
            self._refuse_topic(name, POSITION_TYPES, "no position")
        known = self._position_topics()
        named = [name for name in (*self._options.truths, *self._options.topics) if name in known]
        if named:
            return list(dict.fromkeys(named)), "as asked for"
        if _MMAUD_TRUTH in known:
            return [_MMAUD_TRUTH], "MMAUD's"
        telling = sorted(
            (name for name in known if says_truth(name)),
            key=lambda name: POSITION_TYPES.index(known[name].msgtype),
        )
        return telling[:1], "by its name"

    def _position_topics(self) -> dict[str, _Topic]:
        return {
            name: topic
            for name, topic in self._topics.items()
            if topic.msgtype in POSITION_TYPES and topic.messages
        }

    def _sensor_notes(self) -> list[str]:
        notes = []
        for topic in dict.fromkeys(self._sensors.all().values()):
            names = self._sensors.of_topic(topic)
            if len(names) > 1:
                notes.append(
                    f"{topic}: has {len(names)} frame_ids, each a sensor: {', '.join(names)}"
                )
        return notes

    def _truth_notes(self) -> list[str]:
        others = ", ".join(n for n in self._position_topics() if n not in self._truth_topics)
        if self._truth_topics:
            notes = f"truth is {', '.join(self._truth_topics)} ({self._why_truth})"
            return [f"{notes} and not {others}: --truth for another" if others else notes]
        if others:
            return [f"no truth: no name of {others} says that it is, --truth takes one"]
        return []

    def _refuse_topic(self, name: str, types: tuple[str, ...], otherwise: str) -> None:
        topic = self._topics.get(name)
        if topic is None:
            raise UsageError(
                f"{self._path}: has no topic '{name}', it holds {', '.join(self._topics)}"
            )
        if topic.msgtype not in types:
            why = _REFUSED.get(topic.msgtype, otherwise)
            raise InputError(f"{self._path}: {name} is {topic.type}: {why}")
        if not topic.messages:
            raise InputError(f"{self._path}: {name} has no messages")

    def _why_nothing(self) -> str:
        held = ", ".join(
            f"{t.name} ({t.type}{'' if t.messages else ', no messages'})"
            for t in self._topics.values()
        )
        refused = {
            t.type: _REFUSED[t.msgtype] for t in self._topics.values() if t.msgtype in _REFUSED
        }
        why = "".join(f"; {name} is {text}" for name, text in refused.items())
        flaw = f"{self._flaw}; " if self._flaw else ""
        return f"{flaw}{self._path}: has no topic with clouds, it holds {held or 'no topic'}{why}"

    def _becomes(self, topic: _Topic) -> str:
        names = self._sensors.of_topic(topic.name)
        if names:
            only = ", only if named" if _is_radar(topic.name) else ""
            return f"frames of {', '.join(names)}{only}"
        if topic.name in self._truth_topics:
            return "ground_truth.csv"
        if topic.msgtype in POSITION_TYPES:
            return "ground_truth.csv, only if named"
        if is_static_topic(topic.name, topic.msgtype):
            return "station.yaml"
        return f"refused: {_REFUSED[topic.msgtype]}" if topic.msgtype in _REFUSED else ""


def _by_topic(connections: list[Connection]) -> dict[str, list[Connection]]:
    found: dict[str, list[Connection]] = {}
    for connection in connections:
        found.setdefault(connection.topic, []).append(connection)
    return found


def _type_of(connection: Connection) -> str:
    """With the encoding where that is not one of ROS: then the type says nothing."""
    encoding = encoding_of(connection)
    is_ros = encoding in (ROS1_ENCODING, ROS2_ENCODING)
    return connection.msgtype if is_ros else f"{connection.msgtype} in {encoding}, not of ROS"


def _parsed(connection: Connection, raw: bytes) -> Any:
    return deserialize(raw, connection.msgtype, types_of(connection), is_ros1(connection))


def _is_radar(topic: str) -> bool:
    return "radar" in topic.lower()
