"""Search for the recordings in a folder."""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from unlidar.conversion import EXPECTED, KINDS
from unlidar.errors import InputError, UnlidarError, reason
from unlidar.frames_io import find_sensors, list_frames
from unlidar.output import MARKERS
from unlidar.program import SUMMARY, TRAJECTORY
from unlidar.truth import TRUTH_NAME


@dataclass(frozen=True)
class Found:
    """A recording and its path below the folder that was searched, its name in every table."""

    name: str
    path: Path


def is_recording(path: Path) -> bool:
    """True if `path` is one recording: frame directories, or anything `convert` reads."""
    try:
        if path.is_dir():
            sensors = find_sensors(path)
            if any(_is_result(folder) for folder in (path, *sensors.values())):
                return False
            if sensors:
                return _belong_together(path, sensors)
        # Opening a pipe would block until it has a writer.
        return (path.is_dir() or path.is_file()) and any(kind.matches(path) for kind in KINDS)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from error


def common_folder(given: Sequence[Path]) -> Path:
    """The path itself if it is the only one, else the deepest folder that holds all paths."""
    if len(given) == 1:
        return given[0]
    return Path(os.path.commonpath([_plain(path).parent for path in given]))


def default_results(given: Sequence[Path]) -> Path:
    """Where the results of these recordings go unless another folder is named."""
    return Path("out/run") / common_folder(given).resolve().name


def find_recordings(given: Sequence[Path], results: Path) -> list[Found]:
    """All recordings among the paths that are given and below them, in natural order of names.

    Hidden files, results of earlier runs and the output folder `results` are skipped inside
    folders. Paths given by name always count, also unreadable or empty ones among several: the
    run then reports the reason. Throws InputError if the only folder given holds no recording.
    """
    root = common_folder(given)
    found: dict[str, Found] = {}
    for path in given:
        below = _below(path, _real(results)) if _is_folder(path) else [path]
        if not below and len(given) == 1:
            raise InputError(f"{path}: no recording in it or below, expected {EXPECTED}")
        for one in below or [path]:
            at = one if root == path else _plain(one)
            found.setdefault(_real(one), Found(at.relative_to(root).as_posix(), one))
    return sorted(found.values(), key=lambda f: _natural(f.name))


def _plain(path: Path) -> Path:
    """Absolute and without `..`, links kept, so that names in the results stay below the root."""
    return Path(os.path.abspath(path))  # noqa: PTH100 - resolve() would follow links


def _real(path: Path) -> str:
    """The path with its links resolved, or as it is for circular links, where resolve() raises."""
    return os.path.realpath(path)


def _below(root: Path, results: str) -> list[Path]:
    """The recordings in a folder and further below."""
    found: list[Path] = []
    seen = {results}
    waiting = [root]
    while waiting:
        folder = waiting.pop()
        if _real(folder) in seen:
            continue
        seen.add(_real(folder))
        try:
            entries = [path for path in folder.iterdir() if not path.name.startswith(".")]
        except OSError as error:
            if folder == root:
                raise InputError(f"{folder}: cannot be read: {reason(error)}") from error
            found.append(folder)
            continue
        for path in entries:
            if _real(path) in seen or (path.is_dir() and _is_result(path)):
                continue
            if _is_folder(path):
                waiting.append(path)
            elif path.is_dir() or is_recording(path):
                found.append(path)
    return found


def _is_folder(path: Path) -> bool:
    """True for a folder that is no recording itself but may hold some."""
    try:
        return path.is_dir() and not is_recording(path)
    except InputError:  # an unreadable folder is reported when it is run
        return False


def _is_result(folder: Path) -> bool:
    """True for the output of a run, which holds PCD files as recordings do."""
    return (folder / TRAJECTORY).is_file() and (folder / SUMMARY).is_file()


def _belong_together(folder: Path, sensors: dict[str, Path]) -> bool:
    """True if sibling frame directories are sensors of one recording rather than recordings.

    They are unless one begins after the others have ended.
    """
    if len(sensors) == 1 or any((folder / name).is_file() for name in (*MARKERS, TRUTH_NAME)):
        return True
    try:
        spans = sorted(
            (frames[0].stamp_ns, frames[-1].stamp_ns)
            for frames in (list_frames(directory) for directory in sensors.values())
        )
    except UnlidarError:
        return True  # reported in full when it is run
    last = spans[0][1]
    for begin, end in spans[1:]:
        if begin > last:
            return False
        last = max(last, end)
    return True


def _natural(name: str) -> list[tuple[int, str]]:
    """Sort key that puts seq2 before seq10."""
    parts = re.split(r"(\d+)", name)
    return [(int(p), "") if p.isdecimal() else (-1, p) for p in parts]
