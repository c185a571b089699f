"""Man-made objects, static and moving: poles, gantries, cables, flags, chimneys."""

import itertools

import numpy as np

from unlidar.simulate.flight import swaying
from unlidar.simulate.scenario import Scene
from unlidar.simulate.world import SceneObject

_UP = np.array([0.0, 0.0, 1.0])
_GANTRY_BEYOND_CLEAR_M = 10.0  # signs are near enough to be cut by the edge of a field of view
_BEAM_M = 0.3
_SIGN_REFLECTIVITY = 0.8
_CABLE_RODS = 8
_FLAG_DEPTH_M = 0.04
_PUFFS = 6
_PUFF_LIFE_S = 5.0
_NEW_PUFF = 0.15  # initial size as a share of the final one


def fixtures(scene: Scene, rng: np.random.Generator) -> list[SceneObject]:
    """The fixtures of a scene; absent kinds consume no random numbers."""
    makers = [_gantry] * scene.gantries + [_cable] * scene.cables
    makers += [_flag] * scene.flags + [_chimney] * scene.steam
    return [thing for make in makers for thing in make(scene, rng)]


def place(scene: Scene, rng: np.random.Generator) -> np.ndarray:
    """A place on the ground, uniform over the ring around the station or both sides of the way."""
    if scene.along_m > 0:
        return beside(scene, scene.clear_m, scene.radius_m, rng)
    radius = np.sqrt(rng.uniform(scene.clear_m**2, scene.radius_m**2))
    angle = rng.uniform(0, 2 * np.pi)
    return np.array([radius * np.cos(angle), radius * np.sin(angle), scene.ground_z_m])


def beside(
    scene: Scene, nearest_m: float, farthest_m: float, rng: np.random.Generator
) -> np.ndarray:
    """A place on the ground beside the way along the x axis, at a distance between these."""
    reach_m = scene.along_m / 2
    side = rng.choice([-1.0, 1.0]) * rng.uniform(nearest_m, farthest_m)
    return np.array([rng.uniform(-reach_m, reach_m), side, scene.ground_z_m])


def pole(
    scene: Scene, foot: np.ndarray, width_m: float, height_m: float, reflectivity: float
) -> SceneObject:
    """Upright, on the ground."""
    centre = np.array([foot[0], foot[1], scene.ground_z_m + height_m / 2])
    return SceneObject("pole", centre, np.array([width_m, width_m, height_m]), reflectivity)


def _gantry(scene: Scene, rng: np.random.Generator) -> list[SceneObject]:
    """A beam on two poles across a road, and one to three signs on it that face the station."""
    angle, yaw_off = rng.uniform(0, 2 * np.pi), rng.uniform(-0.5, 0.5)
    away_m = scene.clear_m + rng.uniform(0, _GANTRY_BEYOND_CLEAR_M)
    middle = np.array([away_m * np.cos(angle), away_m * np.sin(angle), scene.ground_z_m])
    yaw = angle + np.pi / 2 + yaw_off
    along = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    span_m, height_m = rng.uniform(8, 13), rng.uniform(5, 7)
    things = [
        pole(scene, middle + side * span_m / 2 * along, _BEAM_M, height_m, 0.3) for side in (-1, 1)
    ]
    beam = np.array([span_m, _BEAM_M, _BEAM_M])
    things.append(SceneObject("sign", middle + height_m * _UP, beam, 0.3, yaw))
    number = rng.integers(1, 4)
    for i in range(number):
        size = np.array([rng.uniform(1.5, 0.9 * span_m / number), 0.1, rng.uniform(1.2, 2.5)])
        centre = middle + height_m * _UP + (i + 0.5 - number / 2) * span_m / number * along
        things.append(SceneObject("sign", centre, size, _SIGN_REFLECTIVITY, yaw))
    return things


def _cable(scene: Scene, rng: np.random.Generator) -> list[SceneObject]:
    """It hangs between two poles as a parabola, with two to four things below it."""
    foot, yaw = place(scene, rng), rng.uniform(0, 2 * np.pi)
    length_m, height_m, sag_m = rng.uniform(15, 35), rng.uniform(6, 9), rng.uniform(0.2, 0.8)
    along = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    things = [pole(scene, foot + way * along, 0.2, height_m, 0.3) for way in (0.0, length_m)]

    def at(share: np.ndarray) -> np.ndarray:
        height = height_m - 4 * sag_m * share * (1 - share)
        return foot + share[:, None] * length_m * along + height[:, None] * _UP

    knots = at(np.linspace(0, 1, _CABLE_RODS + 1))
    for begin, end in itertools.pairwise(knots):
        things.append(SceneObject("cable", (begin + end) / 2, end - begin, 0.2))
    for hook in at(rng.uniform(0.1, 0.9, rng.integers(2, 5))):
        size = np.array([1.0, 1.0, rng.uniform(0.8, 1.6)]) * rng.uniform(0.15, 0.4)
        centre = hook - size[2] / 2 * _UP
        path = swaying(centre, scene.sway_m, rng) if scene.sway_m > 0 else None
        things.append(SceneObject("hanging", centre, size, 0.3, path=path))
    return things


def _flag(scene: Scene, rng: np.random.Generator) -> list[SceneObject]:
    """It waves fast by a little and turns slowly with the wind, about its pole."""
    foot, height_m = place(scene, rng), rng.uniform(5, 9)
    size = np.array([rng.uniform(1.2, 2.0), _FLAG_DEPTH_M, rng.uniform(0.8, 1.3)])
    top = foot + (height_m - size[2] / 2) * _UP
    wind_rad = rng.uniform(0, 2 * np.pi)
    waves = [  # rad, Hz, begin
        (reach, rng.uniform(*hz), rng.random())
        for reach, hz in ((0.5, (0.05, 0.2)), (0.25, (0.3, 0.8)), (0.15, (1.5, 3.0)))
    ]

    def turn(time_s: np.ndarray) -> np.ndarray:
        return wind_rad + sum(
            reach * np.sin(2 * np.pi * (hz * time_s + begin)) for reach, hz, begin in waves
        )

    def path(time_s: np.ndarray) -> np.ndarray:
        yaw = turn(time_s)
        arm = np.stack([np.cos(yaw), np.sin(yaw), np.zeros(len(yaw))], axis=1)
        return top + size[0] / 2 * arm

    flag = SceneObject("flag", top, size, 0.4, path=path, turn=turn)
    return [pole(scene, foot, 0.1, height_m, 0.3), flag]


def _chimney(scene: Scene, rng: np.random.Generator) -> list[SceneObject]:
    """Puffs leave it one after another, each on a way of its own."""
    foot, height_m = place(scene, rng), rng.uniform(3, 8)
    top = foot + height_m * _UP
    heading, wind_mps = rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 2.0)
    velocity = np.array(
        [wind_mps * np.cos(heading), wind_mps * np.sin(heading), rng.uniform(0.8, 1.8)]
    )
    size = rng.uniform(1.5, 3.5) * np.array([1.0, 1.0, 0.8])
    chimney = pole(scene, foot, rng.uniform(0.4, 0.8), height_m, 0.3)
    return [chimney, *(_puff(top, velocity, size, i, rng) for i in range(_PUFFS))]


def _puff(
    top: np.ndarray, velocity: np.ndarray, size: np.ndarray, number: int, rng: np.random.Generator
) -> SceneObject:
    """It begins anew when it has thinned out, on another way."""
    begins_s = number * _PUFF_LIFE_S / _PUFFS
    drift_mps, phases = 0.3 * np.linalg.norm(velocity), rng.uniform(0, 2 * np.pi, 3)

    def lives(time_s: np.ndarray) -> np.ndarray:
        return (time_s - begins_s) / _PUFF_LIFE_S

    def growth(time_s: np.ndarray) -> np.ndarray:
        return _NEW_PUFF + (1 - _NEW_PUFF) * (lives(time_s) % 1.0)

    def path(time_s: np.ndarray) -> np.ndarray:
        life, share = np.divmod(lives(time_s), 1.0)
        # Pseudo-random per life: sines of widely spaced numbers.
        drift = drift_mps * np.sin(life[:, None] * [2.4, 3.9, 5.3] + phases)
        return top + share[:, None] * _PUFF_LIFE_S * (velocity + drift)

    return SceneObject("puff", top, size, 0.15, path=path, growth=growth)
