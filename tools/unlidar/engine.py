"""The engine in this process: frames as numpy arrays in, events or tracks out.

docs/python_api.md shows it at work. The compiled part is the module `_engine`.
"""

import logging
import operator
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from types import ModuleType
from typing import Any, NamedTuple, NoReturn, SupportsIndex

import numpy as np
import numpy.typing as npt

from unlidar.call_checks import config_path, expect, pose_files_of, settings_of
from unlidar.errors import InputError, UnlidarError, UsageError
from unlidar.events.event import EngineState, Event, Now, Row, SensorState, TrackBegins, TrackEnds
from unlidar.pose_files import ALL
from unlidar.poses import Poses
from unlidar.settings import assignments
from unlidar.station import has_sensors

AnyPath = str | os.PathLike[str]
AnyPoses = AnyPath | Poses
Points = npt.NDArray[np.float32] | npt.NDArray[np.float64]

_COLUMNS = ("track_id", "x", "y", "z", "vx", "vy", "vz", "sigma_x", "sigma_y", "sigma_z", "support")
_ROWS = np.dtype([("timestamp_ns", np.int64), *((name, np.float64) for name in _COLUMNS)])
_LOG = logging.getLogger("unlidar")
_MOST_RATE_HZ = 1e6
_STAMPS = np.iinfo(np.int64)
_CLASSES: dict[str, type[Event]] = {
    "track": TrackBegins,
    "row": Row,
    "now": Now,
    "end": TrackEnds,
    "sensor": SensorState,
    "state": EngineState,
}


class Frame(NamedTuple):
    """One frame of one sensor, in the sensor's own axes and clock."""

    sensor: str
    stamp_ns: int  # Unix time
    xyz: Points  # (n, 3) in metres; NaN, Inf and 0, 0, 0 are rays without a return
    offsets_ns: npt.NDArray[np.int64] | None = None  # (n,) from the stamp


class Frames(Iterator[Frame]):
    """The frames of a recording, in order of time."""

    def __init__(
        self,
        frames: Iterator[Frame],
        sensors: Sequence[str],
        settings: Mapping[str, object],
        poses: Mapping[str, Poses],
    ) -> None:
        self._frames = frames
        self.sensors = tuple(sensors)
        # What it knows, for Engine: where its sensors stand and what its stamps mean, by keys of
        # the configuration, and of those that move the way of what carries them, by their names.
        self.settings = dict(settings)
        self.poses = dict(poses)
        self._is_over = False

    def __iter__(self) -> "Frames":
        if self._is_over:
            raise UsageError("these frames have been read, expected a new unlidar.read(...)")
        return self

    def __next__(self) -> Frame:
        try:
            return next(self._frames)
        except BaseException:  # after an error, too, the generator has nothing more to give
            self._is_over = True
            raise


@dataclass(frozen=True)
class Kind:
    """What a track may be: probabilities that add up to 1, docs/kinds.md."""

    drone: float
    bird_like: float
    unknown: float


@dataclass(frozen=True, eq=False)
class Track:
    """The trajectory of one drone."""

    id: int  # from 0, in order of first evidence
    rows: npt.NDArray[np.void]  # the columns of traj.csv, `timestamp_ns` int64, the others float64
    kind: Kind


class Engine:
    """Takes frames one by one and gives events as soon as they are due, as `--stdin --events`.

    Time is that of the stamps: the same calls give the same events, however fast they come. Memory
    is bounded by the configuration. Calls from several threads go one after the other; several
    engines work at the same time, as the interpreter's lock is free meanwhile.

    Example:
        engine = unlidar.Engine("station.yaml")
        for event in engine.add("mid360", stamp_ns, xyz):
            if isinstance(event, unlidar.Row):
                print(event.track, event.timestamp, event.x, event.y, event.z)
    """

    def __init__(
        self,
        config: AnyPath | None = None,
        settings: Mapping[str, object] | None = None,
        rate_hz: float | None = None,
        poses: AnyPoses | Mapping[str, AnyPoses] | None = None,
    ) -> None:
        """The engine of a configuration.

        `config` is a YAML file, `settings` are single values of it by their key, as
        {"live.delay_s": 0.5}, which go before the file. Rows come at the stamps of the first
        sensor's frames, or `rate_hz` times a second. `poses` is the way of what carries the
        sensors, a TUM file or `Poses`, or one for each sensor that moves, by its name.

        ConfigError for a wrong file or value, UsageError for a rate outside (0, 1e6],
        UnlidarError where the compiled module is not built.
        """
        self._stream: Any = _native().Stream(*_setup(config, settings, rate_hz, poses))
        self._lock = Lock()

    def add(
        self,
        sensor: str,
        stamp_ns: SupportsIndex,
        xyz: Points,
        offsets_ns: npt.NDArray[np.int64] | None = None,
    ) -> list[Event]:
        """Adds a frame and gives the events that are due, in order.

        `sensor` is its name, the key to `sensors` of the configuration, which has its pose; one
        that is not there stands at the origin. `stamp_ns` is Unix time in nanoseconds. `xyz` is
        (n, 3) in metres, float32 or float64, of any strides, and copied; NaN, Inf and 0, 0, 0 are
        rays without a return; n may be 0. `offsets_ns` is (n,) int64, the time of each ray after
        the stamp. Frames may come late, and sensors behind each other, by `live.reorder_s`.

        InputError for arrays of another shape or type, a repeated stamp, point times far from it,
        or coordinates that are no metres or beyond float32: the frame is left out and the next may
        follow. UsageError for a bad name or a closed engine.
        """
        with self._lock:
            stream = self._open()
            events = stream.add(*_checked(sensor, stamp_ns, xyz, offsets_ns))
            return self._told(stream, events)

    def advance(self, now_ns: SupportsIndex) -> list[Event]:
        """Tells that time passes without a frame, and gives the events that are due.

        No frame older than `now_ns` less `live.reorder_s` may follow. UsageError for a closed
        engine.
        """
        with self._lock:
            stream = self._open()
            return self._told(stream, stream.advance(_nanoseconds("now_ns", now_ns)))

    def close(self) -> list[Event]:
        """Ends the stream and gives all that is pending; again, nothing. No frame may follow."""
        with self._lock:
            if self._stream is None:
                return []
            stream, self._stream = self._stream, None
            return self._told(stream, stream.close())

    def _open(self) -> Any:
        if self._stream is None:
            raise UsageError("the engine is closed, expected a new one for further frames")
        return self._stream

    @staticmethod
    def _told(stream: Any, events: list[dict[str, Any]]) -> list[Event]:
        _log_notes(stream)
        return [_CLASSES[values["event"]](**values) for values in events]


def track(
    frames: Iterable[Frame | tuple[Any, ...]],
    config: AnyPath | None = None,
    settings: Mapping[str, object] | None = None,
    rate_hz: float | None = None,
    poses: AnyPoses | Mapping[str, AnyPoses] | None = None,
) -> list[Track]:
    """The tracks in the frames of a recording, as `unlidar_track --frames` finds them.

    `frames` are `Frame`s, as of `unlidar.read`, or tuples (sensor, stamp_ns, xyz[, offsets_ns]), in
    any order; the other arguments and the errors are those of `Engine`. Rows come at the stamps of
    the sensor whose frame is the first. Of `unlidar.read` it is the first of the recording's
    sensors, and where they stand and move is taken from it, unless the configuration has `sensors`
    of its own, and `poses` others, and what its stamps mean, unless there is a configuration: the
    tracks are those of `unlidar.run`.

    Example:
        for found in unlidar.track(unlidar.read("flight.bag")):
            print(found.id, found.kind.drone, found.rows["timestamp_ns"], found.rows["x"])
    """
    if isinstance(frames, Frames):
        settings = _known(frames, config_path(config)) | settings_of(settings)
        poses = frames.poses if poses is None else poses
        frames = _led(frames)
    try:
        each = iter(frames)
    except TypeError:
        expect(False, "frames", frames, "an iterable of Frame or tuples")
    recording = _native().Recording(*_setup(config, settings, rate_hz, poses))
    for number, frame in enumerate(each, 1):
        if not isinstance(frame, tuple) or len(frame) not in (3, 4):
            raise UsageError(
                f"frames: item {number} is {_described(frame)}, expected a Frame or a tuple "
                "(sensor, stamp_ns, xyz[, offsets_ns])"
            )
        recording.add(*_checked(*frame))
    tracks = [
        Track(number, np.frombuffer(rows, _ROWS), Kind(*kind))
        for number, rows, kind in recording.tracks()
    ]
    _log_notes(recording)
    return tracks


def _known(frames: Frames, config: str | None) -> dict[str, object]:
    """What the recording says that a configuration does not take the place of."""
    if config is None:
        return frames.settings
    if has_sensors(Path(config)):
        return {}
    return {key: value for key, value in frames.settings.items() if key.startswith("sensors.")}


def _led(frames: Frames) -> Iterator[Frame]:
    """The frames, led by one of the first of the sensors that has any."""
    rank = {name: number for number, name in enumerate(frames.sensors)}
    held = []
    others = iter(frames)
    for frame in others:
        held.append(frame)
        if rank.get(frame.sensor) == 0:
            break
    else:
        others = iter(())
    yield from sorted(held, key=lambda frame: rank.get(frame.sensor, len(rank)))
    yield from others


def _native() -> ModuleType:
    try:
        from unlidar import _engine
    except ImportError as error:
        raise UnlidarError(
            f"the engine for Python cannot be loaded ({error}); build it in the project's folder "
            "with tools/demo.sh or cmake --build build --target unlidar_python"
        ) from error
    return _engine


def _setup(
    config: AnyPath | None,
    settings: Mapping[str, object] | None,
    rate_hz: float | None,
    poses: AnyPoses | Mapping[str, AnyPoses] | None,
) -> tuple[str, list[str], int, dict[str, Any]]:
    """Path, assignments, the rate in nanohertz, 0 for none, and the poses by sensor."""
    path, assigned = config_path(config) or "", assignments(settings_of(settings))
    ways = _ways_of(poses)
    if rate_hz is None:
        return path, assigned, 0, ways
    is_number = isinstance(rate_hz, (int, float, np.number)) and not isinstance(rate_hz, bool)
    if not (is_number and 0 < rate_hz <= _MOST_RATE_HZ):
        raise UsageError(f"rate_hz: {rate_hz!r}, expected a number above 0 to 1e6")
    nanohertz = round(float(rate_hz) * 1e9)
    if nanohertz == 0:
        raise UsageError(f"rate_hz: {rate_hz!r}, expected at least 1e-9")
    return path, assigned, nanohertz, ways


def _ways_of(poses: AnyPoses | Mapping[str, AnyPoses] | None) -> dict[str, Any]:
    """Files and arrays of poses, as the compiled module takes them."""
    named = {ALL: poses} if isinstance(poses, Poses) else poses
    ways: dict[str, Any] = {}
    if isinstance(named, Mapping):
        for name, way in named.items():
            if isinstance(way, Poses):
                expect(isinstance(name, str), "poses", name, "the name of a sensor")
                ways[name] = way.stamp_ns, np.hstack([way.position_m, way.rotation.as_quat()])
        named = {name: way for name, way in named.items() if name not in ways}
    return ways | {name: str(file) for name, file in pose_files_of(named).items()}


def _checked(
    sensor: str, stamp_ns: SupportsIndex, xyz: object, offsets_ns: object = None
) -> tuple[str, int, object, object]:
    if not isinstance(sensor, str):
        raise UsageError(f"sensor: {_described(sensor)}, expected a name")
    for what, array, filled in (("xyz", xyz, "np.nan"), ("offsets_ns", offsets_ns, "0")):
        if isinstance(array, np.ma.MaskedArray):  # whose buffer has what is masked, too
            raise InputError(
                f"frame of {sensor}, stamp {stamp_ns} ns: {what} is a masked array of shape "
                f"{array.shape}, expected one without a mask, as {what}.filled({filled})"
            )
    # The compiled module takes text that is UTF-8; what is none is no name either way.
    name = sensor.encode(errors="replace").decode()
    return name, _nanoseconds("stamp_ns", stamp_ns), xyz, offsets_ns


def _nanoseconds(name: str, value: SupportsIndex) -> int:
    if isinstance(value, bool):  # Python takes it for 0 or 1
        _refuse(name, _described(value))
    try:
        stamp_ns = operator.index(value)
    except TypeError:
        _refuse(name, _described(value))
    if not _STAMPS.min <= stamp_ns <= _STAMPS.max:
        _refuse(name, str(stamp_ns))
    return stamp_ns


def _refuse(name: str, what: str) -> NoReturn:
    raise InputError(f"{name}: {what}, expected Unix time in nanoseconds, an integer of 64 bits")


def _described(value: object) -> str:
    of = f" of {len(value)}" if isinstance(value, (tuple, list)) else ""
    return f"a {type(value).__name__}{of}"


def _log_notes(native: Any) -> None:
    for note in native.take_notes():
        _LOG.warning("%s", note)
