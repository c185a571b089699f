"""Objects of a scenario: static, driving and flying."""

import numpy as np

from unlidar.simulate.fixtures import beside, fixtures, place, pole
from unlidar.simulate.flight import Path, make_path, random_path, swaying, undulating
from unlidar.simulate.scenario import Flight, Scenario, Scene
from unlidar.simulate.world import SceneObject, is_clear

_TRUNK_WIDTH_M = 0.35
_WALKER_SIZE_M = (0.45, 0.45, 1.75)
_WALKER_SPEED_MPS = 1.6
_CAR_SIZE_M = (4.2, 1.8, 1.5)
_CAR_SPEED_MPS = (4.0, 12.0)
_CAR_REACH_M = 60.0  # half of a road's length
_BIRD_SPAN_M = (0.15, 0.38)
_BIRD_SPEED_MPS = 9.0
_BIRD_HEIGHT_M = (3.0, 18.0)
_BIRD_REACH_M = 30.0
_INSECT_WIDTH_M = 0.03  # effective width for beams wider than the insect
_INSECT_REACH_M = 4.0
_INSECT_SPEED_MPS = 1.5
_FLIGHT_TRIES = 200
_MARGIN_S = 2.0  # paths go on for this long behind the end of the scenario


def build_world(scenario: Scenario, rng: np.random.Generator) -> list[SceneObject]:
    """All objects: ground, listed and random ones; the drones come last."""
    scene = scenario.scene
    ground = np.array([0.0, 0.0, scene.ground_z_m])
    things = [SceneObject("ground", ground, np.full(3, np.inf), 0.3)]
    for b in scene.buildings:
        centre = ground + np.array([*b.centre_m, b.size_m[2] / 2])
        yaw = float(np.radians(b.yaw_deg))
        things.append(SceneObject("building", centre, np.array(b.size_m), 0.4, yaw))
    things += [_random_building(scene, rng) for _ in range(scene.random_buildings)]
    for _ in range(scene.poles):
        things.append(pole(scene, place(scene, rng), 0.15, rng.uniform(4, 9), 0.3))
    for _ in range(scene.trees):
        things += _tree(scene, rng)
    time_s = scenario.duration_s + _MARGIN_S
    things += [_walker(scene, time_s, rng) for _ in range(scene.walkers)]
    things += [_car(scene, scenario.duration_s, rng) for _ in range(scene.cars)]
    things += [_bird(scene, time_s, rng) for _ in range(scene.birds)]
    things += [_insect(scene, time_s, rng) for _ in range(scene.insects)]
    things += fixtures(scene, rng)
    for drone in scenario.drones:
        size = np.array(drone.size_m)
        path = _clear_path(drone.flight, things, float(size.max()), time_s, rng)
        things.append(
            SceneObject(
                "drone", path(np.zeros(1))[0], size, drone.reflectivity, 0.0, drone.fill, path
            )
        )
    return things


def _clear_path(
    flight: Flight,
    things: list[SceneObject],
    width_m: float,
    time_s: float,
    rng: np.random.Generator,
) -> Path:
    """A path that keeps clear of what stands there: no drone flies through a tree.

    Waypoints are taken as they are. Where no draw is clear, as in a box full of trees, the last
    one is taken.
    """
    path = make_path(flight, time_s, rng)
    for _ in range(_FLIGHT_TRIES):
        if flight.waypoints or is_clear(things, path, width_m, time_s):
            break
        path = make_path(flight, time_s, rng)
    return path


def _random_building(scene: Scene, rng: np.random.Generator) -> SceneObject:
    size = rng.uniform([8, 6, 4], [20, 12, 14])
    clear = scene.clear_m + np.hypot(size[0], size[1]) / 2
    if scene.along_m > 0:
        foot = beside(scene, clear, scene.radius_m + clear, rng)
    else:
        radius, angle = rng.uniform(clear, scene.radius_m + clear), rng.uniform(0, 2 * np.pi)
        foot = np.array([radius * np.cos(angle), radius * np.sin(angle), scene.ground_z_m])
    centre = foot + np.array([0.0, 0.0, size[2] / 2])
    return SceneObject("building", centre, size, rng.uniform(0.2, 0.6), rng.uniform(0, np.pi))


def _tree(scene: Scene, rng: np.random.Generator) -> list[SceneObject]:
    """A trunk and a crown of one to three ellipsoids around its top."""
    foot = place(scene, rng)
    height = rng.uniform(4, 10)
    things = [pole(scene, foot, _TRUNK_WIDTH_M, 0.5 * height, 0.2)]
    for _ in range(rng.integers(1, 4)):
        size = rng.uniform(0.35, 0.6, 3) * height
        offset = rng.normal(0, 0.1, 3) * height
        centre = foot + np.array([0.0, 0.0, 0.7 * height]) + offset
        reflectivity = rng.uniform(0.2, 0.45)
        path = swaying(centre, scene.sway_m, rng) if scene.sway_m > 0 else None
        things.append(SceneObject("crown", centre, size, reflectivity, path=path))
    return things


def _walker(scene: Scene, time_s: float, rng: np.random.Generator) -> SceneObject:
    size = np.array(_WALKER_SIZE_M)
    reach = min(scene.radius_m, 20.0)
    waist = scene.ground_z_m + size[2] / 2
    low, high = np.array([-reach, -reach, waist]), np.array([reach, reach, waist])
    path = random_path(low, high, _WALKER_SPEED_MPS, 2.0, time_s, rng)
    return SceneObject("walker", path(np.zeros(1))[0], size, 0.3, path=path)


def _car(scene: Scene, duration_s: float, rng: np.random.Generator) -> SceneObject:
    """Passes the station on a straight road, nearest to it some time in the scenario."""
    size = np.array(_CAR_SIZE_M)
    yaw = rng.uniform(-np.pi, np.pi)
    along = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    aside = np.array([-along[1], along[0], 0.0])
    nearest = aside * (scene.clear_m + size[0] / 2 + rng.uniform(0, 12))
    nearest[2] = scene.ground_z_m + size[2] / 2
    speed = rng.uniform(*_CAR_SPEED_MPS)
    passes_s = rng.uniform(0.2, 0.8) * duration_s

    def path(time_s: np.ndarray) -> np.ndarray:
        way = np.clip((time_s - passes_s) * speed, -_CAR_REACH_M, _CAR_REACH_M)
        return nearest + way[:, None] * along

    return SceneObject("car", path(np.zeros(1))[0], size, 0.3, yaw, path=path)


def _bird(scene: Scene, time_s: float, rng: np.random.Generator) -> SceneObject:
    """A body and wings as a flat ellipsoid that bobs and shows its wings with every beat."""
    span = rng.uniform(*_BIRD_SPAN_M)
    size = np.array([span, span, 0.4 * span])
    low, high = (scene.ground_z_m + height for height in _BIRD_HEIGHT_M)
    reach = min(scene.radius_m, _BIRD_REACH_M)
    box = np.array([[-reach, -reach, low], [reach, reach, high]])
    way = random_path(*box, _BIRD_SPEED_MPS, 1.0, time_s, rng)
    beat_hz = rng.uniform(4, 10)
    path = undulating(way, height_m=0.1 * span, turns_hz=beat_hz)
    centre = path(np.zeros(1))[0]
    return SceneObject("bird", centre, size, 0.3, fill=0.7, path=path, flap_hz=beat_hz)


def _insect(scene: Scene, time_s: float, rng: np.random.Generator) -> SceneObject:
    """Dances about near the station."""
    size = np.full(3, _INSECT_WIDTH_M)
    middle = rng.uniform([-1, -1, 0.3], [1, 1, 0.9]) * _INSECT_REACH_M
    path: Path = random_path(middle - 1.0, middle + 1.0, _INSECT_SPEED_MPS, 0.4, time_s, rng)
    return SceneObject("insect", path(np.zeros(1))[0], size, 0.3, path=path)
