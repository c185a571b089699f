"""What folders of files have in common: stamps, arrays, truth, and the time asked for."""

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np

from unlidar_tools.convert.source import Options, Stream, TruthRow
from unlidar_tools.errors import InputError, UsageError, reason
from unlidar_tools.stamps import parse_stamp_ns
from unlidar_tools.truth import TRUTH_NAME

TRUTH_FOLDER = "ground_truth"

# (stamp in ns, stamp as its source spells it, file)
StampedFile = tuple[int, str, Path]


def refuse_bag_options(path: Path, options: Options) -> None:
    """Folders of files have neither topics nor two stamps."""
    for option, given in (("--topic", options.topics), ("--stamp log", options.stamp == "log")):
        if given:
            raise UsageError(f"{path}: is a folder of files, {option} is for bags")


def files_stamped_by_name(directory: Path) -> list[StampedFile]:
    """The `<seconds>.npy` of a folder in order of time."""
    files = []
    for path in directory.glob("*.npy"):
        stamp = path.name.removesuffix(".npy")
        try:
            files.append((parse_stamp_ns(stamp), stamp, path))
        except ValueError as error:
            raise InputError(
                f"{path}: expected a name of seconds, like 1706255621.6.npy"
            ) from error
    return sorted(files)


def in_window(files: list[StampedFile], options: Options, begin_ns: int) -> list[StampedFile]:
    """Those in the time asked for of a recording with this begin."""
    window = options.window(begin_ns)
    return [file for file in files if file[0] in window]


def load_rows(path: Path) -> np.ndarray:
    """The array of a file as (N, 3); an array without elements is a frame without returns."""
    try:
        array = np.load(path, allow_pickle=False)
    except Exception as error:  # numpy evaluates the header as Python: any error may come of it
        raise InputError(f"{path}: not a readable .npy array: {reason(error)}") from error
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu":
        raise InputError(f"{path}: expected an array of numbers")
    if array.size == 0:
        return np.zeros((0, 3))
    rows = np.atleast_2d(array)
    if rows.ndim != 2 or rows.shape[1] < 3:
        raise InputError(f"{path}: the array has shape {array.shape}, expected (N, 3)")
    return rows[:, :3].astype(float)


def truth_targets(recording: Path) -> int:
    """Number of targets in `ground_truth/` (one) or `ground_truth.csv` of a folder."""
    if (recording / TRUTH_FOLDER).is_dir():
        return 1
    if not (recording / TRUTH_NAME).is_file():
        return 0
    return max((row.target for row in _rows_of_table(recording / TRUTH_NAME)), default=0) + 1


def truth_of_folder(recording: Path, options: Options, begin_ns: int) -> Iterator[TruthRow]:
    """The rows of `ground_truth/<seconds>.npy`, or else of `ground_truth.csv`."""
    if (recording / TRUTH_FOLDER).is_dir():
        files = files_stamped_by_name(recording / TRUTH_FOLDER)
        for _, stamp, path in in_window(files, options, begin_ns):
            xyz = load_rows(path)
            if xyz.shape != (1, 3) or not np.isfinite(xyz).all():
                raise InputError(f"{path}: expected one finite position x, y, z")
            yield TruthRow(stamp, (float(xyz[0, 0]), float(xyz[0, 1]), float(xyz[0, 2])))
    elif (recording / TRUTH_NAME).is_file():
        window = options.window(begin_ns)
        rows = _rows_of_table(recording / TRUTH_NAME)
        yield from (row for row in rows if parse_stamp_ns(row.stamp) in window)


class FileSource:
    """What sources that are folders of stamped files, by sensor, have in common."""

    keeps_beginning: ClassVar[bool] = False  # a file can be mended or taken away

    def __init__(self, path: Path, options: Options, files: dict[str, list[StampedFile]]) -> None:
        self._path, self._options, self._files = path, options, files
        self._begin_ns = min((f[0][0] for f in files.values() if f), default=0)
        self.sensors = {name: len(self._asked_for(name)) for name in files}
        self.truths = truth_targets(path)

    def total(self, sensors: list[str]) -> int:
        """The files."""
        return sum(self.sensors[name] for name in sensors)

    def facts(self) -> dict:
        """Nothing beyond the counts."""
        return {}

    def close(self) -> None:
        """Holds no file open."""

    def _asked_for(self, sensor: str) -> list[StampedFile]:
        return in_window(self._files[sensor], self._options, self._begin_ns)

    def _truth_streams(self) -> list[Stream]:
        if not self.truths:
            return []
        return [Stream(TRUTH_FOLDER, ".npy or .csv", 0, "ground_truth.csv")]

    def _truth(self) -> Iterator[TruthRow]:
        return truth_of_folder(self._path, self._options, self._begin_ns)


def _rows_of_table(path: Path) -> list[TruthRow]:
    rows = []
    try:
        with path.open(newline="") as file:
            for row in csv.DictReader(file):
                stamp = row["timestamp"].strip()
                parse_stamp_ns(stamp)
                xyz = (float(row["x"]), float(row["y"]), float(row["z"]))
                rows.append(TruthRow(stamp, xyz, int(row.get("target") or 0)))
    except (OSError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{path}: expected columns timestamp,x,y,z: {reason(error)}") from error
    return rows
