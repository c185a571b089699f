"""A recording in; trajectory, measures, figure and page out."""

import re
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from unlidar.conversion import Options, convert, kept_of
from unlidar.errors import InputError, OutputError, UsageError, listed
from unlidar.figure import write_figure
from unlidar.frames_io import find_sensors, list_frames
from unlidar.live_run import EVENTS_LIVE, SUMMARY_LIVE, TRAJECTORY_LIVE
from unlidar.output import FRAMES, RUN_RECORD, clear_results, write_file
from unlidar.pose_files import find_poses, poses_options
from unlidar.presets import preset_of
from unlidar.program import (
    CLUSTERS,
    SUMMARY,
    TARGET_RETURNS,
    TRAJECTORY,
    check_options,
    run_program,
)
from unlidar.record import (
    EXPLANATION,
    MEASURES,
    RunRecord,
    is_result,
    write_measures,
    write_record,
)
from unlidar.report import PAGE, ReportData, judged, read_results, write_page
from unlidar.report.rrd import RECORDING
from unlidar.report.static import FOLDER, figure_data
from unlidar.reporting import note, timed
from unlidar.station import places_sensors, read_station, station_options
from unlidar.truth import TRUTH_NAME, read_tracks, read_truth

CONFIG = "config.yaml"  # in results of a batch: the common configuration
_DEFAULTS = Options()
_NO_POSES: Mapping[str, Path] = MappingProxyType({})
_FIGURE = "figure.png"
# Outputs of every run, and all files that its folder may hold.
RESULTS = (TRAJECTORY, SUMMARY, TARGET_RETURNS, CLUSTERS, MEASURES, _FIGURE, PAGE, RUN_RECORD)
# Outputs of `run --live` and of `explain`, removed with the run they belong to.
_LATER = (TRAJECTORY_LIVE, EVENTS_LIVE, SUMMARY_LIVE, EXPLANATION)
_OWN = (*RESULTS, *_LATER, CONFIG, FRAMES, FOLDER, RECORDING)
_UNFINISHED = re.compile(r"^\.partial-\d+-")  # of `write_file`


@dataclass(frozen=True)
class Recording:
    """Frame directories by sensor name, with truth, mountings and poses if known."""

    sensors: dict[str, Path]
    truth: Path | None
    mountings: list[str]  # `--set` options of the program
    poses: dict[str, Path]  # files of the program's --poses, by sensor
    frames: Path  # the folder of the frame directories
    notes: list[str]  # for the user, on the conversion
    broken: bool  # True if the recording was damaged


@dataclass(frozen=True)
class RunResult:
    """Result of one run, and its files."""

    out: Path  # the folder of the results
    record: RunRecord
    measures: dict | None  # of `evaluate`; None without truth
    answer: str  # of the program, on stdout

    @property
    def trajectory(self) -> Path:
        """The file with the tracks."""
        return self.out / TRAJECTORY

    @property
    def figure(self) -> Path:
        """A picture of the flight."""
        return self.out / _FIGURE

    @property
    def page(self) -> Path:
        """The report."""
        return self.out / PAGE


def prepare(
    path: Path, out: Path, chosen: list[str] | None = None, reading: Options = _DEFAULTS
) -> Recording:
    """The recording at `path`, converted to `out`/frames unless it holds frame directories.

    Of a damaged recording the readable part is used, with a note.
    """
    if not path.exists():
        raise InputError(f"{path}: does not exist")
    frames = path
    notes, broken = [], False
    sensors = find_sensors(path) if path.is_dir() else {}
    if not sensors:
        frames = out / FRAMES
        with timed(f"convert: {path}"):
            report = convert(path, frames, chosen, force=True, options=reading)
        notes = report["notes"]
        broken = report["broken"] is not None
        if broken:
            notes.append(f"{report['broken']}; went on with what could be read: {kept_of(report)}")
        for text in notes:
            note(text)
        sensors = {name: frames / name for name in report["frames"]}
    if chosen:
        missing = [name for name in chosen if name not in sensors]
        if missing:
            raise UsageError(f"{path}: has no sensor '{missing[0]}', it holds {listed(sensors)}")
        sensors = {name: sensors[name] for name in chosen}
    truth = frames / TRUTH_NAME
    return Recording(
        sensors,
        truth if truth.is_file() else None,
        station_options(read_station(frames), list(sensors)),
        find_poses(frames, sensors),
        frames,
        notes,
        broken,
    )


def run(
    path: Path,
    out: Path,
    chosen: list[str] | None,
    options: list[str],
    reading: Options = _DEFAULTS,
    key: str | None = None,
    report: bool = True,
    poses: Mapping[str, Path] = _NO_POSES,
) -> RunResult:
    """Converts if need be, tracks, evaluates where there is truth, with `report` also draws.

    Faults of the program or its options are reported before the conversion. `key` is stored in
    the record. `poses` by sensor take the place of those beside the frames.
    """
    begin = time.perf_counter()
    check_options([*options, *poses_options(poses)])
    refuse_foreign(out)
    _refuse_source(path, out)
    recording = prepare(path, out, chosen, reading)
    if recording.truth is not None:
        recording = _with_fitting_truth(recording, options)
    preset = preset_of(recording.frames, options)
    if preset is not None:
        options = ["--config", str(preset), *options]
    if not places_sensors(options):
        options = recording.mountings + options
    record = RunRecord(
        path.resolve().name,
        path,
        recording.sensors,
        recording.truth,
        options,
        dict(poses or recording.poses),
        None if preset is None else preset.name,
        notes=tuple(recording.notes),
        broken=recording.broken,
        key=key,
    )
    clear_results(out, (*RESULTS, *_LATER))
    write_record(out, record)
    outcome = run_program(recording.sensors, out, record.arguments)
    record = replace(record, messages=outcome.messages, tracking_s=outcome.wall_s)
    with timed("read and evaluate the results"):
        tracks = read_tracks(out / TRAJECTORY)
        measures = judged(record, tracks)
        if measures is not None:
            write_measures(out, measures)
    if report:
        _draw(read_results(out, record, tracks, measures), out)
    count = len(np.unique(tracks.track_id))
    record = replace(record, tracks=count, total_s=time.perf_counter() - begin)
    write_record(out, record)
    return RunResult(out, record, measures, outcome.answer)


def _with_fitting_truth(recording: Recording, options: list[str]) -> Recording:
    """The recording, without its truth if that is of another time span than the frames.

    Errors in the truth are thus reported before the tracking.
    """
    truth = read_truth(recording.truth)
    frames = [frame for folder in recording.sensors.values() for frame in list_frames(folder)]
    shifted = any("time_offset_s" in option for option in (*options, *recording.mountings))
    if len(truth) == 0 or not frames or shifted:
        return recording
    stamps_s = [frame.stamp_ns * 1e-9 for frame in frames]
    first_s, last_s = truth.time_s.min(), truth.time_s.max()
    if min(stamps_s) <= last_s and first_s <= max(stamps_s):
        return recording
    said = (
        f"{recording.truth}: not evaluated: it is of {first_s:.3f} to {last_s:.3f} s, the frames "
        f"of {min(stamps_s):.3f} to {max(stamps_s):.3f} s"
    )
    note(said)
    return replace(recording, truth=None, notes=[*recording.notes, said])


def _draw(data: ReportData, out: Path) -> None:
    with timed(f"draw: {_FIGURE}"):
        write_file(out / _FIGURE, lambda work: write_figure(figure_data(data), work))
    with timed(f"write: {PAGE}"):
        write_page(data, out)


def is_own(name: str) -> bool:
    """True if a run, or `report` after it, writes a file or folder of this name."""
    return _UNFINISHED.sub("", name) in _OWN


def _refuse_source(path: Path, out: Path) -> None:
    """Refuses the folder of a recording, and one in it with files that are no results."""
    inside = out.resolve().parent == path.resolve() and out.is_dir() and not is_result(out)
    if path.is_dir() and (out.resolve() == path.resolve() or (inside and any(out.iterdir()))):
        raise UsageError(
            f"{out}: has files of the recording {path}, or others that are no results, choose "
            "another folder for the results"
        )


def refuse_foreign(out: Path) -> None:
    """Refuses a folder with files named as results but without the record of a run."""
    if not out.is_dir() or is_result(out):
        return
    foreign = next((name for name in (*RESULTS, *_LATER) if (out / name).exists()), None)
    if foreign is not None:
        raise OutputError(
            f"{out / foreign}: was not written by this command and is not replaced, choose another "
            "folder"
        )
