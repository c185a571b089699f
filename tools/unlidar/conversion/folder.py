"""Folders of one file per frame: PCD, PLY, KITTI's .bin or .npy, of one sensor or of several."""

import re
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import ClassVar

import numpy as np

from unlidar.conversion.files import (
    TRUTH_FOLDER,
    FileSource,
    StampedFile,
    has_truth_folder,
    load_rows,
    refuse_bag_options,
)
from unlidar.conversion.ply import read_ply
from unlidar.conversion.source import Options, SourceFrame, Stream, Unreadable
from unlidar.csv_rows import numbered_lines
from unlidar.errors import InputError, reason
from unlidar.frame_clock import stamps_of_table, times_of_names
from unlidar.frames_io import is_return, read_pcd
from unlidar.names import folder_names
from unlidar.output import is_run
from unlidar.point_times import OFFSET_FIELD, TIME_FIELDS, offsets_ns
from unlidar.stamps import NS_PER_S, format_stamp_ns, parse_stamp_ns

_KITTI_ROW = np.dtype([(name, "<f4") for name in ("x", "y", "z", "intensity")])
_KITTI_TIMES = ("timestamps.txt", "times.txt")
_KITTI_STAMP = re.compile(r"(\d{4}-\d\d-\d\d[ T]\d\d:\d\d:\d\d)\.(\d{1,9})")


def _read_kitti(path: Path) -> dict[str, np.ndarray]:
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from error
    if len(content) % _KITTI_ROW.itemsize:
        raise InputError(
            f"{path}: has {len(content)} bytes, expected rows of 16 (x, y, z, intensity as float32)"
        )
    rows = np.frombuffer(content, _KITTI_ROW)
    return {name: rows[name] for name in ("x", "y", "z")}


def _read_npy(path: Path) -> dict[str, np.ndarray]:
    return dict(zip("xyz", load_rows(path).T, strict=True))


_READERS: dict[str, Callable[[Path], dict[str, np.ndarray]]] = {
    ".pcd": read_pcd,
    ".ply": read_ply,
    ".bin": _read_kitti,
    ".npy": _read_npy,
}


class FrameFolder(FileSource):
    """A folder of frames, or a folder with one such folder per sensor."""

    kind: ClassVar[str] = "frames"
    description: ClassVar[str] = (
        "a folder of .pcd, .ply, .bin (KITTI) or .npy, or one with such a folder per sensor"
    )

    def __init__(self, path: Path, options: Options) -> None:
        refuse_bag_options(path, options)
        self._notes: list[str] = []
        self._suffixes: dict[str, str] = {}
        files: dict[str, list[StampedFile]] = {}
        unnamed: list[Unreadable] = []
        folders = _frame_folders(path)
        for directory, name in zip(folders, folder_names(map(_label, folders)), strict=True):
            self._suffixes[name] = _suffix(directory)
            paths = sorted(directory.glob(f"*{self._suffixes[name]}"))
            files[name], without = self._stamped(directory, paths, options)
            unnamed += [Unreadable(name, why) for why in without]
        super().__init__(path, options, files, unnamed)

    @classmethod
    def matches(cls, path: Path) -> bool:
        """True if the folder or one below it holds files of frames."""
        return path.is_dir() and bool(_frame_folders(path))

    def lidars(self) -> list[str]:
        """All its sensors."""
        return list(self._files)

    def streams(self) -> list[Stream]:
        """Its folders."""
        found = [
            Stream(name, self._suffixes[name], len(files), "frames")
            for name, files in self._files.items()
        ]
        return found + self._truth_streams()

    def notes(self) -> list[str]:
        """Notes on stamps made from frame numbers."""
        return self._notes

    def _frame(self, sensor: str, file: StampedFile) -> SourceFrame:
        return _frame(sensor, *file, _READERS[self._suffixes[sensor]](file[2]))

    def _stamped(
        self, directory: Path, paths: list[Path], options: Options
    ) -> tuple[list[StampedFile], list[str]]:
        """By timestamps.csv, KITTI's list of times, or the names, in this order.

        Files without a stamp are returned with the reason.
        """
        listed = next(
            (
                folder / name
                for folder in (directory, directory.parent)
                for name in _KITTI_TIMES
                if (folder / name).is_file()
            ),
            None,
        )
        if (directory / "timestamps.csv").is_file():
            return _stamped(stamps_of_table(directory / "timestamps.csv", paths), paths)
        if listed is not None:
            return _stamps_of_list(listed, paths), []
        times = times_of_names(directory, [path.stem for path in paths], options.rate_hz)
        if times.note is not None:
            self._notes.append(f"{directory}: {times.note}")
        return _stamped(times.stamps_ns, paths)


def _stamped(
    stamps_ns: Sequence[int | None], paths: list[Path]
) -> tuple[list[StampedFile], list[str]]:
    """The files with a stamp, in order of time, and the faults of the others."""
    files, unnamed = [], []
    for stamp_ns, path in zip(stamps_ns, paths, strict=True):
        if stamp_ns is not None:
            files.append((stamp_ns, format_stamp_ns(stamp_ns), path))
        else:
            unnamed.append(
                f"{path}: the name is no time stamp and no mere number, and there is no "
                "timestamps.csv, timestamps.txt or times.txt"
            )
    return sorted(files), unnamed


def _frame_folders(path: Path) -> list[Path]:
    """The folder itself, or those of its subfolders (or their `data`) that hold frames."""
    if _suffixes(path):
        return [path]
    found = []
    for child in sorted(d for d in path.iterdir() if d.is_dir() and not is_run(d)):
        if child.name != TRUTH_FOLDER or not has_truth_folder(path):
            found += [d for d in (child, child / "data") if d.is_dir() and _suffixes(d)][:1]
    return found


def _label(directory: Path) -> str:
    at = directory.resolve()
    return at.parent.name if at.name == "data" else at.name


def _suffixes(directory: Path) -> list[str]:
    return [s for s in _READERS if next(directory.glob(f"*{s}"), None) is not None]


def _suffix(directory: Path) -> str:
    found = _suffixes(directory)
    if len(found) > 1:
        raise InputError(f"{directory}: holds {' and '.join(found)} files, expected one kind")
    return found[0]


def _frame(
    sensor: str, stamp_ns: int, stamp: str, path: Path, columns: dict[str, np.ndarray]
) -> SourceFrame:
    missing = [axis for axis in "xyz" if axis not in columns]
    if missing:
        raise InputError(f"{path}: has no field {missing[0]}, expected x, y and z")
    xyz_m = np.stack([columns[axis].astype(float) for axis in "xyz"], axis=1)
    kept = is_return(xyz_m)
    for name in TIME_FIELDS:
        if name in columns:
            offsets = offsets_ns(columns[name][kept], stamp_ns)
            fields = {} if offsets is None else {OFFSET_FIELD: offsets}
            return SourceFrame(sensor, stamp, xyz_m[kept], fields)
    return SourceFrame(sensor, stamp, xyz_m[kept])


def _stamps_of_list(listed: Path, paths: list[Path]) -> list[StampedFile]:
    """One stamp a line for the files in the order of their names, as KITTI has it."""
    stamps_ns = []
    for number, line in numbered_lines(listed):
        if line.strip():
            try:
                stamps_ns.append(_kitti_stamp_ns(line.strip()))
            except ValueError as error:
                raise InputError(
                    f"{listed}:{number}: {reason(error)}, expected one stamp a line"
                ) from error
    if len(stamps_ns) != len(paths):
        raise InputError(
            f"{listed}: has {len(stamps_ns)} stamps for {len(paths)} files in {paths[0].parent}"
        )
    return sorted(
        (stamp_ns, format_stamp_ns(stamp_ns), path)
        for stamp_ns, path in zip(stamps_ns, paths, strict=True)
    )


def _kitti_stamp_ns(text: str) -> int:
    """`2011-09-26 13:02:25.964389445`, taken as UTC, or a number of seconds."""
    if not (match := _KITTI_STAMP.fullmatch(text)):
        return parse_stamp_ns(text)
    seconds = int(datetime.fromisoformat(match[1]).replace(tzinfo=UTC).timestamp())
    return seconds * NS_PER_S + int(match[2].ljust(9, "0"))
