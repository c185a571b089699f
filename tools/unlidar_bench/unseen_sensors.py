"""Sensors that nothing was tuned on: other rings, rates, fields of view and noise.

Not those of any data sheet, but within what data sheets have.
"""

from math import cos, radians, sin

from unlidar.simulate.patterns import PrismRosette, Raster, SpinningRings
from unlidar.simulate.sensors import UPRIGHT, SensorModel

_PRISMS_HZ = (121.57, -77.73)


def _rings(
    low_deg: float,
    high_deg: float,
    beams: int,
    shots: int,
    turn_hz: float = 10.0,
    frame_s: float = 0.1,
    noise_m: float = 0.02,
    range_m: float = 90.0,
) -> SensorModel:
    """Spinning beams with so many shots a frame; `range_m` at 10 % reflectivity."""
    return SensorModel(
        pattern=SpinningRings((radians(low_deg), radians(high_deg)), beams, turn_hz),
        rays_per_frame=beams * shots,
        frame_ns=round(frame_s * 1e9),
        axes=UPRIGHT,
        range_at_10_percent_m=range_m,
        divergence_rad=0.003,
        range_noise_m=noise_m,
    )


def _pitched(up_deg: float) -> tuple[tuple[float, ...], ...]:
    """Axes of a sensor that looks up by so much."""
    c, s = cos(radians(up_deg)), sin(radians(up_deg))
    return ((c, 0.0, s), (0.0, 1.0, 0.0), (-s, 0.0, c))


UNSEEN: dict[str, SensorModel] = {
    "rings16": _rings(-15, 15, 16, 1800, noise_m=0.03, range_m=70),
    "rings16_fast": _rings(-15, 15, 16, 900, turn_hz=20, frame_s=0.05, noise_m=0.03, range_m=70),
    "rings32_down": _rings(-30.67, 10.67, 32, 1080, range_m=80),
    "rings32_up": _rings(-10, 50, 32, 1024, range_m=60),
    "rings32_noisy": _rings(-22, 22, 32, 1024, noise_m=0.05),
    "rings32_half": _rings(-22, 22, 32, 512, frame_s=0.05),  # a frame is half a turn
    "rings32_slow": _rings(-25, 15, 32, 1800, turn_hz=10 / 3, frame_s=0.3, range_m=80),
    "rings40_once": _rings(-22, 22, 40, 2400, turn_hz=1, frame_s=1.0),
    "rings64_narrow": _rings(-7, 7, 64, 1024, range_m=100),
    "rosette_ahead": SensorModel(
        PrismRosette(radians(10), radians(12.5), 6, _PRISMS_HZ), 24_000, 100_000_000, UPRIGHT,
        range_at_10_percent_m=150.0, divergence_rad=0.004,
    ),
    "rosette_up": SensorModel(
        PrismRosette(radians(16), radians(19), 6, _PRISMS_HZ), 10_002, 100_000_000, _pitched(22),
        range_at_10_percent_m=150.0, divergence_rad=0.004,
    ),
    "flash": SensorModel(
        Raster(radians(15), radians(12.5), 160, 120), 19_200, 66_666_667, _pitched(10),
        range_at_10_percent_m=25.0, divergence_rad=0.004, range_noise_m=0.015,
    ),
}  # fmt: skip
