"""Between metres around a station and latitude, longitude, height on the WGS 84 ellipsoid."""

from dataclasses import dataclass

import numpy as np

_A_M = 6378137.0  # semi-major axis
_E2 = (2 - 1 / 298.257223563) / 298.257223563  # first eccentricity squared
_EAST_DEG = 90.0


@dataclass(frozen=True)
class Origin:
    """Where 0, 0, 0 of the sensors' frame is, and how the frame is turned about the vertical."""

    latitude_deg: float
    longitude_deg: float
    height_m: float  # above the ellipsoid
    heading_deg: float = _EAST_DEG  # compass direction of the x axis; 90: x east, y north


def to_geodetic(origin: Origin, xyz_m: np.ndarray) -> np.ndarray:
    """(N, 3) latitude and longitude in degrees, height in metres, of (N, 3) positions, z up."""
    rotation = _axes(origin)
    return _geodetic(_ecef(_place(origin)) + xyz_m @ rotation.T)


def from_geodetic(origin: Origin, place: np.ndarray) -> np.ndarray:
    """The inverse of `to_geodetic`."""
    return (_ecef(place) - _ecef(_place(origin))) @ _axes(origin)


def _place(origin: Origin) -> np.ndarray:
    return np.array([[origin.latitude_deg, origin.longitude_deg, origin.height_m]])


def _axes(origin: Origin) -> np.ndarray:
    """(3, 3) the frame's axes as columns in earth-centred coordinates."""
    lat, lon = np.radians([origin.latitude_deg, origin.longitude_deg])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    north = np.array([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)])
    heading = np.radians(origin.heading_deg)
    x = np.sin(heading) * east + np.cos(heading) * north
    up = np.cross(east, north)
    return np.stack([x, np.cross(up, x), up], axis=1)


def _ecef(place: np.ndarray) -> np.ndarray:
    lat, lon = np.radians(place[:, 0]), np.radians(place[:, 1])
    normal = _A_M / np.sqrt(1 - _E2 * np.sin(lat) ** 2)
    across = (normal + place[:, 2]) * np.cos(lat)
    along = (normal * (1 - _E2) + place[:, 2]) * np.sin(lat)
    return np.stack([across * np.cos(lon), across * np.sin(lon), along], axis=1)


def _geodetic(ecef_m: np.ndarray) -> np.ndarray:
    """By Bowring 1976: below a micrometre off for all heights at which drones fly."""
    x, y, z = ecef_m.T
    p = np.hypot(x, y)
    b = _A_M * np.sqrt(1 - _E2)
    reduced = np.arctan2(z * _A_M, p * b)
    lat = np.arctan2(
        z + _E2 / (1 - _E2) * b * np.sin(reduced) ** 3, p - _E2 * _A_M * np.cos(reduced) ** 3
    )
    # The form that is well-behaved at the equator and at the poles alike.
    height = p * np.cos(lat) + z * np.sin(lat) - _A_M * np.sqrt(1 - _E2 * np.sin(lat) ** 2)
    return np.stack([np.degrees(lat), np.degrees(np.arctan2(y, x)), height], axis=1)
