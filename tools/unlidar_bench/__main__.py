"""`python -m unlidar_bench`: measures and writes the page. tools/bench.sh says how."""

import argparse
import importlib
import json
import sys
import time
from dataclasses import replace
from pathlib import Path

from unlidar.errors import UnlidarError, reason

from unlidar_bench.page import heading, machine, put
from unlidar_bench.setting import QUICK, Setting
from unlidar_bench.tables import markdown

PARTS = ("clustering", "pcd", "spline", "whole", "duration", "live", "moving", "swarm")


def main(arguments: list[str]) -> int:
    """The exit code."""
    a = _arguments(arguments)
    work = a.work / ("quick" if a.quick else "full")
    setting = Setting(build=a.build, work=work)
    setting = replace(setting, **QUICK) if a.quick else setting
    setting = replace(setting, minutes=(*setting.minutes, 60.0)) if a.hour else setting
    work.mkdir(parents=True, exist_ok=True)
    try:
        for part in a.parts or PARTS:
            print(f"measuring {part}", file=sys.stderr)
            begin, host = time.monotonic(), machine()
            module = importlib.import_module(f"unlidar_bench.{part}")
            rows = module.measure(setting)
            result = {"machine": host, "rows": rows, "took_s": time.monotonic() - begin}
            (work / f"{part}.json").write_text(json.dumps(result, indent=1) + "\n")
            table = heading(host) + markdown(module.COLUMNS, rows)
            print(table)
            if a.page is not None:
                a.page.write_text(put(a.page.read_text(), part, table))
    except (UnlidarError, OSError) as error:
        print(f"bench: error: {reason(error)}", file=sys.stderr)
        return 1
    return 0


def _arguments(arguments: list[str]) -> argparse.Namespace:
    p = argparse.ArgumentParser(prog="unlidar_bench", description=__doc__)
    p.add_argument("parts", metavar="PART", nargs="*", help=f"of {', '.join(PARTS)}")
    p.add_argument("--build", type=Path, required=True, help="where the programs were built")
    p.add_argument("--work", type=Path, required=True, help="for recordings and results")
    p.add_argument("--page", type=Path, help="the page whose tables are made anew")
    p.add_argument("--quick", action="store_true", help="little of everything")
    p.add_argument("--hour", action="store_true", help="a recording of an hour too")
    a = p.parse_args(arguments)
    for part in a.parts:
        if part not in PARTS:
            p.error(f"no part '{part}', expected some of: {' '.join(PARTS)}")
    return a


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
