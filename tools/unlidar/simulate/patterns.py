"""Beam directions of LiDARs as functions of time.

Livox does not publish its scan in full. What is published, and kept to here: fields of view, rays a
second and number of beams (data sheets); that the Mid-360 draws what a sensor of 40 lines does in
0.1 s, other lines each time (its manual); that the Avia's rosette comes of two wedge prisms turning
in opposite senses, of a line of six beams, and is densest in the middle (Liu, Yuan and Zhang,
"Low-cost retina-like robotic lidars based on incommensurable scanning", 2021, whose prism speeds,
7294 and -4664 turns a minute, are taken here). Directions are in the sensor's axes: x forward,
y left, z up.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np


class Pattern(Protocol):
    """A scan. All beams fire at the same time, one shot after another."""

    @property
    def beams(self) -> int:
        """Number of rays of one shot."""

    def rays(self, seconds: np.ndarray, beam: np.ndarray, phase: tuple[float, float]) -> np.ndarray:
        """Unit directions (N, 3) at times (N,) of beams (N,); `phase` in [0, 1): at time 0."""

    def holds(self, direction: np.ndarray) -> np.ndarray:
        """(N,) bool: directions (N, 3), of any length, that are in the field of view."""


@dataclass(frozen=True)
class TurningMirror:
    """Beams that turn about the vertical, each rising and sinking in its own band of the field.

    Bands and heights are equal in the sine of the elevation: rays per steradian are the same
    everywhere. The two frequencies and the frame rate have no common multiple.
    """

    elevation_rad: tuple[float, float]
    beams: int
    turn_hz: float
    rise_hz: float

    def rays(self, seconds: np.ndarray, beam: np.ndarray, phase: tuple[float, float]) -> np.ndarray:
        """See Pattern."""
        azimuth = 2 * np.pi * (seconds * self.turn_hz + phase[0])
        band = (beam + _to_and_fro(seconds * self.rise_hz + phase[1])) / self.beams
        low, high = np.sin(self.elevation_rad)
        sine = low + (high - low) * band
        cosine = np.sqrt(1 - sine**2)
        return np.stack([cosine * np.cos(azimuth), cosine * np.sin(azimuth), sine], axis=1)

    def holds(self, direction: np.ndarray) -> np.ndarray:
        """See Pattern."""
        return _elevation_within(direction, self.elevation_rad)


@dataclass(frozen=True)
class PrismRosette:
    """A line of beams behind two wedge prisms that deflect equally and turn in opposite senses.

    The deflections add as vectors of angles (thin prisms): a rosette in a circle. The line of
    beams, upright, makes it an oblong, higher than wide.
    """

    half_width_rad: float
    half_height_rad: float
    beams: int
    prism_hz: tuple[float, float]

    def rays(self, seconds: np.ndarray, beam: np.ndarray, phase: tuple[float, float]) -> np.ndarray:
        """See Pattern."""
        left, up = np.zeros(len(seconds)), np.zeros(len(seconds))
        for hz, start in zip(self.prism_hz, phase, strict=True):
            angle = 2 * np.pi * (seconds * hz + start)
            left += self.half_width_rad / 2 * np.cos(angle)
            up += self.half_width_rad / 2 * np.sin(angle)
        reach = self.half_height_rad - self.half_width_rad
        up += reach * (2 * beam / (self.beams - 1) - 1)
        off_axis = np.hypot(left, up)
        side = np.sinc(off_axis / np.pi)  # sin(off_axis) / off_axis
        return np.stack([np.cos(off_axis), side * left, side * up], axis=1)

    def holds(self, direction: np.ndarray) -> np.ndarray:
        """See Pattern."""
        across = np.hypot(direction[:, 1], direction[:, 2])
        off_axis = np.arctan2(across, direction[:, 0])
        scale = off_axis / np.maximum(across, 1e-12)
        left, up = scale * direction[:, 1], scale * direction[:, 2]
        reach = self.half_height_rad - self.half_width_rad
        inside = np.hypot(left, up - np.clip(up, -reach, reach)) <= self.half_width_rad
        return inside & (direction[:, 0] > 0)


@dataclass(frozen=True)
class SpinningRings:
    """Beams one above the other, at equal steps of elevation, that spin: every turn is the same."""

    elevation_rad: tuple[float, float]  # of the lowest and the highest beam
    beams: int
    turn_hz: float

    def rays(self, seconds: np.ndarray, beam: np.ndarray, phase: tuple[float, float]) -> np.ndarray:
        """See Pattern."""
        azimuth = 2 * np.pi * (seconds * self.turn_hz + phase[0])
        low, high = self.elevation_rad
        elevation = low + (high - low) * beam / (self.beams - 1)
        cosine = np.cos(elevation)
        flat = [cosine * np.cos(azimuth), cosine * np.sin(azimuth), np.sin(elevation)]
        return np.stack(flat, axis=1)

    def holds(self, direction: np.ndarray) -> np.ndarray:
        """See Pattern."""
        return _elevation_within(direction, self.elevation_rad)


@dataclass(frozen=True)
class Raster:
    """A grid of directions, the same in every frame, at one instant: a flash LiDAR."""

    half_width_rad: float
    half_height_rad: float
    columns: int
    lines: int

    @property
    def beams(self) -> int:
        """See Pattern."""
        return self.columns * self.lines

    def rays(self, seconds: np.ndarray, beam: np.ndarray, phase: tuple[float, float]) -> np.ndarray:
        """See Pattern."""
        line, column = np.divmod(beam, self.columns)
        azimuth = self.half_width_rad * ((2 * column + 1) / self.columns - 1)
        elevation = self.half_height_rad * ((2 * line + 1) / self.lines - 1)
        cosine = np.cos(elevation)
        flat = [cosine * np.cos(azimuth), cosine * np.sin(azimuth), np.sin(elevation)]
        return np.stack(flat, axis=1)

    def holds(self, direction: np.ndarray) -> np.ndarray:
        """See Pattern."""
        azimuth = np.arctan2(direction[:, 1], direction[:, 0])
        height = (-self.half_height_rad, self.half_height_rad)
        return (np.abs(azimuth) <= self.half_width_rad) & _elevation_within(direction, height)


def _elevation_within(direction: np.ndarray, limits_rad: tuple[float, float]) -> np.ndarray:
    elevation = np.arctan2(direction[:, 2], np.hypot(direction[:, 0], direction[:, 1]))
    return (elevation >= limits_rad[0]) & (elevation <= limits_rad[1])


def _to_and_fro(turns: np.ndarray) -> np.ndarray:
    """Triangular wave between 0 and 1: spends the same time everywhere."""
    return np.abs(2 * (turns % 1.0) - 1)
