"""Poses and clocks of the LiDARs as used by the program, from its summary and its --poses."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from unlidar.errors import InputError, reason
from unlidar.frame_clock import rate_of
from unlidar.frames_io import is_return, positions_of, read_pcd
from unlidar.point_times import TIME_FIELDS, offsets_ns
from unlidar.pose_files import ALL
from unlidar.poses import Poses, read_poses


@dataclass(frozen=True)
class Mounting:
    """Pose of a sensor in the common frame, its clock, and the unit of its files."""

    translation_m: tuple[float, ...] = (0.0, 0.0, 0.0)
    rotation: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0)  # unit quaternion x, y, z, w
    time_offset_s: float = 0.0
    frame_rate_hz: float | None = None  # of frames that are numbered, where it is given
    scale_m: float = 1.0  # metres in a unit of the files
    poses: Poses | None = None  # of its carrier in the common frame; None: it is at rest

    @property
    def offset_ns(self) -> int:
        """To be added to its stamps."""
        return round(self.time_offset_s / 1e-9)  # divided as in the program, for the same rounding

    def place(self, xyz: np.ndarray, time_ns: np.ndarray) -> np.ndarray:
        """Transforms (N, 3) from the sensor frame, in file units, to the common frame in m.

        Each at its own time (N,), on the common clock.
        """
        xyz_m = self.scale_m * xyz
        placed_m = Rotation.from_quat(self.rotation).apply(xyz_m) + np.array(self.translation_m)
        if self.poses is None:
            return placed_m
        position_m, rotation = self.poses.at(time_ns)
        return rotation.apply(placed_m) + position_m

    def viewpoints_m(self, time_ns: np.ndarray) -> np.ndarray:
        """Where the sensor is at these times, (N, 3)."""
        return self.place(np.zeros((len(time_ns), 3)), time_ns)

    def returns_m(self, path: Path, stamp_ns: int) -> tuple[np.ndarray, np.ndarray]:
        """The returns of a file with this stamp: (N, 3) in the common frame, and (N,) ranges."""
        fields = read_pcd(path)
        xyz = positions_of(path, fields)
        kept = is_return(xyz)
        time_ns = np.full(kept.sum(), stamp_ns + self.offset_ns)
        times = next((fields[name] for name in TIME_FIELDS if name in fields), None)
        if self.poses is not None and times is not None:
            offsets = offsets_ns(times[kept], stamp_ns)
            time_ns = time_ns if offsets is None else time_ns + offsets
        ranges_m = np.linalg.norm(self.scale_m * xyz[kept], axis=1)
        return self.place(xyz[kept], time_ns), ranges_m


def mounting_of(path: Path, summary: dict, name: str, poses: Mapping[str, Path]) -> Mounting:
    """The mounting of sensor `name` in a summary of the program, with the files of its --poses.

    `path` is the summary's, for error messages.
    """
    moving = poses.get(name, poses.get(ALL))
    try:
        config = summary.get("config", {})
        mounting = Mounting(
            frame_rate_hz=rate_of(config, name),
            scale_m=float(config.get("input", {}).get("scale_m", 1.0)),
            poses=None if moving is None else read_poses(moving),
        )
        known = config.get("sensors", {}).get(name)
        if known is None:
            return mounting
        return replace(
            mounting,
            translation_m=tuple(float(v) for v in known["translation_m"]),
            rotation=tuple(float(v) for v in known["rotation"]),
            time_offset_s=float(known["time_offset_s"]),
        )
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: config.sensors.{name}: {reason(error)}") from error
