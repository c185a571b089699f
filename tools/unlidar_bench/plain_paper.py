"""The paper in plain Python, as one would write it down from its text, to compare with.

    python -m unlidar_bench.plain_paper OUT FRAMES_DIR...

Global clusters of all frames, their voxels from frame to frame (IoU), their density in a frame and
in all; the best score wins, a spline through its centroids is the trajectory.
"""

import itertools
import sys
from pathlib import Path

import numpy as np
from scipy.interpolate import UnivariateSpline
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from unlidar.frames_io import list_frames, read_returns

VOXEL_M = 0.2
TOLERANCE_M = 0.5
MIN_RETURNS = 10
WINDOW_FRAMES = 5
MIN_IOU = 0.01
RETURN_SIGMA_M = 0.05


def read(folders: list[Path]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stamps of the frames in seconds (F,), returns (N, 3) and the frame of each (N,)."""
    frames = sorted((f.stamp_ns, f.path) for folder in folders for f in list_frames(folder))
    clouds = [read_returns(path) for _, path in frames]
    clouds = [cloud[np.linalg.norm(cloud, axis=1) > 0.5] for cloud in clouds]
    owner = np.repeat(np.arange(len(frames)), [len(cloud) for cloud in clouds])
    return np.array([stamp for stamp, _ in frames]) * 1e-9, np.concatenate(clouds), owner


def global_clusters(voxels: np.ndarray) -> np.ndarray:
    """Label of each voxel (V,): what is joined by steps of at most TOLERANCE_M is one cluster.

    Of voxels, not of returns: all pairs of returns within reach would not fit into memory.
    """
    pairs = cKDTree(voxels * VOXEL_M).query_pairs(TOLERANCE_M, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs), bool), pairs.T), (len(voxels), len(voxels)))
    return connected_components(graph, directed=False)[1]


def score(voxel: np.ndarray, window: np.ndarray) -> float:
    """The psi of a cluster: the mean of e^R over windows and of -ln IoU over pairs of them."""
    of_window = [np.unique(voxel[window == w], return_counts=True) for w in np.unique(window)]
    if len(of_window) < 2:
        return -np.inf
    merged = len(voxel) / len(np.unique(voxel))
    density = np.array([counts.sum() / len(counts) for _, counts in of_window])
    overlaps = []
    for (before, _), (after, _) in itertools.pairwise(of_window):
        both = len(np.intersect1d(before, after, assume_unique=True))
        overlaps.append(both / (len(before) + len(after) - both))
    return float(np.exp(density / merged).mean() - np.log(np.maximum(overlaps, MIN_IOU)).mean())


def track(stamps_s: np.ndarray, xyz_m: np.ndarray, owner: np.ndarray) -> np.ndarray:
    """Rows timestamp, x, y, z of the winner."""
    voxels, voxel = np.unique(np.floor(xyz_m / VOXEL_M), axis=0, return_inverse=True)
    voxel = voxel.reshape(-1)
    label = global_clusters(voxels)[voxel]
    order = np.argsort(label, kind="stable")
    clusters = np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
    clusters = [c for c in clusters if len(c) >= MIN_RETURNS]
    scores = [score(voxel[c], owner[c] // WINDOW_FRAMES) for c in clusters]
    if not scores or not np.isfinite(max(scores)):
        return np.zeros((0, 4))
    best = clusters[int(np.argmax(scores))]
    frames, index, counts = np.unique(owner[best], return_inverse=True, return_counts=True)
    centroid = np.zeros((len(frames), 3))
    np.add.at(centroid, index.reshape(-1), xyz_m[best])
    centroid /= counts[:, None]
    time_s, first = np.unique(stamps_s[frames], return_index=True)
    centroid, counts = centroid[first], counts[first]
    if len(time_s) > 3:
        weight = np.sqrt(counts) / RETURN_SIGMA_M
        fits = [UnivariateSpline(time_s - time_s[0], axis, w=weight) for axis in centroid.T]
        centroid = np.stack([fit(time_s - time_s[0]) for fit in fits], axis=1)
    return np.column_stack([time_s, centroid])


def main(arguments: list[str]) -> None:
    """OUT FRAMES_DIR..."""
    rows = track(*read([Path(folder) for folder in arguments[1:]]))
    lines = [f"{t:.9f},0,{x:.6f},{y:.6f},{z:.6f}\n" for t, x, y, z in rows]
    Path(arguments[0]).write_text("timestamp,track_id,x,y,z\n" + "".join(lines))


if __name__ == "__main__":
    main(sys.argv[1:])
