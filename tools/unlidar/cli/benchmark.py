"""`unlidar benchmark`: options and output."""

import argparse
import os
import shlex
import sys
from pathlib import Path

from unlidar.errors import UsageError
from unlidar.sanitize import printable

EXAMPLE = """unlidar benchmark near two empty_sky --seeds 1-3 --methods robust,paper
  unlidar benchmark --scenes-dir scenes --out out/benchmark --ablate"""


def define(p: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    p.add_argument(
        "scenes",
        metavar="SCENE",
        nargs="*",
        help="a scenario that comes along or a .yaml file, or a scene of --scenes-dir "
        "(default: all)",
    )
    p.add_argument(
        "--scenes-dir",
        metavar="DIR",
        type=Path,
        help="recordings instead of simulations: DIR/[SEED/]SCENE/ with folders of frames and "
        "ground_truth.csv",
    )
    p.add_argument(
        "--seeds",
        metavar="1-5",
        help="numbers and ranges (default: 1-5; with --scenes-dir all it holds)",
    )
    p.add_argument(
        "--methods",
        metavar="NAME,...",
        default="robust,paper,paper_best",
        help="robust, paper, paper_best or .yaml files of the program (default: these three)",
    )
    p.add_argument(
        "--variant",
        metavar="NAME=KEY=VALUE,...",
        action="append",
        default=[],
        dest="changes",
        help="the first method with these keys changed, and its difference; may be repeated",
    )
    p.add_argument(
        "--ablate",
        action="store_true",
        help="as --variant, for each piece of evidence of the robust method in "
        "configs/ablation.yaml",
    )
    p.add_argument(
        "--jobs", metavar="N", type=int, help="recordings at once (default: one for each core)"
    )
    p.add_argument(
        "--time-limit",
        metavar="S",
        type=float,
        default=120.0,
        help="CPU seconds after which a run of the program has failed (default: 120)",
    )
    p.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        default=Path("out/benchmark"),
        help="for the tables and the results of every run (default: out/benchmark)",
    )
    p.set_defaults(act=_benchmark)


def _benchmark(a: argparse.Namespace) -> None:
    from unlidar import benchmark
    from unlidar.benchmark.scenes import seeds
    from unlidar.program import find_program

    if a.jobs is not None and a.jobs < 1:
        raise UsageError(f"--jobs {a.jobs}: expected a number from 1 on")
    if not a.time_limit >= 1:
        raise UsageError(f"--time-limit {a.time_limit}: expected a second or more")
    find_program()
    variants = benchmark.methods(a.methods)
    base = variants[0]
    variants += [benchmark.variant(text, base) for text in a.changes]
    variants += benchmark.ablation(base) if a.ablate else []
    names = [v.name for v in variants]
    if len(set(names)) != len(names):
        raise UsageError(f"two variants have one name, expected different ones: {', '.join(names)}")
    if a.scenes_dir is None:
        scenes = benchmark.simulated_scenes(a.scenes, seeds(a.seeds or "1-5"))
    else:
        scenes = benchmark.find_scenes(a.scenes_dir, a.scenes, seeds(a.seeds) if a.seeds else None)
    jobs = [benchmark.Job(scene, tuple(variants), a.out, a.time_limit) for scene in scenes]
    results = benchmark.run_jobs(jobs, a.jobs or len(os.sched_getaffinity(0)))
    rows = benchmark.summarise(results, variants)
    command = shlex.join(["unlidar", *sys.argv[1:]])
    tables = benchmark.write_report(rows, results, variants, command, a.out)
    print(tables[0].read_text(encoding="utf-8"))
    print(f"tables {', '.join(printable(path) for path in tables)}")
