"""The way of the carrier of moving LiDARs: gimbal, mast, vehicle or drone."""

import numpy as np
from scipy.spatial.transform import Rotation

from unlidar.poses import Poses
from unlidar.simulate.scenario import Carrier
from unlidar.stamps import NS_PER_S

_MARGIN_S = 0.5  # poses begin before the first ray and end after the last
# Shares of the reach and frequencies of two waves, whose sum never exceeds the reach.
_DRIFT = ((0.75, 0.06), (0.25, 0.27))  # Hz
# About two axes, one across the other; together never more than the reach.
_SWAY = ((0.9, 1.0), (0.4, 1.3))  # the frequencies as multiples of the main one


class Motion:
    """Continuous poses of a carrier; the phases of its waves are random."""

    def __init__(self, carrier: Carrier, rng: np.random.Generator) -> None:
        self._carrier = carrier
        self._drift_phases = rng.uniform(0, 2 * np.pi, (3, len(_DRIFT)))
        self._sway_phases = rng.uniform(0, 2 * np.pi, len(_SWAY))
        heading = rng.uniform(0, 2 * np.pi)
        forward = np.array([np.cos(heading), np.sin(heading), 0.0])
        self._sway_axes = np.array([forward, [-forward[1], forward[0], 0.0]])

    def at(self, time_s: np.ndarray) -> tuple[np.ndarray, Rotation]:
        """Positions (N, 3) and rotations in the world at times (N,) after the begin."""
        c = self._carrier
        turns = np.outer(time_s, 2 * np.pi * c.sway_hz * np.array([hz for _, hz in _SWAY]))
        reach = np.radians(c.sway_deg) * np.array([share for share, _ in _SWAY])
        tilt = Rotation.from_rotvec((reach * np.sin(turns + self._sway_phases)) @ self._sway_axes)
        upright = np.zeros((len(time_s), 3))
        upright[:, 2] = np.radians(c.pan_dps) * time_s
        mast = np.array([0.0, 0.0, c.mast_m])
        position = np.array(c.start_m) + np.outer(time_s, c.velocity_mps)
        position = position + self._drift(time_s) + tilt.apply(mast) - mast
        return position, tilt * Rotation.from_rotvec(upright)

    def _drift(self, time_s: np.ndarray) -> np.ndarray:
        drift = np.zeros((len(time_s), 3))
        for number, (share, hz) in enumerate(_DRIFT):
            angle = 2 * np.pi * hz * time_s[:, None] + self._drift_phases[:, number]
            drift += self._carrier.drift_m * share * np.sin(angle)
        return drift


def exact_poses(motion: Motion, rate_hz: float, begin_ns: int, duration_s: float) -> Poses:
    """Poses over a recording that begins at `begin_ns`, and a little before and after it."""
    steps = np.arange(int(-_MARGIN_S * rate_hz), int((duration_s + _MARGIN_S) * rate_hz) + 1)
    offsets_ns = np.rint(steps * (NS_PER_S / rate_hz)).astype(np.int64)
    return Poses(begin_ns + offsets_ns, *motion.at(offsets_ns * 1e-9))


def noisy(poses: Poses, carrier: Carrier, rng: np.random.Generator) -> Poses:
    """The poses as they are measured, each with an error of its own along and about each axis."""
    shape = poses.position_m.shape
    shifted = poses.position_m + rng.normal(0, carrier.pose_noise_m, shape)
    turned = Rotation.from_rotvec(rng.normal(0, np.radians(carrier.pose_noise_deg), shape))
    return Poses(poses.stamp_ns, shifted, poses.rotation * turned)
