"""Folders of the MMAUD data set (UG2+ challenge): one `<unix seconds>.npy` per frame and sensor."""

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

from unlidar_tools.convert.files import (
    TRUTH_FOLDER,
    files_stamped_by_name,
    in_window,
    load_rows,
    refuse_bag_options,
    truth_of_folder,
    truth_targets,
)
from unlidar_tools.convert.source import Options, SourceFrame, Stream, TruthRow
from unlidar_tools.errors import InputError

_LIDARS = ("lidar_360", "livox_avia")
_RADAR = "radar_enhance_pcl"


class MmaudFolder:
    """A sequence of MMAUD: `lidar_360`, `livox_avia`, `radar_enhance_pcl` and `ground_truth`."""

    kind: ClassVar[str] = "mmaud"
    description: ClassVar[str] = (
        "a MMAUD sequence (a folder with lidar_360/ or livox_avia/ of <seconds>.npy)"
    )
    keeps_beginning: ClassVar[bool] = False  # a file can be mended or taken away

    def __init__(self, path: Path, options: Options) -> None:
        refuse_bag_options(path, options)
        self._path, self._options = path, options
        self._files = {
            name: files_stamped_by_name(path / name)
            for name in (*_LIDARS, _RADAR)
            if (path / name).is_dir()
        }
        self._begin_ns = min((files[0][0] for files in self._files.values() if files), default=0)
        self.sensors = {
            name: len(in_window(files, options, self._begin_ns))
            for name, files in self._files.items()
        }
        self.truths = truth_targets(path)

    @classmethod
    def matches(cls, path: Path) -> bool:
        """Whether the folder has a LiDAR folder of the data set."""
        return any(next((path / name).glob("*.npy"), None) for name in _LIDARS) or (
            any((path / name).is_dir() and not any((path / name).iterdir()) for name in _LIDARS)
        )

    def lidars(self) -> list[str]:
        """Those that hold files."""
        found = [name for name in _LIDARS if self._files.get(name)]
        if not found:
            raise InputError(f"{self._path}: {' and '.join(_LIDARS)} hold no .npy files")
        return found

    def streams(self) -> list[Stream]:
        """Its folders."""
        found = [
            Stream(name, ".npy", len(files), "radar, only if named" if name == _RADAR else "frames")
            for name, files in self._files.items()
        ]
        if self.truths:
            found.append(Stream(TRUTH_FOLDER, ".npy or .csv", 0, "ground_truth.csv"))
        return found

    def total(self, sensors: list[str]) -> int:
        """The files."""
        return sum(self.sensors[name] for name in sensors)

    def items(self, sensors: list[str]) -> Iterator[SourceFrame | TruthRow]:
        """The frames, sensor by sensor, then the positions of the Leica prism."""
        for sensor in sensors:
            for _, stamp, path in in_window(self._files[sensor], self._options, self._begin_ns):
                yield SourceFrame(sensor, stamp, load_rows(path))
        yield from truth_of_folder(self._path, self._options, self._begin_ns)

    def notes(self) -> list[str]:
        """Nothing is guessed here."""
        return []

    def facts(self) -> dict:
        """Nothing beyond the counts."""
        return {}

    def close(self) -> None:
        """Holds no file open."""
