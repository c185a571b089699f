"""Recordings of ROS 1 and ROS 2: clouds and truth out of their topics, one message at a time."""

from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar

from rosbags.interfaces import Connection
from rosbags.serde import SerdeError

from unlidar.conversion.bag_files import is_bag, open_bag
from unlidar.conversion.bag_poses import BagPoses, Stamp, find_poses
from unlidar.conversion.bag_sensors import BagSensors
from unlidar.conversion.bag_topics import BagTopics
from unlidar.conversion.clouds import (
    POINT_CLOUD,
    decode_cloud,
    deserialize,
    header_ns,
    read_header,
    stamp_ns,
)
from unlidar.conversion.message_types import (
    is_ros1,
    types_of,
)
from unlidar.conversion.positions import FIX, Positions
from unlidar.conversion.scans import unpacked_message, widest
from unlidar.conversion.sensor_poses import SensorPoses
from unlidar.conversion.source import Options, SourceFrame, Stream, TruthRow, Unreadable, Window
from unlidar.conversion.stamp_selector import StampSelector
from unlidar.conversion.transforms import StaticTransforms
from unlidar.errors import InputError, listed, reason
from unlidar.limits import MEGABYTE, TooLargeError
from unlidar.point_times import OFFSET_FIELD, offsets_ns
from unlidar.poses import Poses
from unlidar.stamps import format_stamp_ns
from unlidar.station import Pose

# Messages read to find the sensors of a topic: they take turns, so a few are enough.
_MESSAGES_OF_A_TOPIC = 50
_POSES_MARGIN_NS = 2_000_000_000  # poses of the first and the last frame may be logged beyond them
_MOST_PARSED = MEGABYTE  # bytes of a message that rosbags parses into objects
_ALL = Window(None, None)
# Exceptions of the parser for messages whose bytes or definition are wrong.
_UNREADABLE = (ValueError, AttributeError, LookupError, TypeError, OverflowError, SerdeError)


class RosBag:
    """A .bag, .db3 or .mcap, or the folder of one."""

    kind: ClassVar[str] = "rosbag"
    description: ClassVar[str] = (
        "a ROS 1 or ROS 2 recording (.bag, .db3, .mcap, or a folder of them)"
    )
    keeps_beginning: ClassVar[bool] = True

    def __init__(self, path: Path, options: Options) -> None:
        self._path, self._options = path, options
        self._opened = open_bag(path)
        self._readers, self._flaw = self._opened.parts, self._opened.flaw
        connections = [c for reader in self._readers for c in reader.connections]
        self._topics = BagTopics(path, connections, options)
        self._sensors = BagSensors({topic: self._frame_ids(topic) for topic in self._topics.clouds})
        self.sensors = {
            name: -(-self._topics.all[topic].messages // len(self._sensors.of_topic(topic)))
            for name, topic in self._sensors.all().items()
        }
        self.truths = len(self._topics.truths)
        self._positions = Positions(options.origin)
        self._transforms = self._read_transforms()
        self._poses = BagPoses()
        self._sensor_poses = SensorPoses(self._transforms, {})
        self._unread_poses: dict[str, int] = {}  # messages by topic
        self._stamps: dict[str, StampSelector] = {}
        self._misfits: dict[str, int] = {}  # messages whose point times fit no unit or epoch
        self._read = 0

    @classmethod
    def matches(cls, path: Path) -> bool:
        """By the endings of files, and metadata.yaml."""
        return is_bag(path)

    def lidars(self) -> list[str]:
        """Sensors of non-empty cloud topics without radars, or of the clouds named by `--topic`."""
        named = [
            name for topic in self._topics.named_clouds() for name in self._sensors.of_topic(topic)
        ]
        if named:
            return named
        found = [
            sensor
            for sensor, topic in self._sensors.all().items()
            if self._topics.all[topic].messages and not self._topics.all[topic].is_radar
        ]
        if not found:
            flaw = f"{self._flaw}; " if self._flaw else ""
            raise InputError(f"{flaw}{self._topics.why_no_clouds()}")
        return found

    def streams(self) -> list[Stream]:
        """Its topics."""
        return [
            Stream(
                topic.name,
                topic.type,
                topic.messages,
                self._topics.becomes(topic, self._sensors.of_topic(topic.name)),
            )
            for topic in self._topics.all.values()
        ]

    def spans_ns(self) -> dict[str, tuple[int, int]]:
        """Log times of its topics."""
        return widest(item for reader in self._readers for item in reader.spans_ns().items())

    def total(self, sensors: list[str]) -> int:
        """Estimated from the share of the time window in the bag's duration."""
        messages = sum(self.sensors[name] for name in sensors)
        messages += sum(self._topics.all[name].messages for name in self._topics.truths)
        begin_ns = min(reader.start_time for reader in self._readers)
        end_ns = max(reader.end_time for reader in self._readers)
        window = self._window()
        first = window.start_ns or begin_ns
        last = end_ns if window.stop_ns is None else min(end_ns, window.stop_ns)
        return round(messages * min(1.0, max(0, last - first) / max(1, end_ns - begin_ns)))

    def items(self, sensors: list[str]) -> Iterator[SourceFrame | TruthRow | Unreadable]:
        """Items in the order of the bag. The time window applies to log times."""
        frames = self._sensors.frames()
        own = {name: frames[name] for name in sensors}
        self._poses = find_poses(self._topics, self._transforms, own.values(), self._read_poses)
        self._sensor_poses = SensorPoses(self._transforms, own, self._poses.carriers)
        left_out = set(frames) - set(sensors)
        wanted = {topic for name, topic in self._sensors.all().items() if name in sensors}
        wanted |= set(self._topics.truths)
        window = self._window()
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
        """Where the sensors stand by /tf_static."""
        return self._sensor_poses.mountings()

    def poses(self) -> dict[str, Poses]:
        """Of the carriers of sensors, by /tf or odometry."""
        return self._sensor_poses.poses()

    def notes(self) -> list[str]:
        """Notes on choices made, unrelated coordinate frames, and unusual stamps or point times."""
        notes = [*self._opened.notes, *self._sensor_notes(), *self._topics.truth_notes()]
        notes += [*self._poses.notes, *self._sensor_poses.notes()]
        for topic, messages in self._unread_poses.items():
            notes.append(f"{topic}: {messages} messages cannot be read, left out")
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
        """The topics read, with their coordinate frames and stamps."""
        return {
            "topics": self._sensors.all(),
            "frame_ids": self._sensors.frames(),
            "common_frame": self._sensor_poses.common,
            "poses_topic": self._poses.topic,
            "truth_topics": self._topics.truths,
            "stamps": {topic: stamps.facts() for topic, stamps in self._stamps.items()},
            "origin": self._positions.origin_text(),
        }

    def close(self) -> None:
        """Closes the files."""
        self._opened.close()

    def _window(self) -> Window:
        """The part of the bag that is converted, in log times."""
        return self._options.window(min(reader.start_time for reader in self._readers))

    def _messages(
        self, topic: str, window: Window = _ALL
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """The messages of one topic up to the first damage, which items() reports later."""
        for reader in self._readers:
            chosen = [c for c in reader.connections if c.topic == topic]
            if not chosen:
                continue
            with suppress(Exception):
                found = reader.messages(chosen, window.start_ns, window.stop_ns)
                for connection, log_ns, raw in found:
                    yield connection, log_ns, _plain(connection, raw)

    def _frame_ids(self, topic: str) -> list[str]:
        """The frame_ids in the first messages of a cloud topic."""
        found = []
        for connection, _, raw in islice(self._messages(topic), _MESSAGES_OF_A_TOPIC):
            with suppress(ValueError):
                found.append(read_header(raw, is_ros1(connection)).frame_id)
        return found

    def _read_transforms(self) -> StaticTransforms:
        transforms = StaticTransforms()
        for topic in filter(lambda topic: topic.is_static, self._topics.all.values()):
            for connection, _, raw in self._messages(topic.name):
                try:
                    transforms.add(_parsed(connection, raw))
                except _UNREADABLE:
                    transforms.unusable.append(topic.name)
        return transforms

    def _read_poses(self, topic: str) -> Iterator[tuple[Any, Stamp]]:
        """The messages of a topic of poses; their stamps are of the frames' clock."""
        window = self._window()
        start_ns, stop_ns = window.start_ns, window.stop_ns
        wider = Window(
            None if start_ns is None else start_ns - _POSES_MARGIN_NS,
            None if stop_ns is None else stop_ns + _POSES_MARGIN_NS,
        )
        for connection, log_ns, raw in self._messages(topic, wider):
            try:
                message = _parsed(connection, raw)
            except _UNREADABLE:
                self._unread_poses[topic] = self._unread_poses.get(topic, 0) + 1
                continue
            clock = StampSelector(self._options.stamp)
            yield message, lambda header, log=log_ns, c=clock: c.pick(header_ns(header), log)

    def _next(
        self, messages: Iterator[tuple[Connection, int, bytes]]
    ) -> tuple[Connection, int, bytes] | None:
        try:
            message = next(messages, None)
        except Exception as error:  # damaged bytes raise anything in the parser
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
            raw = _plain(connection, raw)
            if topic in self._topics.truths:
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
        if connection.msgtype != FIX:  # a fix is in the antenna's frame
            position = self._sensor_poses.truth(message.header.frame_id, position, stamp)
        return TruthRow(format_stamp_ns(stamp), position, self._topics.truths.index(topic))

    def _frame(
        self, connection: Connection, log_ns: int, raw: bytes, left_out: set[str]
    ) -> SourceFrame | None:
        topic = connection.topic
        cloud = decode_cloud(raw, connection.msgtype, types_of(connection), is_ros1(connection))
        others = self._sensors.of_topic(topic)
        sensor = self._sensors.name(topic, cloud.frame_id)
        if sensor not in others and left_out.intersection(others):
            left_out.add(sensor)  # first seen late; not chosen, as the others of its topic
        if sensor in left_out:
            return None
        self._sensor_poses.add_sensor(sensor, cloud.frame_id)
        fields = {}
        if cloud.times is not None:
            if connection.msgtype == POINT_CLOUD:
                offsets = offsets_ns(cloud.times, cloud.header_ns or log_ns)
            else:
                offsets = cloud.times.astype("i8")  # CustomMsg: always offsets, of any length
            if offsets is None:
                self._misfits[topic] = self._misfits.get(topic, 0) + 1
            else:
                fields[OFFSET_FIELD] = offsets
        if cloud.tag is not None:
            fields["tag"] = cloud.tag
        stamp = format_stamp_ns(self._seen(topic).pick(cloud.header_ns, log_ns))
        return SourceFrame(sensor, stamp, cloud.xyz_m, fields)

    def _seen(self, topic: str) -> StampSelector:
        return self._stamps.setdefault(topic, StampSelector(self._options.stamp))

    def _sensor_notes(self) -> list[str]:
        notes = []
        for topic in dict.fromkeys(self._sensors.all().values()):
            names = self._sensors.of_topic(topic)
            if len(names) > 1:
                notes.append(f"{topic}: has {len(names)} frame_ids, each a sensor: {listed(names)}")
        return notes


def _plain(connection: Connection, raw: bytes) -> bytes:
    return raw if is_ros1(connection) else unpacked_message(raw)


def _parsed(connection: Connection, raw: bytes) -> Any:
    """Deserialises a message other than a cloud; ValueError if it exceeds _MOST_PARSED."""
    if len(raw) > _MOST_PARSED:
        raise TooLargeError("a message", len(raw), _MOST_PARSED)
    return deserialize(raw, connection.msgtype, types_of(connection), is_ros1(connection))
