"""Trajectories of tracks and truth, with name and colour as used in all views."""

from dataclasses import dataclass

import numpy as np

from unlidar.colours import RED, track_colours
from unlidar.report.data import ReportData
from unlidar.report.lines import Drawn, drawn_by_group

_DASHES = ("solid", "dash", "dot", "dashdot")


@dataclass(frozen=True)
class Trajectory:
    """The trajectory of a track, or of a drone of the truth."""

    name: str
    colour: str
    dash: str
    is_track: bool
    drawn: Drawn
    time_s: np.ndarray  # (N,) Unix, of all tracks or of the whole truth
    xyz_m: np.ndarray  # (N, 3)

    @property
    def width(self) -> float:
        """Relative line width; wider for the truth, which is then visible behind the estimate."""
        return 1.0 if self.is_track else 1.6


def truth_trajectories(data: ReportData) -> list[Trajectory]:
    """Trajectories of the truth: red, distinguished by dashes."""
    truth = data.truth
    drawn = drawn_by_group(truth.time_s, truth.target)
    return [
        Trajectory(
            "truth" if len(drawn) == 1 else f"truth of drone {target:g}",
            RED,
            _DASHES[index % len(_DASHES)],
            False,
            one,
            truth.time_s,
            truth.xyz_m,
        )
        for index, (target, one) in enumerate(drawn.items())
    ]


def track_trajectories(data: ReportData) -> list[Trajectory]:
    """Trajectories of the tracks, each with its own colour."""
    tracks = data.tracks
    colours = track_colours(tracks.track_id)
    return [
        Trajectory(
            f"track {number:g}", colours[number], "solid", True, one, tracks.time_s, tracks.xyz_m
        )
        for number, one in drawn_by_group(tracks.time_s, tracks.track_id).items()
    ]


def spans(trajectory: Trajectory) -> list[tuple[float, float]]:
    """Begin and end of each piece, Unix time."""
    return [
        (float(trajectory.time_s[piece[0]]), float(trajectory.time_s[piece[-1]]))
        for piece in trajectory.drawn.pieces
    ]
