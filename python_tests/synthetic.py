"""A small made-up recording, and what is needed to run the program on it and read its files.

The scene is what the program has to tell apart: ground, a wall and poles that each frame hits at
other places, and a drone in open air with 5 to 10 returns a frame. Everything is seeded.
"""

from __future__ import annotations

import csv
import os
import resource
import subprocess
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

PROJECT = Path(__file__).resolve().parents[1]
SHARED = PROJECT.parent / "shared"
PROGRAM = Path(os.environ.get("UNLIDAR_TRACK", PROJECT / "build" / "unlidar_track"))

BEGIN_NS = 1_706_300_000_123_456_789
PERIOD_NS = 100_000_000
TRAJ_HEADER = "timestamp,track_id,x,y,z,vx,vy,vz,sigma_x,sigma_y,sigma_z,support"
NO_DRONE_TRAJ = TRAJ_HEADER + "\n"

Points = NDArray[np.float32]


def drone_position_m(time_s: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """(..., 3) where the drone is `time_s` after the recording's begin: 4 m/s, 8 m up."""
    t = np.asarray(time_s, dtype=float)
    return np.stack(
        [2 + 7 * np.cos(0.57 * t), 7 * np.sin(0.57 * t), 8 + 0.8 * np.sin(0.9 * t)], axis=-1
    )


def truth_m(stamps_s: Iterable[float] | NDArray[np.float64], begin_s: float = BEGIN_NS * 1e-9):
    return drone_position_m(np.asarray(stamps_s, dtype=float) - begin_s)


@dataclass
class Flight:
    """Frames of one sensor; `times_s[k]` are seconds after the stamp for each row of a cloud."""

    stamps_ns: list[int] = field(default_factory=list)
    clouds: list[Points] = field(default_factory=list)
    times_s: list[NDArray[np.float32]] = field(default_factory=list)


def _static_returns(rng: np.random.Generator) -> NDArray[np.float64]:
    ground = rng.uniform([-25, -25, -2], [25, 25, -1.95], (700, 3))
    wall = rng.uniform([20, -10, -2], [20.05, 10, 4], (250, 3))
    feet = np.array([[-12, -9], [-6, 14], [5, -13], [13, 8], [-14, 6], [9, 12]], dtype=float)
    poles = np.repeat(feet, 12, axis=0) + rng.normal(0, 0.04, (72, 2))
    poles = np.column_stack([poles, rng.uniform(-2, 3, 72)])
    return np.concatenate([ground, wall, poles])


def make_flight(seed: int = 1, frames: int = 60, drone: bool = True, pace: float = 1.0) -> Flight:
    """Of a drone at 4 m/s times `pace`."""
    rng = np.random.default_rng(seed)
    flight = Flight()
    for i in range(frames):
        points = _static_returns(rng)
        times_s = rng.uniform(0, PERIOD_NS * 1e-9, len(points))
        if drone:
            count = int(rng.integers(5, 11))
            since_stamp_s = rng.uniform(0, PERIOD_NS * 1e-9, count)
            body = drone_position_m(pace * (i * PERIOD_NS * 1e-9 + since_stamp_s))
            body += rng.uniform([-0.15, -0.15, -0.06], [0.15, 0.15, 0.06], (count, 3))
            points = np.concatenate([points, body])
            times_s = np.concatenate([times_s, since_stamp_s])
        order = rng.permutation(len(points))
        flight.stamps_ns.append(BEGIN_NS + i * PERIOD_NS)
        flight.clouds.append(points[order].astype(np.float32))
        flight.times_s.append(times_s[order].astype(np.float32))
    return flight


def with_opposite_drone(flight: Flight) -> Flight:
    """A second drone flies opposite to the first and is seen in the middle half only."""
    clouds = []
    for i, cloud in enumerate(flight.clouds):
        opposite = cloud[cloud[:, 2] > 5] * np.float32([-1, -1, 1])
        clouds.append(np.concatenate([cloud, opposite]) if 15 <= i < 45 else cloud)
    return Flight(flight.stamps_ns, clouds)


def decimal_name(stamp_ns: int) -> str:
    return f"{seconds(stamp_ns)}.pcd"


def seconds(stamp_ns: int) -> str:
    """Exact decimal seconds: a float would lose the last digits."""
    return f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d}"


def write_pcd(path: Path, points: Points, **extra: NDArray[np.generic]) -> None:
    """A binary PCD; every keyword is one more field, of that array's type."""
    columns = {"x": points[:, 0], "y": points[:, 1], "z": points[:, 2], **extra}
    dtype = np.dtype([(name, column.dtype) for name, column in columns.items()])
    rows = np.empty(len(points), dtype)
    for name, column in columns.items():
        rows[name] = column
    kind = {"f": "F", "u": "U", "i": "I"}
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
        f"FIELDS {' '.join(columns)}\n"
        f"SIZE {' '.join(str(c.dtype.itemsize) for c in columns.values())}\n"
        f"TYPE {' '.join(kind[c.dtype.kind] for c in columns.values())}\n"
        f"COUNT {' '.join('1' for _ in columns)}\n"
        f"WIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\n"
        "DATA binary\n"
    )
    path.write_bytes(header.encode() + rows.tobytes())


def read_binary_pcd(path: Path) -> Points:
    """(N, 3) points of a binary PCD whose only fields are x y z as float32."""
    head, _, body = path.read_bytes().partition(b"DATA binary\n")
    header = dict(
        line.split(" ", 1) for line in head.decode().splitlines() if not line.startswith("#")
    )
    assert header["FIELDS"].split() == ["x", "y", "z"]
    assert header["SIZE"].split() == ["4"] * 3 and header["TYPE"].split() == ["F"] * 3
    points = np.frombuffer(body, "<f4").reshape(-1, 3)
    assert int(header["POINTS"]) == int(header["WIDTH"]) * int(header["HEIGHT"]) == len(points)
    return points


def write_frames(
    directory: Path, flight: Flight, name: Callable[[int], str] = decimal_name
) -> Path:
    directory.mkdir(parents=True)
    for stamp_ns, cloud in zip(flight.stamps_ns, flight.clouds, strict=True):
        write_pcd(directory / name(stamp_ns), cloud)
    return directory


def run_program(
    *arguments: str | Path, cwd: Path | None = None, memory_bytes: int | None = None
) -> subprocess.CompletedProcess[str]:
    assert PROGRAM.is_file(), f"{PROGRAM} is not built; UNLIDAR_TRACK names another place"

    def limit_memory() -> None:
        if memory_bytes is not None:
            resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))

    return subprocess.run(
        [PROGRAM, *arguments],
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        cwd=cwd,
        timeout=300,
        preexec_fn=limit_memory,
    )


def track(frames: Path | Sequence[str | Path], out: Path, *arguments: str | Path) -> str:
    """Runs the program, asserts that it succeeds, and returns what it said on stderr."""
    sources = [frames] if isinstance(frames, Path) else frames
    options = [part for source in sources for part in ("--frames", source)]
    result = run_program(*options, "--out", out, *arguments)
    assert result.returncode == 0, result.stderr
    return result.stderr


@dataclass
class Traj:
    """Columns of a traj.csv. `stamps` keeps the digits as written."""

    stamps: list[str]
    time_s: NDArray[np.float64]
    track_id: NDArray[np.int64]
    position_m: NDArray[np.float64]  # (N, 3)
    velocity_mps: NDArray[np.float64]  # (N, 3)
    sigma_m: NDArray[np.float64]  # (N, 3)
    support: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.stamps)


def read_traj(path: Path) -> Traj:
    with path.open(newline="") as file:
        reader = csv.reader(file)
        assert ",".join(next(reader)) == TRAJ_HEADER
        rows = list(reader)
    assert all(len(row) == 12 for row in rows)
    values = np.array([[float(v) for v in row] for row in rows]).reshape(-1, 12)
    return Traj(
        stamps=[row[0] for row in rows],
        time_s=values[:, 0],
        track_id=np.array([int(row[1]) for row in rows], dtype=np.int64),
        position_m=values[:, 2:5],
        velocity_mps=values[:, 5:8],
        sigma_m=values[:, 8:11],
        support=np.array([int(row[11]) for row in rows], dtype=np.int64),
    )


def rmse_m(estimate: NDArray[np.float64], truth: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(np.sum((estimate - truth) ** 2, axis=1))))
