"""Ground truth and trajectories, read into arrays; CSV or TUM is detected by content."""

import math
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from unlidar.csv_rows import Row, csv_rows, numbered_lines
from unlidar.errors import InputError
from unlidar.reporting import note
from unlidar.stamps import format_stamp_ns, parse_seconds_ns, parse_stamp_ns

TRUTH_NAME = "ground_truth.csv"
_TUM = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
_EXPECTED = f"timestamp,x,y,z in its first line, or lines of {' '.join(_TUM)}"
_REQUIRED = ("timestamp", "x", "y", "z")  # of a CSV, and the first columns of TUM


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
    table = _read_columns(path, {"target": 0.0, "in_view": 1.0})
    return Truth(table["timestamp"], table["target"], _xyz(table), table["in_view"] > 0)


def read_tracks(path: Path) -> Tracks:
    """Columns timestamp, x, y, z and optionally the others of a `traj.csv`; or TUM: one track."""
    others = [*_triple("sigma_{}"), *_triple("v{}"), "support"]
    table = _read_columns(path, {"track_id": 0.0} | dict.fromkeys(others, math.nan))

    def known(names: Sequence[str]) -> np.ndarray | None:
        columns = np.stack([table[name] for name in names], axis=1)
        lacking = np.isnan(columns)
        rows = lacking.any(axis=1)
        if rows.any() and not lacking.all():
            lacked = ", ".join(np.array(names)[lacking.any(axis=0)])
            no_nees = ", so there is no NEES" if names[0].startswith("sigma") else ""
            note(
                f"{path}: {rows.sum()} of {len(rows)} rows lack {lacked}: no row's "
                f"{', '.join(names)} are used{no_nees}"
            )
        return None if rows.any() else columns

    for name in _triple("sigma_{}"):
        if (table[name] < 0).any():
            raise InputError(f"{path}: {name} is {np.nanmin(table[name]):g}, expected at least 0")
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

    without = [str(p) for p, part in zip(paths, parts, strict=True) if part.sigma_m is None]
    if 0 < len(without) < len(parts):
        note(f"{', '.join(without)}: no sigmas, which other files have, so there is no NEES")
    of_file = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    pairs = np.stack([of_file, joined("track_id")], axis=1)
    _, track_id = np.unique(pairs, axis=0, return_inverse=True)
    others = {f.name: joined(f.name) for f in fields(Tracks)}
    return Tracks(**others | {"track_id": track_id.reshape(-1).astype(float)})


def is_tum(path: Path) -> bool:
    """True if the first line that is no comment has eight words, or all lines are comments.

    InputError if it cannot be read.
    """
    commented = False
    for _, text in numbered_lines(path):
        words = text.split()
        if words and not words[0].startswith("#"):
            return len(words) == len(_TUM) and "," not in text
        commented |= bool(words)
    return commented


def _triple(pattern: str) -> list[str]:
    return [pattern.format(axis) for axis in "xyz"]


def _xyz(table: dict[str, np.ndarray]) -> np.ndarray:
    return np.stack([table["x"], table["y"], table["z"]], axis=1)


def _read_columns(path: Path, optional: dict[str, float]) -> dict[str, np.ndarray]:
    columns = {name: array("d") for name in (*_REQUIRED, *optional)}
    stamps_ns = array("q")
    for row in _tum_rows(path) if is_tum(path) else csv_rows(path, _REQUIRED, _EXPECTED):
        for name, values in columns.items():
            values.append(row.number(name, optional.get(name)))
        stamps_ns.append(_stamp_ns(row))
    table = {name: np.array(values, dtype=float) for name, values in columns.items()}
    return table | {"stamp_ns": np.array(stamps_ns, dtype=np.int64)}


def _tum_rows(path: Path) -> Iterator[Row]:
    for line, text in numbered_lines(path):
        words = text.split()
        if not words or words[0].startswith("#"):
            continue
        if len(words) != len(_TUM):
            raise InputError(f"{path}:{line}: {len(words)} values, expected {' '.join(_TUM)}")
        yield Row(path, line, dict(zip(_REQUIRED, words, strict=False)))


def _stamp_ns(row: Row) -> int:
    text = row.values["timestamp"]
    try:
        return parse_seconds_ns(text)
    except ValueError as error:
        raise InputError(
            f"{row.where}: timestamp is '{text[:40]}'{_unit_of(text)}, expected seconds"
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
