"""A recording for the rerun viewer; needs the extra `rerun`."""

from pathlib import Path
from types import ModuleType

import numpy as np

from unlidar.colours import GREEN, GREY, RED, track_colours
from unlidar.extras import load_extra
from unlidar.output import write_file
from unlidar.pieces import pieces_of
from unlidar.report.data import ReportData
from unlidar.report.view_data import target_steps

RECORDING = "recording.rrd"


def write_rrd(data: ReportData, run: Path) -> Path:
    """Writes `run`/recording.rrd: the page's points over time, both trajectories with 2 sigma.

    Throws UsageError if rerun-sdk is not installed.
    """
    rerun = _rerun()
    path = run / RECORDING
    write_file(path, lambda work: _write(rerun, data, work))
    return path


def _rerun() -> ModuleType:
    missing = "--rerun: the Python package rerun-sdk is not installed"
    return load_extra("rerun", "rerun", missing)


def _write(rerun: ModuleType, data: ReportData, path: Path) -> None:
    with rerun.RecordingStream("unlidar", recording_id=data.record.title) as stream:
        stream.save(path)
        up = rerun.ViewCoordinates.RIGHT_HAND_Z_UP
        stream.log("world", up, static=True)
        _log_lines(rerun, stream, data)
        _log_returns(rerun, stream, data)
        _log_positions(rerun, stream, data)


def _log_lines(rerun: ModuleType, stream: object, data: ReportData) -> None:
    for name, xyz_m, pieces, colours in (
        ("truth", data.truth.xyz_m, *_coloured(data.truth.time_s, data.truth.target, RED)),
        ("estimate", data.tracks.xyz_m, *_coloured(data.tracks.time_s, data.tracks.track_id)),
    ):
        strips = rerun.LineStrips3D([xyz_m[rows] for rows in pieces], colors=colours)
        stream.log(f"world/{name}/path", strips, static=True)


def _coloured(
    time_s: np.ndarray, group: np.ndarray, colour: str | None = None
) -> tuple[list[np.ndarray], list[tuple[int, ...]]]:
    """Pieces and the colour of each: that of its track unless one is given."""
    pieces, known = pieces_of(time_s, group), track_colours(group)
    return pieces, [_rgb(colour or known[float(group[rows[0]])]) for rows in pieces]


def _rgb(colour: str) -> tuple[int, ...]:
    return tuple(int(colour[i : i + 2], 16) for i in (1, 3, 5))


def _log_returns(rerun: ModuleType, stream: object, data: ReportData) -> None:
    sample = data.sample
    overall = rerun.Points3D(sample.overall_m, colors=_rgb(GREY), radii=rerun.Radius.ui_points(1.0))
    stream.log("world/returns/all", overall, static=True)
    step_of = target_steps(sample)
    for step, time_s in enumerate(sample.steps_s):
        stream.set_time("time", timestamp=time_s)
        for name, colour, size, points_m in (
            ("returns", (60, 64, 67), 1.5, sample.steps_m[step]),
            ("target_returns", _rgb(GREEN), 4.0, sample.target_m[step_of == step]),
        ):
            points = rerun.Points3D(points_m, colors=colour, radii=rerun.Radius.ui_points(size))
            stream.log(f"world/{name}/now", points)


def _log_positions(rerun: ModuleType, stream: object, data: ReportData) -> None:
    for name, only, time_s, group, xyz_m, sigma_m in (
        ("truth", RED, data.truth.time_s, data.truth.target, data.truth.xyz_m, None),
        ("estimate", None, data.tracks.time_s, data.tracks.track_id, data.tracks.xyz_m,
         data.tracks.sigma_m),
    ):  # fmt: skip
        for rows, colour in zip(*_coloured(time_s, group, only), strict=True):
            place = f"world/{name}/{int(group[rows[0]])}"
            for row in rows:
                stream.set_time("time", timestamp=time_s[row])
                point = rerun.Points3D(
                    [xyz_m[row]], colors=colour, radii=rerun.Radius.ui_points(6.0)
                )
                stream.log(place, point)
                if sigma_m is not None:
                    ellipsoid = rerun.Ellipsoids3D(
                        centers=[xyz_m[row]], half_sizes=[2 * sigma_m[row]], colors=colour
                    )
                    stream.log(f"{place}/two_sigma", ellipsoid)
            # Clear ended tracks.
            stream.set_time("time", timestamp=time_s[rows[-1]] + np.float64(1e-3))
            stream.log(place, rerun.Clear(recursive=True))
