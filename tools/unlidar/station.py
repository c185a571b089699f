"""station.yaml: poses and clock offsets of a recording's LiDARs.

It lies beside the frames and is a configuration of the program:
`unlidar_track --frames lidar=rec/lidar --config rec/station.yaml ...`.
"""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError
from ruamel.yaml import YAMLError

from unlidar.errors import InputError, listed, reason
from unlidar.limits import load_yaml
from unlidar.reporting import note
from unlidar.sanitize import printable
from unlidar.settings import assignments

STATION_NAME = "station.yaml"
_Finite = Annotated[float, Field(allow_inf_nan=False)]


@dataclass(frozen=True)
class Pose:
    """Pose of a LiDAR in the common frame: p_common = R(rotation) p_sensor + translation_m."""

    __pydantic_config__ = ConfigDict(extra="forbid")

    translation_m: tuple[_Finite, _Finite, _Finite] = (0.0, 0.0, 0.0)
    rotation: tuple[_Finite, _Finite, _Finite, _Finite] = (0.0, 0.0, 0.0, 1.0)  # x y z w, unit
    time_offset_s: _Finite = 0.0  # to be added to its stamps


_POSES = TypeAdapter(dict[str, Pose])


def write_station(folder: Path, poses: Mapping[str, Pose], about: str) -> None:
    """Writes station.yaml beside the frames; `about` is the poses' origin, a comment."""
    lines = [f"# {printable(about)}", "sensors:"]
    for name, pose in poses.items():
        lines += [
            f"  {name}:",
            f"    translation_m: {json.dumps(pose.translation_m)}",
            f"    rotation: {json.dumps(pose.rotation)}  # unit quaternion x, y, z, w",
            f"    time_offset_s: {json.dumps(pose.time_offset_s)}",
        ]
    (folder / STATION_NAME).write_text("\n".join(lines) + "\n", encoding="utf-8")


def read_station(folder: Path) -> dict[str, Pose]:
    """The poses of a folder's station.yaml by sensor; empty without such a file.

    Throws InputError naming the file, the key and the fault.
    """
    path = folder / STATION_NAME
    if not path.is_file():
        return {}
    try:
        return _POSES.validate_python((load_yaml(path) or {}).get("sensors") or {})
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        key = ".".join(map(str, ("sensors", *fault["loc"])))
        raise InputError(f"{path}: {key}: '{fault['input']}', {fault['msg']}") from error
    except (OSError, ValueError, AttributeError, RecursionError, YAMLError) as error:
        raise InputError(f"{path}: cannot be read as YAML: {reason(error)}") from error


def places_sensors(options: list[str]) -> bool:
    """True if a `--config` among the program's options has poses of its own."""
    if "--config" not in options:
        return False
    position = options.index("--config") + 1
    return position < len(options) and has_sensors(Path(options[position]))


def has_sensors(config: Path) -> bool:
    """True if a configuration has poses."""
    try:
        return bool(load_yaml(config).get("sensors"))
    except (OSError, ValueError, AttributeError, RecursionError, YAMLError):
        return False  # the program will report the fault


def station_settings(poses: Mapping[str, Pose], sensors: Iterable[str]) -> dict[str, object]:
    """Settings of the program for these sensors; empty if all are at the origin."""
    chosen = {name: poses.get(name, Pose()) for name in sensors}
    unplaced = [name for name in chosen if name not in poses]
    if poses and unplaced:
        note(
            f"{listed(unplaced)}: taken to stand at the origin, poses are known of {listed(poses)}"
        )
    if all(pose == Pose() for pose in chosen.values()):
        return {}
    return {
        f"sensors.{name}.{key}": value
        for name, pose in chosen.items()
        for key, value in vars(pose).items()
    }


def station_options(poses: Mapping[str, Pose], sensors: Iterable[str]) -> list[str]:
    """The same as `--set` options of the program."""
    return [
        part for text in assignments(station_settings(poses, sensors)) for part in ("--set", text)
    ]
