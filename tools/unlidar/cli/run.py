"""`unlidar run`: options and output, for one recording and for many."""

import argparse
import os
import sys
from pathlib import Path

from unlidar.cli.convert import define_reading
from unlidar.cli.view import show_results
from unlidar.errors import BatchError, ConfigError, UsageError, reason
from unlidar.limits import read_text
from unlidar.pose_files import ALL
from unlidar.sanitize import printable

EXAMPLE = """unlidar simulate demo out/demo && unlidar run out/demo --method robust
  unlidar run mmaud/val --jobs 2"""


def define(p: argparse.ArgumentParser) -> None:
    """Adds the arguments but --sensors."""
    p.add_argument(
        "recording",
        metavar="RECORDING",
        type=Path,
        nargs="+",
        help="a folder of frame directories (converted or simulated), anything convert reads, or a "
        "folder with any number of these in it or further below; or several of all these",
    )
    p.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        help="for the results (default: out/run/RECORDING, of several out/run/ and their folder)",
    )
    p.add_argument("--method", choices=("robust", "paper"), help="default: that of the program")
    p.add_argument(
        "--config",
        metavar="FILE",
        type=Path,
        help="configuration of the program (default: its own; for MMAUD folders mmaud.yaml)",
    )
    p.add_argument(
        "--set",
        metavar="SECTION.KEY=VALUE",
        action="append",
        default=[],
        dest="assignments",
        help="one value of the configuration; may be repeated",
    )
    p.add_argument(
        "--poses",
        metavar="[NAME=]FILE",
        type=_poses,
        action="append",
        default=[],
        help="the way of the LiDAR NAME, or of all, which move: TUM, the pose in the world of what "
        "bears it; may be repeated (default: those beside the frames, if there are any)",
    )
    define_reading(p)
    p.add_argument("--threads", metavar="N", type=int, help="of the program, for each recording")
    p.add_argument(
        "--no-report",
        action="store_false",
        dest="report",
        help="without figure and page, which take seconds for each recording",
    )
    p.add_argument(
        "--open", action="store_true", help="show the results of one recording as unlidar view does"
    )
    p.add_argument(
        "--live",
        action="store_true",
        help="send one recording through the live program as well, and compare",
    )
    many = p.add_argument_group(
        "many recordings",
        "Each gets a folder of results, complete or absent: after an interruption the same command "
        "goes on where it was. What was done with the same input, settings and program is kept. A "
        "recording that fails does not stop the others; the exit code is then that of the failed "
        "ones, or 1 where theirs differ.",
    )
    many.add_argument(
        "--jobs", metavar="N", type=int, help="recordings at once (default: one for each core)"
    )
    many.add_argument(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        help="run them on the workers of this Dask scheduler, which see the same files",
    )
    p.set_defaults(act=_run)


def _run(a: argparse.Namespace) -> None:
    from unlidar.batch.discovery import common_folder, default_results, is_recording

    for name, value in (("--jobs", a.jobs), ("--threads", a.threads)):
        if value is not None and value < 1:
            raise UsageError(f"{name} {value}: expected a number from 1 on")
    if a.jobs is not None and a.scheduler is not None:
        raise UsageError("--jobs and --scheduler: expected one of them")
    name = common_folder(a.recording).resolve().name
    a.out = a.out or default_results(a.recording)
    first, *others = a.recording
    if a.open and not a.report:
        raise UsageError("--open and --no-report: expected one of them")
    if others or (first.is_dir() and not is_recording(first)):
        single = (("--live", a.live), ("--open", a.open), ("--poses", a.poses))
        for option, is_given in single:
            if is_given:
                raise UsageError(f"{first}: {option} is for one recording, these are more")
        _run_many(a, name)
    elif a.jobs is not None or a.scheduler is not None:
        raise UsageError(f"{first}: --jobs and --scheduler are for many recordings, this is one")
    else:
        _run_one(a, first)


def _run_one(a: argparse.Namespace, recording: Path) -> None:
    from unlidar.conversion import Options
    from unlidar.pipeline import run
    from unlidar.presets import about_preset
    from unlidar.tables import measures_table, show

    _read(a.config)
    options = ["--config", str(a.config)] if a.config else []
    options += _assignments(a)
    options += ["--threads", str(a.threads)] if a.threads is not None else []
    reading = Options(
        truths=tuple(a.truth), skip_bad=a.skip_bad, rate_hz=a.rate, poses_topic=a.poses_topic
    )
    poses = dict(a.poses)
    if len(poses) < len(a.poses):
        raise UsageError("--poses: expected once for all LiDARs, or once for each")
    result = run(recording, a.out, a.sensors, options, reading, report=a.report, poses=poses)
    for line in result.record.messages:
        print(printable(line), file=sys.stderr)
    for line in result.answer.splitlines():
        print(printable(line))
    title = f"{result.record.title} ({', '.join(result.record.frames)})"
    if result.measures is None:
        print(printable(f"{title}: no ground_truth.csv, not evaluated"))
    else:
        show(measures_table(result.measures, title))
    if result.record.preset is not None:
        print(f"settings   {about_preset(result.record.preset)}")
    print(f"time       {result.record.tracking_s:.2f} s")
    print(f"trajectory {printable(result.trajectory)}")
    if a.report:
        print(f"figure     {printable(result.figure)}")
        print(f"page       {printable(result.page)}")
    if a.live:
        _run_live(a.out)
    if a.open:
        show_results(a.out)


def _run_live(out: Path) -> None:
    from unlidar.live_run import live_table, run_live
    from unlidar.tables import show

    result = run_live(out)
    show(live_table(result))
    print(f"live time  {result.times.wall_s:.2f} s")
    print(f"live rows  {printable(result.trajectory)}")


def _run_many(a: argparse.Namespace, name: str) -> None:
    from unlidar.batch import run_many
    from unlidar.batch.job import FAILED, Settings
    from unlidar.batch.table import rich_table, table_files
    from unlidar.presets import about_preset
    from unlidar.tables import show

    cores = len(os.sched_getaffinity(0))
    at_once = a.jobs or cores
    # A slot of a Dask worker is one core; on this machine the jobs share all cores.
    threads = a.threads or (1 if a.scheduler else max(1, cores // at_once))
    config_file = str(a.config) if a.config else None
    config = _read(a.config)
    settings = Settings(
        a.sensors,
        config_file,
        config,
        _assignments(a),
        threads,
        a.truth,
        a.skip_bad,
        a.report,
        a.rate,
        a.poses_topic,
    )
    rows = run_many(a.recording, a.out, settings, at_once, a.scheduler)
    title = f"{name}: {len(rows)} recording{'s' * (len(rows) != 1)}"
    show(rich_table(rows, title))
    tables = table_files(a.out)
    failed = [row for row in rows if row.status == FAILED]
    for row in failed:
        print(f"failed   {printable(row.name)}: {printable(row.reason)}")
    for preset in sorted({row.preset for row in rows if row.preset}):
        print(f"settings {about_preset(preset)}")
    print(f"results  {printable(a.out)}")
    print(f"table    {', '.join(printable(path) for path in tables)}")
    if failed:
        codes = {row.exit_code for row in failed}
        raise BatchError(
            f"{len(failed)} of {len(rows)} recordings failed, for reasons told in {tables[0]}",
            codes.pop() if len(codes) == 1 else 1,
        )


def _assignments(a: argparse.Namespace) -> list[str]:
    options = []
    method = [f"method={a.method}"] if a.method else []
    # The frame rate applies to the conversion and to frames that the program reads directly.
    rate = [f"input.frame_rate_hz={a.rate!r}"] if a.rate else []
    for assignment in (*method, *rate, *a.assignments):
        options += ["--set", assignment]
    return options


def _read(config: Path | None) -> str | None:
    try:
        return None if config is None else read_text(config)
    except (OSError, ValueError) as error:
        raise ConfigError(f"{config}: cannot be read: {reason(error)}") from error


def _poses(text: str) -> tuple[str, Path]:
    name, separator, file = text.partition("=")
    is_named = separator and "/" not in name  # as the program has it
    return (name, Path(file)) if is_named else (ALL, Path(text))
