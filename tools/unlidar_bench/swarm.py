"""What many drones at once cost: tracks times frames a second of the processor."""

from pathlib import Path

from unlidar.csv_rows import csv_rows
from unlidar.evaluation import evaluate_files
from unlidar.frames_io import find_sensors
from unlidar.truth import TRUTH_NAME

from unlidar_bench import live, recordings
from unlidar_bench.live import run_live
from unlidar_bench.paired import by_turns, mean_of_known, median
from unlidar_bench.processes import Usage, run
from unlidar_bench.setting import Setting
from unlidar_bench.tables import Column, digits, percent, whole

COLUMNS = (
    Column("sensor", "sensor"),
    Column("drones", "drones", whole),
    Column("as", "as"),
    Column("CPU, s", "cpu_s", digits),
    Column("share of real time", "share", percent),
    Column("memory, MB", "memory_mb", digits),
    Column("tracks", "tracks"),
    Column("within 1 m", "within1m", percent),
    Column("with a track of its own", "matched", percent),
    Column("false rows", "false", percent),
    Column("tracks x frames", "track_frames", whole),
    Column("tracks x frames per CPU second", "track_frames_per_s", whole),
)
_MEASURES = ("within1m", "matched", "false")


def measure(setting: Setting) -> list[dict]:
    """A row for each sensor, number of drones and way: medians over seeds, means of measures."""
    rows = []
    for sensor, model in recordings.MODELS.items():
        for drones in setting.swarms:
            found: dict[str, list[tuple[Usage, dict]]] = {}
            for turn, seed in enumerate(setting.seeds):
                recording = recordings.swarm(setting, model, drones, seed)
                ways = {
                    "recording": lambda of=recording: _as_recording(setting, of),
                    "live": lambda of=recording: _live(setting, of),
                }
                for name, (result,) in by_turns(1, ways, first=turn).items():
                    found.setdefault(name, []).append(result)
            rows += [
                {"sensor": sensor, "drones": drones, "as": name, **row(runs, setting.swarm_s)}
                for name, runs in found.items()
            ]
    return rows


def row(runs: list[tuple[Usage, dict]], duration_s: float) -> dict:
    """Of the runs, one a seed: what they took, and what their tracks are worth."""
    cpu_s = median([usage.cpu_s for usage, _ in runs])
    return {
        "cpu_s": cpu_s,
        "share": cpu_s / duration_s,
        "memory_mb": max(usage.memory_mb for usage, _ in runs),
        "tracks": " ".join(str(measures["tracks"]) for _, measures in runs),
        **{key: mean_of_known([measures.get(key) for _, measures in runs]) for key in _MEASURES},
        "track_frames": median([measures["track_frames"] for _, measures in runs]),
        "track_frames_per_s": median(
            [measures["track_frames"] / usage.cpu_s for usage, measures in runs]
        ),
    }


def track_frames(rows: Path) -> int:
    """Sum over the frames of the tracks that are confirmed then: a trajectory has a row of each."""
    return sum(1 for _ in csv_rows(rows))


def _as_recording(setting: Setting, recording: Path) -> tuple[Usage, dict]:
    ((_, folder),) = find_sensors(recording).items()
    out = setting.work / "traj.csv"
    options = ["--out", out, "--threads", "1", "--quiet"]
    return run([setting.program, "--frames", folder, *options]), _judged(recording, out)


def _live(setting: Setting, recording: Path) -> tuple[Usage, dict]:
    usage, _ = run_live(setting, recording, 1)
    return usage, _judged(recording, setting.work / live.ROWS)


def _judged(recording: Path, rows: Path) -> dict:
    measures = evaluate_files(recording / TRUTH_NAME, rows)
    return {**measures, "track_frames": track_frames(rows)}
