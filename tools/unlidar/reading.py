"""The frames of a recording in memory, in order of time."""

import heapq
import logging
import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from unlidar.call_checks import chosen_sensors, options_of
from unlidar.conversion import choose_sensors, open_source
from unlidar.conversion.kept_items import KeptItems
from unlidar.conversion.source import Options, Source, SourceFrame
from unlidar.conversion.transforms import AT_REST
from unlidar.engine import Frame, Frames
from unlidar.errors import InputError
from unlidar.point_times import OFFSET_FIELD
from unlidar.stamps import parse_stamp_ns
from unlidar.station import station_settings

_LOG = logging.getLogger("unlidar")


def read(
    recording: str | os.PathLike[str],
    *,
    sensors: Sequence[str] | None = None,
    options: Options | None = None,
) -> Frames:
    """The frames of any recording that `unlidar convert` opens, one by one, without files.

    Frames come in order of time, as float32 and without rays that returned nothing; a few are in
    memory at a time. `sensors` chooses among those of the recording, by default its LiDARs;
    `options` are those of a conversion, as ConvertOptions(start_s=10). Of a damaged recording the
    part before the damage is given. `settings` of the result say where the sensors stand as far as
    the recording knows, its `poses` how those that move are carried; `unlidar.track` takes both,
    and so does `unlidar.Engine(settings=frames.settings, poses=frames.poses)`.

    InputError for what cannot be read, UsageError for a sensor that is not there.

    Example:
        for frame in unlidar.read("flight.bag"):
            print(frame.sensor, frame.stamp_ns, len(frame.xyz))
    """
    path, names = Path(recording), chosen_sensors(sensors)
    reading = options_of(Options, "ConvertOptions", options)
    with closing(open_source(path, reading)) as source:
        chosen = choose_sensors(path, source, names)
        items = source.items(chosen)
        with suppress(InputError):  # comes again where the frames are read
            next(items, None)  # the poses are known then
        settings = station_settings(source.station(), chosen)
        poses = {name: way for name, way in source.poses().items() if name in chosen}
        if poses:
            _LOG.warning(
                "%s: its LiDARs move: frames are as they saw them, unlidar.track takes their poses "
                "and an Engine has to be told: poses=frames.poses",
                path,
            )
    reading = replace(reading, poses_topic=AT_REST)  # they are known by now
    return Frames(_in_order(path, reading, chosen), chosen, settings, poses)


def _in_order(path: Path, options: Options, sensors: list[str]) -> Iterator[Frame]:
    """Merges the sensors; each has a source of its own, as bags and captures mix them loosely."""
    with ExitStack() as opened:
        of_sensor = [
            _SensorFrames(
                path, options, opened.enter_context(closing(open_source(path, options))), name
            )
            for name in sensors
        ]
        count = 0
        for frame in heapq.merge(*of_sensor, key=lambda frame: frame.stamp_ns):
            count += 1
            yield frame
        if not count:
            for frames in of_sensor:
                frames.kept.refuse_nothing(frames.broken)
        notes = [note for frames in of_sensor for note in frames.notes()]
    for note in dict.fromkeys(notes):
        _LOG.warning("%s", note)


class _SensorFrames:
    """The frames of one sensor."""

    def __init__(self, path: Path, options: Options, source: Source, sensor: str) -> None:
        self._source, self._sensor = source, sensor
        self.kept = KeptItems(path, options)
        self.broken: str | None = None

    def __iter__(self) -> Iterator[Frame]:
        try:
            for item in self.kept.of(self._source.items([self._sensor])):
                if isinstance(item, SourceFrame):
                    yield _frame(item)
        except InputError as error:
            if not self._source.keeps_beginning:
                raise
            self.broken = str(error)

    def notes(self) -> list[str]:
        broken = [] if self.broken is None else [f"{self.broken}; the part before it is given"]
        return [*broken, *self._source.notes(), *self.kept.notes()]


def _frame(item: SourceFrame) -> Frame:
    offsets = item.fields.get(OFFSET_FIELD)
    return Frame(
        item.sensor,
        parse_stamp_ns(item.stamp),
        np.ascontiguousarray(item.xyz_m, dtype=np.float32),
        None if offsets is None else offsets.astype(np.int64),
    )
