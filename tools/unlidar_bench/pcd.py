"""Frames read from files that the system has in memory."""

from unlidar_bench.paired import by_turns, median, ratio
from unlidar_bench.processes import google_benchmark
from unlidar_bench.setting import Setting
from unlidar_bench.tables import Column, digits, times

COLUMNS = (
    Column("encoding", "encoding"),
    Column("by", "by"),
    Column("MB/s", "mb_per_s", digits),
    Column("times as fast as PCL", "times", times),
)
_BY = {"ours": "ours", "pcl": "PCL", "cat": "`cat`"}


def measure(setting: Setting) -> list[dict]:
    """Each encoding; the program itself reads by turns."""
    program = setting.bench("pcd_bench")
    turns = by_turns(
        setting.rounds, {"all": lambda: google_benchmark(program, [], setting.least_s)}
    )["all"]
    rows = []
    for encoding in ("ascii", "binary", "compressed"):
        found = [turn[f"ReadByTurns/{encoding}/manual_time"] for turn in turns]
        speed = {by: [one[f"{by}_bytes_per_s"] * 1e-6 for one in found] for by in _BY}
        for by, name in _BY.items():
            rows.append(
                {
                    "encoding": encoding,
                    "by": name,
                    "mb_per_s": median(speed[by]),
                    "times": ratio(speed[by], speed["pcl"]),
                }
            )
    return rows
