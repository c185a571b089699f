"""Uniform sample of the returns for a page, with their measurement times."""

from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from unlidar.frames_io import list_frames
from unlidar.mounting import Mounting
from unlidar.progress import with_progress
from unlidar.truth import Tracks

MOST_OVERALL = 40_000  # returns of all times together
MOST_IN_STEPS = 250_000  # returns of all time steps of the slider
MOST_STEPS = 400
MOST_TARGETS = 40_000
# Pages store centimetres in 16 bits.
FARTHEST_M = 320.0
_NEAR_TRACK_M = 6.0  # target returns are within this distance of the estimate
_SAME_POINT_M = 2e-3


@dataclass(frozen=True)
class Sample:
    """Returns in the common frame in m, and the time steps of the slider."""

    overall_m: np.ndarray  # (N, 3) of all times
    steps_s: np.ndarray  # (S,) Unix time of each step
    edges_s: np.ndarray  # (S - 1,) boundaries between steps
    steps_m: list[np.ndarray]  # S arrays (M, 3), the returns of each step
    frames_per_step: int  # of the first sensor
    target_m: np.ndarray  # (T, 3)
    target_s: np.ndarray  # (T,) Unix time, NaN where it is not known
    targets: int  # before thinning
    frames: int
    returns: int  # in all frames
    far: int  # of these, farther than FARTHEST_M and left out

    @property
    def in_steps(self) -> int:
        """Number of returns in all time steps."""
        return sum(len(step) for step in self.steps_m)


@dataclass(frozen=True)
class _Frame:
    time_s: float
    stamp_ns: int
    path: Path
    mounting: Mounting


def sample_returns(
    sensors: dict[str, tuple[Path, Mounting]],
    tracks: Tracks,
    target_m: np.ndarray,
    expected_returns: int,
) -> Sample:
    """Reads every frame once; the same input gives the same sample.

    The first sensor's frames define the time steps. `target_m` (T, 3) are the target returns; their
    times are found by looking them up in the frames.
    """
    frames = [_frames(directory, mounting) for directory, mounting in sensors.values()]
    first_s = np.array([frame.time_s for frame in frames[0]] if frames else [])
    per_step = -(-len(first_s) // MOST_STEPS)
    chunks = [first_s[i : i + per_step] for i in range(0, len(first_s), max(1, per_step))]
    steps_s = np.array([chunk.mean() for chunk in chunks])
    edges_s = np.array([chunk[0] for chunk in chunks[1:]])
    rng = np.random.default_rng(0)
    clock = _TargetClock(tracks, target_m)
    share = min(1.0, 1.5 * MOST_OVERALL / max(1, expected_returns))
    most = MOST_IN_STEPS // max(1, len(steps_s))
    overall: list[np.ndarray] = [np.zeros((0, 3))]
    steps = [np.zeros((0, 3))] * len(steps_s)
    count = returns = far = 0
    merged = sorted((frame for own in frames for frame in own), key=lambda f: f.time_s)
    moments = groupby(
        with_progress(merged, len(merged), "report"),
        key=lambda f: int(np.searchsorted(edges_s, f.time_s, side="right")),
    )
    for step, group in moments:
        clouds = [np.zeros((0, 3))]
        for frame in group:
            cloud, _ = frame.mounting.returns_m(frame.path, frame.stamp_ns)
            count, returns = count + 1, returns + len(cloud)
            clock.look_up(cloud, frame.time_s)
            near = cloud[np.abs(cloud).max(axis=1, initial=0.0) <= FARTHEST_M]
            far += len(cloud) - len(near)
            clouds.append(near)
        returns_m = np.concatenate(clouds)
        overall.append(returns_m[rng.random(len(returns_m)) < share])
        steps[step] = _thinned(returns_m, most, rng)
    kept = np.sort(rng.permutation(len(target_m))[:MOST_TARGETS])
    return Sample(
        overall_m=_thinned(np.concatenate(overall), MOST_OVERALL, rng),
        steps_s=steps_s,
        edges_s=edges_s,
        steps_m=steps,
        frames_per_step=per_step,
        target_m=target_m[kept],
        target_s=clock.time_s[kept],
        targets=len(target_m),
        frames=count,
        returns=returns,
        far=far,
    )


class _TargetClock:
    """Finds the measurement times of target returns by looking them up in the frames."""

    def __init__(self, tracks: Tracks, target_m: np.ndarray):
        self.time_s = np.full(len(target_m), np.nan)
        self._tree = cKDTree(target_m) if len(target_m) else None
        order = np.argsort(tracks.time_s, kind="stable")
        self._track_s, self._track_m = tracks.time_s[order], tracks.xyz_m[order]

    def look_up(self, cloud_m: np.ndarray, time_s: float) -> None:
        """Gives `time_s` to the target returns that are in this frame."""
        if self._tree is None or len(cloud_m) == 0:
            return
        cloud_m = cloud_m[self._near_track(cloud_m, time_s)]
        away, index = self._tree.query(cloud_m, distance_upper_bound=_SAME_POINT_M)
        self.time_s[index[np.isfinite(away)]] = time_s

    def _near_track(self, cloud_m: np.ndarray, time_s: float) -> np.ndarray:
        begin, end = np.searchsorted(self._track_s, [time_s - 1.0, time_s + 1.0])
        positions = self._track_m[begin:end]
        if len(positions) == 0:
            return np.ones(len(cloud_m), dtype=bool)
        low = positions.min(axis=0) - _NEAR_TRACK_M
        high = positions.max(axis=0) + _NEAR_TRACK_M
        return np.all((cloud_m >= low) & (cloud_m <= high), axis=1)


def _thinned(points_m: np.ndarray, most: int, rng: np.random.Generator) -> np.ndarray:
    if len(points_m) <= most:
        return points_m
    return points_m[np.sort(rng.choice(len(points_m), most, replace=False))]


def _frames(directory: Path, mounting: Mounting) -> list[_Frame]:
    return [
        _Frame(frame.stamp_ns * 1e-9 + mounting.time_offset_s, frame.stamp_ns, frame.path, mounting)
        for frame in list_frames(directory, mounting.frame_rate_hz)
    ]
