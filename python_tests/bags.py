"""Writes ROS bags of every format with rosbags' writers, and the messages to put into them."""

import shutil
import sqlite3
import tempfile
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from unlidar.conversion.message_types import register_livox
from unlidar.frames_io import read_pcd

BEGIN_NS = 1_706_255_621_000_000_007
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
_ROS1, _ROS2 = "ros1", "ros2"
_STORES = {
    _ROS1: register_livox(get_typestore(Stores.ROS1_NOETIC)),
    _ROS2: register_livox(get_typestore(Stores.ROS2_HUMBLE)),
}
_STORES[_ROS1].register(
    get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage")
)
_DATATYPES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
_CHUNK_BYTES = 100_000  # small, so that small bags have several chunks
FORMATS = (
    "ros1",
    "ros1-bz2",
    "ros1-lz4",
    "db3-folder",
    "db3-file",
    "db3-without-definitions",
    "db3-message-zstd",
    "mcap-folder",
    "mcap-file",
    "mcap-chunk-zstd",
    "mcap-message-zstd",
    "mcap-file-zstd",
    "mcap-of-ros1",
    "mcap-of-ros1-lz4",
    "mcap-of-ros1-without-chunks",
    "mcap-without-profile",
    "db3-wal",
    "db3-wal-file",
)


@dataclass(frozen=True)
class Message:
    """One message of a bag; `fill` makes it with the types of the bag's version."""

    topic: str
    msgtype: str
    log_ns: int
    fill: Any
    cut: int = 0  # bytes that are missing at its end


def write_bag(folder: Path, form: str, messages: list[Message], name: str = "flight") -> Path:
    """Writes a bag of the format into the folder and returns what `convert` is to open."""
    folder.mkdir(parents=True, exist_ok=True)
    if form.startswith("ros1"):
        path = folder / f"{name}.bag"
        writer = Writer1(path)
        writer.chunk_threshold = _CHUNK_BYTES
        if form != "ros1":
            writer.set_compression(Writer1.CompressionFormat[form.split("-")[1].upper()])
        _write(writer, _ROS1, messages)
        return path
    if form.startswith(("mcap-of", "mcap-without")):
        return _write_mcap(folder / f"{name}.mcap", form, messages)
    path = folder / name
    plugin = StoragePlugin.SQLITE3 if form.startswith("db3") else StoragePlugin.MCAP
    writer = Writer2(path, version=9, storage_plugin=plugin)
    for word, mode in (
        ("chunk", CompressionMode.STORAGE),
        ("message", CompressionMode.MESSAGE),
        ("file", CompressionMode.FILE),
    ):
        if form.endswith(f"{word}-zstd"):
            writer.set_compression(mode, CompressionFormat.ZSTD)
    _write(writer, _ROS2, messages)
    if form.startswith("db3-wal"):
        leave_in_log(next(path.glob("*.db3")))
    if form == "db3-without-definitions":
        with sqlite3.connect(next(path.glob("*.db3"))) as database:
            database.execute("DELETE FROM message_definitions")
    return next(path.glob(f"*.{form.split('-')[0]}")) if form.endswith("-file") else path


def _write(writer: Any, version: str, messages: list[Message]) -> None:
    store = _STORES[version]
    with writer:
        topics = {}
        for m in messages:
            if m.topic not in topics:
                topics[m.topic] = writer.add_connection(m.topic, m.msgtype, typestore=store)
            filled = m.fill(Types(version))
            pack = store.serialize_ros1 if version == _ROS1 else store.serialize_cdr
            packed = bytes(pack(filled, m.msgtype))
            writer.write(topics[m.topic], m.log_ns, packed[: len(packed) - m.cut])


def _write_mcap(path: Path, form: str, messages: list[Message]) -> Path:
    """By MCAP's own writer, as other recorders than ROS 2's leave it."""
    version, encoding = (_ROS1, "ros1") if "ros1" in form else (_ROS2, "cdr")
    store = _STORES[version]
    compression = CompressionType.LZ4 if form.endswith("lz4") else CompressionType.ZSTD
    with path.open("wb") as file:
        writer = McapWriter(
            file,
            chunk_size=_CHUNK_BYTES,
            compression=compression,
            use_chunking="without-chunks" not in form,
        )
        writer.start(profile="" if "profile" in form else "ros1")
        channels: dict[str, int] = {}
        for m in messages:
            if m.topic not in channels:
                text, _ = store.generate_msgdef(m.msgtype, ros_version=1 if "ros1" in form else 2)
                name = m.msgtype.replace("/msg/", "/") if version == _ROS1 else m.msgtype
                schema = writer.register_schema(name, f"{version}msg", text.encode())
                channels[m.topic] = writer.register_channel(m.topic, encoding, schema)
            pack = store.serialize_ros1 if version == _ROS1 else store.serialize_cdr
            packed = bytes(pack(m.fill(Types(version)), m.msgtype))
            data = packed[: len(packed) - m.cut]
            writer.add_message(channels[m.topic], m.log_ns, data, m.log_ns)
        writer.finish()
    return path


def leave_in_log(database: Path, kept: int = 1) -> None:
    """Moves all rows but the first into a write-ahead log, as of a recorder that was killed."""
    copies = [database.with_name(f"{database.name}{end}") for end in ("", "-wal")]
    with tempfile.TemporaryDirectory() as scratch:
        at = Path(scratch) / database.name
        shutil.copyfile(database, at)
        with closing(sqlite3.connect(at)) as writing:
            rows = writing.execute("SELECT * FROM messages ORDER BY id").fetchall()
            writing.execute("DELETE FROM messages WHERE id > ?", (rows[kept - 1][0],))
            writing.commit()
            writing.execute("VACUUM")
            writing.execute("PRAGMA journal_mode=WAL")
            writing.execute("PRAGMA wal_autocheckpoint=0")
            for row in rows[kept:]:
                writing.execute(f"INSERT INTO messages VALUES ({','.join('?' * len(row))})", row)
                writing.commit()
            for path in copies:  # while the recorder still runs
                shutil.copyfile(at.with_name(path.name), path)


@dataclass(frozen=True)
class Types:
    """The message classes of one version of ROS."""

    version: str

    def make(self, name: str, *arguments: Any, **named: Any) -> Any:
        """A message of the type `package/Name`."""
        return _STORES[self.version].types[name.replace("/", "/msg/")](*arguments, **named)

    def header(self, stamp_ns: int, frame_id: str = "lidar") -> Any:
        """With the stamp, in ROS 1 also with a sequence number."""
        stamp = self.make("builtin_interfaces/Time", *divmod(stamp_ns, 10**9))
        named = {"seq": 3} if self.version == _ROS1 else {}
        return self.make("std_msgs/Header", stamp=stamp, frame_id=frame_id, **named)


@dataclass(frozen=True)
class Layout:
    """Byte layout of the points of a PointCloud2."""

    fields: tuple[tuple[str, str, int], ...] = (("x", "f4", 0), ("y", "f4", 4), ("z", "f4", 8))
    step: int = 12
    height: int = 1
    padding: int = 0  # bytes at the end of a row
    big_endian: bool = False


def point_cloud(
    topic: str,
    stamp_ns: int,
    columns: dict,
    layout: Layout,
    log_ns: int,
    frame_id: str = "lidar",
) -> Message:
    """A PointCloud2 of these columns; the bytes between its fields are noise."""
    order = ">" if layout.big_endian else "<"
    rows = len(next(iter(columns.values())))
    width = rows // layout.height
    row_step = width * layout.step + layout.padding
    data = np.random.default_rng(5).integers(0, 256, layout.height * row_step).astype("u1")
    for name, kind, offset in layout.fields:
        size = np.dtype(kind).itemsize
        values = np.ascontiguousarray(columns[name], dtype=order + kind).view("u1")
        for i, item in enumerate(values.reshape(rows, size)):
            at = (i // width) * row_step + (i % width) * layout.step + offset
            data[at : at + size] = item

    def fill(t: Types) -> Any:
        fields = [
            t.make("sensor_msgs/PointField", name, offset, _DATATYPES[kind], 1)
            for name, kind, offset in layout.fields
        ]
        return t.make(
            "sensor_msgs/PointCloud2",
            header=t.header(stamp_ns, frame_id),
            height=layout.height,
            width=width,
            fields=fields,
            is_bigendian=layout.big_endian,
            point_step=layout.step,
            row_step=row_step,
            data=data,
            is_dense=False,
        )

    return Message(topic, POINT_CLOUD, log_ns, fill)


def plain_cloud(
    topic: str,
    stamp_ns: int,
    xyz: np.ndarray,
    log_ns: int | None = None,
    frame_id: str = "lidar",
) -> Message:
    """A PointCloud2 of x, y, z as most drivers write it."""
    columns = dict(zip("xyz", xyz.T, strict=True))
    log_ns = log_ns or stamp_ns + 2_000_000
    return point_cloud(topic, stamp_ns, columns, Layout(), log_ns, frame_id)


def livox_cloud(topic: str, stamp_ns: int, package: str, columns: dict) -> Message:
    """A CustomMsg of columns x, y, z, offset_time and tag."""

    def fill(t: Types) -> Any:
        points = [
            t.make(f"{package}/CustomPoint", int(o), float(x), float(y), float(z), 7, int(tag), 1)
            for o, x, y, z, tag in zip(
                *(columns[name] for name in ("offset_time", "x", "y", "z", "tag")), strict=True
            )
        ]
        return t.make(
            f"{package}/CustomMsg",
            header=t.header(stamp_ns),
            timebase=stamp_ns,
            point_num=len(points),
            lidar_id=1,
            rsvd=np.zeros(3, dtype="u1"),
            points=points,
        )

    return Message(topic, f"{package}/msg/CustomMsg", stamp_ns + 1000, fill)


def empty_scan(topic: str, stamp_ns: int) -> Message:
    """A LaserScan without ranges."""
    none = np.zeros(0, dtype="f4")

    def fill(t: Types) -> Any:
        numbers = [0.0] * 7
        return t.make("sensor_msgs/LaserScan", t.header(stamp_ns), *numbers, none, none)

    return Message(topic, "sensor_msgs/msg/LaserScan", stamp_ns, fill)


def text(topic: str, stamp_ns: int) -> Message:
    """A String."""
    return Message(topic, "std_msgs/msg/String", stamp_ns, lambda t: t.make("std_msgs/String", "a"))


def random_points(seed: int, rows: int = 40) -> np.ndarray:
    """(rows, 3) float32, some of them no returns."""
    xyz = np.random.default_rng(seed).normal(0, 30, (rows, 3)).astype("f4")
    xyz[::7] = 0.0
    xyz[3, 1], xyz[5, 2] = np.nan, -np.inf
    return xyz


def returns_of(xyz: np.ndarray) -> np.ndarray:
    """(N,) bool, said independently of the converter."""
    return np.array(
        [all(map(np.isfinite, p)) and any(v != 0 for v in p) for p in xyz.tolist()], bool
    )


def read_xyz(path: Path) -> np.ndarray:
    """(N, 3) of a PCD file."""
    fields = read_pcd(path)
    return np.stack([fields[axis] for axis in "xyz"], axis=1)
