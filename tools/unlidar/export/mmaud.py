"""`mmaud_results.csv` of the UG2+ challenge: a position for every requested stamp."""

import csv
import io
import zipfile
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from unlidar.completion import complete
from unlidar.csv_rows import csv_rows, numbered_lines
from unlidar.errors import InputError, UsageError, reason
from unlidar.export.trajectory import Result
from unlidar.output import write_file
from unlidar.stamps import format_stamp_ns, parse_stamp_ns

RESULTS_NAME = "mmaud_results.csv"
HEADER = ("Sequence", "Timestamp", "Position", "Classification")

Stamps = dict[str, list[str]]  # original texts by sequence


def write_mmaud(
    results: Sequence[tuple[str, Result]], out: Path, stamps: Stamps | None, uav_type: int
) -> list[Path]:
    """The table, or for a name in .zip the archive with the table that the challenge takes.

    Positions at stamps between and beyond the tracks are those of `completion.complete`. Without
    `stamps` the answer is given at the trajectories' own. InputError for a sequence without any
    track: the challenge requires a position.
    """
    if stamps is not None:
        absent = [name for name in stamps if name not in dict(results)]
        if absent:
            raise UsageError(
                f"--at: asks for sequence '{absent[0]}', given are "
                + ", ".join(name for name, _ in results)
            )
    rows: list[tuple[str, str, str, int]] = []
    for name, result in results:
        if len(result.tracks) == 0:
            raise InputError(f"{name}: has no track, so there is no position to answer with")
        asked = _own_stamps(result) if stamps is None else stamps.get(name, [])
        time_s = np.array([parse_stamp_ns(stamp) * 1e-9 for stamp in asked])
        position = complete(result.tracks, time_s)
        for stamp, xyz in zip(asked, position, strict=True):
            triple = ",".join(f"{v:.6f}" for v in xyz)
            rows.append((name, stamp, f"({triple})", uav_type))
    write_file(out, lambda work: _write(work, rows))
    return [out]


def read_stamps(path: Path, sequences: Sequence[str]) -> Stamps:
    """Requested stamps: a CSV with Sequence and Timestamp, or for one sequence a list of stamps."""
    found: Stamps = {}
    for where, name, stamp in _asked(path, sequences):
        try:
            parse_stamp_ns(stamp)
        except ValueError as error:
            raise InputError(f"{where}: {reason(error)}") from error
        found.setdefault(name, []).append(stamp)
    if not found:
        raise InputError(f"{path}: lists no stamp, expected one for each position")
    return found


def _asked(path: Path, sequences: Sequence[str]) -> Iterator[tuple[str, str, str]]:
    """Where a stamp stands, its sequence, and its text."""
    lines = numbered_lines(path, pipes=True)
    first = next(lines, (1, ""))
    lines = chain([first], lines)
    if "," in first[1] or len(sequences) != 1:
        for row in csv_rows(path, HEADER[:2], lines=lines):
            yield row.where, row.values["Sequence"].strip(), row.values["Timestamp"].strip()
        return
    for number, line in lines:
        if line.strip():
            yield f"{path}:{number}", sequences[0], line.strip()


def _own_stamps(result: Result) -> list[str]:
    return [format_stamp_ns(stamp) for stamp in np.unique(result.tracks.stamp_ns).tolist()]


def _write(work: Path, rows: list[tuple[str, str, str, int]]) -> None:
    if work.suffix == ".zip":
        with zipfile.ZipFile(work, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr(RESULTS_NAME, _table(rows))
    else:
        work.write_text(_table(rows))


def _table(rows: list[tuple[str, str, str, int]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows((HEADER, *rows))
    return text.getvalue()
