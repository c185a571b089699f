"""Targets to explain: the drones of the truth, or a place given by the user."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from unlidar.evaluation.association import interpolate
from unlidar.mounting import Mounting
from unlidar.truth import Truth

MOST_GAP_S = 1.0  # of the truth, over which it is interpolated
# Radius within which returns, detections and rows belong to a target: exceeds the drone's size plus
# the errors of truth and pose, which grow with range.
NEAR_M, NEAR_SLOPE = 1.0, 0.02


@dataclass(frozen=True)
class Target:
    """A target to explain."""

    name: str
    places_at: Callable[[np.ndarray], np.ndarray]  # (N,) Unix s -> (N, 3) m, NaN where not known
    times_s: np.ndarray  # (N,) at which it is known; empty: always


@dataclass(frozen=True)
class Reach:
    """The association radius, by range from the LiDARs."""

    mountings: Sequence[Mounting]
    radius_m: float | None  # None: by range

    def ranges_m(self, places_m: np.ndarray, time_ns: np.ndarray) -> np.ndarray:
        """(N,) from the nearest LiDAR at these times."""
        away_m = [places_m - mounting.viewpoints_m(time_ns) for mounting in self.mountings]
        return np.linalg.norm(away_m, axis=2).min(axis=0)

    def radii_m(self, places_m: np.ndarray, time_ns: np.ndarray) -> np.ndarray:
        """(N,) association radii at these positions, (N, 3), and times."""
        if self.radius_m is not None:
            return np.full(len(places_m), self.radius_m)
        return NEAR_M + NEAR_SLOPE * self.ranges_m(places_m, time_ns)


def named_place(xyz_m: tuple[float, float, float]) -> Target:
    """A place that does not move."""
    place_m = np.array(xyz_m)
    text = ", ".join(f"{value:g}" for value in xyz_m)
    return Target(f"place {text}", lambda time_s: np.tile(place_m, (len(time_s), 1)), np.zeros(0))


def targets_of(truth: Truth) -> list[Target]:
    """Each drone of the truth, known between rows in view at most `MOST_GAP_S` apart."""
    return [_of_truth(truth, number) for number in np.unique(truth.target)]


def _of_truth(truth: Truth, number: float) -> Target:
    rows = np.flatnonzero(truth.target == number)
    rows = rows[np.argsort(truth.time_s[rows], kind="stable")]
    own_s, xyz_m, in_view = truth.time_s[rows], truth.xyz_m[rows], truth.in_view[rows]

    def places_at(time_s: np.ndarray) -> np.ndarray:
        after = np.clip(np.searchsorted(own_s, time_s), 1, max(1, len(own_s) - 1))
        after = np.minimum(after, len(own_s) - 1)
        before = np.maximum(after - 1, 0)
        known = (time_s >= own_s[before]) & (time_s <= own_s[after])
        known &= (own_s[after] - own_s[before] <= MOST_GAP_S) & in_view[before] & in_view[after]
        return np.where(known[:, None], interpolate(own_s, xyz_m, time_s), np.nan)

    return Target(f"drone {number:g}", places_at, own_s[in_view])
