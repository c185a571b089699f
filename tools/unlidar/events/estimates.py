"""Position estimates with covariance, and their fusion.

The correlation of the errors is unknown (common wind, common survey), so positions are fused by
covariance intersection (Julier and Uhlmann, 1997), which is consistent for any correlation.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from heapq import nsmallest

import numpy as np

_ACCELERATION_MPS2 = 3.0  # 1-sigma process noise of a drone between rows
_FASTEST_MPS = 100.0  # faster displacement is a jump
_JITTER_M = 10.0
_LEAST_RATIO = 1e-12  # of information; estimates below it are ignored
_MOST = 8  # estimates fused at most


@dataclass(frozen=True)
class Estimate:
    """Position and velocity of a track at an instant."""

    stamp_ns: int
    xyz_m: np.ndarray  # (3,)
    velocity_mps: np.ndarray  # (3,)
    covariance_m2: np.ndarray  # (3, 3) of the position


def jumps(before: Estimate, now: Estimate) -> bool:
    """True if the displacement exceeds a drone's speed and both uncertainties."""
    passed_s = abs(now.stamp_ns - before.stamp_ns) * 1e-9
    moved_m = float(np.linalg.norm(now.xyz_m - before.xyz_m))
    sigma_m = math.sqrt(float(np.trace(before.covariance_m2 + now.covariance_m2)))
    return moved_m > _FASTEST_MPS * passed_s + _JITTER_M + 4 * sigma_m


def at(estimate: Estimate, stamp_ns: int) -> Estimate:
    """Predicted with constant velocity; the covariance grows by the acceleration noise."""
    passed_s = (stamp_ns - estimate.stamp_ns) * 1e-9
    sigma_m = 0.5 * _ACCELERATION_MPS2 * passed_s**2
    return Estimate(
        stamp_ns,
        estimate.xyz_m + passed_s * estimate.velocity_mps,
        estimate.velocity_mps,
        estimate.covariance_m2 + sigma_m**2 * np.eye(3),
    )


def covariance_intersection(
    one_m: np.ndarray, one_m2: np.ndarray, two_m: np.ndarray, two_m2: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Position, covariance, and the weight w of the first that minimises the determinant.

    P^-1 = w P1^-1 + (1 - w) P2^-1, P^-1 x = w P1^-1 x1 + (1 - w) P2^-1 x2.
    """
    first, second = np.linalg.inv(one_m2), np.linalg.inv(two_m2)
    share = _share(np.linalg.eigvals(np.linalg.solve(second, first)).real.tolist())
    covariance = np.linalg.inv(share * first + (1 - share) * second)
    position = covariance @ (share * first @ one_m + (1 - share) * second @ two_m)
    return position, covariance, share


def _share(ratios: list[float]) -> float:
    """The w in [0, 1] that maximises the product of 1 - w + w * ratio.

    The logarithm is concave, so bisection on its slope converges.
    """
    excess = [max(ratio, _LEAST_RATIO) - 1 for ratio in ratios]

    def slope(share: float) -> float:
        return sum(value / (1 + share * value) for value in excess)

    low, high = 0.0, 1.0
    if slope(low) <= 0:
        return low
    if slope(high) >= 0:
        return high
    while high - low > 1e-6:
        middle = (low + high) / 2
        low, high = (middle, high) if slope(middle) > 0 else (low, middle)
    return low


def together(estimates: Iterable[Estimate]) -> Estimate:
    """Fuses all at the newest instant; of more than _MOST the most certain ones."""
    known = list(estimates)
    stamp_ns = max(estimate.stamp_ns for estimate in known)
    known = [at(estimate, stamp_ns) for estimate in known]
    if len(known) > _MOST:
        known = nsmallest(
            _MOST, known, key=lambda estimate: float(np.trace(estimate.covariance_m2))
        )
    result, *others = known
    for other in others:
        position, covariance, share = covariance_intersection(
            result.xyz_m, result.covariance_m2, other.xyz_m, other.covariance_m2
        )
        velocity = share * result.velocity_mps + (1 - share) * other.velocity_mps
        result = Estimate(stamp_ns, position, velocity, covariance)
    return result
