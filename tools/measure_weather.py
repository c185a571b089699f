#!/usr/bin/env python3
"""Measures what weather costs: puts its returns into recordings, and tracks and judges these.

The scenes are folders as of make_scenes.py, make_hard.py, make_real.py or `unlidar simulate`. Each
is tracked as a recording and as a stream. Ranges of the returns, and what fog or dirt on the window
takes away, are those of unlidar.simulate.weather. Their rays are even over the field of view: in
the scan of a sensor that the simulator knows by its name, else in the azimuths and elevations that
the scene has returns from. A ray ends where recordings of that direction do.
In clear air the frames are tracked as they are.
"""

import argparse
import math
import shlex
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from unlidar.errors import report_errors
from unlidar.evaluation import evaluate
from unlidar.evaluation.markdown import percent, table_line
from unlidar.frames_io import FrameFile, find_sensors, list_frames, read_pcd, write_pcd
from unlidar.play import MessageSink, frames_in_order, play
from unlidar.point_times import TIME_FIELDS, offsets_ns
from unlidar.pose_files import find_poses, poses_options
from unlidar.program import find_program
from unlidar.record import read_object
from unlidar.station import read_station, station_options
from unlidar.truth import TRUTH_NAME, Tracks, Truth, read_tracks, read_truth
from unlidar_bench.processes import Usage, run, start
from unlidar_bench.weather import (
    DIRTY_SHARE,
    KINDS,
    VISIBILITY_M,
    Air,
    Weather,
    cloud_of,
    weather_of,
)

MODES = ("recording", "stream")
_DRONE_M, _GAP_S = 0.6, 5.0  # of one who is told the returns: so near the truth, over such gaps
_MEASURES = {
    "within1m": ("within 1 m", percent),
    "told": ("told", percent),
    "false": ("false rows", percent),
    "rmse": ("RMSE, m", "{:.3f}".format),
    "nees": ("NEES", "{:.2f}".format),
    "tracks": ("tracks", "{:.3g}".format),
    "blinded_s": ("blinded, s", "{:.0f}".format),
    "cpu_s": ("CPU, s", "{:.1f}".format),
    "memory_mb": ("MB", "{:.0f}".format),
}
_HEAD = tuple(head for head, _ in _MEASURES.values())


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
    known, options = parser.parse_known_args(shlex.split(command.read_text()))
    pairs = [frames.rpartition("=") for frames in known.frames]
    return Flight(name, {n or Path(d).name: Path(d) for n, _, d in pairs}, options, truth)


def put_weather(
    flight: Flight, weather: Weather, seed: int, out: Path
) -> tuple[dict[str, Path], Tracks]:
    """Writes the frames to `out`, and returns their folders and what one told the returns says.

    In clear air nothing is written: the folders are the scene's.
    """
    sensors, seen = {}, []
    for number, (name, folder) in enumerate(flight.sensors.items()):
        frames = list_frames(folder)
        if weather.kind == "clear":
            sensors[name] = folder
            for frame in frames:
                fields, xyz_m = cloud_of(frame.path, read_pcd(frame.path))
                seen.append((frame.stamp_ns, _after_ns(fields, frame), xyz_m))
            continue
        rng = np.random.default_rng([seed, number, *weather.kind.encode()])
        air = Air(name, [frame.path for frame in frames], weather, rng)
        sensors[name] = out / name
        sensors[name].mkdir(parents=True, exist_ok=True)
        if (table := folder / "timestamps.csv").is_file():
            shutil.copy(table, sensors[name])
        for index, frame in enumerate(frames):
            fields, xyz_m = cloud_of(frame.path, read_pcd(frame.path))
            left, strays, likes = air.into(xyz_m, index)
            rest = {
                key: np.append(column[left], np.append(column, column.dtype.type(0))[likes])
                for key, column in fields.items()
            }
            cloud_m = np.concatenate([xyz_m[left], strays])
            write_pcd(sensors[name] / frame.path.name, cloud_m, rest)
            fields = {key: column[left] for key, column in fields.items()}
            seen.append((frame.stamp_ns, _after_ns(fields, frame), xyz_m[left]))
    return sensors, told(flight.truth, seen)


def _after_ns(fields: dict[str, np.ndarray], frame: FrameFile) -> np.ndarray | int:
    """Times of the returns after the frame's stamp."""
    times = next((fields[key] for key in TIME_FIELDS if key in fields), None)
    after_ns = None if times is None else offsets_ns(times, frame.stamp_ns)
    return 0 if after_ns is None else after_ns


def told(truth: Truth, seen: list[tuple[int, np.ndarray | int, np.ndarray]]) -> Tracks:
    """Straight lines between the means of the returns near the truth, frame by frame."""
    rows = []
    for target in np.unique(truth.target):
        mine = truth.target == target
        own_s, own_m = truth.time_s[mine], truth.xyz_m[mine]
        means = []
        for stamp_ns, after_ns, xyz_m in seen:
            time_s = np.broadcast_to(stamp_ns * 1e-9 + after_ns * 1e-9, len(xyz_m))
            at_m = np.stack([np.interp(time_s, own_s, own_m[:, i]) for i in range(3)], axis=1)
            near = np.linalg.norm(xyz_m - at_m, axis=1) < _DRONE_M
            if near.any():
                means.append((time_s[near].mean(), *xyz_m[near].mean(axis=0)))
        if len(means) < 2:
            continue
        known = np.array(sorted(means))
        after = np.clip(np.searchsorted(known[:, 0], own_s), 1, len(known) - 1)
        bridged = known[after, 0] - known[after - 1, 0] <= _GAP_S
        inside = bridged & (own_s >= known[0, 0] - 0.1) & (own_s <= known[-1, 0] + 0.1)
        lines = [np.interp(own_s[inside], known[:, 0], known[:, i]) for i in (1, 2, 3)]
        rows.append(np.column_stack([own_s[inside], np.full(inside.sum(), target), *lines]))
    joined = np.concatenate([np.zeros((0, 5)), *rows])
    return Tracks(joined[:, 0], joined[:, 1], joined[:, 2:])


def track(
    mode: str, sensors: dict[str, Path], options: Sequence[str], out: Path
) -> tuple[Usage, Tracks, float]:
    """Usage of the program, its rows, and the seconds for which its sensors were blinded."""
    out.mkdir(parents=True, exist_ok=True)
    trajectory, summary = out / f"{mode}.csv", out / f"{mode}.json"
    command = [find_program(), "--quiet", "--out", trajectory, "--summary", summary, *options]
    if mode == "recording":
        frames = [part for name, d in sensors.items() for part in ("--frames", f"{name}={d}")]
        usage = run([*command, "--threads", "1", *frames])
    else:
        process = start([*command, "--stdin"])
        with suppress(BrokenPipeError):  # it says why when it is waited for
            play(frames_in_order(sensors), MessageSink(process.stdin), math.inf)
        usage = process.wait()
    blinded_s = sum(one.get("blinded_s", 0.0) for one in read_object(summary)["inputs"])
    return usage, read_tracks(trajectory), blinded_s


def measure(arguments: argparse.Namespace, folder: Path) -> Iterator[dict]:
    """One result for each scene, weather, switched off rule and mode."""
    for scene in arguments.scenes:
        flight = flight_of(scene)
        for weather in arguments.weather:
            out = folder / flight.name / str(weather).replace(" ", "_").replace(",", "")
            sensors, of_told = put_weather(flight, weather, arguments.seed, out)
            is_plain = not flight.options  # else the truth has axes of its own
            best = evaluate(flight.truth, of_told).get("within1m") if is_plain else None
            for rule in (None, *arguments.without):
                off = [] if rule is None else ["--set", f"robust.disabled_rules=[{rule}]"]
                for mode in arguments.modes:
                    options = [*flight.options, *arguments.options, *off]
                    usage, tracks, blinded_s = track(mode, sensors, options, out / f"{rule}")
                    yield {
                        "scene": flight.name, "weather": str(weather), "mode": mode,
                        "without": rule or "", "told": best, "cpu_s": usage.cpu_s,
                        "memory_mb": usage.memory_mb, "blinded_s": blinded_s,
                    } | evaluate(flight.truth, tracks)  # fmt: skip
            if arguments.into is None:
                shutil.rmtree(out)


def line_of(result: dict) -> str:
    rule = f" without {result['without']}" if result["without"] else ""
    return f"{result['scene']}, {result['weather']}, {result['mode']}{rule}: " + ", ".join(
        f"{name} {cell}" for name, cell in zip(_HEAD, cells([result]), strict=True)
    )


def cells(results: Sequence[dict]) -> list[str]:
    """Of several modes side by side: what is the same of all is said once."""
    columns = []
    for key, (_, spell) in _MEASURES.items():
        values = [one.get(key) for one in results]
        texts = ["-" if value is None else spell(value) for value in values]
        columns.append(texts[0] if key == "told" else ", ".join(texts))
    return columns


def mean_of(results: Sequence[dict]) -> dict:
    """Of each measure over those that have it."""
    known = {key: [one[key] for one in results if one.get(key) is not None] for key in _MEASURES}
    return {key: float(np.mean(values)) for key, values in known.items() if values}


def table(results: Sequence[dict], modes: Sequence[str]) -> str:
    """One row for all modes of a scene in a weather, and the mean of all rows of a program."""
    head = ("scene", "weather", "without", *_HEAD)
    lines = [f"Values: {', '.join(modes)}.", "", table_line(head)]
    lines.append("|---|---|---|" + "---:|" * len(_HEAD))
    for first in range(0, len(results), len(modes)):
        row = results[first : first + len(modes)]
        lines.append(
            table_line((*(row[0][key] for key in ("scene", "weather", "without")), *cells(row)))
        )
    for rule in dict.fromkeys(one["without"] for one in results):
        mine = [[r for r in results if (r["without"], r["mode"]) == (rule, m)] for m in modes]
        if len(mine[0]) > 1:
            means = cells([mean_of(one) for one in mine])
            lines.append(table_line((f"mean of {len(mine[0])}", "", rule, *means)))
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "scenes", nargs="+", type=Path, help="folders, each with a ground_truth.csv"
    )
    parser.add_argument("--weather", nargs="+", type=weather_of, default=[weather_of("clear")],
                        help="clear (the frames as they are, without a copy), or "
                        "KIND:RETURNS[:AMOUNT] with the mean number of returns a frame of each "
                        f"LiDAR; {', '.join(KINDS)}; the amount is the visibility "
                        f"in fog ({VISIBILITY_M:g} m) or the dirty share of the window "
                        f"({DIRTY_SHARE:g})")  # fmt: skip
    parser.add_argument("--seed", type=int, default=1, help="of the weather (1)")
    parser.add_argument("--modes", nargs="+", choices=MODES, default=MODES)
    parser.add_argument("--without", nargs="+", default=[], metavar="RULE", help="and once more "
                        "with each of these of robust.disabled_rules off")  # fmt: skip
    parser.add_argument("--into", type=Path, help="keeps frames and results in this folder")
    parser.add_argument(
        "--options", type=shlex.split, default=[], help="of unlidar_track, as one text"
    )
    arguments = parser.parse_args()

    def act() -> None:
        results = []
        with tempfile.TemporaryDirectory(prefix="measure_weather-") as folder:
            for result in measure(arguments, arguments.into or Path(folder)):
                print(line_of(result), flush=True)
                results.append(result)
        print("\n" + table(results, arguments.modes))

    return report_errors(act)


if __name__ == "__main__":
    sys.exit(main())
