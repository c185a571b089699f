"""Intersections of rays with surfaces; `start` (3,) or (N, 3) is relative to the shape's centre."""

import numpy as np

MISS = np.inf


def meet_ground(
    start_z_m: np.ndarray | float, direction: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Distance (N,) to the plane z = 0 and cosine of incidence."""
    down = -direction[:, 2]
    hits = down > 1e-9
    distance = np.where(hits, start_z_m / np.where(hits, down, 1.0), MISS)
    return distance, np.abs(down)


def meet_box(
    start: np.ndarray, direction: np.ndarray, size_m: np.ndarray, yaw_rad: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray]:
    """Distance (N,) to a box turned about z by `yaw_rad` (N,), entered from outside; cosine."""
    start, direction = turned_back(start, yaw_rad), turned_back(direction, yaw_rad)
    direction = np.where(np.abs(direction) < 1e-12, 1e-12, direction)
    near, far = (-size_m / 2 - start) / direction, (size_m / 2 - start) / direction
    entries, exits = np.minimum(near, far), np.maximum(near, far)
    axis = np.argmax(entries, axis=1)
    entry = np.take_along_axis(entries, axis[:, None], axis=1)[:, 0]
    hits = (entry <= exits.min(axis=1)) & (entry > 0)
    cosine = np.abs(np.take_along_axis(direction, axis[:, None], axis=1)[:, 0])
    return np.where(hits, entry, MISS), cosine


def turned_back(vectors: np.ndarray, yaw_rad: np.ndarray | float) -> np.ndarray:
    """(N, 3) in axes that are turned about z; (3,) where neither has more."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return np.stack(np.broadcast_arrays(c * x + s * y, c * y - s * x, z), axis=-1)


def meet_rod(
    start: np.ndarray, direction: np.ndarray, axis_m: np.ndarray, radius_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Distance (N,) to a thin rod about the centre, `axis_m` from end to end; cosine."""
    length = np.linalg.norm(axis_m)
    along = axis_m / length
    # Closest approach of the ray to the rod's line.
    slant = direction @ along
    sine2 = np.maximum(1.0 - slant**2, 1e-12)
    way = (slant * (start @ along) - (direction * start).sum(axis=-1)) / sine2
    nearest = start + way[:, None] * direction
    at = nearest @ along
    apart = np.linalg.norm(nearest - at[:, None] * along, axis=1)
    hits = (apart <= radius_m) & (np.abs(at) <= length / 2) & (way > 0)
    return np.where(hits, way, MISS), np.sqrt(sine2) * np.sqrt(
        1 - np.minimum(apart / radius_m, 1) ** 2
    )


def meet_ellipsoid(
    start: np.ndarray, direction: np.ndarray, size_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distances (N,) at which the rays enter and leave an ellipsoid, and the cosine at entry.

    Both distances are MISS for a ray that passes by or starts inside.
    """
    half = size_m / 2
    p, d = start / half, direction / half  # the ellipsoid is a unit sphere now
    a = (d * d).sum(axis=1)
    b = (p * d).sum(axis=1)
    c = (p * p).sum(axis=-1) - 1.0
    root = b * b - a * c
    hits = (root > 0) & (b < 0) & (c > 0)
    root = np.sqrt(np.where(hits, root, 0.0))
    entry = np.where(hits, (-b - root) / a, MISS)
    leave = np.where(hits, (-b + root) / a, MISS)
    normal = (p + np.where(hits, entry, 0.0)[:, None] * d) / half
    length = np.maximum(np.linalg.norm(normal, axis=1), 1e-12)
    return entry, leave, np.abs((normal * direction).sum(axis=1)) / length


def meet_pole(
    start: np.ndarray, direction: np.ndarray, radius_m: float, height_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Distance (N,) to the side of an upright cylinder of this height about the centre; cosine."""
    flat = direction[:, :2]
    a = np.maximum((flat * flat).sum(axis=1), 1e-12)
    away = start[..., :2]
    b = _dot(flat, away)
    c = _dot(away, away) - radius_m**2
    root = b * b - a * c
    hits = (root > 0) & (b < 0) & (c > 0)
    entry = np.where(hits, (-b - np.sqrt(np.where(hits, root, 0.0))) / a, MISS)
    z = start[..., 2] + np.where(hits, entry, 0.0) * direction[:, 2]
    hits &= np.abs(z) <= height_m / 2
    cosine = np.sqrt(np.maximum(0.0, root)) / radius_m
    return np.where(hits, entry, MISS), np.minimum(1.0, cosine)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Scalar products of the rows of `a` with `b`, or with the rows of `b`."""
    return a @ b if b.ndim == 1 else (a * b).sum(axis=1)
