"""Folders of the MMAUD data set (UG2+ challenge): one `<unix seconds>.npy` per frame and sensor."""

from pathlib import Path
from typing import ClassVar

from unlidar.conversion.files import (
    FileSource,
    StampedFile,
    files_stamped_by_name,
    load_rows,
    refuse_bag_options,
)
from unlidar.conversion.source import Options, SourceFrame, Stream
from unlidar.errors import InputError

_LIDARS = ("lidar_360", "livox_avia")
_RADAR = "radar_enhance_pcl"


class MmaudFolder(FileSource):
    """A sequence of MMAUD: `lidar_360`, `livox_avia`, `radar_enhance_pcl` and `ground_truth`."""

    kind: ClassVar[str] = "mmaud"
    description: ClassVar[str] = (
        "a MMAUD sequence (a folder with lidar_360/ or livox_avia/ of <seconds>.npy)"
    )

    def __init__(self, path: Path, options: Options) -> None:
        refuse_bag_options(path, options)
        names = [name for name in (*_LIDARS, _RADAR) if (path / name).is_dir()]
        found = {name: files_stamped_by_name(path / name, options.rate_hz) for name in names}
        files = {name: stamped for name, (stamped, _, _) in found.items()}
        self._notes = [note for _, _, note in found.values() if note is not None]
        super().__init__(
            path, options, files, [u for _, unnamed, _ in found.values() for u in unnamed]
        )

    @classmethod
    def matches(cls, path: Path) -> bool:
        """True if the folder has a LiDAR folder of the data set."""
        return any(next((path / name).glob("*.npy"), None) for name in _LIDARS) or (
            any((path / name).is_dir() and not any((path / name).iterdir()) for name in _LIDARS)
        )

    def lidars(self) -> list[str]:
        """The LiDAR folders that hold files."""
        found = [name for name in _LIDARS if self._files.get(name)]
        if not found and self._unnamed:
            raise InputError(self._unnamed[0].why)
        if not found:
            raise InputError(f"{self._path}: {' and '.join(_LIDARS)} hold no .npy files")
        return found

    def streams(self) -> list[Stream]:
        """Its folders."""
        found = [
            Stream(name, ".npy", len(files), "radar, only if named" if name == _RADAR else "frames")
            for name, files in self._files.items()
        ]
        return found + self._truth_streams()

    def notes(self) -> list[str]:
        """Notes on stamps made from frame numbers."""
        return self._notes

    def _frame(self, sensor: str, file: StampedFile) -> SourceFrame:
        _, stamp, path = file
        return SourceFrame(sensor, stamp, load_rows(path))
