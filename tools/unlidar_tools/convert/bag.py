"""Recordings of ROS 1 and ROS 2: clouds and truth out of their topics, one message at a time."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from rosbags.interfaces import Connection
from rosbags.serde import SerdeError

from unlidar_tools.convert.bag_files import Part, is_bag, open_bag
from unlidar_tools.convert.clouds import (
    CLOUD_TYPES,
    POINT_CLOUD,
    decode_cloud,
    deserialize,
    stamp_ns,
)
from unlidar_tools.convert.message_types import types_of
from unlidar_tools.convert.point_times import OFFSET_FIELD, offsets_ns
from unlidar_tools.convert.positions import POSITION_TYPES, Positions
from unlidar_tools.convert.source import Options, SourceFrame, Stream, TruthRow
from unlidar_tools.convert.stamps_seen import StampsSeen
from unlidar_tools.errors import InputError, UsageError, reason
from unlidar_tools.stamps import format_stamp_ns

_REFUSED = {
    "sensor_msgs/msg/LaserScan": "a scan of one plane, which cannot tell where a drone is in 3-D",
    "sensor_msgs/msg/MultiEchoLaserScan": "a scan of one plane, no cloud",
}
# Topics of the MMAUD data set and what its folders call them.
_MMAUD_SENSORS = {"/livox_mid360/lidar": "lidar_360", "/livox_avia/lidar": "livox_avia"}
_MMAUD_TRUTH = "/leica/point/relative"


@dataclass(frozen=True)
class _Topic:
    name: str
    msgtype: str
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
        self._parts, self._flaw = opened.parts, opened.flaw
        self._topics = _topics(self._parts)
        clouds = [t for t in self._topics.values() if t.msgtype in CLOUD_TYPES]
        self._names = _sensor_names([topic.name for topic in clouds])
        self.sensors = {self._names[t.name]: t.messages for t in clouds}
        self._truth_topics = self._choose_truth()
        self.truths = len(self._truth_topics)
        self._positions = Positions(options.origin)
        self._stamps: dict[str, StampsSeen] = {}
        self._misfits: dict[str, int] = {}  # messages whose point times fit no reading
        self._read = 0

    @classmethod
    def matches(cls, path: Path) -> bool:
        """By the endings of files, and metadata.yaml."""
        return is_bag(path)

    def lidars(self) -> list[str]:
        """Clouds that hold messages, without radars; those of `--topic` where it names some."""
        for name in self._options.topics:
            self._refuse_topic(name)
        named = [self._names[name] for name in self._options.topics if name in self._names]
        if named:
            return named
        found = [
            sensor
            for topic, sensor in self._names.items()
            if self.sensors[sensor] and "radar" not in topic.lower()
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
        begin_ns = min(part.reader.start_time for part in self._parts)
        end_ns = max(part.reader.end_time for part in self._parts)
        window = self._options.window(begin_ns)
        first = window.start_ns or begin_ns
        last = end_ns if window.stop_ns is None else min(end_ns, window.stop_ns)
        return round(messages * min(1.0, max(0, last - first) / max(1, end_ns - begin_ns)))

    def items(self, sensors: list[str]) -> Iterator[SourceFrame | TruthRow]:
        """In the order of the bag. Log times decide what lies in the time asked for."""
        wanted = {topic for topic, sensor in self._names.items() if sensor in sensors}
        wanted |= set(self._truth_topics)
        begin_ns = min(part.reader.start_time for part in self._parts)
        window = self._options.window(begin_ns)
        for part in self._parts:
            chosen = [c for c in part.reader.connections if c.topic in wanted]
            if not chosen:
                continue
            messages = iter(part.reader.messages(chosen, window.start_ns, window.stop_ns))
            while (message := self._next(messages)) is not None:
                item = self._item(part, *message)
                if item is not None:
                    yield item
        if self._flaw:
            raise InputError(self._flaw)

    def notes(self) -> list[str]:
        """Stamps that differ, point times of another clock, the origin of fixes, radars left."""
        found = [stamps.note(topic) for topic, stamps in self._stamps.items()]
        notes = [note for note in found if note]
        for topic, messages in self._misfits.items():
            notes.append(f"{topic}: point times of {messages} messages fit no stamp, left out")
        others = [
            t.name
            for t in self._topics.values()
            if t.msgtype in POSITION_TYPES and t.messages and t.name not in self._truth_topics
        ]
        if self._truth_topics and others and not self._options.topics:
            notes.append(
                f"took {self._truth_topics[0]} as truth and not {', '.join(others)}: "
                "--topic for another"
            )
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
        sensors = {sensor: topic for topic, sensor in self._names.items()}
        return {
            "topics": sensors,
            "truth_topics": self._truth_topics,
            "stamps": {topic: stamps.facts() for topic, stamps in self._stamps.items()},
            "origin": self._positions.origin_text(),
        }

    def close(self) -> None:
        """Closes the files."""
        for part in self._parts:
            part.reader.close()

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
        self, part: Part, connection: Connection, log_ns: int, raw: bytes
    ) -> SourceFrame | TruthRow | None:
        topic = connection.topic
        try:
            if topic in self._names:
                return self._frame(part, connection, log_ns, raw)
            store = types_of(connection)
            message = deserialize(raw, connection.msgtype, store, part.is_ros1)
            position = self._positions.read(message, connection.msgtype)
            stamp = self._seen(topic).pick(stamp_ns(message), log_ns)
        except (ValueError, AttributeError, LookupError, SerdeError) as error:
            raise InputError(
                f"{self._path}: {topic} ({connection.msgtype.replace('/msg/', '/')}) at "
                f"{format_stamp_ns(log_ns)}: {reason(error)}"
            ) from error
        if position is None:
            return None
        return TruthRow(format_stamp_ns(stamp), position, self._truth_topics.index(topic))

    def _frame(self, part: Part, connection: Connection, log_ns: int, raw: bytes) -> SourceFrame:
        topic = connection.topic
        cloud = decode_cloud(raw, connection.msgtype, types_of(connection), part.is_ros1)
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
        return SourceFrame(self._names[topic], stamp, cloud.xyz_m, fields)

    def _seen(self, topic: str) -> StampsSeen:
        return self._stamps.setdefault(topic, StampsSeen(self._options.stamp))

    def _choose_truth(self) -> list[str]:
        """Named ones, each a target; else one: MMAUD's, or the first of the most telling type."""
        candidates = [
            t for t in self._topics.values() if t.msgtype in POSITION_TYPES and t.messages
        ]
        names = [topic.name for topic in candidates]
        named = [name for name in self._options.topics if name in names]
        if named or not names:
            return named
        if _MMAUD_TRUTH in names:
            return [_MMAUD_TRUTH]
        return [min(candidates, key=lambda t: POSITION_TYPES.index(t.msgtype)).name]

    def _refuse_topic(self, name: str) -> None:
        topic = self._topics.get(name)
        if topic is None:
            raise UsageError(
                f"{self._path}: has no topic '{name}', it holds {', '.join(self._topics)}"
            )
        if topic.msgtype not in CLOUD_TYPES and topic.msgtype not in POSITION_TYPES:
            why = _REFUSED.get(topic.msgtype, "neither a cloud nor a position")
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
        if topic.name in self._names:
            if "radar" in topic.name.lower():
                return f"frames of {self._names[topic.name]}, only if named"
            return f"frames of {self._names[topic.name]}"
        if topic.name in self._truth_topics:
            return "ground_truth.csv"
        if topic.msgtype in POSITION_TYPES:
            return "ground_truth.csv, only if named"
        return f"refused: {_REFUSED[topic.msgtype]}" if topic.msgtype in _REFUSED else ""


def _topics(parts: list[Part]) -> dict[str, _Topic]:
    found: dict[str, _Topic] = {}
    for part in parts:
        for connection in part.reader.connections:
            before = found.get(connection.topic)
            messages = connection.msgcount + (before.messages if before else 0)
            found[connection.topic] = _Topic(connection.topic, connection.msgtype, messages)
    return dict(sorted(found.items()))


def _sensor_names(topics: list[str]) -> dict[str, str]:
    """Names for folders: MMAUD's own, else the topic's with `_` between its parts."""
    names: dict[str, str] = {}
    for topic in topics:
        plain = re.sub(r"\W+", "_", topic.strip("/"), flags=re.ASCII).strip("_") or "cloud"
        name = _MMAUD_SENSORS.get(topic, plain)
        number = 2
        while name in names.values():
            name = f"{plain}_{number}"
            number += 1
        names[topic] = name
    return names
