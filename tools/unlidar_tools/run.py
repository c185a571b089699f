"""A recording in; trajectory, measures, figure and page out."""

import json
from dataclasses import dataclass
from pathlib import Path

from unlidar_tools.convert import Options, convert, kept_of
from unlidar_tools.convert_command import tell_notes
from unlidar_tools.errors import InputError, UsageError
from unlidar_tools.figure import write_figure
from unlidar_tools.frames_io import find_sensors
from unlidar_tools.output import clear_results, write_file
from unlidar_tools.presets import preset_of
from unlidar_tools.program import Outcome, run_program
from unlidar_tools.report import PAGE, RECORD, RunRecord, load_run, write_page, write_record
from unlidar_tools.report.static import figure_data
from unlidar_tools.station import places_sensors, read_station, station_options
from unlidar_tools.truth import TRUTH_NAME, read_truth

_DEFAULTS = Options()
_MEASURES, _FIGURE = "evaluation.json", "figure.png"


@dataclass(frozen=True)
class Recording:
    """Frame directories by sensor name, and truth and poses as far as they are known."""

    sensors: dict[str, Path]
    truth: Path | None
    poses: list[str]  # `--set` options of the program
    frames: Path  # the folder of the frame directories
    notes: list[str]  # what the user should know of the conversion
    broken: bool  # whether it ended before the recording's end


@dataclass(frozen=True)
class RunResult:
    """What one run found and where it lies."""

    recording: Recording
    outcome: Outcome
    measures: dict | None  # None without truth
    figure: Path
    page: Path
    preset: Path | None  # the configuration that was taken because of what the recording is


def prepare(
    path: Path, out: Path, chosen: list[str] | None = None, reading: Options = _DEFAULTS
) -> Recording:
    """The recording at `path`, converted to `out`/frames unless it holds frame directories.

    Of a broken one what could be read is taken, which a note says.
    """
    if not path.exists():
        raise InputError(f"{path}: does not exist")
    frames = path
    notes, broken = [], False
    sensors = find_sensors(path) if path.is_dir() else {}
    if not sensors:
        frames = out / "frames"
        report = convert(path, frames, chosen, force=True, options=reading)
        notes = report["notes"]
        broken = report["broken"] is not None
        if broken:
            notes.append(f"{report['broken']}; went on with what could be read: {kept_of(report)}")
        tell_notes(notes)
        sensors = {name: frames / name for name in report["frames"]}
    if chosen:
        missing = [name for name in chosen if name not in sensors]
        if missing:
            raise UsageError(f"{path}: has no sensor '{missing[0]}', it holds {', '.join(sensors)}")
        sensors = {name: sensors[name] for name in chosen}
    truth = frames / TRUTH_NAME
    poses = station_options(read_station(frames), list(sensors))
    return Recording(sensors, truth if truth.is_file() else None, poses, frames, notes, broken)


def run(
    path: Path,
    out: Path,
    chosen: list[str] | None,
    options: list[str],
    reading: Options = _DEFAULTS,
) -> RunResult:
    """Converts if need be, tracks, evaluates where there is truth, draws and reports."""
    recording = prepare(path, out, chosen, reading)
    if recording.truth is not None:
        read_truth(recording.truth)  # an error in it is told before the tracking, not after
    clear_results(out, (_MEASURES, _FIGURE, PAGE, RECORD))
    preset = preset_of(recording.frames, options)
    if preset is not None:
        options = ["--config", str(preset), *options]
    if not places_sensors(options):
        options = recording.poses + options
    outcome = run_program(recording.sensors, out, options)
    title = path.resolve().name
    write_record(out, RunRecord(title, recording.sensors, recording.truth, options, outcome.wall_s))
    data = load_run(out)
    if data.measures is not None:
        text = json.dumps(data.measures, indent=2) + "\n"
        write_file(out / _MEASURES, lambda work: work.write_text(text))
    write_file(out / _FIGURE, lambda work: write_figure(figure_data(data), work))
    return RunResult(
        recording, outcome, data.measures, out / _FIGURE, write_page(data, out), preset
    )
