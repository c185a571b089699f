"""Checks by columns and times that truth and trajectory can be of one flight."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from unlidar.csv_rows import columns_of
from unlidar.errors import InputError, UsageError
from unlidar.truth import Tracks, Truth, is_tum

_OF_TRACKS = {"track_id", "support"}  # columns that only a trajectory has
_OF_TRUTH = {"target", "in_view"}
_HOUR_S = 3600.0
_GPS_EPOCH_S, _LEAP_S = 315_964_800.0, 18.0
_NEAR_S = 5.0  # tolerance to a whole hour or an epoch; begins of two recordings differ by less
_LEAST_SHARE = 0.1
_APART_M = 1.0  # of two rows of one time; less may be stamps that were rounded
_UNITS = {1e3: "milliseconds", 1e6: "microseconds", 1e9: "nanoseconds"}


def refuse_swapped(truth: Path, trajectories: Sequence[Path]) -> None:
    """UsageError if the columns show that truth and trajectory were swapped."""
    first, *others = [
        set(() if is_tum(path) else columns_of(path)) for path in (truth, *trajectories)
    ]
    if any("track_id" in columns for columns in others):
        return  # comparing two trajectories is allowed
    if first >= _OF_TRACKS:
        raise UsageError(
            f"{truth}: is a trajectory (it has track_id and support), expected TRUTH first, then "
            "TRAJ"
        )
    for path, columns in zip(trajectories, others, strict=True):
        if found := sorted(columns & _OF_TRUTH):
            raise UsageError(
                f"{path}: is a truth (it has {found[0]}), expected TRUTH first, then TRAJ"
            )


def refuse_repeated(trajectories: Sequence[Path]) -> None:
    """UsageError for a file that is given twice, whose tracks would count twice."""
    known = set()
    for path in trajectories:
        if (resolved := path.resolve()) in known:
            raise UsageError(f"{path}: is given twice, expected each trajectory once")
        known.add(resolved)


def repeated_times(time_s: np.ndarray, number: np.ndarray, xyz_m: np.ndarray) -> str | None:
    """A note on rows of one time and number that are at different places; None without any.

    Those of several drones without a column of their numbers are.
    """
    order = np.lexsort((time_s, number))
    time_s, number, xyz_m = time_s[order], number[order], xyz_m[order]
    is_same = (np.diff(time_s) == 0) & (np.diff(number) == 0)
    is_apart = is_same & (np.linalg.norm(np.diff(xyz_m, axis=0), axis=1) > _APART_M)
    if not is_apart.any():
        return None
    first_s = time_s[1:][is_apart].min()
    return (
        f"{is_apart.sum()} rows are at another place at the time of the row before, the first at "
        f"{first_s:.3f} s: rows of several drones need their numbers"
    )


def require_common_time(truth: Truth, tracks: Tracks) -> None:
    """InputError with both spans if all rows lie before or after the truth.

    Empty trajectories and truths are valid.
    """
    if len(truth) == 0 or len(tracks) == 0:
        return
    known, own = _span(truth.time_s), _span(tracks.time_s)
    if own[0] <= known[1] and known[0] <= own[1]:
        return
    raise InputError(
        f"no time in common with the truth: {own[0]:.3f} to {own[1]:.3f} s, truth "
        f"{known[0]:.3f} to {known[1]:.3f} s{_hint(known, own)}"
    )


def _span(time_s: np.ndarray) -> tuple[float, float]:
    return float(time_s.min()), float(time_s.max())


def _hint(known: tuple[float, float], own: tuple[float, float]) -> str:
    """A likely cause, and the shift that would align the begins."""
    for factor, unit in _UNITS.items():
        for name, (first, second) in (("trajectory", (own, known)), ("truth", (known, own))):
            if _is_like((first[0] / factor, first[1] / factor), second):
                return f"; the {name} seems to be in {unit}, expected seconds"
    offset_s = known[0] - own[0]
    hours = round(offset_s / _HOUR_S)
    if hours and abs(hours) <= 14 and abs(offset_s - hours * _HOUR_S) < _NEAR_S:
        return f"; {abs(hours)} h apart: --time-offset {hours * _HOUR_S:g}?"
    for epoch_s in (_GPS_EPOCH_S, _GPS_EPOCH_S - _LEAP_S):
        if abs(abs(offset_s) - epoch_s) < _NEAR_S:
            return f"; GPS against Unix time: --time-offset {np.copysign(epoch_s, offset_s):.0f}?"
    return f"; their begins are {abs(offset_s):.3f} s apart: --time-offset {offset_s:.3f}?"


def _is_like(one: tuple[float, float], other: tuple[float, float]) -> bool:
    """True if two spans overlap and have similar lengths."""
    long_enough = one[1] - one[0] >= _LEAST_SHARE * (other[1] - other[0])
    return long_enough and one[0] <= other[1] and other[0] <= one[1]
