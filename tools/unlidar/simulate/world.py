"""Objects of a scene, and ray casting to the first hit."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from unlidar.simulate import shapes
from unlidar.simulate.flight import Path

_CROWN_FREE_PATH_M = 1.0  # mean way of a ray into a crown before it meets a leaf
_PUFF_FREE_PATH_M = 40.0  # of one that has grown to its size; of a small one much less
_CABLE_WIDTH_M = 0.03
_HIDDEN_SHARE = 0.1  # of the rays that pass a tree at least, for what is behind to be in view
_CLEARANCE_STEP_S = 0.1
_FRAME_SAMPLES = 9  # samples of a moving object's path within a frame

Turn = Callable[[np.ndarray], np.ndarray]  # times in s (N,) -> yaw in rad (N,)
Growth = Callable[[np.ndarray], np.ndarray]  # times in s (N,) -> share of the size (N,)


@dataclass(frozen=True)
class SceneObject:
    """A shape at a place, or along a path if it moves. The ground is a plane, its centre on it."""

    kind: str  # ground, building, pole, crown, ..., drone; determines the intersection
    centre_m: np.ndarray  # (3,)
    size_m: np.ndarray  # (3,) full extents; of a cable its vector from end to end
    reflectivity: float
    yaw_rad: float = 0.0
    fill: float = 1.0  # share of the rays through the outline that meet it
    path: Path | None = None
    flap_hz: float = 0.0  # wings: the fill goes up to its value and down to 0 so often
    turn: Turn | None = None  # for turning objects; else `yaw_rad`
    growth: Growth | None = None  # for growing objects; `size_m` is the largest size

    def centres(self, time_s: np.ndarray) -> np.ndarray:
        """Its centre at these times, (N, 3); (3,) for a static object."""
        return self.centre_m if self.path is None else self.path(time_s)

    @property
    def width_m(self) -> float:
        """The smallest width that a beam can hit."""
        return _CABLE_WIDTH_M if self.kind == "cable" else float(self.size_m.min())

    def yaw_at(self, time_s: np.ndarray) -> np.ndarray | float:
        """Its yaw at these times, (N,), or at any."""
        return self.yaw_rad if self.turn is None else self.turn(time_s)

    def fill_at(self, time_s: np.ndarray) -> np.ndarray:
        """Its fill at these times, (N,)."""
        if self.flap_hz == 0:
            return np.full(len(time_s), self.fill)
        return self.fill * (0.5 + 0.5 * np.cos(2 * np.pi * self.flap_hz * time_s))


@dataclass(frozen=True)
class Hits:
    """First hit of each ray; distance inf and thing -1 without one."""

    distance_m: np.ndarray  # (N,)
    thing: np.ndarray  # (N,) index into the objects
    echo: np.ndarray  # (N,) reflectivity times cosine of incidence
    width_m: np.ndarray  # (N,) smallest width of the object hit


def cast(
    things: list[SceneObject],
    origin_m: np.ndarray,
    direction: np.ndarray,
    time_s: np.ndarray,
    rng: np.random.Generator,
) -> Hits:
    """The first surface along each ray: directions (N, 3) of unit length, one time per ray (N,).

    The origin is (3,), or one per ray (N, 3).
    """
    n = len(direction)
    hits = Hits(np.full(n, np.inf), np.full(n, -1), np.zeros(n), np.ones(n))
    for index, thing in enumerate(things):
        rays = _rays_towards(thing, time_s, origin_m, direction)
        if len(rays) == 0:
            continue
        start = _of(origin_m, rays) - thing.centres(time_s[rays])
        distance, cosine = _meet(thing, start, direction[rays], time_s[rays], rng)
        nearer = distance < hits.distance_m[rays]
        rays = rays[nearer]
        hits.distance_m[rays] = distance[nearer]
        hits.thing[rays] = index
        hits.echo[rays] = thing.reflectivity * cosine[nearer]
        hits.width_m[rays] = thing.width_m
    return hits


def is_hidden(
    things: list[SceneObject], origin_m: np.ndarray, target_m: np.ndarray, time_s: np.ndarray
) -> np.ndarray:
    """(N,) bool: the view from the origin (3,) or (N, 3) to the target (N, 3) is blocked.

    At these times (N,), by the ground or a building, or by crowns that stop nine of ten rays: the
    share that passes is exp(-way through leaves / free path), the mean of what `cast` draws
    (Beer-Lambert).
    """
    way = target_m - origin_m
    length = np.maximum(np.linalg.norm(way, axis=1), 1e-9)
    direction = way / length[:, None]
    opaque = [thing for thing in things if thing.kind in ("ground", "building")]
    unused = np.random.default_rng(0)  # opaque objects need no random numbers
    hits = cast(opaque, origin_m, direction, np.zeros(len(way)), unused)
    leaves_m = np.zeros(len(way))
    for crown in (thing for thing in things if thing.kind == "crown"):
        start = origin_m - crown.centres(time_s)
        entry, leave, _ = shapes.meet_ellipsoid(start, direction, crown.size_m)
        met = entry < length
        leaves_m[met] += np.minimum(leave, length)[met] - entry[met]
    return (hits.distance_m < length) | (np.exp(-leaves_m / _CROWN_FREE_PATH_M) < _HIDDEN_SHARE)


def is_clear(things: list[SceneObject], path: Path, distance_m: float, duration_s: float) -> bool:
    """Whether a path stays clear of all that stands by a distance, over [0, duration_s].

    Things of the kinds ground, building, pole and crown; sampled at a tenth of a second, so that a
    path of 10 m/s moves by 1 m between two samples.
    """
    time_s = np.arange(0.0, duration_s, _CLEARANCE_STEP_S)
    places_m = path(time_s)
    return not any(
        bool(np.any(_is_within(thing, places_m - thing.centres(time_s), distance_m)))
        for thing in things
    )


def _is_within(thing: SceneObject, offset_m: np.ndarray, distance_m: float) -> np.ndarray:
    """(N,) bool: an offset (N, 3) from its centre lies in the thing, grown by a distance."""
    half_m = thing.size_m / 2 + distance_m
    match thing.kind:
        case "ground":
            return offset_m[:, 2] < distance_m
        case "building":
            return np.all(np.abs(shapes.turned_back(offset_m, thing.yaw_rad)) < half_m, axis=1)
        case "pole":
            across_m = np.hypot(offset_m[:, 0], offset_m[:, 1])
            return (across_m < half_m[0]) & (np.abs(offset_m[:, 2]) < half_m[2])
        case "crown":
            return np.linalg.norm(offset_m / half_m, axis=1) < 1.0
    return np.zeros(len(offset_m), dtype=bool)


def _of(origin_m: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """The origin of these rays."""
    return origin_m if origin_m.ndim == 1 else origin_m[rays]


def _rays_towards(
    thing: SceneObject, time_s: np.ndarray, origin_m: np.ndarray, direction: np.ndarray
) -> np.ndarray:
    """Indices of the rays that may meet the thing: those in a cone about its bounding sphere."""
    if thing.kind == "ground":
        return np.flatnonzero(direction[:, 2] < 0)
    middle, moved = thing.centre_m, 0.0
    if thing.path is not None:
        places = thing.path(np.linspace(time_s.min(), time_s.max(), _FRAME_SAMPLES))
        middle = (places.min(axis=0) + places.max(axis=0)) / 2
        # Between two samples the path deviates from their line by less than their distance.
        step = np.linalg.norm(np.diff(places, axis=0), axis=1).max()
        moved = np.linalg.norm(places - middle, axis=1).max() + step
    radius = np.linalg.norm(thing.size_m) / 2 + moved
    if origin_m.ndim == 2:
        seen_from = (origin_m.min(axis=0) + origin_m.max(axis=0)) / 2
        radius += np.linalg.norm(origin_m - seen_from, axis=1).max()
        origin_m = seen_from
    towards = middle - origin_m
    distance = np.linalg.norm(towards)
    if distance <= radius:
        return np.arange(len(direction))
    return np.flatnonzero(direction @ (towards / distance) >= np.sqrt(1 - (radius / distance) ** 2))


def _meet(
    thing: SceneObject,
    start: np.ndarray,
    direction: np.ndarray,
    time_s: np.ndarray,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    match thing.kind:
        case "ground":
            return shapes.meet_ground(start[..., 2], direction)
        case "building" | "car" | "sign" | "flag":
            return shapes.meet_box(start, direction, thing.size_m, thing.yaw_at(time_s))
        case "cable":
            return shapes.meet_rod(start, direction, thing.size_m, _CABLE_WIDTH_M / 2)
        case "pole":
            return shapes.meet_pole(start, direction, thing.size_m[0] / 2, thing.size_m[2])
    share = np.ones(len(direction)) if thing.growth is None else thing.growth(time_s)
    size_m = thing.size_m * share[:, None]
    entry, leave, cosine = shapes.meet_ellipsoid(start, direction, size_m)
    if thing.kind in ("crown", "puff"):
        # Free path in a crown: exponential, at any angle of incidence (Beer-Lambert). The particles
        # of a puff spread over a growing volume.
        free_path_m = _CROWN_FREE_PATH_M if thing.kind == "crown" else _PUFF_FREE_PATH_M * share**3
        leaf = entry + rng.exponential(free_path_m, len(direction))
        return np.where(leaf < leave, leaf, np.inf), rng.uniform(0.3, 1.0, len(direction))
    if thing.fill < 1:
        entry = np.where(rng.random(len(direction)) < thing.fill_at(time_s), entry, np.inf)
    return entry, cosine
