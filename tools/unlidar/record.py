"""`run.json`, the record of a run: its only reader and writer, for all commands.

Beside it lie the program's files with the results, `evaluation.json`, and `explanation.json` of
`unlidar explain`.
"""

import json
from dataclasses import dataclass, field
from pathlib import Path

from unlidar.errors import InputError, reason
from unlidar.limits import read_text
from unlidar.output import RUN_RECORD, write_file
from unlidar.pose_files import poses_options

MEASURES, EXPLANATION = "evaluation.json", "explanation.json"
_VERSION = 1  # format version; unknown ones are rejected


@dataclass(frozen=True)
class RunRecord:
    """Data of a run that its other files lack.

    Written twice: before the program is called, which marks the folder as this package's own, and
    at the end with `tracks` and the times.
    """

    title: str
    recording: Path  # as it was given, converted or not
    frames: dict[str, Path]  # frame directory by sensor
    truth: Path | None
    options: list[str]  # of the program, but those of the other fields
    poses: dict[str, Path] = field(default_factory=dict)  # files of the program's --poses
    preset: str | None = None  # configuration chosen by the kind of recording
    notes: tuple[str, ...] = ()  # for the user, on the conversion
    broken: bool = False  # True if the recording is damaged and only its readable part was tracked
    messages: tuple[str, ...] = ()  # of the program, a line each
    tracks: int | None = None  # None: the run was not completed
    tracking_s: float | None = None  # the program alone
    total_s: float | None = None  # with conversion, evaluation, figure and page
    key: str | None = None  # for batches: hash of input, settings and program

    @property
    def arguments(self) -> list[str]:
        """All options of the program but frames and outputs."""
        return [*self.options, *poses_options(self.poses)]


def write_record(run: Path, record: RunRecord) -> None:
    """Writes `run`/run.json; paths inside `run` stay valid when the folder is moved."""
    content = {
        "version": _VERSION,
        "title": record.title,
        "recording": _written(record.recording, run),
        "frames": {name: _written(path, run) for name, path in record.frames.items()},
        "truth": None if record.truth is None else _written(record.truth, run),
        "options": record.options,
        "poses": {name: _written(path, run) for name, path in record.poses.items()},
        "preset": record.preset,
        "notes": list(record.notes),
        "broken": record.broken,
        "messages": list(record.messages),
        "tracks": record.tracks,
        "tracking_s": _rounded(record.tracking_s),
        "total_s": _rounded(record.total_s),
        "key": record.key,
    }
    _write_object(run / RUN_RECORD, content)


def read_record(run: Path) -> RunRecord:
    """The record of the folder `run`. InputError if absent or of another version."""
    path = run / RUN_RECORD
    if not path.is_file():
        raise InputError(f"{run}: has no {RUN_RECORD}, expected a folder that 'unlidar run' wrote")
    known = read_object(path)
    if known.get("version") != _VERSION:
        raise InputError(
            f"{path}: version is {known.get('version')}, expected {_VERSION}; "
            "run the recording again"
        )
    try:
        return RunRecord(
            title=str(known["title"]),
            recording=run / known["recording"],
            frames={str(name): run / where for name, where in known["frames"].items()},
            truth=None if known["truth"] is None else run / known["truth"],
            options=[str(option) for option in known["options"]],
            poses={str(name): run / where for name, where in known.get("poses", {}).items()},
            preset=None if known["preset"] is None else str(known["preset"]),
            notes=tuple(str(note) for note in known["notes"]),
            broken=bool(known["broken"]),
            messages=tuple(str(line) for line in known["messages"]),
            tracks=None if known["tracks"] is None else int(known["tracks"]),
            tracking_s=_seconds(known["tracking_s"]),
            total_s=_seconds(known["total_s"]),
            key=None if known["key"] is None else str(known["key"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{path}: is not what 'unlidar run' writes: {reason(error)}") from error


def read_finished(run: Path) -> RunRecord:
    """`read_record` of a completed run, else InputError."""
    record = read_record(run)
    if record.tracks is None or record.tracking_s is None:
        raise InputError(f"{run}: the run did not come to its end, run the recording again")
    return record


def is_result(folder: Path) -> bool:
    """True if a folder holds a record, so that its results may be replaced."""
    try:
        read_record(folder)
    except InputError:
        return False
    return True


def write_measures(run: Path, measures: dict) -> None:
    """Writes `run`/evaluation.json."""
    _write_object(run / MEASURES, measures)


def write_explanation(run: Path, explanation: dict) -> None:
    """Writes `run`/explanation.json."""
    _write_object(run / EXPLANATION, explanation)


def read_object(path: Path) -> dict:
    """A JSON object from a file, else InputError."""
    content = read_json(path)
    if not isinstance(content, dict):
        raise InputError(f"{path}: holds a {type(content).__name__}, expected a JSON object")
    return content


def read_json(path: Path) -> object:
    """The content of a JSON file, else InputError."""
    try:
        return json.loads(read_text(path))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from error


def _write_object(path: Path, content: dict) -> None:
    text = json.dumps(content, indent=2) + "\n"
    write_file(path, lambda work: work.write_text(text, encoding="utf-8"))


def _written(path: Path, run: Path) -> str:
    absolute, base = path.absolute(), run.absolute()
    return str(absolute.relative_to(base) if absolute.is_relative_to(base) else absolute)


def _rounded(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds, 3)


def _seconds(value: object) -> float | None:
    return None if value is None else float(str(value))
