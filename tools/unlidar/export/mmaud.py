"""`mmaud_results.csv` of the UG2+ challenge: a position for every requested stamp."""

import csv
import io
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from unlidar.completion import complete
from unlidar.errors import InputError, UsageError, reason
from unlidar.export.trajectory import Result
from unlidar.limits import read_text
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
    try:
        lines = read_text(path).splitlines()
        if lines and "," in lines[0]:
            rows = [(row["Sequence"], row["Timestamp"]) for row in csv.DictReader(lines)]
        elif len(sequences) == 1:
            rows = [(sequences[0], line) for line in lines if line.strip()]
        else:
            raise InputError(f"{path}: has no columns Sequence and Timestamp for several sequences")
        found: Stamps = {}
        for name, stamp in rows:
            stamp = stamp.strip()
            parse_stamp_ns(stamp)
            found.setdefault(name.strip(), []).append(stamp)
    except KeyError as error:
        raise InputError(f"{path}: has no column {error.args[0]}") from error
    except (OSError, ValueError, AttributeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read as stamps: {reason(error)}") from error
    return found


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
