"""What a frame costs while frames come."""

import json
from pathlib import Path

from unlidar.frames_io import find_sensors
from unlidar.play import MessageSink, frames_in_order, play

from unlidar_bench import recordings
from unlidar_bench.paired import by_turns, median
from unlidar_bench.processes import Usage, start
from unlidar_bench.setting import Setting
from unlidar_bench.tables import Column, digits, metres, percent, whole

ROWS = "live.csv"  # of the last live run, in the folder of results
COLUMNS = (
    Column("sensors", "sensors"),
    Column("minutes", "minutes", lambda value: f"{value:g}"),
    Column("returns a second", "returns_per_s", whole),
    Column("p50, ms", "p50", metres),
    Column("p99, ms", "p99", metres),
    Column("max, ms", "max", metres),
    Column("CPU of the process, share of real time", "share", percent),
    Column("memory, MB", "memory_mb", digits),
)


def measure(setting: Setting) -> list[dict]:
    """A station as in own_sensor.md, and dense sensors; medians of some runs."""
    station, turn_s = recordings.STATION, setting.turn_s
    played = {
        "Mid-360 and Avia": (
            recordings.turn(setting, "station", station, turn_s),
            *(turn_s, setting.live_minutes),
        ),
        "the same, with point times": (
            recordings.turn(setting, "station_timed", station, turn_s, timed=True),
            *(turn_s, setting.live_minutes),
        ),
        **{
            f"spinning, {beams} beams": (
                recordings.dense(setting, beams),
                *(setting.dense_turn_s, setting.dense_minutes),
            )
            for beams in (64, 128)
        },
    }
    found = by_turns(
        setting.live_rounds,
        {
            name: lambda one=one: run_live(setting, one[0], round(60 * one[2] / one[1]))
            for name, one in played.items()
        },
    )
    rows = []
    for name, runs in found.items():
        _, turn_s, minutes = played[name]
        summaries = [summary for _, summary in runs]
        rows.append(
            {
                "sensors": name,
                "minutes": minutes,
                "returns_per_s": summaries[0]["counts"]["returns"] / (60 * minutes),
                **{
                    key: median([summary["frame_cpu_ms"][key] for summary in summaries])
                    for key in ("p50", "p99", "max")
                },
                "share": median([usage.cpu_s for usage, _ in runs]) / (60 * minutes),
                "memory_mb": max(usage.memory_mb for usage, _ in runs),
            }
        )
    return rows


def run_live(setting: Setting, recording: Path, turns: int) -> tuple[Usage, dict]:
    """A recording, so many times, through `--stdin` as fast as it is taken; with the summary."""
    out = setting.work / ROWS
    out.unlink(missing_ok=True)
    summary = setting.work / "live.json"
    command = [setting.program, "--stdin", "--quiet", "--out", out, "--summary", summary]
    process = start(command)
    sensors = recordings.in_order(find_sensors(recording))
    play(frames_in_order(sensors, turns), MessageSink(process.stdin), rate=float("inf"))
    return process.wait(), json.loads(summary.read_bytes())
