"""`unlidar view`: options and output."""

import argparse
from pathlib import Path

from unlidar.reporting import note
from unlidar.sanitize import printable

EXAMPLE = """unlidar view out/run/demo
  unlidar view flight.bag"""


def define(p: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    p.add_argument(
        "result",
        metavar="RESULT|RECORDING",
        type=Path,
        help="a folder that unlidar run wrote, or its traj.csv; or a recording, which is run "
        "before with the defaults to out/run/RECORDING",
    )
    p.set_defaults(act=_view)


def _view(a: argparse.Namespace) -> None:
    from unlidar.batch.discovery import default_results
    from unlidar.conversion import Options
    from unlidar.output import RUN_RECORD
    from unlidar.pipeline import run
    from unlidar.program import TRAJECTORY

    folder = a.result.parent if a.result.name == TRAJECTORY else a.result
    if not (folder / RUN_RECORD).is_file():
        folder = default_results([a.result])
        run(a.result, folder, None, [], Options(), report=True)
    show_results(folder)


def show_results(folder: Path) -> None:
    """Opens the results and prints where they are."""
    from unlidar.viewer import show

    what, path, is_open = show(folder)
    print(f"{what:10} {printable(path)}")
    if not is_open:
        note("no browser was found, open the page yourself")
