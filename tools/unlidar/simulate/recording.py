"""Frames of a scenario: rays, hits, noise, and the files of a whole recording."""

import dataclasses
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from unlidar import __version__
from unlidar.frames_io import write_pcd
from unlidar.output import complete_directory
from unlidar.pose_files import poses_name
from unlidar.poses import Poses, write_poses
from unlidar.progress import with_progress
from unlidar.simulate.carrier import Motion, exact_poses, noisy
from unlidar.simulate.population import build_world
from unlidar.simulate.scenario import Scenario, Sensor
from unlidar.simulate.sensors import (
    MODELS,
    SensorModel,
    detection_probability,
    in_field_of_view,
    scan,
)
from unlidar.simulate.weather import Window, fog_transmission, stray_kinds
from unlidar.simulate.world import SceneObject, cast, is_hidden
from unlidar.stamps import NS_PER_S, format_stamp
from unlidar.station import Pose, write_station
from unlidar.truth import TRUTH_NAME

_TRUTH_STEP_NS = 20_000_000
_WORLD_STREAM = 0  # random stream of the world; the sensors' follow
_MOTION_STREAM, _NOISE_STREAM = 1, 2  # within that of the world
TRUE_POSES_NAME = "true_poses.tum"
STRAY = -1  # `thing` of a return from no object


@dataclass(frozen=True)
class SimulatedFrame:
    """The returns of one frame, in the order in which they were measured."""

    sensor: str
    stamp_ns: int  # of its first ray, by the sensor's own clock
    begin_ns: int  # of its first ray since the begin of the scenario
    xyz_m: np.ndarray  # (N, 3) relative to the sensor, axes of the station or its carrier
    time_ns: np.ndarray  # (N,) after the stamp
    thing: np.ndarray  # (N,) index of the object hit, or STRAY


@dataclass(frozen=True)
class TruthRow:
    """Position of a drone at an instant."""

    time_ns: int
    target: int
    xyz_m: np.ndarray  # (3,)
    in_view: bool


class Simulation:
    """A scenario with a seed, which determines world, flights and frames."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        self.scenario = scenario
        self.seed = seed
        self.things = build_world(scenario, np.random.default_rng([seed, _WORLD_STREAM]))
        rng = np.random.default_rng([seed, _WORLD_STREAM, _MOTION_STREAM])
        self._motion = scenario.carrier and Motion(scenario.carrier, rng)

    @property
    def drones(self) -> list[SceneObject]:
        """In the order of the truth's `target`."""
        return [thing for thing in self.things if thing.kind == "drone"]

    def frame_count(self, sensor: str) -> int:
        """Number of frames of a sensor."""
        frame_ns = MODELS[self.scenario.sensors[sensor].model].frame_ns
        return round(self.scenario.duration_s * NS_PER_S / frame_ns)

    def frames(self, sensor: str) -> Iterator[SimulatedFrame]:
        """The frames of a sensor in order of time."""
        spec = self.scenario.sensors[sensor]
        model = MODELS[spec.model]
        stream = _WORLD_STREAM + 1 + sorted(self.scenario.sensors).index(sensor)
        rng = np.random.default_rng([self.seed, stream])
        phase = (float(rng.random()), float(rng.random()))
        window = Window(spec.window_dirt, np.random.default_rng([self.seed, stream, 0]))
        for index in range(self.frame_count(sensor)):
            yield self._frame(sensor, spec, model, index, phase, window, rng)

    def carried(self) -> list[str]:
        """The sensors that move."""
        return [n for n, s in self.scenario.sensors.items() if self._motion and s.on_carrier]

    def poses(self) -> tuple[Poses, Poses]:
        """Those of the carrier, which there must be: the true ones, and as they are measured."""
        carrier, motion = self.scenario.carrier, self._motion
        assert carrier is not None
        assert motion is not None
        latest_s = max(sensor.start_s for sensor in self.scenario.sensors.values())
        begin_ns = self.scenario.start_time_s * NS_PER_S
        duration_s = self.scenario.duration_s + latest_s
        poses = exact_poses(motion, carrier.pose_rate_hz, begin_ns, duration_s)
        rng = np.random.default_rng([self.seed, _WORLD_STREAM, _NOISE_STREAM])
        return poses, noisy(poses, carrier, rng)

    def truth(self) -> Iterator[TruthRow]:
        """Every drone 50 times a second, drone by drone.

        A drone is in view where the field of view of a sensor holds its centre and neither the
        ground nor a building stands before it, nor as many leaves as stop nine of ten rays.
        """
        steps = np.arange(0, round(self.scenario.duration_s * NS_PER_S), _TRUTH_STEP_NS)
        for target, drone in enumerate(self.drones):
            positions = drone.centres(steps * 1e-9)
            in_view = np.zeros(len(steps), dtype=bool)
            for sensor in self.scenario.sensors.values():
                origin, axes = self._placed(sensor, steps * 1e-9)
                relative = positions - origin
                relative = relative if axes is None else axes.inv().apply(relative)
                seen = in_field_of_view(MODELS[sensor.model], relative)
                in_view |= seen & ~is_hidden(self.things, origin, positions, steps * 1e-9)
            for time_ns, position, seen in zip(steps, positions, in_view, strict=True):
                stamp_ns = self.scenario.start_time_s * NS_PER_S + int(time_ns)
                yield TruthRow(stamp_ns, target, position, bool(seen))

    def _placed(self, spec: Sensor, time_s: np.ndarray) -> tuple[np.ndarray, Rotation | None]:
        """Where a sensor is at these times, (N, 3), and its axes; (3,) and none at rest."""
        place = np.array(spec.position_m)
        if self._motion is None or not spec.on_carrier:
            return place, None
        position, axes = self._motion.at(time_s)
        return position + axes.apply(place), axes

    def _frame(
        self,
        name: str,
        spec: Sensor,
        model: SensorModel,
        index: int,
        phase: tuple[float, float],
        window: Window,
        rng: np.random.Generator,
    ) -> SimulatedFrame:
        begin_ns = round(spec.start_s * NS_PER_S) + index * model.frame_ns
        direction, time_ns = scan(model, index, phase)
        time_s = (begin_ns + time_ns) * 1e-9
        origin, axes = self._placed(spec, time_s)
        towards = direction if axes is None else axes.apply(direction)
        hits = cast(self.things, origin, towards, time_s, rng)
        scene = self.scenario.scene
        is_dirty = window.is_dirty(direction)
        echo = hits.echo * fog_transmission(scene.fog, hits.distance_m)
        echo = echo * window.transmission(is_dirty)
        chance = detection_probability(model, hits.distance_m, echo, hits.width_m)
        returned = (rng.random(len(direction)) < chance) & np.isfinite(hits.distance_m)
        distance = hits.distance_m + rng.normal(0, model.range_noise_m, len(direction))
        thing = hits.thing

        # A stray return replaces a ray's own if no object is nearer.
        for mean, ranges, is_on_window in stray_kinds(scene, spec, model):
            rays = rng.integers(0, len(direction), rng.poisson(mean))
            at = ranges(rng, hits.distance_m[rays])
            comes = at < hits.distance_m[rays]
            if is_on_window:
                comes &= is_dirty[rays]
            rays = rays[comes]
            distance[rays], thing[rays], returned[rays] = at[comes], STRAY, True

        offset_ns = round((spec.time_offset_s + spec.clock_error_s) * NS_PER_S)
        return SimulatedFrame(
            sensor=name,
            stamp_ns=self.scenario.start_time_s * NS_PER_S + begin_ns - offset_ns,
            begin_ns=begin_ns,
            xyz_m=direction[returned] * distance[returned, None],
            time_ns=time_ns[returned],
            thing=thing[returned],
        )


def simulate(scenario: Scenario, out: Path, seed: int, force: bool = False) -> dict:
    """`write_recording` of a scenario with a seed."""
    return write_recording(Simulation(scenario, seed), out, force)


def write_recording(simulation: Simulation, out: Path, force: bool = False) -> dict:
    """Writes frames, truth, poses and scenario.json to the folder `out` and returns the latter."""
    scenario = simulation.scenario
    point_times = scenario.point_times
    expected = sum(map(simulation.frame_count, scenario.sensors))
    counts, returns = dict.fromkeys(scenario.sensors, 0), dict.fromkeys(scenario.sensors, 0)
    with complete_directory(out, force) as work:
        for name in scenario.sensors:
            (work / name).mkdir()
        frames = (frame for name in scenario.sensors for frame in simulation.frames(name))
        for frame in with_progress(frames, expected, "Simulating"):
            path = work / frame.sensor / f"{format_stamp(frame.stamp_ns)}.pcd"
            write_pcd(path, frame.xyz_m, {"t": frame.time_ns.astype("u4")} if point_times else {})
            counts[frame.sensor] += 1
            returns[frame.sensor] += len(frame.xyz_m)
        _write_truth(work / TRUTH_NAME, simulation.truth())
        poses = {
            name: Pose(sensor.position_m, time_offset_s=sensor.time_offset_s)
            for name, sensor in scenario.sensors.items()
        }
        if any(pose != Pose() for pose in poses.values()):
            write_station(work, poses, "Poses and clocks of the simulated LiDARs")
        if simulation.carried():
            _write_poses(work, simulation)
        report = {
            "version": __version__,
            "seed": simulation.seed,
            "frames": counts,
            "returns": returns,
            "scenario": dataclasses.asdict(scenario),
        }
        (work / "scenario.json").write_text(json.dumps(report, indent=2) + "\n")
    return report


def _write_poses(folder: Path, simulation: Simulation) -> None:
    """The measured poses as the program takes them, and the true ones."""
    true, measured = simulation.poses()
    write_poses(folder / TRUE_POSES_NAME, true, "True poses of the simulated carrier")
    carried = simulation.carried()
    is_of_all = len(carried) == len(simulation.scenario.sensors)
    for name in [poses_name()] if is_of_all else map(poses_name, carried):
        write_poses(folder / name, measured, "Measured poses of the simulated carrier")


def _write_truth(path: Path, rows: Iterator[TruthRow]) -> None:
    with path.open("w") as file:
        file.write("timestamp,target,x,y,z,in_view\n")
        for row in rows:
            x, y, z = row.xyz_m
            stamp = format_stamp(row.time_ns)
            file.write(f"{stamp},{row.target},{x:.6f},{y:.6f},{z:.6f},{int(row.in_view)}\n")
