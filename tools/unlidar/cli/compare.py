"""`unlidar compare`: options and output."""

import argparse
import json
from pathlib import Path

from unlidar.errors import UsageError
from unlidar.output import write_file
from unlidar.sanitize import printable

EXAMPLE = """unlidar compare batch=out/run/demo live=out/run/demo/live.csv
  unlidar compare ours=out/run/demo theirs=theirs.tum --truth truth.csv --figure compare.pdf"""


def define(p: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    p.add_argument(
        "results",
        metavar="[NAME=]RESULT",
        type=_result,
        nargs="+",
        help="folders that unlidar run wrote, or trajectories, CSV or TUM, of one flight",
    )
    p.add_argument(
        "--truth",
        metavar="FILE",
        type=Path,
        help="what all are judged by (default: the truth that the folders know; without one the "
        "first result)",
    )
    p.add_argument(
        "--figure",
        metavar="FILE",
        type=Path,
        help="also a figure, .png or .pdf: from above, from the side, each axis and the error over "
        "time",
    )
    p.add_argument("--json", action="store_true", help="one line of JSON, lengths in metres")
    p.set_defaults(act=_compare)


def _compare(a: argparse.Namespace) -> None:
    from unlidar.compare import comparison_of, read_results
    from unlidar.compare.figure import write_comparison
    from unlidar.tables import comparison_table, show

    if a.figure is not None and a.figure.suffix not in (".png", ".pdf"):
        raise UsageError(f"--figure {a.figure}: expected a name that ends in .png or .pdf")
    results = read_results(a.results, a.truth)
    comparison = comparison_of(results)
    if a.figure is not None:
        write_file(a.figure, lambda path: write_comparison(results, path))
    if a.json:
        print(json.dumps(comparison))
    else:
        show(comparison_table(comparison))
        if a.figure is not None:
            print(f"figure     {printable(a.figure)}")


def _result(text: str) -> tuple[str, Path]:
    name, equals, path = text.partition("=")
    if not equals or "/" in name:
        name, path = "", text
    if not path:
        raise argparse.ArgumentTypeError(f"'{text}', expected NAME=RESULT")
    return name, Path(path)
