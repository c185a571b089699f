"""Detection of truth and trajectory in different coordinates: units, axes, origins."""

from collections.abc import Callable

import numpy as np

_LEAST_ROWS = 10
_LEAST_M = 2.0  # a smaller distance is an error of the trajectory
_FAR_M = 1_000.0  # beyond the range of a LiDAR
_EXPLAINED = 0.1  # largest residual of an explanation, as a share of the distance
_MOVED = 0.2  # largest residual with means removed, as a share of the flight's extent
_DEG_M = 111_195.0  # of latitude, within 1 %
# Scale from units of the truth to those of the trajectory.
_UNITS = {
    1e-3: "the truth seems to be in millimetres (or the trajectory in kilometres)",
    1e-2: "the truth seems to be in centimetres",
    0.3048: "the truth seems to be in feet",
    1 / 0.3048: "the trajectory seems to be in feet (input.scale_m=0.3048)",
    1e2: "the trajectory seems to be in centimetres (input.scale_m=0.01)",
    1e3: "the trajectory seems to be in millimetres (or the truth in kilometres)",
}

Reading = Callable[[np.ndarray], np.ndarray]


def coordinate_mismatch(truth: np.ndarray, estimate: np.ndarray, are_aligned: bool) -> str | None:
    """The likely mismatch of coordinates of two paths, (N, 3) at the same times; None if plausible.

    Reported if another reading of the truth reduces the distance to a tenth, or if the distance
    exceeds a LiDAR's range. `are_aligned`: a constant offset was already removed.
    """
    if len(truth) < _LEAST_ROWS:
        return None
    apart_m = _median(truth - estimate)
    if apart_m < _LEAST_M:
        return None
    centre = np.median(estimate, axis=0) if are_aligned else np.zeros(3)
    most_m = _EXPLAINED * min(apart_m, _median(estimate - centre))
    left = {text: _left(read(truth) - estimate, are_aligned) for text, read in _READINGS.items()}
    likely = min(left, key=lambda text: left[text])
    if left[likely] < most_m:
        return f"{likely}: {apart_m:,.0f} m apart as they are, {left[likely]:,.1f} m if so"
    moved = truth - np.median(truth, axis=0)
    own = estimate - np.median(estimate, axis=0)
    for text, read in _MOVED_READINGS.items():
        left_m = _median(read(truth, moved) - own)
        if left_m < min(_EXPLAINED * apart_m, _MOVED * _median(own)):
            return f"{text}: {apart_m:,.0f} m apart as they are, {left_m:,.1f} m if so"
    if apart_m > _FAR_M:
        return f"truth and trajectory are {apart_m:,.0f} m apart: coordinates of a map, or a unit?"
    return None


def _median(difference: np.ndarray) -> float:
    return float(np.median(np.linalg.norm(difference, axis=1)))


def _left(difference: np.ndarray, are_aligned: bool) -> float:
    return _median(difference - np.median(difference, axis=0) if are_aligned else difference)


def _scaled(factor: float) -> Reading:
    return lambda xyz: xyz * factor


def _axes(x: int, y: int, z: float) -> Reading:
    return lambda xyz: xyz[:, [x, y, 2]] * [1.0, 1.0, z]


def _degrees(latitude: int) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Degrees as local east, north, up in m; `latitude` is the column of the latitude, 0 or 1."""

    def read(truth: np.ndarray, moved: np.ndarray) -> np.ndarray:
        parallel = np.cos(np.radians(np.median(truth[:, latitude])))
        east, north = moved[:, 1 - latitude] * parallel, moved[:, latitude]
        return np.stack([east * _DEG_M, north * _DEG_M, moved[:, 2]], axis=1)

    return read


_READINGS: dict[str, Reading] = {
    **{f"{text}, expected metres": _scaled(factor) for factor, text in _UNITS.items()},
    "the truth's z seems to point down, expected up": _axes(0, 1, z=-1),
    "the truth seems to have x and y exchanged": _axes(1, 0, z=1),
    "the truth seems to be north, east, down, expected z up": _axes(1, 0, z=-1),
}
_MOVED_READINGS = {
    "the truth seems to have another origin, as coordinates of a map (UTM) have, expected metres "
    "from the LiDAR (or --align translation)": lambda _, moved: moved,
    "the truth seems to be latitude and longitude in degrees, expected metres": _degrees(0),
    "the truth seems to be longitude and latitude in degrees, expected metres": _degrees(1),
}
