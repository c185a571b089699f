"""Scenes drawn of a kind of clutter, a sensor and a flight, each from its seed alone."""

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np
from unlidar.simulate import Scenario, Simulation
from unlidar.simulate.recording import SimulatedFrame
from unlidar.simulate.scenario import Drone, Flight, Sensor, Vector
from unlidar.simulate.sensors import MODELS, in_field_of_view
from unlidar.simulate.world import is_clear
from unlidar.stamps import NS_PER_S

from unlidar_bench.clutter import KINDS, Kind

NOBODY = "none"  # in the place of a flight
_LEAST_S, _LEAST_FRAMES = 20.0, 40
_LEAST_IN_VIEW = 0.6  # share of the places of a flight that the sensor looks at
_LEAST_SEEN, _TRIES = 0.4, 50  # share of the time without anything before the drone
_DRAW, _THINGS, _FRAMES = 1000, 1001, 1002  # random streams, apart from those of a simulation


def _box(low: Vector, high: Vector, max_speed_mps: float, **more) -> Flight:
    return Flight(box_m=(low, high), max_speed_mps=max_speed_mps, **more)


def _take_off(ground_m: float, rng: np.random.Generator) -> Flight:
    """Five seconds on the ground, somewhere about the sensor, then up and away."""
    heading = rng.uniform(0, 2 * np.pi)
    c, s = np.cos(heading), np.sin(heading)
    ways = ((0, 12, 0, 0.2), (5, 12, 0, 0.2), (9, 13, 1, 2.8), (13, 18, 3, 5), (20, 4, 15, 5))
    return Flight(
        waypoints=tuple((t, c * x - s * y, s * x + c * y, ground_m + z) for t, x, y, z in ways)
    )


# Function: height of the ground below the sensor -> flight.
FLIGHTS: dict[str, Callable[[float, np.random.Generator], Flight]] = {
    "around": lambda ground_m, rng: _box((-22, -22, 0), (22, 22, 6), 6.0),
    "level": lambda ground_m, rng: _box((-22, -22, -0.6), (22, 22, 2), 4.0),
    "hover": lambda ground_m, rng: _box((-16, -16, 0), (16, 16, 4), 4.0, hover_s=((6, 14),)),
    "low": lambda ground_m, rng: _box((-16, -16, ground_m + 1.2), (16, 16, ground_m + 2.4), 3.0),
    "take_off": _take_off,
    "near": lambda ground_m, rng: _box((8, -2, -1), (25, 2, 3), 3.0),
    "far": lambda ground_m, rng: _box((25, -8, 5), (70, 8, 22), 8.0),
    "above": lambda ground_m, rng: _box((-6, -6, 12), (6, 6, 35), 5.0),
}


class Drawn(Simulation):
    """A scenario with the clutter of a kind."""

    def __init__(self, scenario: Scenario, seed: int, kind: Kind) -> None:
        super().__init__(scenario, seed)
        self._kind = kind
        self.things += kind.things(self, np.random.default_rng([seed, _THINGS]))

    def frames(self, sensor: str) -> Iterator[SimulatedFrame]:
        """Frames as the sensor hands them over, without those that are lost."""
        rng = np.random.default_rng([self.seed, _FRAMES])
        for frame in super().frames(sensor):
            altered = self._kind.alter(self, frame, rng)
            if altered is not None:
                yield altered

    def shows_its_drone(self) -> bool:
        """True if the drone is in view for long and flies through nothing that stands there."""
        (drone,) = self.drones
        standing = [one for one in self.things if one.kind in ("building", "pole", "crown")]
        width_m, duration_s = float(drone.size_m.max()), self.scenario.duration_s
        return (
            is_clear(standing, drone.centres, width_m, duration_s)
            and np.mean([row.in_view for row in self.truth()]) >= _LEAST_SEEN
        )


def draw(
    kind: str, sensor: str, seed: int, duration_s: float | None = None
) -> Iterator[tuple[str, Drawn]]:
    """The name of the flight and its scene, then the same clutter with nobody in it.

    The sensor is one of MODELS.
    """
    rng = np.random.default_rng([seed, _DRAW, *f"{kind} {sensor}".encode()])
    clutter = KINDS[kind]
    frames_s = _LEAST_FRAMES * MODELS[sensor].frame_ns / NS_PER_S
    empty = Scenario(
        sensors={sensor: Sensor(sensor)},
        scene=clutter.scene,
        duration_s=duration_s or max(_LEAST_S, frames_s),
        point_times=bool(rng.integers(2)),
    )
    flights = suited(sensor, clutter.scene.ground_z_m)
    for _ in range(_TRIES):
        name = flights[rng.integers(len(flights))]
        drone = Drone(FLIGHTS[name](clutter.scene.ground_z_m, rng))
        scenario = dataclasses.replace(empty, drones=(drone,))
        flown = Drawn(scenario, int(rng.integers(2**32)), clutter)
        if flown.shows_its_drone():
            break
    yield name, flown
    yield NOBODY, Drawn(empty, flown.seed, clutter)


def suited(sensor: str, ground_m: float) -> list[str]:
    """The flights most places of which the sensor looks at, half of them within its range."""
    model, rng, found = MODELS[sensor], np.random.default_rng(0), []
    for name, make in FLIGHTS.items():
        flight = make(ground_m, rng)
        places = np.array([place for _, *place in flight.waypoints])
        if flight.box_m is not None:
            places = rng.uniform(*flight.box_m, (1000, 3))
        is_in_view = in_field_of_view(model, places).mean() >= _LEAST_IN_VIEW
        range_m = np.median(np.linalg.norm(places, axis=1))
        if is_in_view and range_m <= model.range_at_10_percent_m:
            found.append(name)
    return found
