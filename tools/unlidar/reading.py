"""The frames of a recording in memory, in order of time."""

import heapq
import logging
import os
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path
from weakref import finalize

import numpy as np

from unlidar.call_checks import chosen_sensors, options_of, path_of
from unlidar.conversion import choose_sensors, open_source
from unlidar.conversion.kept_items import KeptItems
from unlidar.conversion.source import Options, Source, SourceFrame
from unlidar.conversion.transforms import AT_REST
from unlidar.engine import Frame, Frames
from unlidar.errors import InputError
from unlidar.limits import MEGABYTE
from unlidar.point_times import OFFSET_FIELD
from unlidar.presets import preset_settings
from unlidar.stamps import parse_stamp_ns
from unlidar.station import station_settings

_LOG = logging.getLogger("unlidar")
_MOST_HELD = 64 * MEGABYTE  # of frames that wait for those of another sensor


def read(
    recording: str | os.PathLike[str],
    *,
    sensors: Sequence[str] | None = None,
    options: Options | None = None,
) -> Frames:
    """The frames of any recording that `unlidar convert` opens, one by one, without files.

    Frames come in order of time, as float32 and without rays that returned nothing; a few are in
    memory at a time, and of those that wait for another sensor's at most 64 MB. `sensors` chooses
    among those of the recording, by default its LiDARs; `options` are those of a conversion, as
    ConvertOptions(start_s=10). Of a damaged recording the part before the damage is given.
    `settings` of the result say where the sensors stand and what stamps mean (MMAUD's are the end
    of a frame) as far as the recording knows, its `poses` how those that move are carried;
    `unlidar.track` takes both, and so does
    `unlidar.Engine(settings=frames.settings, poses=frames.poses)`.

    InputError for what cannot be read, UsageError for a sensor that is not there, and for frames
    that are asked for a second time.

    Example:
        for frame in unlidar.read("flight.bag"):
            print(frame.sensor, frame.stamp_ns, len(frame.xyz))
    """
    path, names = path_of("recording", recording), chosen_sensors(sensors)
    reading = options_of(Options, "ConvertOptions", options)
    with ExitStack() as opened:
        source = opened.enter_context(closing(open_source(path, reading)))
        chosen = choose_sensors(path, source, names)
        shared = _Reading(path, reading, source, chosen, held=chosen)
        settings = preset_settings(path, source.kind) | station_settings(source.station(), chosen)
        poses = {name: way for name, way in source.poses().items() if name in chosen}
        if poses:
            _LOG.warning(
                "%s: its LiDARs move: frames are as they saw them, unlidar.track takes their poses "
                "and an Engine has to be told: poses=frames.poses",
                path,
            )
        frames = Frames(_in_order(shared, chosen), chosen, settings, poses)
        finalize(frames, opened.pop_all().close)
    return frames


def _in_order(shared: "_Reading", sensors: list[str]) -> Iterator[Frame]:
    count = 0
    for frame in heapq.merge(*map(shared.of, sensors), key=lambda frame: frame.stamp_ns):
        count += 1
        yield frame
    if not count:
        shared.kept.refuse_nothing(shared.broken)
    for note in shared.notes():
        _LOG.warning("%s", note)


class _Reading:
    """One reading of a recording for several sensors, whose frames come loosely mixed.

    Frames that wait for those of another sensor are held. Where they would be too many, as of
    clocks hours apart, that sensor gets a reading of its own.
    """

    def __init__(
        self, path: Path, options: Options, source: Source, sensors: list[str], held: list[str]
    ) -> None:
        """Reads these sensors and gives those that are held."""
        self._path, self._options, self._source = path, options, source
        self._sensors = sensors
        self.kept = KeptItems(path, options)
        self.broken: str | None = None
        self._others: list[_Reading] = []
        self._held: dict[str, deque[Frame]] = {name: deque() for name in held}
        self._bytes = 0
        items = source.items(sensors)
        try:
            begin = list(islice(items, 1))  # the poses are known then
        except InputError:
            begin, items = [], source.items(sensors)  # it comes again where the frames are read
        self._items = self.kept.of(chain(begin, items))

    def of(self, sensor: str) -> Iterator[Frame]:
        """The frames of one sensor."""
        held, given = self._held[sensor], 0
        while held or self._read_on(sensor):
            if held:
                frame = held.popleft()
                given += frame.sensor == sensor
                self._bytes -= _size(frame)
                yield frame
            elif self._bytes > _MOST_HELD:
                del self._held[sensor]
                options = replace(self._options, poses_topic=AT_REST)  # they are known by now
                with closing(open_source(self._path, options)) as source:
                    own = _Reading(self._path, options, source, self._sensors, [sensor])
                    self._others.append(own)
                    frames = (frame for frame in own.of(sensor) if frame.sensor == sensor)
                    yield from islice(frames, given, None)
                return

    def notes(self) -> list[str]:
        """What is to be said of it, each once."""
        broken = [] if self.broken is None else [f"{self.broken}; the part before it is given"]
        notes = [*broken, *self._source.notes(), *self.kept.notes()]
        return list(dict.fromkeys([*notes, *(n for other in self._others for n in other.notes())]))

    def _read_on(self, sensor: str) -> bool:
        """Reads one item, looking for a frame of this sensor; False at the end."""
        try:
            item = next(self._items, None)
        except InputError as error:
            if not self._source.keeps_beginning:
                raise
            self.broken = str(error)
            return False
        if isinstance(item, SourceFrame):
            # A sensor that nothing told of before comes along with whichever is looked for.
            known = item.sensor in self._source.sensors
            held = self._held.get(item.sensor if known else sensor)
            if held is not None:
                held.append(_frame(item))
                self._bytes += _size(held[-1])
        return item is not None


def _frame(item: SourceFrame) -> Frame:
    offsets = item.fields.get(OFFSET_FIELD)
    return Frame(
        item.sensor,
        parse_stamp_ns(item.stamp),
        np.ascontiguousarray(item.xyz_m, dtype=np.float32),
        None if offsets is None else offsets.astype(np.int64),
    )


def _size(frame: Frame) -> int:
    return frame.xyz.nbytes + (0 if frame.offsets_ns is None else frame.offsets_ns.nbytes)
