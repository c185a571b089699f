"""Which returns are those of what flies: the program beside a detector of all that moves."""

import importlib.util
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from unlidar.errors import InputError
from unlidar.evaluation import evaluate_files
from unlidar.frames_io import find_sensors, list_frames, positions_of, read_pcd, read_returns
from unlidar.simulate import Simulation
from unlidar.truth import TRUTH_NAME

from unlidar_bench import live, recordings
from unlidar_bench.live import run_live
from unlidar_bench.paired import by_turns, mean_of_known, median, ratio
from unlidar_bench.processes import run
from unlidar_bench.setting import Setting
from unlidar_bench.tables import Column, digits, percent, times, whole

COLUMNS = (
    Column("sensor", "sensor"),
    Column("the drone flies", "where"),
    Column("by", "by"),
    Column("µs a return", "us_per_return", digits),
    Column("times ours", "times", times),
    Column("memory, MB", "memory_mb", digits),
    Column("returns of the drone", "of_drone", whole),
    Column("found", "found", percent),
    Column("people and car found", "others_found", percent),
    Column("others flagged", "false", whole),
    Column("within 1 m", "within1m", percent),
    Column("tracks", "tracks"),
)
OURS = "unlidar_track"
VOXELS_M = (0.1, 0.2)  # its default, and twice that
_MOVING = ("walker", "car")


@dataclass(frozen=True)
class Found:
    """Of one run on one recording."""

    cpu_s: float
    memory_mb: float
    moves: np.ndarray | None  # (N,) bool: returns that are flagged, where they are told
    measures: Mapping | None  # of its tracks, where there are any


def measure(setting: Setting) -> list[dict]:
    """A row for each sensor, flight and contestant: medians of time, sums of returns over seeds."""
    if importlib.util.find_spec("dufomap") is None:
        print("dufomap is not installed: measured without it", file=sys.stderr)
    rows = []
    for sensor, model in recordings.MODELS.items():
        for where in recordings.FLIGHTS:
            found: dict[str, list[Found]] = {}
            kinds = []
            for turn, seed in enumerate(setting.seeds):
                recording, simulation = recordings.flight(setting, model, where, seed)
                kinds.append(kinds_of_returns(simulation, recording))
                contestants = _contestants(setting, recording)
                for name, (result,) in by_turns(1, contestants, first=turn).items():
                    found.setdefault(name, []).append(result)
            rows += [
                {"sensor": sensor, "where": where, "by": name, **row(runs, found[OURS], kinds)}
                for name, runs in found.items()
            ]
    return rows


def row(runs: Sequence[Found], ours: Sequence[Found], kinds: Sequence[np.ndarray]) -> dict:
    """Times of the runs, one a seed, beside ours, and what they flagged of `kinds`."""
    cpu_s = [one.cpu_s for one in runs]
    result = {
        "us_per_return": median(
            [1e6 * one / len(of) for one, of in zip(cpu_s, kinds, strict=True)]
        ),
        "times": ratio(cpu_s, [one.cpu_s for one in ours]),
        "memory_mb": max(one.memory_mb for one in runs),
    }
    flags = [one.moves for one in runs if one.moves is not None]
    if flags:
        result |= counts(np.concatenate(flags), np.concatenate(kinds))
    measures = [one.measures for one in runs if one.measures is not None]
    if measures:
        result["within1m"] = mean_of_known([one["within1m"] for one in measures])
        result["tracks"] = " ".join(str(one["tracks"]) for one in measures)
    return result


def counts(moves: np.ndarray, kinds: np.ndarray) -> dict:
    """Of the returns (N,) that are flagged, those of the drone, of others that move, and the rest.

    Stray returns, of no thing, count to what stands still: nothing flies there.
    """
    is_drone, is_other = kinds == "drone", np.isin(kinds, _MOVING)
    return {
        "of_drone": int(is_drone.sum()),
        "found": _share(moves, is_drone),
        "others_found": _share(moves, is_other),
        "false": int((moves & ~is_drone & ~is_other).sum()),
    }


def _share(moves: np.ndarray, of: np.ndarray) -> float | None:
    return float(moves[of].mean()) if of.any() else None


def kinds_of_returns(simulation: Simulation, recording: Path) -> np.ndarray:
    """(N,) what each return of the recording's only sensor was: `drone`, `walker`, ..., `stray`.

    Throws InputError if the recording is not of this simulation.
    """
    ((_, folder),) = find_sensors(recording).items()
    (sensor,) = simulation.scenario.sensors
    kinds = np.array([*(thing.kind for thing in simulation.things), "stray"])
    found = []
    for file, frame in zip(list_frames(folder), simulation.frames(sensor), strict=True):
        if not np.array_equal(read_returns(file.path), frame.xyz_m.astype(np.float32)):
            raise InputError(f"{file.path}: is of another simulator, remove {recording}")
        found.append(kinds[frame.thing])
    return np.concatenate(found)


def flagged(xyz_m: np.ndarray, chosen_m: np.ndarray) -> np.ndarray:
    """(N,) bool: which of the returns (N, 3) are among those chosen (M, 3), to the last bit."""

    def whole_rows(rows: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(rows, dtype=np.float32).view("V12").ravel()

    return np.isin(whole_rows(xyz_m), whole_rows(chosen_m))


def _contestants(setting: Setting, recording: Path) -> dict[str, Callable[[], Found]]:
    ((_, folder),) = find_sensors(recording).items()
    found = {
        OURS: lambda: _ours(setting, recording, folder),
        f"{OURS}, live": lambda: _live(setting, recording),
    }
    if importlib.util.find_spec("dufomap") is not None:
        for voxel_m in VOXELS_M:
            found[f"DUFOMap, voxels of {voxel_m:g} m"] = lambda voxel_m=voxel_m: _dufomap(
                setting, folder, voxel_m
            )
    return found


def _ours(setting: Setting, recording: Path, folder: Path) -> Found:
    """The whole program, from files to rows and the returns of the tracks."""
    rows, points = setting.work / "traj.csv", setting.work / "points.pcd"
    out = ["--out", rows, "--points", points, "--threads", "1", "--quiet"]
    usage = run([setting.program, "--frames", folder, *out])
    xyz_m = np.concatenate([read_returns(frame.path) for frame in list_frames(folder)])
    moves = flagged(xyz_m, positions_of(points, read_pcd(points)))
    return Found(usage.cpu_s, usage.memory_mb, moves, evaluate_files(recording / TRUTH_NAME, rows))


def _live(setting: Setting, recording: Path) -> Found:
    usage, _ = run_live(setting, recording, 1)
    measures = evaluate_files(recording / TRUTH_NAME, setting.work / live.ROWS)
    return Found(usage.cpu_s, usage.memory_mb, None, measures)


def _dufomap(setting: Setting, folder: Path, voxel_m: float) -> Found:
    """Its calls alone: the time in which Python reads the files is not counted."""
    out = setting.work / "dufomap.npz"
    program = [sys.executable, "-m", "unlidar_bench.dufomap_labels"]
    usage = run([*program, out, str(voxel_m), folder])
    with np.load(out) as result:
        return Found(float(result["cpu_s"]), usage.memory_mb, result["moves"], None)
