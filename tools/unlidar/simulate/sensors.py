"""LiDAR models: directions and times of rays, and detection probability of hits."""

from dataclasses import dataclass

import numpy as np

from unlidar.simulate.patterns import Pattern, PrismRosette, SpinningRings, TurningMirror


@dataclass(frozen=True)
class SensorModel:
    """Parameters of the data sheet."""

    pattern: Pattern
    rays_per_frame: int
    frame_ns: int
    axes: tuple[tuple[float, ...], ...]  # rows: the sensor's forward, left and up in the station
    range_at_10_percent_m: float  # half of the rays on a surface of 10 % reflectivity return
    divergence_rad: float
    range_noise_m: float = 0.02
    blind_m: float = 0.3


UPRIGHT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_ON_ITS_BACK = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))


def _degrees(low: float, high: float) -> tuple[float, float]:
    return float(np.radians(low)), float(np.radians(high))


def _spinning(beams: int) -> SensorModel:
    return SensorModel(
        pattern=SpinningRings(_degrees(-22.5, 22.5), beams, turn_hz=10.0),
        rays_per_frame=beams * 1024,
        frame_ns=100_000_000,
        axes=UPRIGHT,
        range_at_10_percent_m=90.0,
        divergence_rad=0.003,
    )


MODELS: dict[str, SensorModel] = {
    # Livox Mid-360: all around, -7 to 52 degrees, 200,000 rays a second, 40 m at 10 %.
    "mid360": SensorModel(
        pattern=TurningMirror(_degrees(-7, 52), beams=4, turn_hz=97.3606798, rise_hz=6.1803399),
        rays_per_frame=20_000,
        frame_ns=100_000_000,
        axes=UPRIGHT,
        range_at_10_percent_m=40.0,
        divergence_rad=0.0044,
    ),
    # Livox Avia, lying on its back: 70.4 x 77.2 degrees, 240,000 rays a second, 190 m at 10 %.
    "avia": SensorModel(
        pattern=PrismRosette(*_degrees(35.2, 38.6), beams=6, prism_hz=(121.5691342, -77.7312889)),
        rays_per_frame=24_000,
        frame_ns=100_000_000,
        axes=_ON_ITS_BACK,
        range_at_10_percent_m=190.0,
        divergence_rad=0.0049,
    ),
    # Spinning sensors of 32, 64 and 128 beams as Ouster's OS1: 45 degrees high, 1024 shots a turn,
    # 90 m at 10 %.
    "spinning32": _spinning(32),
    "spinning64": _spinning(64),
    "spinning128": _spinning(128),
}


def scan(
    model: SensorModel, frame: int, phase: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """The rays of a frame: unit directions (N, 3) and times (N,) in ns after its stamp.

    `phase` in [0, 1) says where in its pattern the scan is at frame 0.
    """
    index = np.arange(model.rays_per_frame, dtype=np.int64)
    beams = model.pattern.beams
    time_ns = index // beams * beams * model.frame_ns // model.rays_per_frame
    seconds = (frame * model.frame_ns + time_ns) * 1e-9
    return model.pattern.rays(seconds, index % beams, phase) @ np.array(model.axes), time_ns


def in_field_of_view(model: SensorModel, relative_m: np.ndarray) -> np.ndarray:
    """(N,) bool: positions (N, 3) relative to the sensor that are in its field of view."""
    return model.pattern.holds(relative_m @ np.array(model.axes).T)


def detection_probability(
    model: SensorModel, range_m: np.ndarray, echo: np.ndarray, width_m: np.ndarray
) -> np.ndarray:
    """Share of the hits that give a return, (N,).

    `echo` is reflectivity times cosine of incidence, `width_m` the smallest width of the object:
    a beam wider than it loses the rest. The reach grows with the fourth root of the echo, as the
    data sheets' figures for 10 and 80 % do (40 and 70 m, 190 and 320 m).
    """
    filled = np.minimum(1.0, width_m / (model.divergence_rad * np.maximum(range_m, 1e-9))) ** 2
    reach = model.range_at_10_percent_m * (np.maximum(echo, 1e-9) * filled / 0.1) ** 0.25
    return np.where(range_m < model.blind_m, 0.0, 1.0 / (1.0 + (range_m / reach) ** 8))
