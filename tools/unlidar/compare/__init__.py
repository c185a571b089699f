"""Several results of one flight side by side, against its truth or against the first of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from unlidar.errors import InputError, UsageError
from unlidar.evaluation import evaluate
from unlidar.evaluation.plausibility import require_common_time
from unlidar.output import RUN_RECORD
from unlidar.pieces import pieces_of
from unlidar.program import TRAJECTORY
from unlidar.record import read_record
from unlidar.truth import Tracks, Truth, read_tracks, read_truth

_MEASURES = ("rmse", "rmse_unbiased", "within1m", "coverage", "false", "nees")


@dataclass(frozen=True)
class Result:
    """The tracks of one program or setting."""

    name: str
    path: Path  # of the trajectory
    tracks: Tracks


@dataclass(frozen=True)
class Results:
    """At least one result, and what they are judged by."""

    results: Sequence[Result]
    reference: Truth  # the truth, or the rows of the first result
    truth: Path | None


def read_results(named: Sequence[tuple[str, Path]], truth: Path | None) -> Results:
    """Reads trajectories and folders of runs; an empty name becomes that of its path.

    Without `truth` that of the folders is taken, which must be one file. UsageError for a name
    that comes twice, InputError for results without common time.
    """
    results: list[Result] = []
    truths: dict[Path, Path] = {}
    for name, path in named:
        trajectory = path / TRAJECTORY if path.is_dir() else path
        own = name or path.name or str(path)
        if any(own == other.name for other in results):
            raise UsageError(f"{path}: the name {own} is taken, expected NAME=RESULT with another")
        results.append(Result(own, trajectory, read_tracks(trajectory)))
        if path.is_dir() and (path / RUN_RECORD).is_file():
            known = read_record(path).truth
            if known is not None:
                truths.setdefault(known.resolve(), path)
    if truth is None and len(truths) > 1:
        one, other = list(truths.values())[:2]
        raise InputError(f"{one} and {other}: have different truths, expected --truth")
    truth = truth or next(iter(truths), None)
    reference = read_truth(truth) if truth is not None else _rows_of(results[0].tracks)
    for result in results if truth is not None else results[1:]:
        try:
            require_common_time(reference, result.tracks)
        except InputError as error:
            raise InputError(f"{result.path}: {error}") from error
    return Results(results, reference, truth)


def comparison_of(results: Results) -> dict:
    """The measures of each result, lengths in metres; those that are not defined are absent."""
    rows = []
    for result in results.results:
        row = {"name": result.name, **_plain(result.tracks)}
        if results.truth is not None or result is not results.results[0]:
            found = evaluate(results.reference, result.tracks)
            row |= {name: found[name] for name in _MEASURES if found.get(name) is not None}
        rows.append(row)
    judged_by = str(results.truth) if results.truth is not None else results.results[0].name
    return {"judged_by": judged_by, "is_truth": results.truth is not None, "results": rows}


def _plain(tracks: Tracks) -> dict:
    """What a result is like by itself."""
    length_m = duration_s = 0.0
    for piece in pieces_of(tracks.time_s, tracks.track_id):
        steps_m = np.diff(tracks.xyz_m[piece], axis=0)
        length_m += float(np.linalg.norm(steps_m, axis=1).sum())
        duration_s += float(tracks.time_s[piece[-1]] - tracks.time_s[piece[0]])
    return {
        "tracks": len(np.unique(tracks.track_id)),
        "rows": len(tracks),
        "duration_s": duration_s,
        "length_m": length_m,
    }


def _rows_of(tracks: Tracks) -> Truth:
    """The rows of a trajectory as what others are judged by."""
    return Truth(tracks.time_s, tracks.track_id, tracks.xyz_m, np.ones(len(tracks), dtype=bool))
