"""DBSCAN labels of the C++ clustering against scikit-learn, label for label."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

DBSCAN = pytest.importorskip("sklearn.cluster").DBSCAN

PROJECT = Path(__file__).resolve().parent.parent
FRAMES = PROJECT.parent / "shared/data/mmaud/val/seq0001/lidar_360"


def find_program() -> Path | None:
    """The test-only executable, from UNLIDAR_BUILD_DIR or a build folder of the checkout."""
    configured = os.environ.get("UNLIDAR_BUILD_DIR")
    folders = [Path(configured)] if configured else sorted(PROJECT.glob("build*"))
    for folder in folders:
        for path in sorted(folder.rglob("cluster_labels")):
            if path.is_file() and os.access(path, os.X_OK):
                return path
    return None


PROGRAM = find_program()
pytestmark = pytest.mark.skipif(PROGRAM is None, reason="cluster_labels is not built")


def labels_of(points: np.ndarray, engine: str, eps: float, min_samples: int) -> np.ndarray:
    text = "".join(f"{x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in points)  # 9 digits keep a float
    done = subprocess.run(
        [str(PROGRAM), "dbscan", engine, repr(eps), str(min_samples), "1"],
        input=text,
        capture_output=True,
        text=True,
        check=True,
    )
    return np.array(done.stdout.split(), dtype=int)


def expect_scikit_learn_labels(points: np.ndarray, eps: float, min_samples: int) -> None:
    points = points.astype(np.float32)
    expected = DBSCAN(eps=eps, min_samples=min_samples).fit_predict(points.astype(np.float64))
    for engine in ("grid", "pcl"):
        labels = labels_of(points, engine, eps, min_samples)
        np.testing.assert_array_equal(labels, expected, err_msg=engine)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("min_samples", [1, 4, 10])
def test_random_clouds_get_the_labels_of_scikit_learn(seed: int, min_samples: int) -> None:
    rng = np.random.default_rng(seed)
    blobs = rng.normal(rng.uniform(-6, 6, (12, 1, 3)), 0.5, (12, 60, 3)).reshape(-1, 3)
    strays = rng.uniform(-20, 20, (150, 3))
    expect_scikit_learn_labels(rng.permutation(np.concatenate([blobs, strays])), 0.6, min_samples)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("min_samples", [2, 4, 7])
def test_points_exactly_eps_apart_are_neighbours(seed: int, min_samples: int) -> None:
    rng = np.random.default_rng(seed)
    lattice = rng.integers(0, 12, (900, 3)) * 0.5  # many border points between clusters
    expect_scikit_learn_labels(lattice, 0.5, min_samples)


def test_a_real_frame_gets_the_labels_of_scikit_learn() -> None:
    paths = sorted(FRAMES.glob("*.npy"))
    if not paths:
        pytest.skip("no real recording beside the project")
    for path in paths[::40]:
        rows = np.load(path)
        expect_scikit_learn_labels(rows[np.any(rows != 0, axis=1)], 0.5, 5)
