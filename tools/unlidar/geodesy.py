"""Between metres around a station and latitude, longitude, height on the WGS 84 ellipsoid.

pymap3d is imported on use: the command line needs Origin only.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from unlidar.call_checks import expect_number

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

_EAST_DEG = 90.0


@dataclass(frozen=True)
class Origin:
    """Geodetic position of the sensor frame's origin, and its heading."""

    latitude_deg: float
    longitude_deg: float
    height_m: float  # above the ellipsoid
    heading_deg: float = _EAST_DEG  # compass direction of the x axis; 90: x east, y north

    def __post_init__(self) -> None:
        """Throws UsageError for a value that is none."""
        expect_number("latitude_deg", self.latitude_deg, -90, 90)
        expect_number("longitude_deg", self.longitude_deg, -360, 360)
        expect_number("height_m", self.height_m)
        expect_number("heading_deg", self.heading_deg)


def to_geodetic(origin: Origin, xyz_m: np.ndarray) -> np.ndarray:
    """(N, 3) latitude and longitude in degrees, height in metres, of (N, 3) positions, z up."""
    from pymap3d import enu2geodetic

    enu_m = _turn(origin).apply(xyz_m)
    return np.stack(enu2geodetic(*enu_m.T, *_place(origin)), axis=1)


def from_geodetic(origin: Origin, place: np.ndarray) -> np.ndarray:
    """The inverse of `to_geodetic`."""
    from pymap3d import geodetic2enu

    enu_m = np.stack(geodetic2enu(*place.T, *_place(origin)), axis=1)
    return _turn(origin).apply(enu_m, inverse=True)


def turn_between(one: Origin, other: Origin) -> np.ndarray:
    """(3, 3) from the axes of one frame to those of another, both upright, some km apart."""
    return (_turn(other).inv() * _turn(one)).as_matrix()


def to_east_north_up(origin: Origin, vectors: np.ndarray) -> np.ndarray:
    """(N, 3) vectors of the sensor frame by east, north, up of the station."""
    return _turn(origin).apply(vectors)


def metres_per_degree(origin: Origin) -> tuple[float, float]:
    """Metres north and east that a degree of latitude and of longitude span at a place."""
    from pymap3d.rcurve import meridian, transverse

    lat, _, height_m = _place(origin)
    north_m = float(meridian(lat)) + height_m
    east_m = (float(transverse(lat)) + height_m) * math.cos(math.radians(lat))
    return math.radians(north_m), math.radians(east_m)


def _place(origin: Origin) -> tuple[float, float, float]:
    return origin.latitude_deg, origin.longitude_deg, origin.height_m


def _turn(origin: Origin) -> "Rotation":
    """From the frame's axes to east, north, up: a heading counts clockwise, from north."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler("z", _EAST_DEG - origin.heading_deg, degrees=True)
