"""Input of exports: the tracks of a result, and the target returns."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from unlidar.errors import InputError, reason
from unlidar.frames_io import read_returns
from unlidar.program import SUMMARY, TARGET_RETURNS, TRAJECTORY
from unlidar.record import read_object
from unlidar.truth import Tracks, read_tracks


@dataclass(frozen=True)
class Track:
    """Rows of one track in order of time."""

    track_id: int
    stamp_ns: np.ndarray  # (N,) int64
    xyz_m: np.ndarray  # (N, 3)
    velocity_mps: np.ndarray | None  # (N, 3)
    sigma_m: np.ndarray | None  # (N, 3)
    support: np.ndarray | None  # (N,)

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.stamp_ns)


@dataclass(frozen=True)
class Kind:
    """Probabilities of what a track may be; docs/kinds.md."""

    drone: float
    bird_like: float


@dataclass(frozen=True)
class Result:
    """A trajectory file, whole and by track."""

    name: str
    tracks: Tracks
    by_track: list[Track]
    target_returns_m: np.ndarray | None  # (N, 3)
    kinds: dict[int, Kind] = field(default_factory=dict)  # of a folder of results, where known


def trajectory_of(path: Path) -> Path:
    """The trajectory itself, or that of a folder of results."""
    return path / TRAJECTORY if path.is_dir() else path


def read_result(path: Path, points: Path | None = None) -> Result:
    """A trajectory, or a folder of results: traj.csv, target_returns.pcd and summary.json."""
    trajectory = trajectory_of(path)
    beside = path / TARGET_RETURNS
    if points is None and path.is_dir() and beside.is_file():
        points = beside
    tracks = read_tracks(trajectory)
    by_track = [_one(trajectory, tracks, track) for track in np.unique(tracks.track_id)]
    returns = None if points is None else read_returns(points)
    name = path.resolve().name if path.is_dir() else path.resolve().parent.name
    summary = path / SUMMARY
    kinds = _kinds(summary) if path.is_dir() and summary.is_file() else {}
    return Result(name, tracks, by_track, returns, kinds)


def _kinds(path: Path) -> dict[int, Kind]:
    try:
        return {
            int(track["track_id"]): Kind(
                float(track["kind"]["drone"]), float(track["kind"]["bird_like"])
            )
            for track in read_object(path).get("tracks", [])
            if "kind" in track
        }
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: tracks: {reason(error)}") from error


def _one(path: Path, tracks: Tracks, track: float) -> Track:
    if track != int(track) or track < 0:
        raise InputError(f"{path}: track_id is {track:g}, expected a whole number from 0 on")
    rows = np.flatnonzero(tracks.track_id == track)
    stamp_ns = tracks.stamp_ns[rows]
    rows = rows[np.argsort(stamp_ns, kind="stable")]
    if tracks.stamp_ns[rows[0]] < 0:
        raise InputError(f"{path}: timestamp is {tracks.time_s[rows[0]]:.9f}, expected 0 or later")
    pick = [
        None if column is None else column[rows]
        for column in (tracks.velocity_mps, tracks.sigma_m, tracks.support)
    ]
    return Track(int(track), tracks.stamp_ns[rows], tracks.xyz_m[rows], *pick)
