"""Optional removal of errors that are not the tracker's: lever arms, mountings, clocks."""

import dataclasses
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from unlidar.errors import InputError
from unlidar.evaluation.association import Coverage, cover
from unlidar.truth import Tracks, Truth

MAX_OFFSET_S = 1.0
_COARSE_STEP_S = 0.02
_MOST_ROUNDS = 20
# Time offsets must keep at least this share of the best coverage.
_COVERED_SHARE = 0.8
_VAGUE_S = 0.1
_ALIKE_S = 1.0
_MOST_STAMPS = 5000


@dataclass(frozen=True)
class Alignment:
    """The transform p -> rotation @ p + translation_m of the tracks."""

    rotation: np.ndarray  # (3, 3)
    translation_m: np.ndarray  # (3,)

    def apply(self, tracks: Tracks) -> Tracks:
        """The transformed tracks; sigmas keep their axes."""
        return dataclasses.replace(
            tracks, xyz_m=tracks.xyz_m @ self.rotation.T + self.translation_m
        )


IDENTITY = Alignment(np.eye(3), np.zeros(3))


def fit_alignment(kind: str, from_m: np.ndarray, to_m: np.ndarray) -> Alignment:
    """The least-squares rigid motion of (N, 3) points onto their partners, without scale.

    "translation": the mean difference. "yaw": also a turn about z, the 4 degrees of freedom that
    a level station leaves open. "se3": any rotation, as in Umeyama 1991. InputError if the
    points do not determine the rotation: coincident, or for se3 collinear.
    """
    if kind == "none" or len(from_m) == 0:
        return IDENTITY
    centre, goal = from_m.mean(axis=0), to_m.mean(axis=0)
    rotation = np.eye(3)
    if kind != "translation":
        rotation = (_yaw if kind == "yaw" else _umeyama)(from_m - centre, to_m - goal)
    return Alignment(rotation, goal - rotation @ centre)


def align(kind: str, truth: Truth, tracks: Tracks) -> Alignment:
    """The alignment over the covered in-view truth; the nearest track is found anew each round."""
    found, chosen = IDENTITY, None
    for _ in range(_MOST_ROUNDS):
        nearest = cover(truth, found.apply(tracks))
        covered = truth.in_view & np.isfinite(nearest.distance_m)
        moved = (truth.xyz_m + nearest.error_m)[covered]
        from_m = (moved - found.translation_m) @ found.rotation
        # Within rounding (a micrometre) the association has converged.
        if (
            chosen is not None
            and np.array_equal(chosen[0], covered)
            and np.allclose(chosen[1], from_m, rtol=0, atol=1e-6)
        ):
            break
        found, chosen = fit_alignment(kind, from_m, truth.xyz_m[covered]), (covered, from_m)
    return found


def shift(tracks: Tracks, offset_s: float) -> Tracks:
    """The tracks with `offset_s` added to their stamps."""
    return dataclasses.replace(tracks, time_s=tracks.time_s + offset_s, stamp_ns=None)


def estimate_time_offset(kind: str, truth: Truth, tracks: Tracks) -> tuple[float, float]:
    """The offset to add to the tracks' stamps for the best fit to the truth, and its sigma, in s.

    Minimises the mean squared error about its mean (or after the alignment), as a lever arm would
    otherwise look like a delay, within MAX_OFFSET_S. InputError if the offset is not observable:
    no coverage, no minimum inside the range, or sigma above _VAGUE_S, as for a target that hovers
    or flies at constant velocity.
    """
    truth = _thinned(truth)
    turned = kind if kind in ("yaw", "se3") else "translation"
    tried = np.arange(-MAX_OFFSET_S, MAX_OFFSET_S + _COARSE_STEP_S / 2, _COARSE_STEP_S)
    cost, counts = np.array([_misfit(turned, truth, tracks, offset) for offset in tried]).T
    if counts.max() < 3:
        raise InputError("--time-offset auto: fewer than 3 stamps of the truth are covered")
    cost[counts < _COVERED_SHARE * counts.max()] = np.inf
    best = int(np.argmin(cost))
    sigma_s = _offset_sigma_s(truth, cost[best])
    if sigma_s > _VAGUE_S:
        raise InputError(
            f"--time-offset auto: the flight tells the offset only to {sigma_s:.2g} s, the target "
            "hovers or keeps its velocity; give it in seconds"
        )
    if best in (0, len(tried) - 1) or not np.isfinite(cost[[best - 1, best + 1]]).all():
        raise InputError(
            f"--time-offset auto: no best offset within {MAX_OFFSET_S:g} s, give it in seconds"
        )
    refined = minimize_scalar(
        lambda offset: _misfit(turned, truth, tracks, offset)[0],
        bounds=(tried[best - 1], tried[best + 1]),
        method="bounded",
        options={"xatol": 1e-6},
    )
    return float(refined.x), sigma_s


def _thinned(truth: Truth) -> Truth:
    """A subset of the stamps: beyond some thousand the search gets slower, not more precise."""
    stamps, rank = np.unique(truth.time_s, return_inverse=True)
    kept = rank % -(-len(stamps) // _MOST_STAMPS) == 0
    return Truth(truth.time_s[kept], truth.target[kept], truth.xyz_m[kept], truth.in_view[kept])


def _offset_sigma_s(truth: Truth, squared_m2: float) -> float:
    """Standard deviation of the offset: sigma of the error over the spread of the velocity.

    A constant velocity only shifts the mean error, which is removed. Errors within _ALIKE_S of
    each other count as one.
    """
    changes = []
    for target in np.unique(truth.target):
        rows = np.flatnonzero(truth.in_view & (truth.target == target))
        rows = rows[np.diff(truth.time_s[rows], prepend=-np.inf) > 0]
        if len(rows) >= 2:
            changes.append(np.gradient(truth.xyz_m[rows], truth.time_s[rows], axis=0))
    if not changes:
        return np.inf
    velocity = np.concatenate(changes)
    change = np.mean(((velocity - velocity.mean(axis=0)) ** 2).sum(axis=1))
    independent = max(1.0, np.ptp(truth.time_s) / _ALIKE_S)
    with np.errstate(divide="ignore"):
        return float(np.sqrt(np.divide(max(squared_m2, 1e-12) / 3, change * independent)))


def _misfit(kind: str, truth: Truth, tracks: Tracks, offset_s: float) -> tuple[float, int]:
    """Mean squared residual after the best alignment, and the number of stamps in it."""
    nearest: Coverage = cover(truth, shift(tracks, offset_s))
    covered = truth.in_view & np.isfinite(nearest.distance_m)
    if not covered.any():
        return np.inf, 0
    to_m = truth.xyz_m[covered]
    from_m = to_m + nearest.error_m[covered]
    found = fit_alignment(kind, from_m, to_m)
    residual = from_m @ found.rotation.T + found.translation_m - to_m
    return float((residual**2).sum(axis=1).mean()), int(covered.sum())


def _yaw(from_m: np.ndarray, to_m: np.ndarray) -> np.ndarray:
    """Maximises sum(to . R from) over turns about z, both centred: a tangent of two sums."""
    sine = (from_m[:, 0] * to_m[:, 1] - from_m[:, 1] * to_m[:, 0]).sum()
    cosine = (from_m[:, :2] * to_m[:, :2]).sum()
    extent = np.sqrt((from_m[:, :2] ** 2).sum() * (to_m[:, :2] ** 2).sum())
    if np.hypot(sine, cosine) <= 1e-9 * max(extent, 1e-9):
        raise InputError("--align yaw: the target does not move sideways, no turn can be found")
    length = np.hypot(sine, cosine)
    c, s = cosine / length, sine / length
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _umeyama(from_m: np.ndarray, to_m: np.ndarray) -> np.ndarray:
    """Umeyama 1991, equations 40 and 43 with c = 1; both sets centred."""
    u, values, vt = np.linalg.svd(to_m.T @ from_m / len(from_m))
    if values[1] <= 1e-9 * max(values[0], 1e-9):
        raise InputError("--align se3: the target moves on a line, its rotation cannot be found")
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    return u @ sign @ vt
