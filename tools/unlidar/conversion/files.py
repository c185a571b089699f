"""Shared code of folder recordings: stamps, arrays, truth, and the time window."""

import heapq
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import ClassVar, TypeVar

import numpy as np

from unlidar.conversion.source import Options, SourceFrame, Stream, TruthRow, Unreadable
from unlidar.conversion.transforms import AT_REST
from unlidar.csv_rows import Row, csv_rows
from unlidar.errors import InputError, UsageError, reason
from unlidar.frame_clock import times_of_names
from unlidar.limits import check_frame_size
from unlidar.pose_files import ALL, find_poses
from unlidar.poses import Poses, read_poses
from unlidar.stamps import format_stamp_ns, parse_stamp_ns
from unlidar.station import Pose, read_station
from unlidar.truth import TRUTH_NAME

_MOST_COLUMNS = 32  # of a frame; with more it is turned: (3, N)
_MOST_TARGET = (1 << 31) - 1
TRUTH_FOLDER = "ground_truth"
Item = TypeVar("Item")

# (stamp in ns, original text of the stamp, file)
StampedFile = tuple[int, str, Path]


def refuse_bag_options(
    path: Path,
    options: Options,
    what: str = "is a folder of files",
    has_log_times: bool = False,
) -> None:
    """UsageError for options on topics, stamps and fixes, which only bags have."""
    asked = {
        "--topic": options.topics,
        "--truth": options.truths,
        "--poses-topic": options.poses_topic not in (None, AT_REST),
        "--origin": options.origin is not None,
        "--stamp log": options.stamp == "log" and not has_log_times,
    }
    for option, given in asked.items():
        if given:
            raise UsageError(f"{path}: {what}, {option} is for bags")


def files_stamped_by_name(
    directory: Path, rate_hz: float | None = None
) -> tuple[list[StampedFile], list[Unreadable], str | None]:
    """The `<seconds>.npy` of a folder in order of time, files without a stamp, and a note.

    `rate_hz` and the note: as of `times_of_names`.
    """
    files, unnamed = [], []
    paths = sorted(directory.glob("*.npy"))
    names = [path.name.removesuffix(".npy") for path in paths]
    times = times_of_names(directory, names, rate_hz)
    for name, stamp_ns, path in zip(names, times.stamps_ns, paths, strict=True):
        if stamp_ns is not None:
            stamp = format_stamp_ns(stamp_ns) if times.are_numbers else name
            files.append((stamp_ns, stamp, path))
        else:
            why = f"{path}: expected a name of seconds, like 1706255621.6.npy"
            unnamed.append(Unreadable(directory.name, why))
    note = None if times.note is None else f"{directory}: {times.note}"
    return sorted(files), unnamed, note


def in_window(files: list[StampedFile], options: Options, begin_ns: int) -> list[StampedFile]:
    """The files in the time window of a recording that begins at `begin_ns`."""
    window = options.window(begin_ns)
    return [file for file in files if file[0] in window]


def load_rows(path: Path) -> np.ndarray:
    """The array of a file as (N, 3); an array without elements is a frame without returns."""
    check_frame_size(path)
    try:
        array = np.load(path, allow_pickle=False)
    except Exception as error:  # numpy evaluates the header as Python: anything may be raised
        raise InputError(f"{path}: not a readable .npy array: {reason(error)}") from error
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu":
        raise InputError(f"{path}: expected an array of numbers")
    if array.size == 0:
        return np.zeros((0, 3))
    # Of one dimension: one point, as a position of the truth.
    if array.ndim not in (1, 2) or not 3 <= array.shape[-1] <= _MOST_COLUMNS:
        raise InputError(
            f"{path}: the array has shape {array.shape}, expected (N, 3), or up to "
            f"{_MOST_COLUMNS} columns"
        )
    return np.atleast_2d(array)[:, :3].astype(float)


def has_truth_folder(recording: Path) -> bool:
    """True if `ground_truth/` holds positions; a folder of that name may also hold clouds."""
    return next((recording / TRUTH_FOLDER).glob("*.npy"), None) is not None


def truth_targets(recording: Path) -> int:
    """Number of targets in `ground_truth/` (one) or `ground_truth.csv` of a folder."""
    if has_truth_folder(recording):
        return 1
    if not (recording / TRUTH_NAME).is_file():
        return 0
    return max((row.target for row in _rows_of_table(recording / TRUTH_NAME)), default=0) + 1


def truth_of_folder(
    recording: Path, options: Options, begin_ns: int
) -> Iterator[TruthRow | Unreadable]:
    """The rows of `ground_truth/<seconds>.npy`, or else of `ground_truth.csv`."""
    if has_truth_folder(recording):
        files, unnamed, _ = files_stamped_by_name(recording / TRUTH_FOLDER, options.rate_hz)
        yield from unnamed
        for _, stamp, path in in_window(files, options, begin_ns):
            yield read_or_not(TRUTH_FOLDER, lambda p=path, s=stamp: TruthRow(s, _position(p)))
    elif (recording / TRUTH_NAME).is_file():
        window = options.window(begin_ns)
        rows = _rows_of_table(recording / TRUTH_NAME)
        yield from (row for row in rows if parse_stamp_ns(row.stamp) in window)


def read_or_not(where: str, read: Callable[[], Item]) -> Item | Unreadable:
    """The result of `read`, or Unreadable with the reason."""
    try:
        return read()
    except InputError as error:
        return Unreadable(where, str(error))


class FileSource:
    """Base class of sources that are folders of stamped files by sensor."""

    keeps_beginning: ClassVar[bool] = False  # a bad file can be repaired or removed

    def __init__(
        self,
        path: Path,
        options: Options,
        files: dict[str, list[StampedFile]],
        unnamed: list[Unreadable],
    ) -> None:
        """`files`: the frames of each sensor; `unnamed`: files whose names are no stamps."""
        self._path, self._options, self._files, self._unnamed = path, options, files, unnamed
        self._begin_ns = min((f[0][0] for f in files.values() if f), default=0)
        self.sensors = {name: len(self._asked_for(name)) for name in files}
        self.truths = truth_targets(path)

    def items(self, sensors: list[str]) -> Iterator[SourceFrame | TruthRow | Unreadable]:
        """The frames in order of time, then the truth."""
        yield from (file for file in self._unnamed if file.where in sensors)
        files = [[(sensor, file) for file in self._asked_for(sensor)] for sensor in sensors]
        for sensor, file in heapq.merge(*files, key=lambda one: one[1][0]):
            yield read_or_not(sensor, lambda s=sensor, f=file: self._bounded(s, f))
        yield from truth_of_folder(self._path, self._options, self._begin_ns)

    def spans_ns(self) -> dict[str, tuple[int, int]]:
        """First and last stamp of each sensor and of the truth."""
        spans = {name: (f[0][0], f[-1][0]) for name, f in self._files.items() if f}
        stamps_ns = _truth_stamps_ns(self._path)
        return spans | ({TRUTH_FOLDER: (min(stamps_ns), max(stamps_ns))} if stamps_ns else {})

    def total(self, sensors: list[str]) -> int:
        """The number of files."""
        return sum(self.sensors[name] for name in sensors)

    def facts(self) -> dict:
        """Empty: the counts say all."""
        return {}

    def station(self) -> dict[str, Pose]:
        """The poses of the folder's own station.yaml."""
        return read_station(self._path)

    def poses(self) -> dict[str, Poses]:
        """Those of the folder's own files of poses."""
        found = find_poses(self._path, self.sensors)
        common = found.pop(ALL, None)
        files = dict.fromkeys(self.sensors, common) if common else {}
        return {name: read_poses(path) for name, path in (files | found).items()}

    def close(self) -> None:
        """Does nothing: no file stays open."""

    def _frame(self, sensor: str, file: StampedFile) -> SourceFrame:
        raise NotImplementedError

    def _bounded(self, sensor: str, file: StampedFile) -> SourceFrame:
        check_frame_size(file[2])
        return self._frame(sensor, file)

    def _asked_for(self, sensor: str) -> list[StampedFile]:
        return in_window(self._files[sensor], self._options, self._begin_ns)

    def _truth_streams(self) -> list[Stream]:
        if not self.truths:
            return []
        kind = ".npy" if has_truth_folder(self._path) else ".csv"
        rows = len(_truth_stamps_ns(self._path))
        return [Stream(TRUTH_FOLDER, kind, rows, "ground_truth.csv")]


def _truth_stamps_ns(recording: Path) -> list[int]:
    if has_truth_folder(recording):
        return [file[0] for file in files_stamped_by_name(recording / TRUTH_FOLDER)[0]]
    if (recording / TRUTH_NAME).is_file():
        return [parse_stamp_ns(row.stamp) for row in _rows_of_table(recording / TRUTH_NAME)]
    return []


def _position(path: Path) -> tuple[float, float, float]:
    xyz = load_rows(path)
    if xyz.shape != (1, 3) or not np.isfinite(xyz).all():
        raise InputError(f"{path}: expected one finite position x, y, z")
    x, y, z = (float(v) for v in xyz[0])
    return x, y, z


def _rows_of_table(path: Path) -> list[TruthRow]:
    return [_row_of_table(row) for row in csv_rows(path, ("timestamp", "x", "y", "z"))]


def _row_of_table(row: Row) -> TruthRow:
    stamp = row.values["timestamp"].strip()
    try:
        parse_stamp_ns(stamp)
    except ValueError as error:
        raise InputError(f"{row.where}: {reason(error)}") from error
    target = row.number("target", 0.0)
    if not (0 <= target <= _MOST_TARGET and target.is_integer()):
        raise InputError(
            f"{row.where}: target is {target:g}, expected a whole number from 0 to {_MOST_TARGET}"
        )
    in_view = row.number("in_view", 1.0) > 0 if "in_view" in row.values else None
    xyz_m = row.number("x"), row.number("y"), row.number("z")
    return TruthRow(stamp, xyz_m, int(target), in_view)
