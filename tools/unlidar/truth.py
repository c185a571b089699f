"""Ground truth and trajectories, read into arrays; CSV or TUM is detected by content."""

import csv
import math
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TextIO

import numpy as np

from unlidar.errors import InputError, listed, reason
from unlidar.limits import lines_of, require_file
from unlidar.stamps import format_stamp_ns, parse_seconds_ns, parse_stamp_ns

TRUTH_NAME = "ground_truth.csv"
_TUM = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
_EXPECTED = f"timestamp,x,y,z in its first line, or lines of {' '.join(_TUM)}"
_TUM_COLUMNS = ("timestamp", "x", "y", "z")  # the first TUM columns, as named in CSV


@dataclass(frozen=True)
class Truth:
    """Positions of the targets, rows in the order of the file."""

    time_s: np.ndarray  # (N,)
    target: np.ndarray  # (N,)
    xyz_m: np.ndarray  # (N, 3)
    in_view: np.ndarray  # (N,) bool: a sensor could see the target

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.time_s)


@dataclass(frozen=True)
class Tracks:
    """Rows of a trajectory file, in its order."""

    time_s: np.ndarray  # (N,)
    track_id: np.ndarray  # (N,)
    xyz_m: np.ndarray  # (N, 3)
    sigma_m: np.ndarray | None = None  # (N, 3) standard deviations, None where there are none
    velocity_mps: np.ndarray | None = None  # (N, 3), None where there are none
    support: np.ndarray | None = None  # (N,) returns behind a row, None where not known
    stamp_ns: np.ndarray | None = None  # (N,) int64, exact; None where only time_s is known

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.time_s)


def read_truth(path: Path) -> Truth:
    """Columns timestamp, x, y, z and optionally target (0) and in_view (1); or TUM."""
    table = _read_columns(path, {"timestamp", "x", "y", "z"}, {"target": 0.0, "in_view": 1.0})
    return Truth(table["timestamp"], table["target"], _xyz(table), table["in_view"] > 0)


def read_tracks(path: Path) -> Tracks:
    """Columns timestamp, x, y, z and optionally the others of a `traj.csv`; or TUM: one track."""
    others = [*_triple("sigma_{}"), *_triple("v{}"), "support"]
    table = _read_columns(
        path, {"timestamp", "x", "y", "z"}, {"track_id": 0.0} | dict.fromkeys(others, math.nan)
    )

    def known(names: Sequence[str]) -> np.ndarray | None:
        columns = np.stack([table[name] for name in names], axis=1)
        return None if np.isnan(columns).any() else columns

    support = known(["support"])
    return Tracks(
        table["timestamp"],
        table["track_id"],
        _xyz(table),
        known(_triple("sigma_{}")),
        known(_triple("v{}")),
        None if support is None else support[:, 0],
        table["stamp_ns"],
    )


def read_all_tracks(paths: Sequence[Path]) -> Tracks:
    """The tracks of several files together, renumbered to be distinct.

    A TUM file holds one track, as the format has no number for it.
    """
    parts = [read_tracks(path) for path in paths]
    if len(parts) == 1:
        return parts[0]

    def joined(name: str) -> np.ndarray | None:
        columns = [getattr(part, name) for part in parts]
        return None if any(column is None for column in columns) else np.concatenate(columns)

    of_file = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    pairs = np.stack([of_file, joined("track_id")], axis=1)
    _, track_id = np.unique(pairs, axis=0, return_inverse=True)
    others = {f.name: joined(f.name) for f in fields(Tracks)}
    return Tracks(**others | {"track_id": track_id.reshape(-1).astype(float)})


def is_tum(path: Path) -> bool:
    """True if the first line that is no comment has eight words, or all lines are comments."""
    try:
        require_file(path)
        with path.open(encoding="utf-8-sig") as file:
            return _is_tum(file)
    except (OSError, ValueError):
        return False  # reported in full when it is read


def columns_of(path: Path) -> set[str]:
    """The column names of a CSV; empty for TUM, or if it cannot be read."""
    try:
        require_file(path)
        with path.open(newline="", encoding="utf-8-sig") as file:
            return set(next(csv.reader(lines_of(file)), ()))
    except (OSError, ValueError, csv.Error):
        return set()  # reported in full when it is read


def _triple(pattern: str) -> list[str]:
    return [pattern.format(axis) for axis in "xyz"]


def _xyz(table: dict[str, np.ndarray]) -> np.ndarray:
    return np.stack([table["x"], table["y"], table["z"]], axis=1)


def _read_columns(
    path: Path, required: set[str], optional: dict[str, float]
) -> dict[str, np.ndarray]:
    columns = {name: array("d") for name in (*required, *optional)}
    stamps_ns = array("q")
    try:
        require_file(path)
        with path.open(newline="", encoding="utf-8-sig") as file:
            tum = _is_tum(file)
            file.seek(0)
            for line, row in _tum_rows(path, file) if tum else _csv_rows(path, file, required):
                for name, values in columns.items():
                    values.append(_number(path, line, name, row.get(name), optional))
                stamps_ns.append(_stamp_ns(path, line, row["timestamp"]))
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from error
    table = {name: np.array(values, dtype=float) for name, values in columns.items()}
    return table | {"stamp_ns": np.array(stamps_ns, dtype=np.int64)}


def _csv_rows(path: Path, file: TextIO, required: set[str]) -> Iterator[tuple[int, dict[str, str]]]:
    reader = csv.reader(lines_of(file))
    names = next(reader, [])
    missing = sorted(required - set(names))
    if missing:
        why = _first_line(names)
        raise InputError(f"{path}: has no column {missing[0]}, {why}, expected {_EXPECTED}")
    for values in reader:
        if not values:
            continue
        if len(values) != len(names):
            raise InputError(
                f"{path}:{reader.line_num}: {len(values)} values, expected {len(names)}"
            )
        yield reader.line_num, dict(zip(names, values, strict=True))


def _first_line(names: Sequence[str]) -> str:
    """A description of an unexpected first line, for messages."""
    first = ",".join(names).strip()
    words = first.replace(",", " ").replace(";", " ").split()
    if not words:
        return "it is empty" if not names else "its first line is empty"
    if all(_is_number(word) for word in words):
        return f"its first line is {len(words)} numbers"
    if len(names) == 1 and len(words) > 1:
        return "its first line has no commas"
    return f"it has {listed(names)}"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _tum_rows(path: Path, file: TextIO) -> Iterator[tuple[int, dict[str, str]]]:
    for line, text in enumerate(lines_of(file), 1):
        words = text.split()
        if not words or words[0].startswith("#"):
            continue
        if len(words) != len(_TUM):
            raise InputError(f"{path}:{line}: {len(words)} values, expected {' '.join(_TUM)}")
        yield line, dict(zip(_TUM_COLUMNS, words, strict=False))


def _is_tum(file: TextIO) -> bool:
    commented = False
    for text in lines_of(file):
        words = text.split()
        if words and not words[0].startswith("#"):
            return len(words) == len(_TUM) and "," not in text
        commented |= bool(words)
    return commented


def _stamp_ns(path: Path, line: int, text: str) -> int:
    try:
        return parse_seconds_ns(text)
    except ValueError as error:
        raise InputError(
            f"{path}:{line}: timestamp is '{text[:40]}'{_unit_of(text)}, expected seconds"
        ) from error


def _unit_of(text: str) -> str:
    """A hint if a stamp looks like Unix time in another unit than seconds."""
    try:
        spelled = format_stamp_ns(parse_stamp_ns(text.strip()))
    except ValueError:
        return ""
    units = {13: "milli", 16: "micro", 19: "nano"}
    unit = units.get(len(text.strip().lstrip("-")))
    return f", which may be {unit}seconds ({spelled} s)" if unit else ""


def _number(
    path: Path, line: int, name: str, text: str | None, optional: dict[str, float]
) -> float:
    if not text and name in optional:
        return optional[name]
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{path}:{line}: {name} is '{text or ''}', expected a finite number")
    return value
