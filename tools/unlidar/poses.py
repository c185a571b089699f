"""Poses of LiDARs that move, over time."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from unlidar.call_checks import expect
from unlidar.csv_rows import finite_number, numbered_lines
from unlidar.errors import InputError, UsageError, reason
from unlidar.output import write_file
from unlidar.pose_files import ALL, poses_name
from unlidar.sanitize import printable
from unlidar.stamps import format_stamp_ns, parse_stamp_ns

if TYPE_CHECKING:  # slow to import, and every `unlidar.Engine` would
    from scipy.spatial.transform import Rotation

_COLUMNS = "timestamp tx ty tz qx qy qz qw"
_STILL_M, _STILL_RAD = 1e-3, 1e-4  # poses that differ by less do not move


@dataclass(frozen=True)
class Poses:
    """Poses of a carrier in the world over time: p_world = rotation * p_carrier + position."""

    stamp_ns: np.ndarray  # (N,) ascending
    position_m: np.ndarray  # (N, 3)
    rotation: "Rotation"  # N of them

    def __post_init__(self) -> None:
        """Throws UsageError for arrays of other shapes."""
        (n, *others) = _shape("stamp_ns", self.stamp_ns) or (None,)
        expect(n is not None and not others, "stamp_ns", self.stamp_ns, "an array of shape (n,)")
        position = _shape("position_m", self.position_m)
        expect(position == (n, 3), "position_m", position, f"an array of shape ({n}, 3)")
        as_quat = getattr(self.rotation, "as_quat", lambda: None)
        expect(np.shape(as_quat()) == (n, 4), "rotation", self.rotation, f"a Rotation of {n}")

    @property
    def is_still(self) -> bool:
        """True if nothing moves."""
        if len(self.stamp_ns) < 2:
            return True
        moved_m = np.linalg.norm(self.position_m - self.position_m[0], axis=1).max()
        turned_rad = (self.rotation[0].inv() * self.rotation).magnitude().max()
        return bool(moved_m < _STILL_M and turned_rad < _STILL_RAD)

    def equals(self, other: "Poses") -> bool:
        """True if times and poses are the same."""
        return (
            np.array_equal(self.stamp_ns, other.stamp_ns)
            and np.array_equal(self.position_m, other.position_m)
            and np.array_equal(self.rotation.as_quat(), other.rotation.as_quat())
        )

    def at(self, time_ns: np.ndarray) -> tuple[np.ndarray, "Rotation"]:
        """Positions (M, 3) and rotations at times (M,) within the span of at least two poses.

        Positions are interpolated along lines, rotations along great circles, as by the program.
        """
        known_s = self._known_s
        time_s = np.clip((time_ns - int(self.stamp_ns[0])) * 1e-9, known_s[0], known_s[-1])
        position = [np.interp(time_s, known_s, axis) for axis in self.position_m.T]
        return np.stack(position, axis=1), self._slerp(time_s)

    @cached_property
    def _known_s(self) -> np.ndarray:
        return (self.stamp_ns - int(self.stamp_ns[0])) * 1e-9

    @cached_property
    def _slerp(self) -> Any:
        from scipy.spatial.transform import Slerp

        return Slerp(self._known_s, self.rotation)


def write_all_poses(folder: Path, poses: Mapping[str, Poses], sensors: int, about: str) -> None:
    """Writes the poses beside the frames: one file if they are the same for all `sensors`."""
    first = next(iter(poses.values()), None)
    if first is not None and len(poses) == sensors and all(map(first.equals, poses.values())):
        poses = {ALL: first}
    for name, own in poses.items():
        write_poses(folder / poses_name(name), own, about)


def write_poses(path: Path, poses: Poses, about: str) -> None:
    """Writes a TUM file; `about` is a comment in its first line."""
    rows = np.concatenate([poses.position_m, poses.rotation.as_quat(canonical=True)], axis=1)
    lines = [f"# {printable(about)}", f"# {_COLUMNS}"]
    for stamp_ns, row in zip(poses.stamp_ns, rows, strict=True):
        lines.append(f"{format_stamp_ns(int(stamp_ns))} {' '.join(f'{v:.9f}' for v in row)}")
    write_file(path, lambda work: work.write_text("\n".join(lines) + "\n", encoding="utf-8"))


def _shape(name: str, array: object) -> tuple[int, ...]:
    try:
        return np.shape(array)
    except ValueError as error:  # its rows differ in length
        raise UsageError(f"{name}: {reason(error)}, expected an array") from error


def read_poses(path: Path) -> Poses:
    """Reads a TUM file. InputError naming file, line and value, by the rules of the program."""
    from scipy.spatial.transform import Rotation

    stamps_ns: list[int] = []
    values: list[list[float]] = []
    for number, line in numbered_lines(path):
        words = line.split("#")[0].split()
        if not words:
            continue
        try:
            stamps_ns.append(parse_stamp_ns(words[0]))
            values.append([finite_number(word) for word in words[1:]])
        except ValueError as error:
            raise InputError(f"{path}:{number}: {reason(error)}, expected {_COLUMNS}") from error
        if len(words) != 8 or stamps_ns[-2:] != sorted(set(stamps_ns[-2:])):
            raise InputError(f"{path}:{number}: '{line.strip()}', expected {_COLUMNS}, rising")
    table = np.array(values).reshape(-1, 7)
    norms = np.linalg.norm(table[:, 3:], axis=1)
    if len(table) < 2 or not np.isfinite(table).all() or not np.allclose(norms, 1, atol=0.01):
        raise InputError(f"{path}: expected two poses or more, their quaternions of norm 1")
    return Poses(np.array(stamps_ns), table[:, :3], Rotation.from_quat(table[:, 3:]))
