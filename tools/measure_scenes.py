#!/usr/bin/env python3
"""Tracks scenes as recordings and as streams and judges both, also in weather or by a rule less.

The scenes are folders as of make_scenes.py, make_hard.py, make_real.py, draw_scenes.py or
`unlidar simulate`. In clear air, which is what is measured unless told otherwise, the frames are
tracked as they are. With --weather its returns are put into the frames: their ranges, and what fog
or dirt on the window takes away, are those of unlidar.simulate.weather. Their rays are even over
the field of view: in the scan of a sensor that the simulator knows by its name, else in the
azimuths and elevations that the scene has returns from. A ray ends where recordings of that
direction do.
"""

import argparse
import itertools
import json
import math
import shlex
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

from unlidar.cli.arguments import count
from unlidar.errors import OutputError, UsageError, reason, report_errors
from unlidar.evaluation import Options, compare, evaluate, measure
from unlidar.output import refuse_input
from unlidar.play import MessageSink, frames_in_order, play
from unlidar.program import find_program
from unlidar.record import read_object
from unlidar.truth import Tracks, read_tracks
from unlidar_bench.flights import Flight, flight_of, put_weather
from unlidar_bench.processes import Usage, run, start
from unlidar_bench.results import (
    MODES,
    line_of,
    once_live,
    read_results,
    report,
    report_changes,
)
from unlidar_bench.weather import (
    DIRTY_SHARE,
    GUSTY,
    KINDS,
    VISIBILITY_M,
    Weather,
    weather_of,
)


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


def results_of(
    flight: Flight, weather: Weather, folder: Path, arguments: argparse.Namespace
) -> list[dict]:
    """One result for each switched off rule and mode."""
    out = folder / flight.name / str(weather).replace(" ", "_").replace(",", "")
    sensors, of_told = put_weather(flight, weather, arguments.seed, out)
    is_plain = not flight.options  # else the truth has axes of its own
    told = evaluate(flight.truth, of_told).get("within1m") if is_plain else None
    results = []
    for rule in (None, *dict.fromkeys(arguments.without)):
        off = [] if rule is None else ["--set", f"robust.disabled_rules=[{rule}]"]
        options = [*flight.options, *arguments.options, *off]
        comparisons, used = {}, {}
        for mode in arguments.modes:
            usage, tracks, blinded_s = track(mode, sensors, options, out / f"{rule}")
            comparisons[mode] = compare(flight.truth, tracks, Options())
            used[mode] = {
                "cpu_s": usage.cpu_s, "memory_mb": usage.memory_mb, "blinded_s": blinded_s,
            }  # fmt: skip
        confirmed = once_live(comparisons) if len(comparisons) == len(MODES) else {}
        results += [
            {"scene": flight.name, "weather": str(weather), "mode": mode, "without": rule or ""}
            | {"told": told, "once_live": confirmed.get(mode)}
            | used[mode]
            | measure([compared], Options())
            for mode, compared in comparisons.items()
        ]
    if arguments.into is None:
        shutil.rmtree(out)
    return results


def results_in_order(
    flights: Sequence[Flight], folder: Path, arguments: argparse.Namespace
) -> Iterator[dict]:
    """Results of each flight in each weather, with as many at a time as there are jobs."""
    with ThreadPoolExecutor(arguments.jobs) as pool:  # threads, as the program does the work
        works = itertools.product(flights, dict.fromkeys(arguments.weather))
        for results in pool.map(lambda work: results_of(*work, folder, arguments), works):
            yield from results


def flights_of(scenes: Sequence[Path]) -> list[Flight]:
    """Flights of the scenes. UsageError for two of one name, by which results are told apart."""
    flights: dict[str, Flight] = {}
    for scene in scenes:
        flight = flight_of(scene)
        if flight.name in flights:
            raise UsageError(f"{scene}: {flight.name} comes twice, expected scenes of other names")
        flights[flight.name] = flight
    return list(flights.values())


def arguments_of() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "scenes", nargs="+", type=Path, help="folders, each with a ground_truth.csv"
    )
    parser.add_argument("--weather", nargs="+", type=weather_of, default=[weather_of("clear")],
                        help="clear (the frames as they are, without a copy), or "
                        "KIND:RETURNS[:AMOUNT] with the mean number of returns a frame of each "
                        f"LiDAR; {', '.join(KINDS)}; the amount is the visibility "
                        f"in fog ({VISIBILITY_M:g} m) or the dirty share of the window "
                        f"({DIRTY_SHARE:g}); {GUSTY} before a kind: in gusts")  # fmt: skip
    parser.add_argument("--seed", type=int, default=1, help="of the weather (1)")
    parser.add_argument("--modes", nargs="+", choices=MODES, default=MODES)
    parser.add_argument("--without", nargs="+", default=[], metavar="RULE", help="and once more "
                        "with each of these of robust.disabled_rules off")  # fmt: skip
    parser.add_argument(
        "--jobs", type=count, default=1, metavar="N", help="scenes side by side (1)"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="results, one JSON object a line")
    parser.add_argument("--against", type=Path, metavar="FILE", help="of --json of an earlier run: "
                        "what differs is listed, with the means of both")  # fmt: skip
    parser.add_argument("--into", type=Path, help="keeps frames and results in this folder")
    parser.add_argument(
        "--options", type=shlex.split, default=[], help="of unlidar_track, as one text"
    )
    return parser.parse_args()


def write(path: Path, mode: str, text: str) -> None:
    """Puts a text into a file that is opened anew each time: it is there if the run is ended."""
    try:
        with path.open(mode, encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {reason(error)}") from error


def main() -> int:
    arguments = arguments_of()

    def act() -> None:
        before = None if arguments.against is None else read_results(arguments.against)
        flights = flights_of(arguments.scenes)
        if arguments.json is not None:
            refuse_input(arguments.json, arguments.against)
            write(arguments.json, "w", "")
        results = []
        with tempfile.TemporaryDirectory(prefix="measure_scenes-") as folder:
            for result in results_in_order(flights, arguments.into or Path(folder), arguments):
                print(line_of(result), flush=True)
                if arguments.json is not None:
                    write(arguments.json, "a", json.dumps(result) + "\n")
                results.append(result)
        print("\n" + report(results))
        if before is not None:
            print(report_changes(before, results, str(arguments.against)))

    return report_errors(act)


if __name__ == "__main__":
    sys.exit(main())
