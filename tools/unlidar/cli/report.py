"""`unlidar report`: options and output."""

import argparse
from pathlib import Path

from unlidar.sanitize import printable

EXAMPLE = """unlidar report out/run/demo
  unlidar report out/run/demo --static"""


def define(p: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    p.add_argument("run", metavar="RUN_DIR", type=Path, help="a folder that unlidar run wrote")
    p.add_argument(
        "--static", action="store_true", help="also figures for papers, PNG and PDF, in figures/"
    )
    p.add_argument(
        "--rerun",
        action="store_true",
        help="also recording.rrd for the rerun viewer (needs the extra rerun)",
    )
    p.set_defaults(act=_report)


def _report(a: argparse.Namespace) -> None:
    from unlidar.report import load_run, write_page
    from unlidar.report.rrd import write_rrd
    from unlidar.report.static import write_figures

    data = load_run(a.run)
    print(f"page       {printable(write_page(data, a.run))}")
    for path in write_figures(data, a.run) if a.static else ():
        print(f"figure     {printable(path)}")
    if a.rerun:
        print(f"recording  {printable(write_rrd(data, a.run))}")
