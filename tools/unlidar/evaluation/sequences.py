"""Evaluation of many sequences, from a manifest or folders of results, in groups."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from unlidar.csv_rows import csv_rows, numbered_lines
from unlidar.errors import InputError
from unlidar.evaluate_options import Options
from unlidar.evaluation.comparison import compare_files
from unlidar.evaluation.measures import measure
from unlidar.output import FRAMES, RUN_RECORD
from unlidar.presets import about_truth
from unlidar.program import TRAJECTORY
from unlidar.record import MEASURES, read_json, read_record
from unlidar.reporting import note
from unlidar.truth import TRUTH_NAME

ALL = "all"
_COLUMNS = ("truth", "trajectory")


@dataclass(frozen=True)
class Flight:
    """One flight to evaluate."""

    name: str
    group: str  # day, night, ...; empty: none
    truth: Path
    trajectory: Path
    one_clock: bool = False  # True if a run has already compared the two


def read_manifest(path: Path) -> list[Flight]:
    """A CSV, or a JSON list of objects: truth, trajectory and optionally sequence and group.

    Paths are relative to the manifest. An unnamed sequence gets the name of its trajectory's
    folder.
    """
    if path.suffix.lower() == ".json":
        entries = [(f"{path}: entry {n}", one) for n, one in enumerate(_objects(path), 1)]
    else:
        lines = numbered_lines(path, pipes=True)
        entries = [(row.where, row.values) for row in csv_rows(path, _COLUMNS, lines=lines)]
    if not entries:
        raise InputError(f"{path}: lists no sequence, expected rows with {', '.join(_COLUMNS)}")
    return [_of_entry(path.parent, where, entry) for where, entry in entries]


def find_results(folder: Path, group: str = "") -> list[Flight]:
    """The folder itself if it holds a traj.csv, else all folders below it that do.

    Of these, those that were run without a truth are left out with a note. InputError if none is
    left.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: is no folder, expected results with a {TRAJECTORY}")
    if (folder / TRAJECTORY).is_file():
        return [_of_results(folder.resolve().name, group, folder)]
    found = sorted(path.parent for path in folder.rglob(TRAJECTORY))
    names = {one.relative_to(folder).as_posix(): one for one in found}
    names = {name: one for name, one in names.items() if "/." not in f"/{name}"}  # unfinished
    if not names:
        raise InputError(f"{folder}: holds no {TRAJECTORY}, nor does a folder below it")
    flights = []
    for name, one in names.items():
        try:
            flights.append(_of_results(name, group, one))
        except NoTruthError as error:
            note(f"{error}, left out")
    if not flights:
        raise InputError(f"{folder}: none of its {len(names)} results has a truth to compare with")
    return flights


def evaluate_sequences(sequences: Iterable[Flight], options: Options) -> dict:
    """Measures of each sequence, of each group's sequences together, and of all together.

    Each sequence is aligned on its own. Within a group every stamp of the truth counts once.
    """
    judged = [
        (one, compare_files(one.truth, [one.trajectory], options, one.one_clock))
        for one in sequences
    ]
    groups = list(dict.fromkeys(one.group for one, _ in judged if one.group))
    return {
        "sequences": [
            {"sequence": one.name, "group": one.group, **measure([result], options)}
            | about_truth(one.truth)
            for one, result in judged
        ],
        "groups": {
            group: measure([r for one, r in judged if one.group == group], options)
            for group in groups
        }
        | {ALL: measure([result for _, result in judged], options)},
    }


def _of_results(name: str, group: str, folder: Path) -> Flight:
    judged = (folder / MEASURES).is_file()
    return Flight(name, group, _truth_of(folder), folder / TRAJECTORY, judged)


def _objects(path: Path) -> list:
    entries = read_json(path)
    if not isinstance(entries, list):
        raise InputError(f"{path}: is no list, expected objects with {', '.join(_COLUMNS)}")
    return entries


def _of_entry(folder: Path, where: str, entry: object) -> Flight:
    if not isinstance(entry, dict):
        raise InputError(f"{where}: is {entry!r}, expected truth and trajectory")
    for name in _COLUMNS:
        if not isinstance(entry.get(name), str) or not entry[name]:
            raise InputError(f"{where}: has no {name}, expected a path")
    trajectory = folder / entry["trajectory"]
    return Flight(
        str(entry.get("sequence") or trajectory.resolve().parent.name),
        str(entry.get("group") or ""),
        folder / entry["truth"],
        trajectory,
    )


class NoTruthError(InputError):
    """Results of a recording that has no truth."""


def _truth_of(folder: Path) -> Path:
    """The truth recorded by the run, else one beside the results."""
    places = [folder / TRUTH_NAME, folder / FRAMES / TRUTH_NAME]
    has_record = (folder / RUN_RECORD).is_file()
    known = read_record(folder).truth if has_record else None
    if known is not None:
        places.insert(0, known)
    truth = next((place for place in places if place.is_file()), None)
    if truth is not None:
        return truth
    if known is not None:
        raise InputError(f"{folder}: its truth {known} is no longer there; a manifest can name it")
    if has_record:
        raise NoTruthError(f"{folder}: was run without a truth; a manifest can name one")
    raise InputError(
        f"{folder}: has a {TRAJECTORY} but neither {RUN_RECORD} nor {TRUTH_NAME} nor "
        f"{FRAMES}/{TRUTH_NAME}; a manifest can name a truth elsewhere"
    )


def names_are_unique(sequences: Sequence[Flight]) -> None:
    """InputError if two sequences of a group share a name, as tables could not distinguish them."""
    seen = set()
    for one in sequences:
        if (one.group, one.name) in seen:
            raise InputError(f"{one.trajectory}: a second sequence '{one.name}' in one group")
        seen.add((one.group, one.name))
