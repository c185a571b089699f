"""Kinds of clutter to be drawn: surroundings, things that move in them, and altered frames.

Weather is none of them: `tools/measure_scenes.py --weather` puts it into any scene.
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from unlidar.simulate import Simulation
from unlidar.simulate.flight import Path
from unlidar.simulate.recording import STRAY, SimulatedFrame
from unlidar.simulate.scenario import Scene
from unlidar.simulate.sensors import MODELS, in_field_of_view
from unlidar.simulate.world import SceneObject

_UP = np.array([0.0, 0.0, 1.0])

# Function: a simulation -> further things in it.
Things = Callable[[Simulation, np.random.Generator], list[SceneObject]]
# Function: a frame -> the frame as the sensor hands it over, None if it is lost.
Alter = Callable[[Simulation, SimulatedFrame, np.random.Generator], SimulatedFrame | None]


@dataclass(frozen=True)
class Kind:
    """Surroundings, further things and altered frames of a scene."""

    scene: Scene
    things: Things = lambda simulation, rng: []
    alter: Alter = lambda simulation, frame, rng: frame


def leaves(simulation: Simulation, rng: np.random.Generator) -> list[SceneObject]:
    """They come off the crowns one after another, flutter to the ground and lie there."""
    crowns = [thing for thing in simulation.things if thing.kind == "crown"]
    scene, duration_s = simulation.scenario.scene, simulation.scenario.duration_s
    wind_mps = rng.normal(0, 0.8, 2)
    found = []
    for _ in range(6 * len(crowns)):
        crown = crowns[rng.integers(len(crowns))]
        hold = crown.centre_m + rng.uniform(-0.4, 0.4, 3) * crown.size_m
        velocity = np.array([*(wind_mps + rng.normal(0, 0.4, 2)), -rng.uniform(0.7, 1.6)])
        falls_s = (hold[2] - scene.ground_z_m) / -velocity[2]
        way = _moving(hold, velocity, rng.uniform(-0.2, 1.0) * duration_s, falls_s)
        path = _fluttering(way, hold[2], rng.uniform(0.1, 0.4), rng.uniform(0.5, 1.5))
        found.append(SceneObject("leaf", hold, np.array([0.09, 0.09, 0.05]), 0.3, path=path))
    return found


def dust(simulation: Simulation, rng: np.random.Generator) -> list[SceneObject]:
    """Clouds rise from the ground, drift with the wind, grow and are gone after some seconds."""
    wind_mps, found = rng.uniform(-3, 3, 2), []
    for _ in range(12):
        place = _ahead(simulation, rng.uniform(5, 25), rng)[0] + _UP
        velocity = np.array([*(wind_mps + rng.normal(0, 0.5, 2)), 0.4])
        begins_s, lives_s = rng.uniform(0, simulation.scenario.duration_s), rng.uniform(4, 9)
        size = rng.uniform(2, 6) * np.array([1.0, 1.0, 0.6])
        path = _moving(place, velocity, begins_s, lives_s)
        growth = _growing(begins_s, lives_s)
        found.append(SceneObject("puff", place, size, 0.3, path=path, growth=growth))
    return found


def crane(simulation: Simulation, rng: np.random.Generator) -> list[SceneObject]:
    """A jib of pieces slews about a mast."""
    foot, _ = _ahead(simulation, 28.0, rng)
    height_m, begin_rad = rng.uniform(14, 22), rng.uniform(0, 2 * np.pi)
    slew_radps = np.radians(rng.choice([-1, 1]) * rng.uniform(1, 3))
    mast = SceneObject("pole", foot + height_m / 2 * _UP, np.array([1.2, 1.2, height_m]), 0.4)

    def turn(time_s: np.ndarray) -> np.ndarray:
        return begin_rad + slew_radps * time_s

    def piece(out_m: float) -> SceneObject:
        def path(time_s: np.ndarray) -> np.ndarray:
            yaw = turn(time_s)
            arm = np.stack([np.cos(yaw), np.sin(yaw), np.zeros(len(yaw))], axis=1)
            return foot + height_m * _UP + out_m * arm

        size = np.array([3.6, 0.8, 0.8])
        return SceneObject("sign", path(np.zeros(1))[0], size, 0.3, path=path, turn=turn)

    return [mast, *map(piece, np.linspace(-8, 26, 9))]


def bridge(simulation: Simulation, rng: np.random.Generator) -> list[SceneObject]:
    """A deck on pillars above the ground, with cars and people that pass over it."""
    middle, away = _ahead(simulation, 30.0, rng)
    along = np.array([-away[1], away[0], 0.0])
    yaw = float(np.arctan2(along[1], along[0]))
    height_m, deck_m, duration_s = 6.0, 120.0, simulation.scenario.duration_s

    def box(kind: str, size: tuple[float, ...], aside_m: float) -> SceneObject:
        """A thing that stands on the deck."""
        place = middle + aside_m * away + (height_m + 0.3 + size[2] / 2) * _UP
        return SceneObject(kind, place, np.array(size), 0.4, yaw)

    def passing(kind: str, size: tuple[float, ...], aside_m: float, mps: float) -> SceneObject:
        crosses_s, reach_s = rng.uniform(0, duration_s), (deck_m / 2 - 3) / abs(mps)
        here = box(kind, size, aside_m)
        begin_m = here.centre_m - mps * reach_s * along
        way = _moving(begin_m, mps * along, crosses_s - reach_s, 2 * reach_s)  # from end to end
        return dataclasses.replace(here, path=way)

    deck = SceneObject("building", middle + height_m * _UP, np.array([deck_m, 9.0, 0.6]), 0.4, yaw)
    found = [deck, box("building", (deck_m, 0.2, 1.0), -4.3)]
    for out_m in (-30.0, 0.0, 30.0):
        pillar = middle + out_m * along + height_m / 2 * _UP
        found.append(SceneObject("pole", pillar, np.array([1.0, 1.0, height_m]), 0.4))
    for _ in range(6):
        mps = rng.choice([-1, 1]) * rng.uniform(6, 14)
        found.append(passing("car", (4.2, 1.8, 1.5), 1.5 * np.sign(mps), mps))
    for _ in range(2):
        mps = rng.choice([-1, 1]) * rng.uniform(1.0, 1.7)
        found.append(passing("walker", (0.45, 0.45, 1.75), -3.6, mps))
    return found


def mirrored(
    simulation: Simulation, frame: SimulatedFrame, rng: np.random.Generator
) -> SimulatedFrame:
    """A wet road: some rays that meet it near the sensor see what it mirrors, below the ground."""
    ground_m = simulation.scenario.scene.ground_z_m
    is_above = frame.xyz_m[:, 2] > ground_m
    is_above &= _is_kind(simulation, frame, lambda kind: kind != "ground")
    rays = np.flatnonzero(is_above & (rng.random(len(is_above)) < 0.15))
    images = frame.xyz_m[rays] * [1, 1, -1] + [0, 0, 2 * ground_m]
    # Distance at which the ray to an image meets the road.
    road_m = np.linalg.norm(images, axis=1) * ground_m / images[:, 2]
    model = MODELS[simulation.scenario.sensors[frame.sensor].model]
    shown = (road_m > 3) & (road_m < 35) & in_field_of_view(model, images)
    return _with(frame, images[shown], rays[shown], STRAY)


def second_returns(
    simulation: Simulation, frame: SimulatedFrame, rng: np.random.Generator
) -> SimulatedFrame:
    """Each ray tells two: in a crown one behind the other, else the same once more."""
    deeper_m = np.where(
        _is_kind(simulation, frame, lambda kind: kind == "crown"),
        rng.exponential(0.8, len(frame.xyz_m)),
        0.0,
    )
    ranges_m = np.linalg.norm(frame.xyz_m, axis=1)
    again = frame.xyz_m * (1 + deeper_m / ranges_m)[:, None]
    return _with(frame, again, np.arange(len(again)), frame.thing)


def coarse_ranges(
    simulation: Simulation, frame: SimulatedFrame, rng: np.random.Generator
) -> SimulatedFrame:
    """Ranges are whole multiples of 4 cm."""
    ranges_m = np.linalg.norm(frame.xyz_m, axis=1)
    whole_m = 0.04 * np.maximum(1, np.rint(ranges_m / 0.04))
    return dataclasses.replace(frame, xyz_m=frame.xyz_m * (whole_m / ranges_m)[:, None])


def lost_frames(
    simulation: Simulation, frame: SimulatedFrame, rng: np.random.Generator
) -> SimulatedFrame | None:
    """Three of ten never come, and none for an eighth of the time."""
    share = frame.begin_ns * 1e-9 / simulation.scenario.duration_s
    return None if rng.random() < 0.3 or 0.5 <= share < 0.625 else frame


_PLACE = Scene(random_buildings=3, poles=6, trees=12)
KINDS: dict[str, Kind] = {
    "calm": Kind(_PLACE),
    "street": Kind(dataclasses.replace(_PLACE, walkers=4, cars=5)),
    "people": Kind(dataclasses.replace(_PLACE, clear_m=20.0, trees=6, walkers=8, cars=2)),
    "wind": Kind(dataclasses.replace(_PLACE, trees=20, sway_m=0.6, flags=3)),
    "overhead": Kind(dataclasses.replace(_PLACE, sway_m=0.15, cables=2, gantries=1, walkers=2)),
    "mast": Kind(dataclasses.replace(_PLACE, ground_z_m=-8.0, walkers=4, cars=3)),
    "insects": Kind(dataclasses.replace(_PLACE, insects=8)),
    "leaves": Kind(dataclasses.replace(_PLACE, trees=20, sway_m=0.1), leaves),
    "dust": Kind(_PLACE, dust),
    "crane": Kind(_PLACE, crane),
    "bridge": Kind(_PLACE, bridge),
    "wet": Kind(dataclasses.replace(_PLACE, walkers=4, cars=3), alter=mirrored),
    "dual": Kind(dataclasses.replace(_PLACE, sway_m=0.15, walkers=4), alter=second_returns),
    "coarse": Kind(dataclasses.replace(_PLACE, walkers=4, cars=3), alter=coarse_ranges),
    "lossy": Kind(dataclasses.replace(_PLACE, walkers=2, cars=3), alter=lost_frames),
}


def _ahead(
    simulation: Simulation, away_m: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """A place on the ground at this distance where the sensor looks, and the way there, level."""
    (sensor,) = simulation.scenario.sensors.values()
    rays = rng.normal(size=(10_000, 3))
    ray = rays[in_field_of_view(MODELS[sensor.model], rays)][0]
    away = np.array([*ray[:2], 0.0]) / np.hypot(*ray[:2])
    return away_m * away + simulation.scenario.scene.ground_z_m * _UP, away


def _moving(begin_m: np.ndarray, velocity: np.ndarray, begins_s: float, lasts_s: float) -> Path:
    """At rest, then straight on for so long, then at rest."""
    return lambda time_s: begin_m + np.clip(time_s - begins_s, 0, lasts_s)[:, None] * velocity


def _fluttering(way: Path, top_m: float, reach_m: float, turns_per_m: float) -> Path:
    """To and fro by the way down from the top: it stops with it."""

    def path(time_s: np.ndarray) -> np.ndarray:
        places = way(time_s)
        fallen_m = top_m - places[:, 2]
        places[:, 0] += reach_m * np.sin(2 * np.pi * turns_per_m * fallen_m)
        return places

    return path


def _growing(begins_s: float, lives_s: float) -> Callable[[np.ndarray], np.ndarray]:
    """From a sixth of the size to all of it; next to nothing before and after."""

    def growth(time_s: np.ndarray) -> np.ndarray:
        age = (time_s - begins_s) / lives_s
        return np.where((age < 0) | (age > 1), 1e-3, 1 / 6 + 5 / 6 * np.clip(age, 0, 1))

    return growth


def _is_kind(
    simulation: Simulation, frame: SimulatedFrame, holds: Callable[[str], bool]
) -> np.ndarray:
    """(N,) bool: returns of things of such kinds."""
    # The last value is that of strays, whose index is -1.
    of_thing = np.array([*(holds(thing.kind) for thing in simulation.things), False])
    return of_thing[frame.thing]


def _with(
    frame: SimulatedFrame, xyz_m: np.ndarray, rays: np.ndarray, thing: np.ndarray | int
) -> SimulatedFrame:
    """A frame with further returns (K, 3) at the times of these (K,) of its returns."""
    time_ns = np.append(frame.time_ns, frame.time_ns[rays])
    order = np.argsort(time_ns, kind="stable")
    things = np.append(frame.thing, np.broadcast_to(thing, len(rays)))
    return dataclasses.replace(
        frame,
        xyz_m=np.concatenate([frame.xyz_m, xyz_m])[order],
        time_ns=time_ns[order],
        thing=things[order],
    )
