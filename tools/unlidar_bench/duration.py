"""What a recording costs by its length, as a whole and frame by frame."""

from pathlib import Path

from unlidar.frames_io import find_sensors

from unlidar_bench import recordings
from unlidar_bench.live import run_live
from unlidar_bench.paired import by_turns
from unlidar_bench.processes import run
from unlidar_bench.setting import Setting
from unlidar_bench.tables import Column, digits, percent

COLUMNS = (
    Column("minutes", "minutes", lambda value: f"{value:g}"),
    Column("as", "as"),
    Column("CPU, s", "cpu_s", digits),
    Column("CPU, s per minute", "cpu_s_per_minute", digits),
    Column("share of real time", "share", percent),
    Column("memory, MB", "memory_mb", digits),
)


def measure(setting: Setting) -> list[dict]:
    """A minute of a Mid-360 and an Avia, played again and again."""
    turn = recordings.turn(setting, "station", recordings.STATION, setting.turn_s)
    rows = []
    for minutes in setting.minutes:
        folder = recordings.repeated(setting, turn, 60 * minutes, setting.turn_s)
        out = setting.work / "traj.csv"
        batch = [setting.program, *_frames(folder), "--quiet", "--out", out]
        turns = round(60 * minutes / setting.turn_s)
        found = by_turns(
            1,
            {
                "recording": lambda command=batch: run(command),
                "live": lambda turns=turns: run_live(setting, turn, turns)[0],
            },
        )
        for name, (usage,) in found.items():
            rows.append(
                {
                    "minutes": minutes,
                    "as": name,
                    "cpu_s": usage.cpu_s,
                    "cpu_s_per_minute": usage.cpu_s / minutes,
                    "share": usage.cpu_s / (60 * minutes),
                    "memory_mb": usage.memory_mb,
                }
            )
    return rows


def _frames(folder: Path) -> list[str | Path]:
    sensors = recordings.in_order(find_sensors(folder))
    return [part for name, path in sensors.items() for part in ("--frames", f"{name}={path}")]
