"""From frames to tracks: the program, and what one would put together instead."""

import sys
from collections.abc import Callable
from pathlib import Path

from unlidar.configs import CONFIG_DIR
from unlidar.evaluation import evaluate_files
from unlidar.frames_io import find_sensors
from unlidar.truth import TRUTH_NAME

from unlidar_bench import recordings
from unlidar_bench.paired import by_turns, median, ratio
from unlidar_bench.processes import Usage, run
from unlidar_bench.setting import Setting
from unlidar_bench.tables import Column, digits, metres, percent, times

COLUMNS = (
    Column("scene", "scene"),
    Column("by", "by"),
    Column("CPU, s", "cpu_s", digits),
    Column("times ours", "times", times),
    Column("memory, MB", "memory_mb", digits),
    Column("within 1 m", "within1m", percent),
    Column("RMSE, m", "rmse", metres),
    Column("false rows", "false", percent),
    Column("tracks", "tracks"),
)
OURS = "unlidar_track"


def measure(setting: Setting) -> list[dict]:
    """A row for each scene and contestant: medians of time over the seeds, means of the rest."""
    rows = []
    for scene in setting.scenes:
        found: dict[str, list[tuple[Usage, dict]]] = {}
        for seed in setting.seeds:
            recording = recordings.scene(setting, scene, seed)
            for name, (result,) in by_turns(1, _contestants(setting, recording)).items():
                found.setdefault(name, []).append(result)
        reference = [usage.cpu_s for usage, _ in found[OURS]]
        for name, runs in found.items():
            cpu_s = [usage.cpu_s for usage, _ in runs]
            rows.append(
                {
                    "scene": scene,
                    "by": name,
                    "cpu_s": median(cpu_s),
                    "times": ratio(cpu_s, reference),
                    "memory_mb": max(usage.memory_mb for usage, _ in runs),
                    **{key: _mean(runs, key) for key in ("within1m", "rmse", "false")},
                    "tracks": " ".join(str(measures["tracks"]) for _, measures in runs),
                }
            )
    return rows


def _contestants(setting: Setting, recording: Path) -> dict[str, Callable[[], tuple[Usage, dict]]]:
    folders = list(find_sensors(recording).values())
    folders.sort(key=lambda folder: folder.name != "mid360")  # the first gives the output times
    ours = [part for folder in folders for part in ("--frames", folder)] + ["--quiet"]
    out = setting.work / "traj.csv"
    commands = {
        OURS: [setting.program, *ours, "--out", out],
        f"{OURS}, `method: paper`": [
            *(setting.program, *ours, "--out", out, "--config", CONFIG_DIR / "paper.yaml")
        ],
        "the paper in plain Python": [
            *(sys.executable, "-m", "unlidar_bench.plain_paper", out, *folders)
        ],
        "parts of PCL": [setting.bench("pcl_pipeline"), out, *folders],
    }

    def judged(command: list[str | Path]) -> tuple[Usage, dict]:
        usage = run(command)
        return usage, evaluate_files(recording / TRUTH_NAME, out)

    return {name: (lambda c=command: judged(c)) for name, command in commands.items()}


def _mean(runs: list[tuple[Usage, dict]], key: str) -> float | None:
    """Of what is defined: there is no error where nothing was found, nor where nothing flies."""
    values = [measures[key] for _, measures in runs if measures.get(key) is not None]
    return sum(values) / len(values) if values else None
