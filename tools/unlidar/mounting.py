"""Poses and clocks of the LiDARs as used by the program, from its summary."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from unlidar.errors import InputError, reason
from unlidar.frame_clock import rate_of


@dataclass(frozen=True)
class Mounting:
    """Pose of a sensor in the common frame, its clock, and the unit of its files."""

    translation_m: tuple[float, ...] = (0.0, 0.0, 0.0)
    rotation: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0)  # unit quaternion x, y, z, w
    time_offset_s: float = 0.0
    frame_rate_hz: float | None = None  # of frames that are numbered, where it is given
    scale_m: float = 1.0  # metres in a unit of the files

    def place(self, xyz: np.ndarray) -> np.ndarray:
        """Transforms (N, 3) from the sensor frame, in file units, to the common frame in m."""
        xyz_m = self.scale_m * xyz
        return Rotation.from_quat(self.rotation).apply(xyz_m) + np.array(self.translation_m)


def mounting_of(path: Path, summary: dict, name: str) -> Mounting:
    """The mounting of sensor `name` in a summary of the program; `path` is for error messages."""
    try:
        config = summary.get("config", {})
        mounting = Mounting(
            frame_rate_hz=rate_of(config, name),
            scale_m=float(config.get("input", {}).get("scale_m", 1.0)),
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
