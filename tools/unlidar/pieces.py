"""The parts of trajectories that have no gaps."""

import numpy as np

from unlidar.evaluation import MAX_STEP_S


def pieces_of(time_s: np.ndarray, group: np.ndarray) -> list[np.ndarray]:
    """The rows of lines, in order of time: per group, split at gaps of more than MAX_STEP_S."""
    pieces: list[np.ndarray] = []
    for one in np.unique(group):
        rows = np.flatnonzero(group == one)
        rows = rows[np.argsort(time_s[rows], kind="stable")]
        leaps = np.flatnonzero(np.diff(time_s[rows]) > MAX_STEP_S) + 1
        pieces += np.split(rows, leaps)
    return pieces
