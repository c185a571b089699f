"""Returns from particles in the air or dirt on the window, and the attenuation they cause.

Range distributions of such returns. Published findings are quoted; the distributions are chosen
to resemble them.

- sun: noise of the receiver, which fires as soon anywhere on the way that is listened to. Even in
  range and direction.
- rain: as often from 1 to 2 m as from 10 to 20 m.
- fog: the soft echo of a ray falls with r^-2 exp(-2 a r), a = 3 / visibility, so that returns crowd
  about the sensor (Rasshofer, Spies and Spies, "Influences of weather phenomena on automotive laser
  radar systems", 2011; Bijelic, Gruber and Ritter, "A benchmark for lidar sensors in fog", 2018;
  Hahner et al., "Fog simulation on real LiDAR point clouds", 2021). Gamma distributed, shape 2, the
  mean a tenth of the visibility. Hard echoes lose exp(-2 a r).
- snow: single flakes, most of them within some 15 m (Charron, Phillips and Waslander, "De-noising
  of lidar point clouds corrupted by snowfall", 2018; Hahner et al., "LiDAR snowfall simulation for
  robust 3D object detection", 2022). Gamma distributed, shape 3, mean 8 m, none beyond 30 m.
- window: dirt or water in patches. A patch returns from within a metre, and lets little through.
"""

from collections.abc import Callable

import numpy as np

from unlidar.simulate.scenario import Fog, Scene, Sensor
from unlidar.simulate.sensors import SensorModel

_RAIN_RANGE_M = (1.0, 25.0)
_FOG_SHAPE, _FOG_MEAN = 2.0, 0.1  # the latter as a share of the visibility
_SNOW_SHAPE, _SNOW_MEAN_M, _SNOW_REACH_M = 3.0, 8.0, 30.0
_EXTINCTION = 3.0  # times visibility: 5 % of the contrast is left there (Koschmieder)
_WINDOW_DEPTH_M = 0.3  # mean, beyond the blind zone
_PATCH_WAVES = 24
_PATCH_RAD = 0.25  # how far apart patches lie
_PATCH_TRANSMISSION = 0.02  # both ways

# Function: free paths of rays (N,) -> ranges of their early returns.
Draw = Callable[[np.random.Generator, np.ndarray], np.ndarray]


def stray_kinds(scene: Scene, sensor: Sensor, model: SensorModel) -> list[tuple[float, Draw, bool]]:
    """Mean number a frame, ranges, and whether they come through the dirty part of the window."""

    def sun(rng: np.random.Generator, free_m: np.ndarray) -> np.ndarray:
        reach = np.minimum(free_m, 2 * model.range_at_10_percent_m)
        return np.maximum(model.blind_m, reach * rng.random(len(free_m)))

    def rain(rng: np.random.Generator, free_m: np.ndarray) -> np.ndarray:
        return np.exp(rng.uniform(*np.log(_RAIN_RANGE_M), len(free_m)))

    def fog(rng: np.random.Generator, free_m: np.ndarray) -> np.ndarray:
        mean = _FOG_MEAN * scene.fog.visibility_m if scene.fog else 0.0
        return model.blind_m + rng.gamma(_FOG_SHAPE, mean / _FOG_SHAPE, len(free_m))

    def snow(rng: np.random.Generator, free_m: np.ndarray) -> np.ndarray:
        at = rng.gamma(_SNOW_SHAPE, _SNOW_MEAN_M / _SNOW_SHAPE, len(free_m))
        return np.where(at < _SNOW_REACH_M, np.maximum(at, model.blind_m), np.inf)

    def window(rng: np.random.Generator, free_m: np.ndarray) -> np.ndarray:
        return model.blind_m + rng.exponential(_WINDOW_DEPTH_M, len(free_m))

    return [
        (sensor.stray_returns, sun, False),
        (scene.rain_returns, rain, False),
        (scene.fog.returns if scene.fog else 0.0, fog, False),
        (scene.snow_returns, snow, False),
        (sensor.window_returns, window, True),
    ]


def fog_transmission(fog: Fog | None, range_m: np.ndarray) -> np.ndarray | float:
    """(N,) two-way transmission of fog at a range."""
    return 1.0 if fog is None else np.exp(-2 * _EXTINCTION * range_m / fog.visibility_m)


class Window:
    """A sensor's window with dirt in patches, which stay where they are."""

    def __init__(self, dirty_share: float, rng: np.random.Generator) -> None:
        self._waves = rng.normal(size=(3, _PATCH_WAVES)) / _PATCH_RAD
        self._phases = rng.uniform(0, 2 * np.pi, _PATCH_WAVES)
        everywhere = rng.normal(size=(4096, 3))
        everywhere /= np.linalg.norm(everywhere, axis=1)[:, None]
        self._least = np.quantile(self._thickness(everywhere), 1 - dirty_share)
        self._is_clean = dirty_share == 0

    def is_dirty(self, direction: np.ndarray) -> np.ndarray:
        """(N,) bool: unit rays (N, 3) that pass through a patch."""
        if self._is_clean:
            return np.zeros(len(direction), dtype=bool)
        return self._thickness(direction) >= self._least

    @staticmethod
    def transmission(is_dirty: np.ndarray) -> np.ndarray:
        """(N,) two-way transmission of rays, by passage through a patch."""
        return np.where(is_dirty, _PATCH_TRANSMISSION, 1.0)

    def _thickness(self, direction: np.ndarray) -> np.ndarray:
        return np.cos(direction @ self._waves + self._phases).sum(axis=1)
