"""Recordings by the project's own simulator, made where they are missing."""

import shutil
from pathlib import Path

from unlidar.frames_io import find_sensors, list_frames
from unlidar.play import frames_in_order
from unlidar.simulate import Simulation, load_scenario, simulate
from unlidar.simulate.scenario import Drone, Flight, Scenario, Scene, Sensor
from unlidar.stamps import format_stamp_ns

from unlidar_bench.setting import Setting

FLIGHTS = {
    "before walls and trees": ((-12.0, -12.0, -1.0), (12.0, 12.0, 3.0)),
    "before the sky": ((-25.0, -25.0, 5.0), (25.0, 25.0, 9.0)),
}
MODELS = {"Mid-360": "mid360", "spinning, 64 beams": "spinning64"}  # by names in tables
STATION = {"mid360": Sensor("mid360"), "avia": Sensor("avia", start_s=0.013)}

_SWARM_M = ((-30.0, -30.0, 3.0), (30.0, 30.0, 12.0))


def scene(setting: Setting, name: str, seed: int) -> Path:
    """A scenario that comes along."""
    return _made(setting, f"{name}_{seed}", load_scenario(name), seed)


def turn(
    setting: Setting, name: str, sensors: dict[str, Sensor], duration_s: float, timed: bool = False
) -> Path:
    """What can be played again and again: a drone comes from behind the trees and leaves.

    People and a car pass below. `timed`: each return has a time of its own.
    """
    end = duration_s
    waypoints = (
        (0.0, -70.0, 10.0, 14.0),
        (0.3 * end, -12.0, 6.0, 10.0),
        (0.5 * end, 8.0, -4.0, 8.0),
        (0.7 * end, 14.0, 10.0, 12.0),
        (end, 70.0, 20.0, 14.0),
    )
    scenario = Scenario(
        sensors,
        drones=(Drone(Flight(waypoints=waypoints)),),
        scene=Scene(random_buildings=8, trees=30, walkers=2, cars=1),
        duration_s=duration_s,
        point_times=timed,
    )
    return _made(setting, f"{name}_{duration_s:g}", scenario, 1)


def dense(setting: Setting, beams: int) -> Path:
    """The same place for a spinning sensor of so many beams."""
    sensors = {"spinning": Sensor(f"spinning{beams}")}
    return turn(setting, f"spinning{beams}", sensors, setting.dense_turn_s)


def flight(setting: Setting, model: str, where: str, seed: int) -> tuple[Path, Simulation]:
    """A drone in one of the boxes of FLIGHTS, people and a car below; and what it is made of."""
    scenario = Scenario(
        {model: Sensor(model)},
        drones=(Drone(Flight(box_m=FLIGHTS[where])),),
        scene=Scene(random_buildings=8, trees=20, walkers=2, cars=1, radius_m=40.0),
        duration_s=setting.flight_s,
    )
    name = f"{model}_{where.replace(' ', '_')}_{setting.flight_s:g}_{seed}"
    return _made(setting, name, scenario, seed), Simulation(scenario, seed)


def swarm(setting: Setting, model: str, drones: int, seed: int) -> Path:
    """So many drones at once, each on a random way of its own through the same box."""
    scenario = Scenario(
        {model: Sensor(model)},
        drones=(Drone(Flight(box_m=_SWARM_M)),) * drones,
        scene=Scene(random_buildings=8, trees=20, radius_m=60.0),
        duration_s=setting.swarm_s,
    )
    return _made(setting, f"{model}_swarm{drones}_{setting.swarm_s:g}_{seed}", scenario, seed)


def in_order(sensors: dict[str, Path]) -> dict[str, Path]:
    """The sensor that gives the output times first."""
    return dict(sorted(sensors.items(), key=lambda item: item[0] != "mid360"))


def part_of(setting: Setting, recording: Path, seconds: float) -> Path:
    """The folder of the first frames of its only sensor, as links to them."""
    (directory,) = find_sensors(recording).values()
    out = setting.work / "recordings" / f"{recording.name}_first_{seconds:g}"
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    frames = list_frames(directory)
    for frame in frames:
        if frame.stamp_ns - frames[0].stamp_ns < seconds * 1e9:
            (out / frame.path.name).symlink_to(frame.path.resolve())
    return out


def repeated(setting: Setting, recording: Path, seconds: float, turn_s: float) -> Path:
    """The recording again and again as one, as links to its frames with stamps that go on."""
    out = setting.work / "recordings" / f"{recording.name}_for_{seconds:g}"
    if out.is_dir():
        return out
    work = out.with_name(f".{out.name}")
    shutil.rmtree(work, ignore_errors=True)
    sensors = find_sensors(recording)
    for name in sensors:
        (work / name).mkdir(parents=True)
    for frame in frames_in_order(sensors, max(1, round(seconds / turn_s))):
        link = work / frame.sensor / f"{format_stamp_ns(frame.stamp_ns)}.pcd"
        link.symlink_to(frame.path.resolve())
    return work.rename(out)


def _made(setting: Setting, name: str, scenario: Scenario, seed: int) -> Path:
    out = setting.work / "recordings" / name
    if not out.is_dir():
        simulate(scenario, out, seed)
    return out
