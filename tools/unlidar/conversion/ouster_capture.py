"""Captured packets of Ouster LiDARs, decoded by ouster-sdk: a turn is a frame."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

import numpy as np

from unlidar.capture import Datagram, datagrams, missing_captures
from unlidar.conversion.capture_makers import is_ouster, maker_of
from unlidar.conversion.files import refuse_bag_options
from unlidar.conversion.one_file import BeforeDamage, OneFileSource, up_to_damage
from unlidar.conversion.source import Options, SourceFrame
from unlidar.conversion.stamp_selector import StampSelector
from unlidar.errors import InputError, listed, reason
from unlidar.extras import load_lone
from unlidar.limits import read_text
from unlidar.point_times import OFFSET_FIELD
from unlidar.stamps import format_stamp_ns

_RANGES = ("RANGE", "RANGE2")  # of the first and the second return
_LONGEST_NS = 1_000_000_000  # a turn lasts 0.2 s at most; longer times are damage


class OusterCapture(OneFileSource):
    """The LiDARs of a capture, each named by its address."""

    kind: ClassVar[str] = "Ouster packets"
    description: ClassVar[str] = "a capture of packets of Ouster LiDARs with their metadata"
    _holds: ClassVar[str] = "point packets"

    @classmethod
    def matches(cls, path: Path) -> bool:
        """True if the first packet of points in a capture is an Ouster's."""
        return maker_of(path) == "Ouster"

    def __init__(self, path: Path, options: Options) -> None:
        # --stamp chooses between the sensor's and the recorder's clock, as for bags.
        refuse_bag_options(path, options, "holds packets", has_log_times=True)
        self._sdk = _library(path)
        self._path, self._options = path, options
        self._models = [_model(self._sdk, file) for file in _metadata(path)]
        self._begin_ns: int | None = None
        self._turns: dict[str, _Turns] = {}
        self.sensors: dict[str, int] = {}
        self._spans_ns: dict[str, tuple[int, int]] = {}
        newest: dict[str, int] = {}
        with up_to_damage(self.sensors):
            for datagram, model in self._points():
                turn = model.packet(self._sdk, datagram).frame_id()
                name = datagram.sensor
                self.sensors[name] = self.sensors.get(name, 0) + (turn != newest.get(name))
                newest[name] = turn
                first_ns, _ = self._spans_ns.get(name, (datagram.time_ns, 0))
                self._spans_ns[name] = first_ns, datagram.time_ns

    def items(self, sensors: list[str]) -> Iterator[SourceFrame]:
        """A frame for each completed turn."""
        self._turns = {}
        packets = BeforeDamage(self._points())
        for datagram, model in packets:
            name = datagram.sensor
            if name in sensors:
                if name not in self._turns:
                    self._turns[name] = _Turns(
                        name, self._sdk, model, StampSelector(self._options.stamp)
                    )
                yield from self._frames(name, self._turns[name].add(datagram))
        for name, turns in self._turns.items():
            yield from self._frames(name, turns.rest())
        packets.report()

    def notes(self) -> list[str]:
        """Notes on clocks that differ widely and captures that are missing."""
        clocks = [note for name, t in self._turns.items() if (note := t.stamps.note(name))]
        return [*missing_captures(self._path), *clocks]

    def facts(self) -> dict:
        """The clocks, and the metadata files with the beam angles."""
        return {
            "stamps": {name: turns.stamps.facts() for name, turns in self._turns.items()},
            "metadata": {name: turns.model.file.name for name, turns in self._turns.items()},
        }

    def _points(self) -> Iterator[tuple[Datagram, "_Model"]]:
        """Point packets with the metadata of their sensor."""
        models: dict[str, _Model] = {}
        for datagram in datagrams(self._path):
            if not is_ouster(datagram.payload):
                continue
            model = models.get(datagram.sensor) or self._model_of(datagram)
            models[datagram.sensor] = model
            if len(datagram.payload) == model.bytes:
                yield datagram, model

    def _model_of(self, datagram: Datagram) -> "_Model":
        """The metadata that fits the packet's size; of several, the one with its serial number."""
        size = len(datagram.payload)
        fitting = [model for model in self._models if model.bytes == size]
        if len(fitting) > 1:
            serial = str(fitting[0].packet(self._sdk, datagram).prod_sn())
            fitting = [model for model in fitting if str(model.info.sn) == serial]
        if len(fitting) == 1:
            return fitting[0]
        told = listed(f"{model.file.name} {model.bytes}" for model in self._models)
        raise InputError(
            f"{self._path}: no metadata fits {datagram.source}, whose packets have {size} bytes, "
            f"expected this sensor's own (bytes: {told})"
        )

    def _frames(self, name: str, turns: Iterator[tuple[int, SourceFrame]]) -> Iterator[SourceFrame]:
        try:
            for stamp_ns, frame in turns:
                self._begin_ns = stamp_ns if self._begin_ns is None else self._begin_ns
                if stamp_ns in self._options.window(self._begin_ns):
                    yield frame
        except (RuntimeError, ValueError, OverflowError) as error:
            raise InputError(f"{self._path}: packets of {name}: {reason(error)}") from error


@dataclass(frozen=True)
class _Model:
    """Sensor metadata, from the JSON file that the sensor exports."""

    file: Path
    info: Any
    format: Any

    @property
    def bytes(self) -> int:
        return self.format.lidar_packet_size

    def packet(self, sdk: ModuleType, datagram: Datagram) -> Any:
        packet = sdk.LidarPacket(self.format)
        packet.buf[:] = np.frombuffer(datagram.payload, np.uint8)
        packet.host_timestamp = datagram.time_ns
        return packet


class _Turns:
    """Groups the packets of a sensor by turn."""

    def __init__(self, name: str, sdk: ModuleType, model: _Model, stamps: StampSelector) -> None:
        self.model, self.stamps = model, stamps
        self._name, self._sdk = name, sdk
        self._batcher, self._frame = sdk.FrameBatcher(model.info), sdk.LidarFrame(model.info)
        self._positions = sdk.XYZLut(model.info)

    def add(self, datagram: Datagram) -> Iterator[tuple[int, SourceFrame]]:
        """The turn that this packet completes, and its stamp."""
        if self._batcher.batch(self.model.packet(self._sdk, datagram), self._frame):
            yield from self.rest()
            self._frame = self._sdk.LidarFrame(self.model.info)

    def rest(self) -> Iterator[tuple[int, SourceFrame]]:
        """The last, incomplete turn."""
        times_ns = self._frame.timestamp.astype(np.int64)
        is_there = (self._frame.status & 1).astype(bool)
        if not is_there.any():
            return
        is_there &= np.abs(times_ns - np.median(times_ns[is_there])) < _LONGEST_NS
        begin_ns = int(times_ns[is_there].min())
        xyz_m, offsets_ns = [], []
        for channel in _RANGES:
            if self._frame.has_field(channel):
                away_mm = self._frame.field(channel)
                row, column = np.nonzero((away_mm > 0) & is_there)
                xyz_m.append(self._positions(away_mm)[row, column])
                offsets_ns.append(times_ns[column] - begin_ns)
        captured_ns = self._frame.packet_timestamp
        stamp_ns = self.stamps.pick(begin_ns, int(captured_ns[captured_ns > 0].min()))
        fields = {OFFSET_FIELD: np.concatenate(offsets_ns)}
        frame = SourceFrame(self._name, format_stamp_ns(stamp_ns), np.concatenate(xyz_m), fields)
        yield stamp_ns, frame


def _metadata(path: Path) -> list[Path]:
    """JSON files beside a capture that share its name, as ouster-cli writes them."""
    stem = path.with_suffix("").name
    is_called = re.compile(re.escape(stem) + r"(_\d+)?\.json")
    found = sorted(file for file in path.parent.iterdir() if is_called.fullmatch(file.name))
    if not found:
        raise InputError(
            f"{path}: packets of Ouster LiDARs need the metadata of their sensor, expected "
            f"{stem}.json beside it (http://SENSOR/api/v1/sensor/metadata gives it)"
        )
    return found


def _model(sdk: ModuleType, file: Path) -> _Model:
    try:
        info = sdk.SensorInfo(read_text(file))
        return _Model(file, info, sdk.PacketFormat(info))
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(f"{file}: no metadata of an Ouster LiDAR: {reason(error)}") from error


def _library(path: Path) -> ModuleType:
    missing = f"{path}: needs the Python package ouster-sdk"
    return load_lone("ouster.sdk.core", "ouster-sdk>=1.0", missing)
