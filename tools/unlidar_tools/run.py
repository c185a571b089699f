"""A recording in; trajectory, measures, figure and page out."""

import json
import re
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from unlidar_tools.convert import convert
from unlidar_tools.convert_command import tell_notes
from unlidar_tools.errors import InputError, OutputError, UsageError, reason
from unlidar_tools.figure import write_figure
from unlidar_tools.frames_io import find_sensors
from unlidar_tools.output import FRAMES, RUN_RECORD, clear_results, write_file
from unlidar_tools.presets import preset_of
from unlidar_tools.program import (
    CLUSTERS,
    SUMMARY,
    TARGET_RETURNS,
    TRAJECTORY,
    check_options,
    run_program,
)
from unlidar_tools.record import (
    MEASURES,
    RunRecord,
    is_result,
    write_measures,
    write_record,
)
from unlidar_tools.report import PAGE, read_results, write_page
from unlidar_tools.report.rrd import RECORDING
from unlidar_tools.report.static import FOLDER, figure_data
from unlidar_tools.telling import timed
from unlidar_tools.truth import TRUTH_NAME, read_truth

CONFIG = "config.yaml"  # in the results of one of many recordings: what was given for all
_FIGURE = "figure.png"
# What is made anew by every run, and all that may lie in its folder.
RESULTS = (TRAJECTORY, SUMMARY, TARGET_RETURNS, CLUSTERS, MEASURES, _FIGURE, PAGE, RUN_RECORD)
_OWN = (*RESULTS, CONFIG, FRAMES, FOLDER, RECORDING)
_UNFINISHED = re.compile(r"^\.partial-\d+-")  # of `write_file`


@dataclass(frozen=True)
class Recording:
    """Frame directories by sensor name, and truth and poses as far as they are known."""

    sensors: dict[str, Path]
    truth: Path | None
    poses: list[str]  # `--set` options of the program
    frames: Path  # the folder of the frame directories


@dataclass(frozen=True)
class RunResult:
    """What one run found and where it lies."""

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


def prepare(path: Path, out: Path, chosen: list[str] | None = None) -> Recording:
    """The recording at `path`, converted to `out`/frames unless it holds frame directories."""
    if not path.exists():
        raise InputError(f"{path}: does not exist")
    frames = path
    sensors = find_sensors(path) if path.is_dir() else {}
    if not sensors:
        frames = out / FRAMES
        with timed(f"convert: {path}"):
            report = convert(path, frames, chosen, force=True)
        tell_notes(report)
        sensors = {name: frames / name for name in report["frames"]}
    if chosen:
        missing = [name for name in chosen if name not in sensors]
        if missing:
            raise UsageError(f"{path}: has no sensor '{missing[0]}', it holds {', '.join(sensors)}")
        sensors = {name: sensors[name] for name in chosen}
    truth = frames / TRUTH_NAME
    poses = _poses(frames, list(sensors))
    return Recording(sensors, truth if truth.is_file() else None, poses, frames)


def run(
    path: Path,
    out: Path,
    chosen: list[str] | None,
    options: list[str],
    key: str | None = None,
) -> RunResult:
    """Converts if need be, tracks, evaluates where there is truth, draws and reports.

    What is wrong with the program or its options is told before the conversion. `key` goes into
    the record.
    """
    begin = time.perf_counter()
    check_options(options)
    refuse_foreign(out)
    recording = prepare(path, out, chosen)
    if recording.truth is not None:
        read_truth(recording.truth)  # an error in it is told before the tracking, not after
    preset = preset_of(recording.frames, options)
    if preset is not None:
        options = ["--config", str(preset), *options]
    record = RunRecord(
        path.resolve().name,
        path,
        recording.sensors,
        recording.truth,
        recording.poses + options,
        None if preset is None else preset.name,
        key=key,
    )
    clear_results(out, RESULTS)
    write_record(out, record)
    outcome = run_program(recording.sensors, out, record.options)
    record = replace(record, messages=outcome.messages, tracking_s=outcome.wall_s)
    with timed("read and evaluate the results"):
        data = read_results(out, record)
        if data.measures is not None:
            write_measures(out, data.measures)
    with timed(f"draw: {_FIGURE}"):
        write_file(out / _FIGURE, lambda work: write_figure(figure_data(data), work))
    with timed(f"write: {PAGE}"):
        write_page(data, out)
    tracks = len(np.unique(data.tracks.track_id))
    record = replace(record, tracks=tracks, total_s=time.perf_counter() - begin)
    write_record(out, record)
    return RunResult(out, record, data.measures, outcome.answer)


def is_own(name: str) -> bool:
    """Whether a run, or `report` after it, gives this name to a file or folder of its results."""
    return _UNFINISHED.sub("", name) in _OWN


def refuse_foreign(out: Path) -> None:
    """Files that have the names of results may be removed only where a run has left its record."""
    if not out.is_dir() or is_result(out):
        return
    foreign = next((name for name in RESULTS if (out / name).exists()), None)
    if foreign is not None:
        raise OutputError(
            f"{out / foreign}: was not written by this command and is not replaced, choose another "
            "folder"
        )


def _poses(frames: Path, sensors: list[str]) -> list[str]:
    """Place and clock of simulated sensors, unless all of them stand at the origin."""
    path = frames / "scenario.json"
    if not path.is_file():
        return []
    try:
        known = json.loads(path.read_text())["scenario"]["sensors"]
        poses = {
            name: (known[name]["position_m"], known[name]["time_offset_s"]) for name in sensors
        }
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: is not what simulate writes: {reason(error)}") from error
    if not any(any(position) or offset for position, offset in poses.values()):
        return []
    options = []
    for name, (position, offset) in poses.items():
        options += ["--set", f"sensors.{name}.translation_m={json.dumps(position)}"]
        options += ["--set", f"sensors.{name}.time_offset_s={offset}"]
    return options
