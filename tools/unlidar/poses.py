"""Poses of LiDARs that move, over time."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from unlidar.output import write_file
from unlidar.sanitize import printable
from unlidar.stamps import format_stamp_ns

_COLUMNS = "timestamp tx ty tz qx qy qz qw"
_STILL_M, _STILL_RAD = 1e-3, 1e-4  # poses that differ by less do not move


@dataclass(frozen=True)
class Poses:
    """Poses of a carrier in the world over time: p_world = rotation * p_carrier + position."""

    stamp_ns: np.ndarray  # (N,) ascending
    position_m: np.ndarray  # (N, 3)
    rotation: Rotation  # N of them

    @property
    def is_still(self) -> bool:
        """True if nothing moves."""
        if len(self.stamp_ns) < 2:
            return True
        moved_m = np.linalg.norm(self.position_m - self.position_m[0], axis=1).max()
        turned_rad = (self.rotation[0].inv() * self.rotation).magnitude().max()
        return bool(moved_m < _STILL_M and turned_rad < _STILL_RAD)

    def at(self, time_ns: np.ndarray) -> tuple[np.ndarray, Rotation]:
        """Positions (M, 3) and rotations at times (M,) within the span of at least two poses.

        Positions are interpolated along lines, rotations along great circles, as by the program.
        """
        begin_ns = int(self.stamp_ns[0])
        known_s = (self.stamp_ns - begin_ns) * 1e-9
        time_s = np.clip((time_ns - begin_ns) * 1e-9, known_s[0], known_s[-1])
        position = [np.interp(time_s, known_s, axis) for axis in self.position_m.T]
        return np.stack(position, axis=1), Slerp(known_s, self.rotation)(time_s)


def write_poses(path: Path, poses: Poses, about: str) -> None:
    """Writes a TUM file; `about` is a comment in its first line."""
    rows = np.concatenate([poses.position_m, poses.rotation.as_quat(canonical=True)], axis=1)
    lines = [f"# {printable(about)}", f"# {_COLUMNS}"]
    for stamp_ns, row in zip(poses.stamp_ns, rows, strict=True):
        lines.append(f"{format_stamp_ns(int(stamp_ns))} {' '.join(f'{v:.9f}' for v in row)}")
    write_file(path, lambda work: work.write_text("\n".join(lines) + "\n", encoding="utf-8"))
