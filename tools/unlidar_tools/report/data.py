"""What a report is made of: the files of one run, read into arrays."""

import csv
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from unlidar_tools.errors import InputError, reason
from unlidar_tools.evaluate import evaluate
from unlidar_tools.frames_io import read_returns
from unlidar_tools.output import write_file
from unlidar_tools.program import CLUSTERS, SUMMARY, TARGET_RETURNS, TRAJECTORY
from unlidar_tools.report.sample import Sample, Station, sample_returns
from unlidar_tools.truth import Tracks, Truth, read_tracks, read_truth

RECORD = "run.json"


@dataclass(frozen=True)
class RunRecord:
    """What the program's own files do not tell about a run."""

    title: str
    frames: dict[str, Path]  # frame directory by sensor
    truth: Path | None
    options: list[str]  # of the program
    wall_s: float


@dataclass(frozen=True)
class Clusters:
    """The program's table of cluster scores, values as written."""

    columns: list[str]
    rows: list[list[str]]  # in order of rank


@dataclass(frozen=True)
class ReportData:
    """Everything that pages and figures show. Times are Unix seconds, lengths metres."""

    record: RunRecord
    summary: dict
    tracks: Tracks
    truth: Truth  # empty if there is none
    measures: dict | None  # of `evaluate`; None without truth
    clusters: Clusters
    sample: Sample
    missing_frames: list[Path]  # directories of the run that are gone

    @property
    def flight_m(self) -> np.ndarray:
        """Positions of truth and estimate, (N, 3)."""
        return np.concatenate([self.truth.xyz_m, self.tracks.xyz_m])


def write_record(run: Path, record: RunRecord) -> None:
    """Writes `run`/run.json; paths inside `run` stay valid when the folder is moved."""
    content = {
        "title": record.title,
        "frames": {name: _written(path, run) for name, path in record.frames.items()},
        "truth": None if record.truth is None else _written(record.truth, run),
        "options": record.options,
        "wall_s": round(record.wall_s, 3),
    }
    text = json.dumps(content, indent=2) + "\n"
    write_file(run / RECORD, lambda work: work.write_text(text))


def load_run(run: Path) -> ReportData:
    """Reads what `unlidar run` left in the folder `run`, and a sample of the frames it read.

    Frames or truth that have been moved away are left out. Throws InputError if `run` is no such
    folder or one of its files cannot be read.
    """
    record = read_record(run)
    summary = _read_json(run / SUMMARY)
    tracks = read_tracks(run / TRAJECTORY)
    truth = _no_truth()
    if record.truth is not None and record.truth.is_file():
        truth = read_truth(record.truth)
    has_truth = record.truth is not None and record.truth.is_file()
    present = {name: path for name, path in record.frames.items() if path.is_dir()}
    sample = sample_returns(
        {name: (path, _station(run / SUMMARY, summary, name)) for name, path in present.items()},
        tracks,
        read_returns(run / TARGET_RETURNS),
        summary.get("counts", {}).get("returns", 0),
    )
    return ReportData(
        record=record,
        summary=summary,
        tracks=tracks,
        truth=truth,
        measures=evaluate(truth, tracks) if has_truth else None,
        clusters=_read_clusters(run / CLUSTERS),
        sample=sample,
        missing_frames=[path for name, path in record.frames.items() if name not in present],
    )


def _written(path: Path, run: Path) -> str:
    absolute, base = path.absolute(), run.absolute()
    return str(absolute.relative_to(base) if absolute.is_relative_to(base) else absolute)


def read_record(run: Path) -> RunRecord:
    """What `write_record` wrote. Throws InputError."""
    path = run / RECORD
    if not path.is_file():
        raise InputError(f"{run}: has no {RECORD}, expected a folder that 'unlidar run' wrote")
    known = _read_json(path)
    try:
        return RunRecord(
            title=str(known["title"]),
            frames={str(name): run / where for name, where in known["frames"].items()},
            truth=None if known["truth"] is None else run / known["truth"],
            options=[str(option) for option in known["options"]],
            wall_s=float(known["wall_s"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{path}: is not what 'unlidar run' writes: {reason(error)}") from error


def _read_json(path: Path) -> dict:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: holds a {type(content).__name__}, expected a JSON object")
    return content


def _read_clusters(path: Path) -> Clusters:
    try:
        with path.open(newline="", encoding="utf-8") as file:
            columns, *rows = list(csv.reader(file)) or [[]]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from error
    for line, row in enumerate(rows, start=2):
        if len(row) != len(columns):
            raise InputError(f"{path}:{line}: {len(row)} values, expected {len(columns)}")
    return Clusters(columns, rows)


def _station(path: Path, summary: dict, name: str) -> Station:
    """Pose and clock that the program used for a sensor."""
    try:
        known = summary.get("config", {}).get("sensors", {}).get(name)
        if known is None:
            return Station()
        return Station(
            tuple(float(v) for v in known["translation_m"]),
            tuple(float(v) for v in known["rotation"]),
            float(known["time_offset_s"]),
        )
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: config.sensors.{name}: {reason(error)}") from error


def _no_truth() -> Truth:
    return Truth(np.zeros(0), np.zeros(0), np.zeros((0, 3)), np.zeros(0, dtype=bool))
