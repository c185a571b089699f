"""Weather in recorded frames: what the simulator's models of it add, replace and take away."""

import argparse
import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree
from unlidar.errors import InputError
from unlidar.frames_io import is_return, positions_of, read_pcd
from unlidar.simulate.scenario import Fog, Scene, Sensor
from unlidar.simulate.sensors import (
    MODELS,
    SensorModel,
    detection_probability,
    in_field_of_view,
    scan,
)
from unlidar.simulate.weather import Draw, Window, fog_transmission, stray_kinds

KINDS = ("sun", "rain", "fog", "snow", "dirt")
VISIBILITY_M, DIRTY_SHARE = 100.0, 0.3  # where no amount is stated
GUSTY = "gusty-"  # before a kind whose returns come in gusts
_GUST_PERIODS_S, _GUST_SPREAD = np.array([5.0, 9.0, 17.0]), 0.8  # the latter of the logarithm
_ECHO = 0.1  # of whatever fog or dirt weakens: what the data sheets state the range of
_SAMPLED_FRAMES, _SAMPLED_RETURNS = 20, 200_000
_SURFACE_RAD, _SURFACE_RETURNS = 0.0175, 8  # so many sampled returns within a degree stop a ray
_EDGES = (0.001, 0.999)  # of the returns within the field of view of a sensor that is not known
_LEAST_KNOWN = 0.5  # share of the returns within the field of view of the model of that name


@dataclass(frozen=True)
class Weather:
    """A kind, the mean number of its returns a frame, and of fog or dirt how much there is."""

    kind: str
    returns: float = 0.0
    amount: float = 0.0  # visibility in m, or dirty share of the window
    is_gusty: bool = False

    def strength(self, stamp_ns: int, seed: int) -> float:
        """How many times the mean number of returns a frame has, the same for all LiDARs."""
        if not self.is_gusty:
            return 1.0
        phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(_GUST_PERIODS_S))
        waves = np.sin(2 * np.pi * 1e-9 * stamp_ns / _GUST_PERIODS_S + phases)
        spread = _GUST_SPREAD * math.sqrt(2 / len(waves))
        return float(np.exp(spread * waves.sum() - _GUST_SPREAD**2 / 2))

    def strays(self, model: SensorModel) -> list[tuple[float, Draw, bool]]:
        """As the simulator has them: mean number, ranges, whether through dirt."""
        of = {kind: self.returns if kind == self.kind else 0.0 for kind in KINDS}
        scene = Scene(rain_returns=of["rain"], snow_returns=of["snow"], fog=self.fog)
        sensor = Sensor(next(iter(MODELS)), stray_returns=of["sun"], window_returns=of["dirt"])
        return [kind for kind in stray_kinds(scene, sensor, model) if kind[0] > 0]

    @property
    def fog(self) -> Fog | None:
        return Fog(self.returns, self.amount) if self.kind == "fog" else None

    @property
    def dirty_share(self) -> float:
        return self.amount if self.kind == "dirt" else 0.0

    def __str__(self) -> str:
        unit = {"fog": f", {self.amount:g} m", "dirt": f", {self.amount:g} of the window"}
        kind = "gusty " * self.is_gusty + self.kind
        return kind + (f" {self.returns:g}" if self.returns else "") + unit.get(self.kind, "")


def weather_of(text: str) -> Weather:
    """`KIND:RETURNS[:AMOUNT]`, or `clear`; `gusty-` may stand before the kind."""
    kind, *numbers = text.removeprefix(GUSTY).split(":")
    is_gusty = text.startswith(GUSTY)
    try:
        values = [float(number) for number in numbers]
    except ValueError:
        values = []
    has_amount = kind in ("fog", "dirt")
    if kind == "clear" and not numbers and not is_gusty:
        return Weather(kind)
    if kind not in KINDS or not 1 <= len(values) <= 1 + has_amount or min(values) <= 0:
        raise argparse.ArgumentTypeError(
            f"'{text}', expected clear or {', '.join(KINDS)} with the returns a frame: rain:300; "
            "fog:300:150 has a visibility of 150 m, dirt:300:0.8 covers 0.8 of the window; "
            f"{GUSTY}rain:300 has 300 in the mean"
        )
    default = VISIBILITY_M if kind == "fog" else DIRTY_SHARE
    return Weather(kind, values[0], (*values[1:], default)[0] if has_amount else 0.0, is_gusty)


class Air:
    """What weather does to the frames of one sensor."""

    def __init__(
        self, name: str, frames: Sequence[Path], weather: Weather, rng: np.random.Generator
    ) -> None:
        self._rng, self._weather = rng, weather
        chosen = frames[:: max(1, len(frames) // _SAMPLED_FRAMES)]
        clouds = [cloud_of(path, read_pcd(path))[1] for path in chosen]
        sample = np.concatenate(clouds)
        sample = sample[:: max(1, len(sample) // _SAMPLED_RETURNS)]
        self._ranges_m = np.linalg.norm(sample, axis=1)
        towards = sample / self._ranges_m[:, None]
        self._surfaces = KDTree(towards)
        known = next((model for key, model in MODELS.items() if name.startswith(key)), None)
        self._is_known = (
            known is not None
            and len(sample) > 0
            and in_field_of_view(known, sample).mean() > _LEAST_KNOWN
        )
        if self._is_known:
            self._model = known
            sphere = rng.normal(size=(20_000, 3))
            solid_angle = 4 * np.pi * in_field_of_view(known, sphere).mean()
        elif len(sample) == 0:
            raise InputError(f"{frames[0].parent}: no return tells what {name} sees")
        else:
            self._model = dataclasses.replace(
                MODELS["spinning64"],
                rays_per_frame=max(map(len, clouds)),
                range_at_10_percent_m=float(np.quantile(self._ranges_m, _EDGES[1])) / 2,
            )
            azimuth = np.arctan2(towards[:, 1], towards[:, 0])
            # Azimuths count from the middle of the widest gap between them.
            ascending = np.sort(azimuth)
            gaps = np.diff(ascending, append=ascending[0] + 2 * np.pi)
            self._behind = ascending[np.argmax(gaps)] + gaps.max() / 2
            turned = (azimuth - self._behind) % (2 * np.pi)
            self._azimuths = np.quantile(turned, _EDGES)
            self._sines = np.quantile(towards[:, 2], _EDGES)
            solid_angle = float(np.diff(self._azimuths)[0] * np.diff(self._sines)[0])
        self._phase = (float(rng.random()), float(rng.random()))
        self._window = Window(weather.dirty_share, rng)
        self._half_spacing = math.sqrt(solid_angle / self._model.rays_per_frame) / 2

    def into(self, xyz_m: np.ndarray, index: int, strength: float = 1.0) -> tuple[np.ndarray, ...]:
        """What it makes of the returns (N, 3) of a frame, with so many times its mean of strays.

        (N,) bool, those that are left; (K, 3) strays; and (K,) for each stray the return nearest in
        direction, to take the time and whatever else a file has from, -1 in an empty frame.
        """
        rng = self._rng
        ranges_m = np.linalg.norm(xyz_m, axis=1)
        towards = xyz_m / ranges_m[:, None]
        left = rng.random(len(xyz_m)) < self._passing(ranges_m, towards)
        strays, likes = [np.zeros((0, 3))], [np.zeros(0, dtype=int)]
        for mean, draw, is_on_window in self._weather.strays(self._model):
            rays = self._rays(rng.poisson(strength * mean), index)
            free_m = self._free_m(rays)
            like = np.full(len(rays), -1)
            is_own = np.zeros(len(rays), dtype=bool)
            if len(xyz_m):
                away, like = KDTree(towards).query(rays)
                is_own = away < self._half_spacing
                free_m[is_own] = ranges_m[like[is_own]]
            at_m = draw(rng, free_m)
            comes = at_m < free_m
            if is_on_window:
                comes &= self._window.is_dirty(rays)
            left[like[comes & is_own]] = False  # a ray has one return
            strays.append(rays[comes] * at_m[comes, None])
            likes.append(like[comes])
        return left, np.concatenate(strays), np.concatenate(likes)

    def _passing(self, ranges_m: np.ndarray, towards: np.ndarray) -> np.ndarray:
        """Share of the returns that would still be there."""
        fog, width_m = self._weather.fog, np.full(len(ranges_m), np.inf)
        echo = _ECHO * fog_transmission(fog, ranges_m)
        echo = echo * Window.transmission(self._window.is_dirty(towards))
        echoes = (echo, np.full(len(ranges_m), _ECHO))
        weak, clear = (
            detection_probability(self._model, ranges_m, each, width_m) for each in echoes
        )
        return np.divide(weak, clear, out=np.ones(len(ranges_m)), where=clear > 0)

    def _rays(self, count: int, index: int) -> np.ndarray:
        """(count, 3) directions of a frame."""
        if self._is_known:
            towards, _ = scan(self._model, index, self._phase)
            return towards[self._rng.integers(0, len(towards), count)]
        azimuth = self._behind + self._rng.uniform(*self._azimuths, count)
        sine = self._rng.uniform(*self._sines, count)
        across = np.sqrt(1 - sine**2)
        return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), sine], axis=1)

    def _free_m(self, rays: np.ndarray) -> np.ndarray:
        """How far each ray goes: to the median of what is about it, where that is enough."""
        _, nearest = self._surfaces.query(rays, _SURFACE_RETURNS, distance_upper_bound=_SURFACE_RAD)
        ranges_m = np.append(self._ranges_m, np.inf)[nearest]  # absent ones have the last number
        is_surface = np.isfinite(ranges_m).all(axis=1)
        return np.where(is_surface, np.median(ranges_m, axis=1), np.inf)


def cloud_of(path: Path, fields: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The other fields of the returns, and these, (N, 3)."""
    xyz_m = positions_of(path, fields)
    kept = is_return(xyz_m)
    others = {name: column[kept] for name, column in fields.items() if name not in ("x", "y", "z")}
    return others, xyz_m[kept]
