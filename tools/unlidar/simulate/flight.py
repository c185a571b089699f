"""Paths with continuous acceleration (C2), as cubic splines of time."""

from collections.abc import Callable

import numpy as np
from scipy.interpolate import BSpline, CubicSpline

from unlidar.simulate.scenario import Flight

Path = Callable[[np.ndarray], np.ndarray]  # times in s (N,) -> positions in m (N, 3)

_TRIES = 50


def make_path(flight: Flight, duration_s: float, rng: np.random.Generator) -> Path:
    """The path of a flight over [0, duration_s]."""
    if flight.waypoints:
        points = np.array(flight.waypoints, dtype=float)
        points[:, 1:] += flight.spread_m * rng.uniform(-1, 1, (len(points), 3))
        if flight.rest_at_waypoints:
            return _resting_path(points)
        spline = CubicSpline(points[:, 0], points[:, 1:], bc_type="natural")
        first, last = points[0, 0], points[-1, 0]
        return lambda t: spline(np.clip(t, first, last))
    assert flight.box_m is not None  # Flight has waypoints or a box
    low, high = (np.array(corner) for corner in flight.box_m)
    return random_path(
        low, high, flight.max_speed_mps, flight.turn_s, duration_s, rng, flight.hover_s
    )


def _resting_path(points: np.ndarray) -> Path:
    """Straight from one (time, x, y, z) to the next, without speed and acceleration at each.

    The way goes as 6 u^5 - 15 u^4 + 10 u^3 over the share u of the time: never beyond either end,
    fastest half-way at 15/8 of the mean speed.
    """
    times, places = points[:, 0], points[:, 1:]

    def path(time_s: np.ndarray) -> np.ndarray:
        leg = np.clip(np.searchsorted(times, time_s, side="right") - 1, 0, len(times) - 2)
        u = np.clip((time_s - times[leg]) / (times[leg + 1] - times[leg]), 0.0, 1.0)[:, None]
        way = u**3 * (10 - 15 * u + 6 * u**2)
        return places[leg] + way * (places[leg + 1] - places[leg])

    return path


def swaying(centre_m: np.ndarray, reach_m: float, rng: np.random.Generator) -> Path:
    """Sway in the wind about a position: two perpendicular oscillations of up to `reach_m`."""
    heading = rng.uniform(0, 2 * np.pi)
    swings = [
        (np.array([np.cos(angle), np.sin(angle), 0.0]), rng.uniform(0.2, 0.6), rng.random())
        for angle in (heading, heading + np.pi / 2)
    ]

    def path(time_s: np.ndarray) -> np.ndarray:
        place = np.tile(centre_m, (len(time_s), 1))
        for axis, hz, start in swings:
            place += reach_m * np.sin(2 * np.pi * (hz * time_s + start))[:, None] * axis
        return place

    return path


def undulating(way: Path, height_m: float, turns_hz: float) -> Path:
    """A path that goes up and down by `height_m` on its way."""
    up = np.array([0.0, 0.0, height_m])
    return lambda t: way(t) + np.sin(2 * np.pi * turns_hz * t)[:, None] * up


def random_path(
    low_m: np.ndarray,
    high_m: np.ndarray,
    max_speed_mps: float,
    turn_s: float,
    duration_s: float,
    rng: np.random.Generator,
    hover_s: tuple[tuple[float, float], ...] = (),
) -> Path:
    """A uniform cubic B-spline whose control points wander about in the box.

    A B-spline lies in the convex hull of its control points, and its velocity in that of their
    differences over the knot distance: position and speed keep their limits by construction.
    """
    pieces = max(1, int(np.ceil(duration_s / turn_s)))
    points = [rng.uniform(low_m, high_m)]
    course = rng.normal(size=3)
    for _ in range(pieces + 2):
        for _ in range(_TRIES):
            turned = course + rng.normal(size=3)
            length = max_speed_mps * turn_s * rng.uniform(0.5, 1.0)
            step = turned / np.linalg.norm(turned) * length
            step[high_m == low_m] = 0.0
            point = points[-1] + step
            if np.all((point >= low_m) & (point <= high_m)):
                break
            course = rng.normal(size=3)  # wall ahead: new random direction
        else:
            point = np.clip(point, low_m, high_m)
        course = step / length
        points.append(point)
    for begin, end in hover_s:  # the pieces of the hover rest on four equal control points each
        first, last = int(begin / turn_s), int(end / turn_s) + 4
        points[first:last] = [points[min(first, len(points) - 1)]] * len(points[first:last])
        _close_up(points, last, low_m, high_m, max_speed_mps * turn_s)
    knots = turn_s * (np.arange(pieces + 7) - 3.0)
    spline = BSpline(knots, np.array(points), 3)
    return lambda t: spline(np.clip(t, 0.0, pieces * turn_s))


def _close_up(
    points: list[np.ndarray], first: int, low_m: np.ndarray, high_m: np.ndarray, longest_m: float
) -> None:
    """Moves the control points from `first` on so that each follows the last without a leap."""
    if first >= len(points) or first == 0:
        return
    for i in range(first, len(points)):
        step = points[i] - points[i - 1]
        length = np.linalg.norm(step)
        if length > longest_m:
            points[i] = np.clip(points[i - 1] + step / length * longest_m, low_m, high_m)
