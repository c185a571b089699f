"""Made-up truths and tracks for the tests of evaluate and export."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from unlidar.truth import Tracks, Truth

BEGIN_S = 1_706_300_000.0


def place(time_s: np.ndarray) -> np.ndarray:
    """(N, 3) a curved flight that turns about no axis twice alike."""
    return np.stack(
        [5 * np.cos(0.8 * time_s), 4 * np.sin(1.1 * time_s), 9 + 0.3 * time_s + np.sin(time_s)],
        axis=1,
    )


def truth_at(time_s: np.ndarray, target: float = 0.0, away_m: float = 0.0) -> Truth:
    xyz = place(time_s) + np.array([away_m, 0, 0])
    seen = np.ones(len(time_s), dtype=bool)
    return Truth(BEGIN_S + time_s, np.full(len(time_s), target), xyz, seen)


def track_at(
    time_s: np.ndarray,
    error_m: np.ndarray | float = 0.0,
    track_id: float = 0.0,
    sigma_m: np.ndarray | None = None,
) -> Tracks:
    xyz = place(time_s) + error_m
    return Tracks(BEGIN_S + time_s, np.full(len(time_s), track_id), xyz, sigma_m)


def join_truths(*parts: Truth) -> Truth:
    names = ("time_s", "target", "xyz_m", "in_view")
    return Truth(*(np.concatenate([getattr(p, name) for p in parts]) for name in names))


def join_tracks(*parts: Tracks) -> Tracks:
    names = ("time_s", "track_id", "xyz_m")
    return Tracks(*(np.concatenate([getattr(p, name) for p in parts]) for name in names))


def write_result(folder: Path, truth: Truth, tracks: Tracks) -> Path:
    """The folder, with ground_truth.csv and traj.csv as the program writes them."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "ground_truth.csv").open("w") as file:
        file.write("timestamp,target,x,y,z,in_view\n")
        for t, k, xyz, seen in zip(
            truth.time_s, truth.target, truth.xyz_m, truth.in_view, strict=True
        ):
            file.write(f"{t:.9f},{k:.0f},{','.join(map(repr, map(float, xyz)))},{int(seen)}\n")
    sigma = np.full((len(tracks), 3), 0.1) if tracks.sigma_m is None else tracks.sigma_m
    with (folder / "traj.csv").open("w") as file:
        file.write("timestamp,track_id,x,y,z,vx,vy,vz,sigma_x,sigma_y,sigma_z,support\n")
        for i in range(len(tracks)):
            numbers = [*tracks.xyz_m[i], 0.5, -1.25, 0.125, *sigma[i]]
            values = ",".join(repr(float(v)) for v in numbers)
            file.write(f"{tracks.time_s[i]:.9f},{tracks.track_id[i]:.0f},{values},{3 + i % 4}\n")
    return folder
