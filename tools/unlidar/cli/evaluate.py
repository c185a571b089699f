"""`unlidar evaluate`: options and output."""

import argparse
import json
import re
from pathlib import Path

from unlidar.cli.arguments import number, positive, whole
from unlidar.errors import InputError, UsageError
from unlidar.evaluate_options import ALIGNMENTS, AUTO, Options
from unlidar.reporting import note

EXAMPLE = """unlidar evaluate out/demo/ground_truth.csv out/run/demo/traj.csv --align translation
  unlidar evaluate --group day=out/run/day --group night=out/run/night --markdown"""


def define(p: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    default = Options()
    p.add_argument(
        "inputs",
        metavar="TRUTH TRAJ... | RESULTS",
        type=Path,
        nargs="*",
        help="files, timestamp,x,y,z[,target,in_view] and timestamp,x,y,z[,track_id,...] or TUM, "
        "of which each is a track; or folders of results, which know their truth",
    )
    p.add_argument(
        "--group",
        metavar="NAME=RESULTS",
        type=_group,
        action="append",
        default=[],
        help="folders of results that get a row together, as day=DIR; may be repeated",
    )
    p.add_argument(
        "--manifest",
        metavar="FILE",
        type=Path,
        help="CSV or JSON with truth,trajectory[,sequence,group] of many sequences",
    )
    p.add_argument(
        "--align",
        choices=ALIGNMENTS,
        default=default.align,
        help="take off first: translation the mean offset, yaw also a turn about z, se3 any turn; "
        "never a scale (default: %(default)s)",
    )
    p.add_argument(
        "--time-offset",
        metavar="S|auto",
        type=_offset,
        default=default.time_offset,
        help="add so many seconds to the trajectory's stamps; auto: estimate and report them "
        "(default: 0)",
    )
    p.add_argument(
        "--bootstrap",
        metavar="N",
        type=whole,
        default=default.bootstrap,
        help="replicates for the 95 %% intervals, 0: none (default: %(default)s)",
    )
    p.add_argument(
        "--block",
        metavar="S",
        type=positive,
        default=default.block_s,
        help="seconds that are drawn together for the intervals (default: %(default)s)",
    )
    p.add_argument(
        "--seed",
        metavar="N",
        type=whole,
        default=default.seed,
        help="of the intervals: same seed, same numbers (default: %(default)s)",
    )
    output = p.add_mutually_exclusive_group()
    output.add_argument("--json", action="store_true", help="one line of JSON, lengths in metres")
    output.add_argument("--markdown", action="store_true", help="a Markdown table")
    p.set_defaults(act=act)


def act(a: argparse.Namespace) -> None:
    """Evaluates one trajectory, or many sequences in groups, and prints the result."""
    options = Options(a.align, a.time_offset, a.bootstrap, a.block, a.seed)
    folders = bool(a.inputs) and all(path.is_dir() for path in a.inputs)
    if a.manifest is not None or a.group or folders:
        if a.inputs and not folders:
            raise UsageError(f"{a.inputs[0]}: is no folder; --group and --manifest name the files")
        _many(a, options)
    elif len(a.inputs) >= 2:
        if folder := next((path for path in a.inputs if path.is_dir()), None):
            raise InputError(f"{folder}: is a folder, expected files TRUTH TRAJ, or only folders")
        _one(a, options)
    else:
        raise UsageError(
            "expected TRUTH and TRAJ... as files, folders of results, --group or --manifest "
            "(see unlidar evaluate --help)"
        )


def _one(a: argparse.Namespace, options: Options) -> None:
    from unlidar.evaluation import evaluate_files
    from unlidar.evaluation.markdown import markdown_table
    from unlidar.tables import measures_table, show

    truth, *trajectories = a.inputs
    for path in trajectories:
        for other in _other_tracks(path):
            if other not in trajectories:
                note(f"{other}: another track beside {path.name}, not judged as it was not named")
    measures = evaluate_files(truth, trajectories, options)
    if a.json:
        print(json.dumps(measures))
    elif a.markdown:
        print(markdown_table([(trajectories[0].stem, measures)]), end="")
    else:
        names = ", ".join(str(path) for path in trajectories)
        show(measures_table(measures, f"{names} against {truth}"))


def _other_tracks(path: Path) -> list[Path]:
    """The program's files of further tracks beside a TUM file, which holds one track."""
    from unlidar.truth import is_tum

    name = re.compile(rf"{re.escape(path.stem)}_track\d+{re.escape(path.suffix)}")
    if not (path.is_file() and is_tum(path)):  # one that is not there is told of behind the truth
        return []
    return sorted(other for other in path.parent.iterdir() if name.fullmatch(other.name))


def _many(a: argparse.Namespace, options: Options) -> None:
    from unlidar.evaluation.markdown import markdown_table, table_rows
    from unlidar.evaluation.sequences import (
        evaluate_sequences,
        find_results,
        names_are_unique,
        read_manifest,
    )
    from unlidar.tables import sequences_table, show

    flights = read_manifest(a.manifest) if a.manifest is not None else []
    for folder in a.inputs:
        flights += find_results(folder)
    for name, folder in a.group:
        flights += find_results(folder, name)
    names_are_unique(flights)
    result = evaluate_sequences(flights, options)
    if a.json:
        print(json.dumps(result))
    elif a.markdown:
        print(markdown_table(table_rows(result), len(result["groups"])), end="")
    else:
        show(sequences_table(result))


def _group(text: str) -> tuple[str, Path]:
    name, _, folder = text.partition("=")
    if not name or not folder or name == "all":
        raise argparse.ArgumentTypeError(f"'{text}', expected NAME=FOLDER, NAME not 'all'")
    return name, Path(folder)


def _offset(text: str) -> float | str:
    return AUTO if text == AUTO else number(text)
