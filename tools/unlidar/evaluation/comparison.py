"""Comparison of one trajectory with one truth, row by row: the input of all measures."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from unlidar.completion import complete
from unlidar.errors import InputError
from unlidar.evaluate_options import AUTO, Options
from unlidar.evaluation.alignment import (
    IDENTITY,
    Alignment,
    align,
    estimate_time_offset,
    shift,
)
from unlidar.evaluation.association import Coverage, OwnRows, cover, identities, own_rows
from unlidar.evaluation.coordinates import coordinate_mismatch
from unlidar.evaluation.plausibility import (
    refuse_repeated,
    refuse_swapped,
    repeated_times,
    require_common_time,
)
from unlidar.reporting import note
from unlidar.truth import Tracks, Truth, read_all_tracks, read_truth


@dataclass(frozen=True)
class Comparison:
    """Errors per row of the truth (N), in order of time, and per row of the tracks (M)."""

    tracks: int
    time_s: np.ndarray  # (N,)
    target: np.ndarray  # (N,)
    seen: np.ndarray  # (N,) bool: in view of a sensor
    nearest: Coverage  # (N,)
    own: Coverage  # (N,) matched one to one
    sigma_basis: Coverage  # (N,) `nearest` or `own`; used for NEES
    switches: int
    completed_m: np.ndarray  # (N, 3) error of the completed track; NaN without one
    rows: OwnRows  # (M,)
    align: str
    alignment: Alignment
    time_offset_s: float
    time_offset_sigma_s: float | None  # None: the offset was given
    coordinate_warning: str | None  # the likely mismatch, None if there is none

    @property
    def nees(self) -> np.ndarray:
        """(N,) NaN where not covered or the trajectory has no sigma."""
        return _nees(self.sigma_basis, self.alignment)

    @property
    def covered(self) -> np.ndarray:
        """(N,) bool: in view and with an estimate."""
        return self.seen & np.isfinite(self.nearest.distance_m)

    @property
    def nees_unbiased(self) -> np.ndarray:
        """(K,) of the covered rows, about their mean error: a lever arm is not in sigma."""
        known = self.sigma_basis.rows(self.covered & np.isfinite(self.sigma_basis.distance_m))
        if len(known.distance_m) == 0:
            return np.zeros(0)
        mean_m = known.error_m.mean(axis=0)
        return _nees(replace(known, error_m=known.error_m - mean_m), self.alignment)

    @property
    def matched(self) -> np.ndarray:
        """(N,) bool: in view and with a track of its own."""
        return np.isfinite(self.own.distance_m)

    @property
    def drones(self) -> int:
        """Number of targets."""
        return len(np.unique(self.target))


def compare_files(
    truth: Path, trajectories: Sequence[Path], options: Options, one_clock: bool = False
) -> Comparison:
    """`compare` on files; errors and warnings name the first trajectory.

    Their time spans must overlap unless they are known to be of `one_clock`. UsageError if
    truth and trajectory are swapped, or a trajectory is given twice.
    """
    refuse_swapped(truth, trajectories)
    refuse_repeated(trajectories)
    known, tracks = read_truth(truth), read_all_tracks(trajectories)
    for path, text in (
        (truth, repeated_times(known.time_s, known.target, known.xyz_m)),
        (
            ", ".join(map(str, trajectories)),
            repeated_times(tracks.time_s, tracks.track_id, tracks.xyz_m),
        ),
    ):
        if text is not None:
            note(f"{path}: {text} (target of a truth, track_id of a trajectory)")
    if tracks.sigma_m is not None and (zeros := (tracks.sigma_m == 0).any(axis=1).sum()):
        note(f"{trajectories[0]}: {zeros} of {len(tracks)} rows have a sigma of 0: NEES is without")
    try:
        if not one_clock:
            given_s = 0.0 if options.time_offset == AUTO else float(options.time_offset)
            require_common_time(known, shift(tracks, given_s))
        compared = compare(known, tracks, options)
    except InputError as error:
        raise InputError(f"{trajectories[0]}: {error}") from error
    if compared.coordinate_warning is not None:
        note(f"{trajectories[0]}: {compared.coordinate_warning}")
    return compared


def compare(truth: Truth, tracks: Tracks, options: Options) -> Comparison:
    """Shifts and aligns the tracks by the options, then compares them with the truth."""
    order = np.argsort(truth.time_s, kind="stable")
    truth = Truth(*(column[order] for column in (
        truth.time_s, truth.target, truth.xyz_m, truth.in_view)))  # fmt: skip
    estimated = options.time_offset == AUTO and len(truth) > 0 and len(tracks) > 0
    offset_s, sigma_s = 0.0, None
    if estimated:
        offset_s, sigma_s = estimate_time_offset(options.align, truth, tracks)
    elif options.time_offset != AUTO:
        offset_s = float(options.time_offset)
    if offset_s:
        tracks = shift(tracks, offset_s)
    alignment = align(options.align, truth, tracks) if options.align != "none" else IDENTITY
    moved = alignment.apply(tracks) if options.align != "none" else tracks
    nearest = cover(truth, moved)
    who = identities(truth, moved)
    met = np.isfinite(nearest.distance_m)
    known_m = truth.xyz_m[met]
    are_aligned = options.align != "none"
    return Comparison(
        tracks=len(np.unique(tracks.track_id)),
        time_s=truth.time_s,
        target=truth.target,
        seen=truth.in_view,
        nearest=nearest,
        own=who.own,
        # With several targets the nearest track, and its sigma, may be another target's.
        sigma_basis=who.own if len(np.unique(truth.target)) > 1 else nearest,
        switches=who.switches,
        completed_m=complete(moved, truth.time_s) - truth.xyz_m,
        rows=own_rows(truth, moved),
        align=options.align,
        alignment=alignment,
        time_offset_s=offset_s,
        time_offset_sigma_s=sigma_s,
        coordinate_warning=coordinate_mismatch(
            known_m, known_m + nearest.error_m[met], are_aligned
        ),
    )


def _nees(estimate: Coverage, alignment: Alignment) -> np.ndarray:
    """Error squared over variance; the sigmas are those of the axes before the alignment."""
    error = estimate.error_m @ alignment.rotation
    known = (estimate.sigma_m > 0).all(axis=1)
    nees = np.full(len(error), np.nan)
    nees[known] = ((error[known] / estimate.sigma_m[known]) ** 2).sum(axis=1)
    return nees
