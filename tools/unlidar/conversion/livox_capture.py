"""Recorded packets of Livox LiDARs, cut into frames as `unlidar_track --livox` cuts them."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np

from unlidar import livox
from unlidar.capture import datagrams, is_capture, missing_captures
from unlidar.conversion import lvx
from unlidar.conversion.capture_makers import maker_of
from unlidar.conversion.files import refuse_bag_options
from unlidar.conversion.livox_clock import LivoxClock
from unlidar.conversion.one_file import BeforeDamage, OneFileSource, up_to_damage
from unlidar.conversion.source import Options, SourceFrame
from unlidar.errors import InputError
from unlidar.point_times import OFFSET_FIELD
from unlidar.stamps import format_stamp_ns
from unlidar.station import Pose

_FRAME_NS = 100_000_000
_PATIENCE_NS = 10_000_000  # reordering in a network is shorter than this


# Sensor name, capture time (None: not known), packet.
Recorded = tuple[str, int | None, livox.Packet]


class _LivoxRecording(OneFileSource):
    """Base class of captures and of Livox Viewer's files."""

    kind: ClassVar[str] = "Livox packets"
    _holds: ClassVar[str] = "point packets"
    _expected: ClassVar[str] = livox.EXPECTED

    def __init__(self, path: Path, options: Options) -> None:
        refuse_bag_options(path, options, "holds packets")
        self._path, self._options = path, options
        self._notes: list[str] = []
        spans: dict[str, tuple[int, int]] = {}  # numbers of the first and the last frame
        with up_to_damage(spans):
            for name, time_ns, _, _ in self._packets():
                if time_ns is None:
                    continue
                number = time_ns // _FRAME_NS
                first, last = spans.get(name, (number, number))
                spans[name] = min(first, number), max(last, number)
        if not spans:
            raise InputError(f"{path}: holds no points of a Livox LiDAR, expected {self._expected}")
        self._begin_ns = min(first for first, _ in spans.values()) * _FRAME_NS
        self.sensors = {name: last - first + 1 for name, (first, last) in spans.items()}
        self._spans_ns = {
            name: (first * _FRAME_NS, last * _FRAME_NS) for name, (first, last) in spans.items()
        }

    def items(self, sensors: list[str]) -> Iterator[SourceFrame]:
        """Frames as they become complete."""
        window = self._options.window(self._begin_ns)
        cutters = {name: _Cutter(name) for name in sensors}
        packets = BeforeDamage(self._packets())
        for name, time_ns, now_ns, packet in packets:
            if name in cutters:
                cutters[name].add(time_ns, now_ns, packet)
                yield from (f for ns, f in cutters[name].over() if ns in window)
        for cutter in cutters.values():
            yield from (f for ns, f in cutter.over(at_the_end=True) if ns in window)
        self._notes = [note for cutter in cutters.values() for note in cutter.notes()]
        packets.report()

    def notes(self) -> list[str]:
        """Notes on packets left out and captures that are missing."""
        return [*missing_captures(self._path), *self._notes]

    def _packets(self) -> Iterator[tuple[str, int | None, int, livox.Packet]]:
        """Name of the sensor, Unix time of the first ray (None: astray), sensor's time, packet."""
        clocks: dict[str, LivoxClock] = {}
        for name, recorded_ns, packet in self._recorded():
            clock = clocks.setdefault(name, LivoxClock(_FRAME_NS))
            time_ns = clock.time_ns(packet, recorded_ns)
            yield name, time_ns, clock.now_ns, packet

    def _recorded(self) -> Iterator[Recorded]:
        raise NotImplementedError


class LivoxCapture(_LivoxRecording):
    """The LiDARs of a capture, each named by its address."""

    description: ClassVar[str] = "a capture (.pcap, .pcapng) of packets of Livox LiDARs"
    _expected: ClassVar[str] = f"{livox.EXPECTED}, or of a Velodyne or an Ouster"

    @classmethod
    def matches(cls, path: Path) -> bool:
        """True for captures of any kind."""
        return is_capture(path)

    def __init__(self, path: Path, options: Options) -> None:
        if maker_of(path) == "Hesai":
            raise InputError(
                f"{path}: holds packets of a Hesai LiDAR, which are not read, expected a bag that "
                "its driver for ROS made of them"
            )
        super().__init__(path, options)

    def _recorded(self) -> Iterator[Recorded]:
        for datagram in datagrams(self._path):
            packet = livox.parse(datagram.payload)
            if packet is not None:
                name = livox.name_of(datagram.source, packet)
                yield name, datagram.time_ns, packet


class LivoxFile(_LivoxRecording):
    """A file of Livox Viewer; LiDARs are named by serial number."""

    description: ClassVar[str] = "a file of Livox Viewer (.lvx, .lvx2)"

    @classmethod
    def matches(cls, path: Path) -> bool:
        """True if the suffix is .lvx or .lvx2."""
        return path.suffix.lower() in (".lvx", ".lvx2") and path.is_file()

    def station(self) -> dict[str, Pose]:
        """The poses of the file; empty if all are the identity."""
        poses = {lidar.name: lidar.pose for lidar in lvx.lidars(self._path)}
        return poses if any(pose != Pose() for pose in poses.values()) else {}

    def notes(self) -> list[str]:
        """Also notes poses that are switched off in the file."""
        unused = [lidar.name for lidar in lvx.lidars(self._path) if lidar.is_pose_off]
        said = [f"{name}: its pose is switched off in the file, and not taken" for name in unused]
        return [*super().notes(), *said]

    def _recorded(self) -> Iterator[Recorded]:
        # The file has no recording time: unsynchronised clocks stay as they are.
        for name, packet in lvx.packets(self._path):
            yield name, None, packet


@dataclass
class _Cutter:
    """Groups the packets of a sensor by frame."""

    name: str
    _open: dict[int, dict[tuple[int, int], livox.Packet]] = field(default_factory=dict)
    _now_ns: int = 0
    _closed: int | None = None
    _repeated: int = 0
    _late: int = 0
    _astray: int = 0
    _noise: int = 0

    def add(self, time_ns: int | None, now_ns: int, packet: livox.Packet) -> None:
        self._now_ns = now_ns
        if time_ns is None:
            self._astray += 1
            return
        number = time_ns // _FRAME_NS
        key = time_ns, packet.counter or 0
        if key in self._open.get(number, ()):
            self._repeated += 1
        elif self._closed is not None and number <= self._closed:
            self._late += 1
        else:
            self._open.setdefault(number, {})[key] = packet

    def over(self, at_the_end: bool = False) -> Iterator[tuple[int, SourceFrame]]:
        """Completed frames with their stamps in nanoseconds."""
        for number in sorted(self._open):
            stamp_ns = number * _FRAME_NS
            if not at_the_end and stamp_ns + _FRAME_NS > self._now_ns - _PATIENCE_NS:
                return
            self._closed = number
            yield stamp_ns, self._frame(stamp_ns, self._open.pop(number))

    def notes(self) -> list[str]:
        left_out = [
            f"{count} {what}"
            for count, what in (
                (self._repeated, "packets that came twice"),
                (self._late, "packets that came too late"),
                (self._astray, "packets more than a second from those before"),
                (self._noise, "points whose tags call them noise"),
            )
            if count
        ]
        return [f"{self.name}: left out {', '.join(left_out)}"] if left_out else []

    def _frame(self, stamp_ns: int, packets: dict[tuple[int, int], livox.Packet]) -> SourceFrame:
        in_order = sorted(packets.items())
        spacings_ns = sorted(np.diff([time_ns for (time_ns, _), _ in in_order]).tolist())
        spacing_ns = spacings_ns[len(spacings_ns) // 2] if spacings_ns else 0
        offsets_ns, points_m = [], []
        for (time_ns, _), packet in in_order:
            points, rays = packet.points(), len(packet.rows)
            span_ns = packet.span_ns
            if span_ns is None:
                span_ns = spacing_ns * (rays - 1) // rays
            within_ns = span_ns * points.ray.astype(np.int64) // max(rays - 1, 1)
            offsets_ns.append(time_ns - stamp_ns + within_ns)
            points_m.append(points.xyz_m)
            self._noise += points.noise
        return SourceFrame(
            self.name,
            format_stamp_ns(stamp_ns),
            np.concatenate(points_m),
            {OFFSET_FIELD: np.concatenate(offsets_ns)},
        )
