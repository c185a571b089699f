"""Captured packets of Velodyne LiDARs, decoded by velodyne-decoder: a turn is a frame."""

import struct
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

import numpy as np

from unlidar.capture import Datagram, datagrams, missing_captures
from unlidar.conversion.capture_makers import is_velodyne, maker_of
from unlidar.conversion.files import refuse_bag_options
from unlidar.conversion.one_file import BeforeDamage, OneFileSource, up_to_damage
from unlidar.conversion.source import Options, SourceFrame
from unlidar.conversion.stamp_selector import StampSelector
from unlidar.errors import InputError, reason
from unlidar.extras import load_extra
from unlidar.point_times import OFFSET_FIELD
from unlidar.stamps import format_stamp_ns

_AZIMUTH_AT = 2
_FARTHEST_M = 1_000.0  # beyond the range of all models; track limits are the program's


class VelodyneCapture(OneFileSource):
    """The LiDARs of a capture, each named by its address."""

    kind: ClassVar[str] = "Velodyne packets"
    description: ClassVar[str] = "a capture of packets of Velodyne LiDARs"
    _holds: ClassVar[str] = "point packets"

    @classmethod
    def matches(cls, path: Path) -> bool:
        """True if the first packet of points in a capture is a Velodyne's."""
        return maker_of(path) == "Velodyne"

    def __init__(self, path: Path, options: Options) -> None:
        # --stamp chooses between the sensor's and the recorder's clock, as for bags.
        refuse_bag_options(path, options, "holds packets", has_log_times=True)
        self._decoder = _library(path)
        self._path, self._options = path, options
        self._stamps: dict[str, StampSelector] = {}
        self.sensors: dict[str, int] = {}
        self._spans_ns: dict[str, tuple[int, int]] = {}
        self._begin_ns: int | None = None
        azimuths: dict[str, int] = {}
        with up_to_damage(self.sensors):
            for datagram in self._points():
                (azimuth,) = struct.unpack_from("<H", datagram.payload, _AZIMUTH_AT)
                name = datagram.sensor
                turns = azimuth < azimuths.get(name, 1 << 16)
                self.sensors[name] = self.sensors.get(name, 0) + turns
                first_ns, _ = self._spans_ns.get(name, (datagram.time_ns, 0))
                self._spans_ns[name] = first_ns, datagram.time_ns
                azimuths[name] = azimuth

    def items(self, sensors: list[str]) -> Iterator[SourceFrame]:
        """A frame for each completed turn."""
        config = {"timestamp_first_packet": True, "max_range": _FARTHEST_M}
        decoders = {n: self._decoder.StreamDecoder(self._decoder.Config(**config)) for n in sensors}
        self._stamps = {name: StampSelector(self._options.stamp) for name in sensors}
        packets = BeforeDamage(self._points())
        for datagram in packets:
            name = datagram.sensor
            if name in decoders:
                time_s = datagram.time_ns * 1e-9
                yield from self._frame(
                    name,
                    lambda d=datagram, n=name, t=time_s: decoders[n].decode(t, d.payload, True),
                )
        for name, decoder in decoders.items():
            yield from self._frame(name, lambda d=decoder: d.finish(True))
        packets.report()

    def notes(self) -> list[str]:
        """Notes on clocks that differ widely and captures that are missing."""
        clocks = [note for name, seen in self._stamps.items() if (note := seen.note(name))]
        return [*missing_captures(self._path), *clocks]

    def facts(self) -> dict:
        """The clocks used."""
        return {"stamps": {name: seen.facts() for name, seen in self._stamps.items()}}

    def _points(self) -> Iterator[Datagram]:
        return (datagram for datagram in datagrams(self._path) if is_velodyne(datagram.payload))

    def _frame(self, name: str, decode: Any) -> Iterator[SourceFrame]:
        try:
            turn = decode()
        except (RuntimeError, ValueError, OverflowError) as error:
            raise InputError(f"{self._path}: packets of {name}: {reason(error)}") from error
        if turn is None or len(turn[1]) == 0:
            return
        times, rows = turn
        stamp_ns = self._stamps[name].pick(round(times.device * 1e9), round(times.host * 1e9))
        self._begin_ns = stamp_ns if self._begin_ns is None else self._begin_ns
        if stamp_ns not in self._options.window(self._begin_ns):
            return
        offsets_ns = np.rint(rows["time"].astype(float) * 1e9).astype(np.int64)
        xyz_m = np.stack([rows[axis] for axis in "xyz"], axis=1)
        yield SourceFrame(name, format_stamp_ns(stamp_ns), xyz_m, {OFFSET_FIELD: offsets_ns})


def _library(path: Path) -> ModuleType:
    missing = f"{path}: needs the Python package velodyne-decoder"
    return load_extra("velodyne_decoder", "velodyne", missing)
