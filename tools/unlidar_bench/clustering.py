"""Clusters of the same returns with the same parameters."""

import time

import numpy as np
from sklearn.cluster import DBSCAN
from unlidar.frames_io import list_frames, read_returns

from unlidar_bench.paired import by_turns, median, ratio
from unlidar_bench.processes import cpu_ms, google_benchmark
from unlidar_bench.recordings import dense, part_of
from unlidar_bench.setting import Setting
from unlidar_bench.tables import Column, digits, times, whole

COLUMNS = (
    Column("returns", "returns", whole),
    Column("method", "method"),
    Column("by", "by"),
    Column("clusters", "clusters", whole),
    Column("ms", "ms", digits),
    Column("times ours", "times", times),
)
_TOLERANCE_M, _NEIGHBOURS, _NEAREST_M = 0.5, 5, 0.5  # the defaults of the program


def measure(setting: Setting) -> list[dict]:
    """One frame, and some seconds superimposed."""
    frames = part_of(setting, dense(setting, 64), setting.superimposed_s)
    clouds = [read_returns(frame.path) for frame in list_frames(frames)]
    clouds = [cloud[np.linalg.norm(cloud, axis=1) >= _NEAREST_M] for cloud in clouds]
    points = {"frame": max(clouds, key=len), "all": np.concatenate(clouds)}

    def ours() -> dict:
        found = google_benchmark(setting.bench("clustering_bench"), [frames], setting.least_s)
        return {name: (cpu_ms(one), one["clusters"]) for name, one in found.items()}

    def sklearn() -> dict:
        return {
            f"{name}/{method}/sklearn": _dbscan(xyz_m, neighbours)
            for name, xyz_m in points.items()
            for method, neighbours in (("euclidean", 1), ("dbscan", _NEIGHBOURS))
        }

    turns = by_turns(setting.rounds, {"ours": ours, "sklearn": sklearn})
    both = [a | b for a, b in zip(turns["ours"], turns["sklearn"], strict=True)]
    rows = []
    for name, xyz_m in points.items():
        for method, others in (("euclidean", ("pcl", "sklearn")), ("dbscan", ("sklearn",))):
            reference = [one[f"{name}/{method}/grid"][0] for one in both]
            for by in ("grid", *others):
                found = [one[f"{name}/{method}/{by}"] for one in both]
                rows.append(
                    {
                        "returns": len(xyz_m),
                        "method": {"euclidean": "Euclidean", "dbscan": "DBSCAN"}[method],
                        "by": {"grid": "ours", "pcl": "PCL", "sklearn": "scikit-learn"}[by],
                        "clusters": found[0][1],
                        "ms": median([ms for ms, _ in found]),
                        "times": ratio([ms for ms, _ in found], reference),
                    }
                )
    return rows


def _dbscan(xyz_m: np.ndarray, neighbours: int) -> tuple[float, int]:
    """With one neighbour, itself, every point is core: the Euclidean clusters."""
    begin = time.process_time()
    labels = DBSCAN(eps=_TOLERANCE_M, min_samples=neighbours, n_jobs=1).fit(xyz_m).labels_
    return 1e3 * (time.process_time() - begin), int(labels.max()) + 1
