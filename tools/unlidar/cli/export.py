"""`unlidar export`: options and output."""

import argparse
from dataclasses import replace
from pathlib import Path

from unlidar.cli.arguments import number, origin, whole
from unlidar.errors import UsageError
from unlidar.export_options import FORMATS, Options, check, guess_format
from unlidar.geoid import GRID_NAME

EXAMPLE = """unlidar export out/run/seq0001 flight.mcap
  unlidar export out/run/seq0001 flight.kml --origin 1.3483,103.6831,40 --heading 90
  unlidar export out/run/seq0001 --to log.courageous.json --origin 1.3483,103.6831,40
  unlidar export seq1=out/run/seq1 seq2=out/run/seq2 mmaud_results.csv --at stamps.csv"""


def define(p: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    default = Options()
    p.add_argument(
        "sources",
        metavar="[NAME=]TRAJ",
        nargs="+",
        help="a traj.csv or a folder of results; several, each with the sequence's name, for "
        "mmaud. Without --to the last one is OUT",
    )
    p.add_argument("--to", metavar="OUT", type=Path, help="file or folder to be written")
    p.add_argument(
        "--format",
        choices=FORMATS,
        help="default: by OUT's name. " + "; ".join(f"{k}: {v}" for k, v in FORMATS.items()),
    )
    p.add_argument(
        "--origin",
        metavar="LAT,LON,HEIGHT",
        type=origin,
        help="where 0,0,0 is: degrees north and east, metres above the WGS 84 ellipsoid; "
        "--origin=-33.9,18.4,10 if it begins with a minus",
    )
    p.add_argument(
        "--heading",
        metavar="DEG",
        type=number,
        help="compass direction of the x axis (default: 90, x east and y north)",
    )
    p.add_argument(
        "--frame-id",
        metavar="NAME",
        default=default.frame_id,
        help="of the ROS messages (default: %(default)s)",
    )
    p.add_argument(
        "--points",
        metavar="PCD",
        type=Path,
        help="returns to go along in ROS recordings (default: target_returns.pcd of the folder)",
    )
    p.add_argument(
        "--at",
        metavar="FILE",
        type=Path,
        help="mmaud: CSV with the Sequence and Timestamp of every position asked for, or a list "
        "of stamps for one sequence (default: the trajectory's own stamps)",
    )
    p.add_argument(
        "--geoid",
        metavar="METRES",
        type=number,
        help="courageous: height of the sea level (EGM96) above the ellipsoid at the station "
        f"(default: by PROJ's {GRID_NAME} where it is installed, else 0, with a note)",
    )
    p.add_argument(
        "--uav-type",
        metavar="N",
        type=whole,
        default=default.uav_type,
        help="mmaud: Classification to be written; nothing here tells types (default: %(default)s)",
    )
    p.set_defaults(act=act)


def act(a: argparse.Namespace) -> None:
    """Writes the files and names them."""
    *sources, last = a.sources if a.to is None else [*a.sources, a.to]
    if not sources:
        raise UsageError(f"'{last}', expected a trajectory and OUT behind it, or --to OUT")
    out = Path(last)
    if not out.name:
        raise UsageError(f"'{last}' is a folder, expected the name of what is to be written")
    form = a.format or guess_format(out)
    place = a.origin
    if a.heading is not None and place is None:
        raise UsageError("--heading needs --origin")
    if a.heading is not None:
        place = replace(place, heading_deg=a.heading)
    options = Options(place, a.frame_id, a.points, a.at, a.uav_type, a.geoid)
    check(len(sources), form, options)

    from unlidar.export import export

    for path in export([_source(text) for text in sources], out, form, options):
        print(path)


def _source(text: str) -> tuple[str, Path]:
    name, equals, path = text.partition("=")
    if equals and name and path and not Path(text).exists():
        return name, Path(path)
    resolved = Path(text).resolve()
    return (resolved if resolved.is_dir() else resolved.parent).name, Path(text)
