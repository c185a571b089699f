"""Association of tracks with targets over time, and their distances."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from unlidar.completion import interpolate
from unlidar.truth import Tracks, Truth

MAX_STEP_S = 0.6  # tracks and truth are interpolated between samples at most this far apart
_END_SLACK_S = 0.051  # a track extends half a frame beyond its first and last row
FALSE_BEYOND_M = 2.0


@dataclass(frozen=True)
class Coverage:
    """The associated track at every row of the truth; inf and NaN without one."""

    distance_m: np.ndarray  # (N,)
    error_m: np.ndarray  # (N, 3) estimate minus truth
    sigma_m: np.ndarray  # (N, 3) of the estimate, NaN where not known

    def rows(self, chosen: np.ndarray) -> "Coverage":
        """A subset of the rows."""
        return Coverage(self.distance_m[chosen], self.error_m[chosen], self.sigma_m[chosen])

    def take(self, rows: np.ndarray, other: "Coverage") -> None:
        """Overwrites rows by those of another."""
        for mine, theirs in (
            (self.distance_m, other.distance_m),
            (self.error_m, other.error_m),
            (self.sigma_m, other.sigma_m),
        ):
            mine[rows] = theirs[rows]


@dataclass(frozen=True)
class OwnRows:
    """The nearest target at every row of the tracks."""

    distance_m: np.ndarray  # (M,) truth extrapolated as constant
    judged_m: np.ndarray  # (M,) inf outside the truth's time span
    error_m: np.ndarray  # (M, 3) of the judged rows, else NaN


@dataclass(frozen=True)
class Identities:
    """One-to-one matches of targets and tracks within FALSE_BEYOND_M."""

    own: Coverage  # (N,) the track matched to the target; none where it is not in view
    switches: int


def cover(truth: Truth, tracks: Tracks) -> Coverage:
    """The nearest track at every row of the truth; one track may serve several targets."""
    nearest = _nowhere(len(truth))
    for at in _tracks_at(truth.time_s, tracks):
        one = _coverage(truth, tracks, *at)
        nearest.take(one.distance_m < nearest.distance_m, one)
    return nearest


def own_rows(truth: Truth, tracks: Tracks) -> OwnRows:
    """The nearest target at every row of the tracks."""
    distance, judged = np.full((2, len(tracks)), np.inf)
    judged_error = np.full((len(tracks), 3), np.nan)
    for target in np.unique(truth.target):
        chosen = truth.target == target
        at = interpolate(truth.time_s[chosen], truth.xyz_m[chosen], tracks.time_s)
        error = tracks.xyz_m - at
        away = np.linalg.norm(error, axis=1)
        distance = np.minimum(distance, away)
        inside = _inside(np.sort(truth.time_s[chosen]), tracks.time_s)
        nearer = inside & (away < judged)
        judged[nearer], judged_error[nearer] = away[nearer], error[nearer]
    return OwnRows(distance, judged, judged_error)


def identities(truth: Truth, tracks: Tracks) -> Identities:
    """Matches stamp by stamp as in CLEAR MOT (Bernardin and Stiefelhagen 2008).

    A match is kept while the track is within FALSE_BEYOND_M; the rest is assigned anew with the
    least sum of distances. A target matched to another track than its last one, also after a
    pause, is an identity switch.
    """
    known = [_coverage(truth, tracks, *at) for at in _tracks_at(truth.time_s, tracks)]
    away = np.full((len(truth), len(known)), np.inf)
    for column, one in enumerate(known):
        near = one.distance_m <= FALSE_BEYOND_M
        away[near, column] = one.distance_m[near]
    own = np.full(len(truth), -1)
    switches = 0
    last: dict[float, int] = {}  # track of each target
    holder: dict[int, float] = {}  # target of each track
    order = np.flatnonzero(truth.in_view)
    order = order[np.argsort(truth.time_s[order], kind="stable")]
    for rows in np.split(order, np.flatnonzero(np.diff(truth.time_s[order])) + 1):
        had = [last.get(target) for target in truth.target[rows]]
        kept = [
            k if holder.get(k) == t else None for k, t in zip(had, truth.target[rows], strict=True)
        ]
        pairs = _match(away[rows], kept)
        for i, track in pairs.items():
            target = truth.target[rows[i]]
            switches += last.setdefault(target, track) != track
            last[target], holder[track] = track, target
            own[rows[i]] = track
    chosen = _nowhere(len(truth))
    for column, one in enumerate(known):
        chosen.take(own == column, one)
    return Identities(chosen, switches)


def _match(away: np.ndarray, kept: list[int | None]) -> dict[int, int]:
    pairs = {
        i: track
        for i, track in enumerate(kept)
        if track is not None and np.isfinite(away[i, track])
    }
    rows = [i for i in range(len(away)) if i not in pairs]
    columns = [k for k in range(away.shape[1]) if k not in pairs.values()]
    left = away[np.ix_(rows, columns)]
    if not np.isfinite(left).any():
        return pairs
    # Exceeds any sum of valid costs, so that the number of matches is maximal.
    cost = np.where(np.isfinite(left), left, 10.0 * FALSE_BEYOND_M * (1 + left.size))
    for i, k in zip(*linear_sum_assignment(cost), strict=True):
        if np.isfinite(left[i, k]):
            pairs[rows[i]] = columns[k]
    return pairs


def _nowhere(rows: int) -> Coverage:
    error_m, sigma_m = np.full((2, rows, 3), np.nan)
    return Coverage(np.full(rows, np.inf), error_m, sigma_m)


def _coverage(
    truth: Truth, tracks: Tracks, rows: np.ndarray, valid: np.ndarray, at_m: np.ndarray
) -> Coverage:
    """The coverage of the truth by one track of `_tracks_at`."""
    one = _nowhere(len(truth))
    one.error_m[valid] = (at_m - truth.xyz_m)[valid]
    one.distance_m[valid] = np.linalg.norm(one.error_m[valid], axis=1)
    if tracks.sigma_m is not None:
        known_s, known_m = tracks.time_s[rows], tracks.sigma_m[rows]
        one.sigma_m[valid] = interpolate(known_s, known_m, truth.time_s[valid])
    return one


def _tracks_at(time_s: np.ndarray, tracks: Tracks):
    """Per track: its rows by time, (N,) bool where it is defined, (N, 3) positions then."""
    for track in np.unique(tracks.track_id):
        rows = np.flatnonzero(tracks.track_id == track)
        rows = rows[np.argsort(tracks.time_s[rows], kind="stable")]
        own_s = tracks.time_s[rows]
        valid = np.zeros(len(time_s), dtype=bool)
        if len(rows) >= 2:
            after = np.clip(np.searchsorted(own_s, time_s), 1, len(rows) - 1)
            valid = (
                (time_s >= own_s[0] - _END_SLACK_S)
                & (time_s <= own_s[-1] + _END_SLACK_S)
                & (own_s[after] - own_s[after - 1] <= MAX_STEP_S)
            )
        yield rows, valid, interpolate(own_s, tracks.xyz_m[rows], time_s)


def _inside(samples_s: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """(N,) bool: the times between two samples at most MAX_STEP_S apart."""
    if len(samples_s) < 2:
        return np.isin(time_s, samples_s)
    after = np.clip(np.searchsorted(samples_s, time_s), 1, len(samples_s) - 1)
    spanned = (time_s >= samples_s[0]) & (time_s <= samples_s[-1])
    return spanned & (samples_s[after] - samples_s[after - 1] <= MAX_STEP_S)
