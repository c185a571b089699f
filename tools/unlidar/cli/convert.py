"""`unlidar convert`: options and output."""

import argparse
from pathlib import Path

from unlidar import reporting
from unlidar.cli.arguments import count, not_negative, origin, positive
from unlidar.errors import InputError, UsageError
from unlidar.sanitize import cell, printable

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
        help="a ROS 1 or ROS 2 recording (.bag, .db3, .mcap or a folder of them), a capture of "
        "Livox or Velodyne packets (.pcap, .pcapng, or a folder of a series of "
        "them), a file of Livox Viewer (.lvx, .lvx2), .las or "
        ".laz, a MMAUD sequence or a folder of .pcd, .ply, .bin (KITTI) or .npy",
    )
    p.add_argument("out", metavar="OUT", nargs="?", type=Path, help="folder to be written")
    p.add_argument("--list", action="store_true", help="show what SRC holds and write nothing")
    p.add_argument("--force", action="store_true", help="replace OUT if it was converted before")
    p.add_argument(
        "--start", metavar="S", type=not_negative, default=0.0, help="leave out the first S s"
    )
    p.add_argument("--duration", metavar="S", type=positive, help="take no more than S s")
    p.add_argument(
        "--merge",
        metavar="N",
        type=count,
        default=1,
        help="N messages of a sensor make a frame, for rosette scanners that send often",
    )
    define_reading(p)
    bags = p.add_argument_group("ROS recordings")
    bags.add_argument(
        "--topic",
        metavar="NAME",
        action="append",
        default=[],
        help="clouds, or truth, to take; may be repeated (default: all clouds but radars)",
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
        type=origin,
        help="of the local frame of NavSatFix, degrees and m above the ellipsoid; write "
        "--origin=-33.9,18.4,10 if it begins with a minus (default: the first fix)",
    )
    p.set_defaults(act=_convert)


def define_reading(p: argparse.ArgumentParser) -> None:
    """Adds the conversion options that `run` shares."""
    p.add_argument(
        "--rate",
        metavar="HZ",
        type=positive,
        help="of frames whose names are but numbers: how many of these make a second (1000 where "
        "they are milliseconds)",
    )
    p.add_argument(
        "--truth",
        metavar="TOPIC",
        action="append",
        default=[],
        help="of a ROS recording; may be repeated, each is a target (default: one topic of "
        "positions whose name says that it is the truth)",
    )
    p.add_argument(
        "--poses-topic",
        metavar="TOPIC",
        help="of a ROS recording whose LiDARs move: /tf, odometry or poses; 'none': they are at "
        "rest (default: /tf if it moves them, else odometry of what bears them)",
    )
    p.add_argument(
        "--skip-bad",
        action="store_true",
        help="leave out frames and messages that cannot be read or repeat a stamp, and count them",
    )


def counts_of(report: dict) -> str:
    """Frames and returns of each sensor, as a conversion or a simulation reports them."""
    return ", ".join(
        f"{name} {frames} frames with {report['returns'][name]} returns"
        for name, frames in report["frames"].items()
    )


def _convert(a: argparse.Namespace) -> None:
    from unlidar.conversion import Options, convert, kept_of

    if a.list:
        _list(a.source)
        return
    if a.out is None:
        raise UsageError("OUT is missing, expected a folder to be written, or --list")
    options = Options(
        topics=tuple(a.topic),
        truths=tuple(a.truth),
        skip_bad=a.skip_bad,
        start_s=a.start,
        duration_s=a.duration,
        stamp=a.stamp,
        merge=a.merge,
        rate_hz=a.rate,
        poses_topic=a.poses_topic,
        origin=a.origin,
    )
    report = convert(a.source, a.out, a.sensors, a.force, options)
    if report["broken"] is not None:
        raise InputError(f"{report['broken']}; kept {kept_of(report)}")
    for note in report["notes"]:
        reporting.note(note)
    counts = counts_of(report)
    truth = report["truth_rows"]
    told = "no truth" if truth is None else f"{truth} truth rows"
    print(printable(f"{a.out}: {counts}, {told}"))


def _list(source: Path) -> None:
    from rich import box
    from rich.table import Table

    from unlidar.conversion import list_streams
    from unlidar.tables import show

    kind, streams = list_streams(source)
    table = Table(title=cell(f"{source} ({kind})"), box=box.SIMPLE)
    for title in ("name", "type", "items", "duration, s", "rate, Hz", "becomes"):
        is_text = title in ("name", "type", "becomes")
        table.add_column(title, justify="left" if is_text else "right", overflow="fold")
    for stream in streams:
        duration = "-" if stream.span_s is None else f"{stream.span_s:.1f}"
        rate = "-" if stream.rate_hz is None else f"{stream.rate_hz:.1f}"
        cells = stream.name, stream.type, stream.items, duration, rate, stream.becomes
        table.add_row(*map(cell, cells))
    show(table)
