"""Which recordings lie in a folder."""

import re
from dataclasses import dataclass
from pathlib import Path

from unlidar_tools.conversion import KINDS
from unlidar_tools.errors import InputError, UnlidarError, reason
from unlidar_tools.frames_io import find_sensors, list_frames
from unlidar_tools.output import MARKERS
from unlidar_tools.program import SUMMARY, TRAJECTORY
from unlidar_tools.truth import TRUTH_NAME


@dataclass(frozen=True)
class Found:
    """A recording and its path below the folder that was searched, its name in every table."""

    name: str
    path: Path


def is_recording(path: Path) -> bool:
    """Whether `path` is one recording: frame directories, or anything `convert` reads."""
    try:
        if path.is_dir():
            sensors = find_sensors(path)
            if any(_is_result(folder) for folder in (path, *sensors.values())):
                return False
            if sensors:
                return _belong_together(path, sensors)
        return any(kind.matches(path) for kind in KINDS)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from error


def find_recordings(root: Path, results: Path) -> list[Found]:
    """All recordings below `root`, in natural order of their names.

    Left out are hidden files, results of earlier runs and the folder `results` that this run
    writes to. Throws InputError if there is none.
    """
    found: list[Found] = []
    seen = {results.resolve()}
    waiting = [root]
    while waiting:
        folder = waiting.pop()
        if folder.resolve() in seen:  # also a circle of links
            continue
        seen.add(folder.resolve())
        try:
            entries = [path for path in folder.iterdir() if not path.name.startswith(".")]
        except OSError as error:
            raise InputError(f"{folder}: cannot be read: {reason(error)}") from error
        for path in entries:
            if path.resolve() in seen or (path.is_dir() and _is_result(path)):
                continue
            if is_recording(path):
                found.append(Found(path.relative_to(root).as_posix(), path))
            elif path.is_dir():
                waiting.append(path)
    if not found:
        expected = "; ".join(kind.description for kind in KINDS)
        raise InputError(f"{root}: no recording in it, expected folders of PCD frames; {expected}")
    return sorted(found, key=lambda f: _natural(f.name))


def _is_result(folder: Path) -> bool:
    """What a run leaves holds PCD files too."""
    return (folder / TRAJECTORY).is_file() and (folder / SUMMARY).is_file()


def _belong_together(folder: Path, sensors: dict[str, Path]) -> bool:
    """Whether frame directories side by side are the sensors of one recording, or recordings.

    They are one unless a frame directory begins after the others have ended.
    """
    if len(sensors) == 1 or any((folder / name).is_file() for name in (*MARKERS, TRUTH_NAME)):
        return True
    try:
        spans = sorted(
            (frames[0].stamp_ns, frames[-1].stamp_ns)
            for frames in (list_frames(directory) for directory in sensors.values())
        )
    except UnlidarError:
        return True  # told in full when it is run
    last = spans[0][1]
    for begin, end in spans[1:]:
        if begin > last:
            return False
        last = max(last, end)
    return True


def _natural(name: str) -> list[tuple[int, str]]:
    """seq2 before seq10."""
    parts = re.split(r"(\d+)", name)
    return [(int(p), "") if p.isdecimal() else (-1, p) for p in parts]
