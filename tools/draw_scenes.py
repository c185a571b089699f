#!/usr/bin/env python3
"""Draws scenes of sensors and clutter that nothing was tuned on, for measure_scenes.py.

For each kind of clutter and each sensor a flight that the sensor can see, and the same clutter with
nobody in it: folders OUT/KIND_SENSOR_FLIGHT and OUT/KIND_SENSOR_none as `unlidar simulate` writes
them. Each is drawn from the seed and its names alone: it is the same whatever else is drawn.
"""

import argparse
import itertools
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from unlidar.cli.arguments import positive, whole
from unlidar.cli.convert import counts_of
from unlidar.errors import UsageError, report_errors
from unlidar.sanitize import printable
from unlidar.simulate import write_recording
from unlidar.simulate.sensors import MODELS
from unlidar_bench.clutter import KINDS
from unlidar_bench.draws import draw
from unlidar_bench.unseen_sensors import UNSEEN


def chosen(names: Sequence[str], known: Iterable[str], what: str) -> list[str]:
    """The names, each once. UsageError for one that is not known."""
    for name in names:
        if name not in known:
            raise UsageError(f"no {what} '{name}', expected some of: {' '.join(known)}")
    return list(dict.fromkeys(names))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("out", metavar="OUT", type=Path, help="folder for those of the scenes")
    parser.add_argument(
        "kinds", metavar="KIND", nargs="*", default=[*KINDS], help=f"of {', '.join(KINDS)} (all)"
    )
    parser.add_argument("--sensors", metavar="SENSOR", nargs="+", default=[*UNSEEN],
                        help=f"of {', '.join(UNSEEN)} (these), {', '.join(MODELS)}")  # fmt: skip
    parser.add_argument("--seed", type=whole, default=1, help="same seed, same bytes (1)")
    parser.add_argument("--duration", metavar="S", type=positive, help="of each scene, in seconds "
                        "(20, or that of 40 frames where these take longer)")  # fmt: skip
    parser.add_argument("--force", action="store_true", help="replaces scenes drawn before")
    arguments = parser.parse_args()

    def act() -> None:
        MODELS.update(UNSEEN)  # the simulator knows them by their names from here on
        kinds = chosen(arguments.kinds, KINDS, "kind")
        sensors = chosen(arguments.sensors, MODELS, "sensor")
        for kind, sensor in itertools.product(kinds, sensors):
            for flight, scene in draw(kind, sensor, arguments.seed, arguments.duration):
                folder = arguments.out / f"{kind}_{sensor}_{flight}"
                report = write_recording(scene, folder, arguments.force)
                print(printable(f"{folder}: {counts_of(report)}"), flush=True)

    return report_errors(act)


if __name__ == "__main__":
    sys.exit(main())
