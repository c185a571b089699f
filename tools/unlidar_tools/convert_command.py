"""`unlidar convert`: its options and what it prints."""

import argparse
from pathlib import Path

from unlidar_tools import telling
from unlidar_tools.arguments import number
from unlidar_tools.errors import UsageError
from unlidar_tools.geodesy import Origin

EXAMPLE = (
    "unlidar convert mmaud/val/seq0001 --list && "
    "unlidar convert mmaud/val/seq0001 out/seq0001 --start 1 --duration 5"
)


def define(p: argparse.ArgumentParser) -> None:
    """Adds the arguments but --sensors."""
    p.add_argument(
        "source",
        metavar="SRC",
        type=Path,
        help="a ROS 1 or ROS 2 recording (.bag, .db3, .mcap or a folder of them), a MMAUD sequence "
        "or a folder of .pcd, .ply, .bin (KITTI) or .npy",
    )
    p.add_argument("out", metavar="OUT", nargs="?", type=Path, help="folder to be written")
    p.add_argument("--list", action="store_true", help="show what SRC holds and write nothing")
    p.add_argument("--force", action="store_true", help="replace OUT if it was converted before")
    p.add_argument(
        "--start", metavar="S", type=_not_negative, default=0.0, help="leave out the first S s"
    )
    p.add_argument("--duration", metavar="S", type=_positive, help="take no more than S s")
    p.add_argument(
        "--merge",
        metavar="N",
        type=_count,
        default=1,
        help="N messages of a sensor make a frame, for rosette scanners that send often",
    )
    p.add_argument(
        "--rate", metavar="HZ", type=_positive, help="of frames whose names are but numbers"
    )
    bags = p.add_argument_group("ROS recordings")
    bags.add_argument(
        "--topic",
        metavar="NAME",
        action="append",
        default=[],
        help="clouds or truth to take; may be repeated (default: all clouds but radars, one truth)",
    )
    bags.add_argument(
        "--stamp",
        choices=("header", "log"),
        default="header",
        help="the sensor's or the recorder's time (default: header)",
    )
    bags.add_argument(
        "--origin",
        metavar="LAT,LON,HEIGHT",
        type=_origin,
        help="of the local frame of NavSatFix, degrees and m above the ellipsoid; write "
        "--origin=-33.9,18.4,10 if it begins with a minus (default: the first fix)",
    )
    p.set_defaults(act=_convert)


def tell_notes(report: dict) -> None:
    """Says on stderr what the user should know of a conversion."""
    for note in report["notes"]:
        telling.note(note)


def _convert(a: argparse.Namespace) -> None:
    from unlidar_tools.convert import Options, convert

    if a.list:
        _list(a.source)
        return
    if a.out is None:
        raise UsageError("OUT is missing, expected a folder to be written, or --list")
    options = Options(
        topics=tuple(a.topic),
        start_s=a.start,
        duration_s=a.duration,
        stamp=a.stamp,
        merge=a.merge,
        rate_hz=a.rate,
        origin=a.origin,
    )
    report = convert(a.source, a.out, a.sensors, a.force, options)
    tell_notes(report)
    counts = ", ".join(
        f"{name} {frames} frames with {report['returns'][name]} returns"
        for name, frames in report["frames"].items()
    )
    truth = report["truth_rows"]
    print(f"{a.out}: {counts}, {'no truth' if truth is None else f'{truth} truth rows'}")


def _list(source: Path) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    from unlidar_tools.convert import list_streams

    kind, streams = list_streams(source)
    console = Console(highlight=False)
    console.print(f"{source} ({kind})", soft_wrap=True, markup=False)
    table = Table("name", "type", box=box.SIMPLE)
    table.add_column("items", justify="right")
    table.add_column("becomes")
    for stream in streams:
        table.add_row(stream.name, stream.type, str(stream.items), stream.becomes)
    # In a pipe nothing is wrapped: the longest name decides.
    console.print(table, width=None if console.is_terminal else 400)


def _not_negative(text: str) -> float:
    if (value := number(text)) < 0:
        raise argparse.ArgumentTypeError(f"'{text}', expected a number from 0 on")
    return value


def _positive(text: str) -> float:
    if (value := number(text)) <= 0:
        raise argparse.ArgumentTypeError(f"'{text}', expected a number above 0")
    return value


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}', expected a whole number from 1 on")
    return int(text)


def _origin(text: str) -> Origin:
    parts = text.split(",")
    if len(parts) != 3:
        raise argparse.ArgumentTypeError(f"'{text}', expected latitude,longitude,height")
    latitude, longitude, height = (number(part) for part in parts)
    if abs(latitude) > 90 or abs(longitude) > 180:
        raise argparse.ArgumentTypeError(f"'{text}', expected degrees within 90 and 180")
    return Origin(latitude, longitude, height)
