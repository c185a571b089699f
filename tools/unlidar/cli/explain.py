"""`unlidar explain`: options and output."""

import argparse
import json
from pathlib import Path

from unlidar.cli.arguments import number, positive
from unlidar.sanitize import printable

EXAMPLE = """unlidar explain out/run/demo
  unlidar explain out/run/demo --at 1706255625 --near 4.5,-2,7 --radius 1.5
  unlidar explain out/run/demo --live"""

_FARTHEST_M = 1e9


def define(p: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    p.add_argument("run", metavar="RESULT", type=Path, help="a folder that unlidar run wrote")
    p.add_argument(
        "--at",
        metavar="T",
        type=_stamp_ns,
        help="only the second about this stamp, as in traj.csv (default: every second)",
    )
    p.add_argument(
        "--near",
        metavar="X,Y,Z",
        type=_place,
        help="a place in the common frame in metres, in place of the truth; --near=-4,2,7 if it "
        "begins with a minus",
    )
    p.add_argument(
        "--radius",
        metavar="M",
        type=positive,
        help="what lies so near is the target's (default: 1 m and 2 %% of its range)",
    )
    p.add_argument(
        "--live",
        action="store_true",
        help="of the frames played as a stream, whose rules differ, in place of the recording",
    )
    p.add_argument("--json", action="store_true", help="one line of JSON")
    p.set_defaults(act=_explain)


def _explain(a: argparse.Namespace) -> None:
    from unlidar.explain import Question, explain
    from unlidar.explain.table import as_json, meanings, runs_table, summary_line
    from unlidar.record import write_explanation
    from unlidar.tables import show

    question = Question(a.at, a.near, a.radius)
    explained = explain(a.run, question, a.live)
    found = as_json(explained)
    if question.is_about_the_truth and not a.live:
        write_explanation(a.run, found)
    if a.json:
        print(json.dumps(found))
        return
    for one in explained:
        show(runs_table(one))
    for stage, text in meanings(explained):
        print(printable(f"{stage}: {text}"))
    for one in explained:
        print(printable(summary_line(one)))


def _stamp_ns(text: str) -> int:
    from unlidar.stamps import MOST_STAMP_NS, parse_seconds_ns

    try:
        stamp_ns = parse_seconds_ns(text)
    except ValueError:
        stamp_ns = MOST_STAMP_NS + 1
    if abs(stamp_ns) > MOST_STAMP_NS:
        raise argparse.ArgumentTypeError(f"'{text}', expected a stamp in seconds")
    return stamp_ns


def _place(text: str) -> tuple[float, ...]:
    place_m = tuple(number(part) for part in text.split(","))
    if len(place_m) != 3 or max(map(abs, place_m)) > _FARTHEST_M:
        raise argparse.ArgumentTypeError(f"'{text}', expected X,Y,Z in metres")
    return place_m
