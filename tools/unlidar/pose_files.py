"""Files of poses of LiDARs that move, beside the frames: `--poses` of the program.

`poses.tum` is of the carrier of all LiDARs, `poses_NAME.tum` of that of one.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path

from unlidar.reporting import note

ALL = ""  # in place of a sensor's name: all sensors


def poses_name(sensor: str = ALL) -> str:
    """The file with the poses of a sensor's carrier."""
    return "poses.tum" if sensor == ALL else f"poses_{sensor}.tum"


def poses_options(poses: Mapping[str, Path]) -> list[str]:
    """`--poses` options of the program for these files by sensor."""
    named = [str(path) if name == ALL else f"{name}={path}" for name, path in poses.items()]
    return [part for text in named for part in ("--poses", text)]


def find_poses(folder: Path, sensors: Iterable[str]) -> dict[str, Path]:
    """The files of poses beside the frames of these sensors, by sensor; a note on those of none."""
    files = {sensor: folder / poses_name(sensor) for sensor in (ALL, *sensors)}
    for path in sorted(folder.glob(poses_name("*"))):
        name = path.stem.removeprefix("poses_")
        if name not in files and not (folder / name).is_dir():
            note(f"{path}: not taken, no LiDAR is called {name}")
    return {sensor: path for sensor, path in files.items() if path.is_file()}
