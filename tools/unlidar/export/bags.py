"""Recordings that RViz and Foxglove open: a ROS 1 bag, a ROS 2 folder or a single mcap file."""

import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from unlidar.errors import InputError
from unlidar.export.trajectory import Result, Track
from unlidar.output import complete_directory, write_file

_PREFIX = "/unlidar"
_PATH, _ODOMETRY = "nav_msgs/msg/Path", "nav_msgs/msg/Odometry"
_CLOUD = "sensor_msgs/msg/PointCloud2"
# Unknown attitude: variance of a uniform angle.
_ANY_ANGLE_RAD2 = np.pi**2 / 3
_FLOAT32 = 7  # sensor_msgs/PointField
_ROS2_METADATA = 9
_NEVER = QosTime(9223372036, 854775807)
# Transient local, for late subscribers, as a latched topic of ROS 1.
_KEPT = Qos(
    QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL, _NEVER,
    _NEVER, QosLiveliness.AUTOMATIC, _NEVER, False,
)  # fmt: skip


@dataclass(frozen=True)
class _Topic:
    name: str
    kind: str
    kept: bool  # latched: one message for the whole recording
    messages: list[tuple[int, object]]  # (ns, message)


def write_ros1(result: Result, out: Path, frame_id: str) -> list[Path]:
    """A ROS 1 bag; frames of reference and stamps as in `_topics`."""
    store = get_typestore(Stores.ROS1_NOETIC)
    topics = _topics(store, result, frame_id)

    def write(work: Path) -> None:
        with Writer1(work) as writer:
            connections = {
                topic.name: writer.add_connection(
                    topic.name, topic.kind, typestore=store, latching=int(topic.kept)
                )
                for topic in topics
            }
            for topic, stamp_ns, message in _in_order(topics):
                data = store.serialize_ros1(message, topic.kind)
                writer.write(connections[topic.name], stamp_ns, data)

    write_file(out, write)
    return [out]


def write_mcap(result: Result, out: Path, frame_id: str) -> list[Path]:
    """One .mcap file, or, for a name without this suffix, the folder that `ros2 bag` makes."""
    with tempfile.TemporaryDirectory() as scratch:
        bag = Path(scratch) / (
            out.stem if out.suffix == ".mcap" else out.name
        )  # rosbags names the file after the folder
        _write_ros2(result, bag, frame_id)
        if out.suffix == ".mcap":
            write_file(out, lambda work: shutil.copyfile(bag / f"{bag.name}.mcap", work))
        else:
            with complete_directory(out, force=False) as work:
                shutil.copytree(bag, work, dirs_exist_ok=True)
    return [out]


def _write_ros2(result: Result, bag: Path, frame_id: str) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    topics = _topics(store, result, frame_id)
    with Writer2(bag, version=_ROS2_METADATA, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {
            topic.name: writer.add_connection(
                topic.name,
                topic.kind,
                typestore=store,
                offered_qos_profiles=[_KEPT] if topic.kept else [],
            )
            for topic in topics
        }
        for topic, stamp_ns, message in _in_order(topics):
            data = store.serialize_cdr(message, topic.kind)
            writer.write(connections[topic.name], stamp_ns, data)


def _in_order(topics: list[_Topic]) -> Iterator[tuple[_Topic, int, object]]:
    found = [(stamp, topic, message) for topic in topics for stamp, message in topic.messages]
    for stamp, topic, message in sorted(found, key=lambda entry: entry[0]):
        yield topic, stamp, message


def _topics(store: Typestore, result: Result, frame_id: str) -> list[_Topic]:
    """The path of each track, whole, at its first stamp; odometry row by row; the returns, whole.

    Headers carry `frame_id` and the row's own stamp, which is also the time of the message.
    """
    make = _Maker(store, frame_id)
    topics = []
    for track in result.by_track:
        name = f"{_PREFIX}/track_{track.track_id}"
        begin = int(track.stamp_ns[0])
        topics.append(_Topic(f"{name}/path", _PATH, True, [(begin, make.path(track))]))
        rows = [(int(stamp), make.odometry(track, i)) for i, stamp in enumerate(track.stamp_ns)]
        topics.append(_Topic(f"{name}/odometry", _ODOMETRY, False, rows))
    if result.target_returns_m is not None and result.by_track:
        begin = min(int(track.stamp_ns[0]) for track in result.by_track)
        cloud = make.cloud(begin, result.target_returns_m)
        topics.append(_Topic(f"{_PREFIX}/target_returns", _CLOUD, True, [(begin, cloud)]))
    return topics


class _Maker:
    """Messages of one ROS release: ROS 1 headers count themselves, ROS 2 headers do not."""

    def __init__(self, store: Typestore, frame_id: str) -> None:
        self._types = store.types
        self._frame_id = frame_id
        self._ros1 = "seq" in store.types["std_msgs/msg/Header"].__dataclass_fields__

    def path(self, track: Track) -> object:
        poses = [
            self._type("geometry_msgs/msg/PoseStamped")(
                header=self._header(int(stamp), i), pose=self._pose(track.xyz_m[i])
            )
            for i, stamp in enumerate(track.stamp_ns)
        ]
        return self._type(_PATH)(header=self._header(int(track.stamp_ns[0])), poses=poses)

    def odometry(self, track: Track, i: int) -> object:
        covariance = np.zeros((6, 6))
        if track.sigma_m is not None:
            covariance[:3, :3] = np.diag(track.sigma_m[i] ** 2)
        covariance[3:, 3:] = np.eye(3) * _ANY_ANGLE_RAD2
        velocity = np.zeros(3) if track.velocity_mps is None else track.velocity_mps[i]
        return self._type(_ODOMETRY)(
            header=self._header(int(track.stamp_ns[i]), i),
            child_frame_id=f"track_{track.track_id}",
            pose=self._type("geometry_msgs/msg/PoseWithCovariance")(
                pose=self._pose(track.xyz_m[i]), covariance=covariance.ravel()
            ),
            # The attitude is the identity, so the child frame's axes are those of the frame.
            twist=self._type("geometry_msgs/msg/TwistWithCovariance")(
                twist=self._type("geometry_msgs/msg/Twist")(
                    linear=self._vector(velocity), angular=self._vector(np.zeros(3))
                ),
                covariance=np.zeros(36),
            ),
        )

    def cloud(self, stamp_ns: int, xyz_m: np.ndarray) -> object:
        field = self._type("sensor_msgs/msg/PointField")
        points = np.ascontiguousarray(xyz_m, dtype="<f4")
        return self._type(_CLOUD)(
            header=self._header(stamp_ns),
            height=1,
            width=len(points),
            fields=[
                field(name=axis, offset=4 * i, datatype=_FLOAT32, count=1)
                for i, axis in enumerate("xyz")
            ],
            is_bigendian=False,
            point_step=12,
            row_step=12 * len(points),
            data=points.reshape(-1).view(np.uint8),
            is_dense=True,
        )

    def _type(self, name: str) -> type:
        return self._types[name]

    def _header(self, stamp_ns: int, count: int = 0) -> object:
        seconds, rest = divmod(stamp_ns, 1_000_000_000)
        # Seconds are an int32 in ROS 2 and a uint32 in ROS 1.
        if seconds >= 1 << (32 if self._ros1 else 31):
            raise InputError(f"stamp {seconds} s is too late for a ROS header")
        stamp = self._type("builtin_interfaces/msg/Time")(sec=seconds, nanosec=rest)
        extra = {"seq": count} if self._ros1 else {}
        return self._type("std_msgs/msg/Header")(stamp=stamp, frame_id=self._frame_id, **extra)

    def _pose(self, xyz_m: np.ndarray) -> object:
        x, y, z = (float(v) for v in xyz_m)
        return self._type("geometry_msgs/msg/Pose")(
            position=self._type("geometry_msgs/msg/Point")(x=x, y=y, z=z),
            orientation=self._type("geometry_msgs/msg/Quaternion")(x=0.0, y=0.0, z=0.0, w=1.0),
        )

    def _vector(self, xyz: np.ndarray) -> object:
        x, y, z = (float(v) for v in xyz)
        return self._type("geometry_msgs/msg/Vector3")(x=x, y=y, z=z)
