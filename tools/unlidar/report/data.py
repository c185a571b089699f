"""Input of a report: the files of one run, read into arrays."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from unlidar.csv_rows import csv_rows
from unlidar.evaluation import evaluate
from unlidar.frames_io import read_returns
from unlidar.mounting import Mounting, mounting_of
from unlidar.presets import about_truth
from unlidar.program import CLUSTERS, SUMMARY, TARGET_RETURNS, TRAJECTORY
from unlidar.record import RunRecord, read_finished, read_object
from unlidar.report.explanation import Lost, read_explanation
from unlidar.report.sample import Sample, sample_returns
from unlidar.truth import Tracks, Truth, read_tracks, read_truth


@dataclass(frozen=True)
class ReportData:
    """All data of pages and figures. Times are Unix seconds, lengths metres."""

    record: RunRecord
    summary: dict
    tracks: Tracks
    truth: Truth  # empty if there is none
    measures: dict | None  # of `evaluate`; None without truth
    clusters: list[dict[str, str]]  # rows of the table of scores, in order of rank
    sample: Sample
    missing_frames: list[Path]  # frame directories that no longer exist
    station_m: np.ndarray = field(default_factory=lambda: np.zeros((1, 3)))  # or its way, (N, 3)
    explanation: list[Lost] = field(default_factory=list)  # empty without `unlidar explain`

    @property
    def flight_m(self) -> np.ndarray:
        """Positions of truth and estimate, (N, 3)."""
        return np.concatenate([self.truth.xyz_m, self.tracks.xyz_m])


def load_run(run: Path) -> ReportData:
    """`read_results` of a folder that `unlidar run` left; InputError if `run` is none."""
    record = read_finished(run)
    tracks = read_tracks(run / TRAJECTORY)
    return read_results(run, record, tracks, judged(record, tracks))


def judged(record: RunRecord, tracks: Tracks) -> dict | None:
    """The measures of a run with its truth's reference point; None without a truth file."""
    if record.truth is None or not record.truth.is_file():
        return None
    return evaluate(read_truth(record.truth), tracks) | about_truth(record.truth)


def read_results(run: Path, record: RunRecord, tracks: Tracks, measures: dict | None) -> ReportData:
    """Reads the program's files in the folder `run`, and a sample of the frames it read.

    Frames or truth that have been moved away are left out. Throws InputError if one of the files
    cannot be read.
    """
    summary = read_object(run / SUMMARY)
    truth = _no_truth()
    if record.truth is not None and record.truth.is_file():
        truth = read_truth(record.truth)
    present = {name: path for name, path in record.frames.items() if path.is_dir()}
    mountings = {name: mounting_of(run / SUMMARY, summary, name, record.poses) for name in present}
    sample = sample_returns(
        {name: (path, mountings[name]) for name, path in present.items()},
        tracks,
        read_returns(run / TARGET_RETURNS),
        summary.get("counts", {}).get("returns", 0),
    )
    return ReportData(
        record=record,
        summary=summary,
        tracks=tracks,
        truth=truth,
        measures=measures,
        clusters=[row.values for row in csv_rows(run / CLUSTERS)],
        sample=sample,
        station_m=_way_of(sample.steps_s, mountings.values()),
        missing_frames=[path for name, path in record.frames.items() if name not in present],
        explanation=read_explanation(run),
    )


def _way_of(time_s: np.ndarray, mountings: Iterable[Mounting]) -> np.ndarray:
    """The way of the first LiDAR that moves, (N, 3) at these times; else the origin."""
    moving = next((mounting for mounting in mountings if mounting.poses is not None), None)
    if moving is None or len(time_s) == 0:
        return np.zeros((1, 3))
    return moving.viewpoints_m(np.rint(time_s * 1e9).astype(np.int64))


def _no_truth() -> Truth:
    return Truth(np.zeros(0), np.zeros(0), np.zeros((0, 3)), np.zeros(0, dtype=bool))
