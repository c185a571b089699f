"""One position for every stamp, as the UG2+ challenge asks for: tracks joined, gaps bridged."""

import numpy as np

from unlidar.truth import Tracks


def complete(tracks: Tracks, time_s: np.ndarray) -> np.ndarray:
    """(N, 3) the position at each time; NaN throughout where there is no track at all.

    Positions within a track are interpolated linearly; of simultaneous tracks the one with the
    most returns (rows, if returns are unknown) is taken. Gaps between tracks are bridged
    linearly; before the first and after the last row the position is held.
    """
    position = np.full((len(time_s), 3), np.nan)
    if len(tracks) == 0:
        return position
    best = np.full(len(time_s), -np.inf)
    before, after = np.full(len(time_s), -np.inf), np.full(len(time_s), np.inf)
    end, begin = np.full((len(time_s), 3), np.nan), np.full((len(time_s), 3), np.nan)
    for track in np.unique(tracks.track_id):
        rows = np.flatnonzero(tracks.track_id == track)
        rows = rows[np.argsort(tracks.time_s[rows], kind="stable")]
        own_s, xyz_m = tracks.time_s[rows], tracks.xyz_m[rows]
        weight = float(len(rows) if tracks.support is None else tracks.support[rows].sum())
        better = (time_s >= own_s[0]) & (time_s <= own_s[-1]) & (weight > best)
        best[better] = weight
        position[better] = interpolate(own_s, xyz_m, time_s[better])
        nearer = (own_s[-1] < time_s) & (own_s[-1] > before)
        before[nearer], end[nearer] = own_s[-1], xyz_m[-1]
        nearer = (own_s[0] > time_s) & (own_s[0] < after)
        after[nearer], begin[nearer] = own_s[0], xyz_m[0]
    position[np.isinf(best)] = _bridge(before, end, after, begin, time_s)[np.isinf(best)]
    return position


def interpolate(own_s: np.ndarray, xyz_m: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """(N, 3) columns of `xyz_m` at `time_s`, linear between the ascending `own_s`, ends held."""
    return np.stack([np.interp(time_s, own_s, xyz_m[:, i]) for i in range(3)], axis=1)


def _bridge(
    before: np.ndarray, end: np.ndarray, after: np.ndarray, begin: np.ndarray, time_s: np.ndarray
) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        share = ((time_s - before) / (after - before))[:, None]
        line = end + share * (begin - end)
    return np.where(np.isinf(before)[:, None], begin, np.where(np.isinf(after)[:, None], end, line))
