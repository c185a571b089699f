"""`unlidar explain`: the stage at which a target was lost, second by second."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from unlidar.errors import InputError, UsageError
from unlidar.explain.evidence import Collector, SensorFrames
from unlidar.explain.stages import Run, runs_of
from unlidar.explain.targets import Reach, Target, named_place, targets_of
from unlidar.explain.trace import read_trace
from unlidar.frames_io import list_frames
from unlidar.live_run import SUMMARY_LIVE, TRAJECTORY_LIVE, stream_frames
from unlidar.mounting import mounting_of
from unlidar.program import SUMMARY, run_program
from unlidar.progress import with_progress
from unlidar.record import RunRecord, read_finished, read_object
from unlidar.stamps import format_stamp
from unlidar.truth import read_tracks, read_truth

__all__ = ["Explained", "Question", "Run", "explain"]
_TRACE = "trace.jsonl"


@dataclass(frozen=True)
class Question:
    """Scope of the explanation: all of the truth, an instant, a place, or both."""

    at_ns: int | None = None
    near_m: tuple[float, float, float] | None = None
    radius_m: float | None = None  # None: grows with range

    @property
    def is_about_the_truth(self) -> bool:
        """True if neither instant nor place is given."""
        return self.at_ns is None and self.near_m is None


@dataclass(frozen=True)
class Explained:
    """The explanation of one target."""

    target: str
    runs: list[Run]  # in order of time; none where it was never in view of a frame


def explain(run: Path, question: Question, live: bool = False) -> list[Explained]:
    """Calls the program once more on the frames of a finished `unlidar run`, and reads its trace.

    `live`: the frames are played to it as a stream.

    Throws UsageError for questions unfit for this run, InputError if frames or truth are gone,
    ProgramError with the program's own message and exit code if it fails.
    """
    record = read_finished(run)
    _check_method(run)
    targets = _targets(run, record, question)
    with tempfile.TemporaryDirectory(prefix="unlidar-explain-") as folder:
        trace = Path(folder) / _TRACE
        trajectory, summary = _track(run, record, Path(folder), trace, live)
        sensors = _sensors(summary, record)
        reach = Reach([sensor.mounting for sensor in sensors.values()], question.radius_m)
        collector = Collector(targets, sensors, reach, question.at_ns)
        frames = sum(len(sensor.files) for sensor in sensors.values())
        collector.add_trace(with_progress(read_trace(trace), frames, "explain"))
        collector.add_rows(read_tracks(trajectory))
    collector.add_unseen()
    if question.at_ns is not None and not any(collector.found):
        raise UsageError(_not_there(question.at_ns, sensors))
    return [
        Explained(target.name, runs_of(found))
        for target, found in zip(targets, collector.found, strict=True)
    ]


def _track(
    run: Path, record: RunRecord, folder: Path, trace: Path, live: bool
) -> tuple[Path, Path]:
    """Trajectory and summary of a call of the program with --trace."""
    if live:
        stream_frames(run, record, folder, ["--trace", str(trace)])
        return folder / TRAJECTORY_LIVE, folder / SUMMARY_LIVE
    outcome = run_program(record.frames, folder, [*record.arguments, "--trace", str(trace)])
    return outcome.trajectory, outcome.summary


def _check_method(run: Path) -> None:
    config = read_object(run / SUMMARY).get("config")
    method = config.get("method") if isinstance(config, dict) else None
    if method != "robust":
        raise UsageError(
            f"{run}: was tracked with method {method}, expected robust, whose stages are told"
        )


def _targets(run: Path, record: RunRecord, question: Question) -> Sequence[Target]:
    if question.near_m is not None:
        return [named_place(question.near_m)]
    if record.truth is None:
        raise UsageError(
            f"{run}: has no ground truth, expected --at T --near X,Y,Z: when and where a target is"
        )
    if not record.truth.is_file():
        raise InputError(f"{record.truth}: the truth of {run} is gone, expected it or --near X,Y,Z")
    targets = targets_of(read_truth(record.truth))
    if not targets:
        raise UsageError(f"{record.truth}: has no target, expected --at T --near X,Y,Z")
    return targets


def _sensors(summary: Path, record: RunRecord) -> dict[str, SensorFrames]:
    """The sensors with poses and clocks of the program's summary."""
    known = read_object(summary)
    config = known.get("config", {}).get("input", {})
    sensors = {}
    for name, directory in record.frames.items():
        mounting = mounting_of(summary, known, name, record.poses)
        frames = list_frames(directory, mounting.frame_rate_hz)
        sensors[name] = SensorFrames(
            {frame.stamp_ns + mounting.offset_ns: frame.path for frame in frames},
            mounting,
            float(config.get("min_range_m", 0.0)),
            float(config.get("max_range_m", np.inf)),
        )
    return sensors


def _not_there(at_ns: int, sensors: dict[str, SensorFrames]) -> str:
    stamps_ns = [stamp_ns for sensor in sensors.values() for stamp_ns in sensor.files]
    first, last = (format_stamp(stamp_ns) for stamp_ns in (min(stamps_ns), max(stamps_ns)))
    return (
        f"--at {format_stamp(at_ns)}: no frame within half a second in which a target is known, "
        f"the frames are of {first} to {last}"
    )
