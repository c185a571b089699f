"""Recordings by the project's own simulator, made where they are missing."""

import shutil
from pathlib import Path

from unlidar_tools.frames_io import find_sensors
from unlidar_tools.play import frames_in_order
from unlidar_tools.simulate import load_scenario, simulate
from unlidar_tools.simulate.scenario import Drone, Flight, Scenario, Scene, Sensor
from unlidar_tools.stamps import format_stamp_ns

from unlidar_bench.setting import Setting

STATION = {"mid360": Sensor("mid360"), "avia": Sensor("avia", start_s=0.013)}


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
    waypoints = ((0.0, -70.0, 10.0, 14.0), (0.3 * end, -12.0, 6.0, 10.0), (0.5 * end, 8.0, -4.0, 8.0),
                 (0.7 * end, 14.0, 10.0, 12.0), (end, 70.0, 20.0, 14.0))  # fmt: skip
    scenario = Scenario(
        sensors,
        drones=(Drone(Flight(waypoints=waypoints)),),
        scene=Scene(random_buildings=8, trees=30, walkers=2, cars=1),
        duration_s=duration_s,
        point_times=timed,
    )
    return _made(setting, f"{name}_{duration_s:g}", scenario, 1)


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
