"""Scenes to be measured: frames, truth, weather in the frames, and who is told the returns."""

import argparse
import shlex
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from unlidar.errors import InputError, reason
from unlidar.frames_io import FrameFile, find_sensors, list_frames, read_pcd, write_pcd
from unlidar.point_times import TIME_FIELDS, offsets_ns
from unlidar.pose_files import find_poses, poses_options
from unlidar.station import read_station, station_options
from unlidar.truth import TRUTH_NAME, Tracks, Truth, read_truth

from unlidar_bench.weather import Air, Weather, cloud_of

_DRONE_M, _GAP_S = 0.6, 5.0  # of one who is told the returns: so near the truth, over such gaps
_END_SLACK_S = 0.1  # and so long before the first of them and after the last


@dataclass(frozen=True)
class Flight:
    """A scene: frame folders, further options of the program, and the truth."""

    name: str
    sensors: dict[str, Path]
    options: list[str]
    truth: Truth


def flight_of(folder: Path) -> Flight:
    """By its cmd.txt, else as `unlidar run` takes it."""
    truth = read_truth(folder / TRUTH_NAME)
    name = f"{folder.resolve().parent.name}/{folder.resolve().name}"
    command = folder / "cmd.txt"
    if not command.is_file():
        sensors = find_sensors(folder)
        options = station_options(read_station(folder), sensors)
        options += poses_options(find_poses(folder, sensors))
        return Flight(name, sensors, options, truth)
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--frames", action="append", default=[])
    try:
        words = shlex.split(command.read_text())
    except (OSError, ValueError) as error:
        raise InputError(f"{command}: {reason(error)}, expected options of a command") from error
    known, options = parser.parse_known_args(words)
    pairs = [frames.rpartition("=") for frames in known.frames]
    return Flight(name, {n or Path(d).name: Path(d) for n, _, d in pairs}, options, truth)


def put_weather(
    flight: Flight, weather: Weather, seed: int, out: Path
) -> tuple[dict[str, Path], Tracks]:
    """Writes the frames to `out`, and returns their folders and what one told the returns says.

    In clear air nothing is written: the folders are the scene's.
    """
    sensors, sightings = {}, []
    for number, (name, folder) in enumerate(flight.sensors.items()):
        frames = list_frames(folder)
        sensors[name], air = folder, None
        if weather.kind != "clear":
            rng = np.random.default_rng([seed, number, *weather.kind.encode()])
            air = Air(name, [frame.path for frame in frames], weather, rng)
            sensors[name] = _folder_like(folder, out / name)
        if air is None and len(flight.truth) == 0:
            continue  # nobody flies of whom one could be told
        for index, frame in enumerate(frames):
            fields, xyz_m = cloud_of(frame.path, read_pcd(frame.path))
            if air is not None:
                strength = weather.strength(frame.stamp_ns, seed)
                left, strays, likes = air.into(xyz_m, index, strength)
                cloud_m = np.concatenate([xyz_m[left], strays])
                rest = {
                    key: np.append(column[left], np.append(column, column.dtype.type(0))[likes])
                    for key, column in fields.items()
                }
                write_pcd(sensors[name] / frame.path.name, cloud_m, rest)
                fields = {key: column[left] for key, column in fields.items()}
                xyz_m = xyz_m[left]
            sightings += _sightings(flight.truth, _times_s(fields, frame), xyz_m)
    return sensors, _told(flight.truth, sightings)


def _folder_like(folder: Path, new: Path) -> Path:
    """The new folder, with the table of stamps of the other one."""
    new.mkdir(parents=True, exist_ok=True)
    if (table := folder / "timestamps.csv").is_file():
        shutil.copy(table, new)
    return new


def _times_s(fields: dict[str, np.ndarray], frame: FrameFile) -> np.ndarray:
    """Times of the returns (N,), or that of the frame (1,) for all where they have none."""
    times = next((fields[key] for key in TIME_FIELDS if key in fields), None)
    after_ns = None if times is None else offsets_ns(times, frame.stamp_ns)
    return frame.stamp_ns * 1e-9 + (np.zeros(1) if after_ns is None else after_ns * 1e-9)


def _sightings(
    truth: Truth, time_s: np.ndarray, xyz_m: np.ndarray
) -> list[tuple[float, float, float, float, float]]:
    """(target, time in s, x, y, z) of the mean of the returns (N, 3) near each target, if any."""
    found = []
    time_s = np.broadcast_to(time_s, len(xyz_m))
    for target in np.unique(truth.target):
        mine = truth.target == target
        own_s, own_m = truth.time_s[mine], truth.xyz_m[mine]
        at_m = np.stack([np.interp(time_s, own_s, own_m[:, i]) for i in range(3)], axis=1)
        near = np.linalg.norm(xyz_m - at_m, axis=1) < _DRONE_M
        if near.any():
            found.append((target, time_s[near].mean(), *xyz_m[near].mean(axis=0)))
    return found


def _told(truth: Truth, sightings: Sequence[tuple[float, float, float, float, float]]) -> Tracks:
    """Straight lines from sighting to sighting of each target, at the times of its truth."""
    rows = [np.zeros((0, 5))]
    known = np.array(sorted(sightings)).reshape(-1, 5)
    for target in np.unique(truth.target):
        own_s = truth.time_s[truth.target == target]
        seen_s, *seen_m = known[known[:, 0] == target, 1:].T
        if len(seen_s) < 2:
            continue
        after = np.clip(np.searchsorted(seen_s, own_s), 1, len(seen_s) - 1)
        inside = (seen_s[after] - seen_s[after - 1] <= _GAP_S) & (
            np.abs(own_s - np.clip(own_s, seen_s[0], seen_s[-1])) <= _END_SLACK_S
        )
        at_s = own_s[inside]
        lines = [np.interp(at_s, seen_s, column) for column in seen_m]
        rows.append(np.column_stack([at_s, np.full(len(at_s), target), *lines]))
    joined = np.concatenate(rows)
    return Tracks(joined[:, 0], joined[:, 1], joined[:, 2:])
