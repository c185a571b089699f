"""The figures of the page, as plotly figures. Times are seconds after the recording's begin."""

from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from unlidar.colours import GREEN, GREY, RED, faded
from unlidar.evaluation.association import cover, identities
from unlidar.figure import view_box
from unlidar.report.data import ReportData
from unlidar.report.lines import Drawn, drawn_rows, range_sigma, speed
from unlidar.report.trajectories import Trajectory, track_trajectories, truth_trajectories

ORANGE = "#b45f06"
_DARK = "#3c4043"
_BINS = 40
_LEAST_AROUND_M = 16.0
_EYE = (0.85, -1.3, 0.6)
_FONT = {"family": "system-ui, sans-serif", "size": 13, "color": "#202124"}
# The first traces of the 3-D view, which page.js fills; the second four follow the time slider.
OVERALL, TARGETS = 0, 1
TIME_STEP_TRACES = [2, 3, 4, 5]  # returns, target returns, truth, estimate
FIRST_TRAJECTORY = 6  # lines of the truth and of the tracks, then their tubes


@dataclass(frozen=True)
class Errors:
    """Estimate minus truth at the in-view rows of the truth that a track covers."""

    time_s: np.ndarray  # (N,) Unix
    target: np.ndarray  # (N,)
    error_m: np.ndarray  # (N, 3)
    sigma_m: np.ndarray  # (N, 3), NaN where not known


def errors_of(data: ReportData) -> Errors:
    """All errors, before thinning for the charts.

    With several drones each is compared with its matched track, as the nearest may be another's.
    """
    several = len(np.unique(data.truth.target)) > 1
    at = identities(data.truth, data.tracks).own if several else cover(data.truth, data.tracks)
    kept = np.flatnonzero(data.truth.in_view & np.isfinite(at.distance_m))
    kept = kept[np.argsort(data.truth.time_s[kept], kind="stable")]
    return Errors(
        data.truth.time_s[kept], data.truth.target[kept], at.error_m[kept], at.sigma_m[kept]
    )


def drawn_errors(errors: Errors) -> Drawn:
    """Errors that are drawn as a curve."""
    return drawn_rows(errors.time_s, errors.target)


def scene(data: ReportData) -> go.Figure:
    """The 3-D view; its point clouds and markers are still empty."""
    figure = go.Figure()
    # Many target returns get small markers, so as not to hide the estimate.
    target_size = 1.4 if data.sample.targets > 1000 else 2.6
    for name, colour, size, opacity, symbol in (
        ("returns", GREY, 1.4, 0.35, "circle"),
        ("target returns", GREEN, target_size, 0.5, "circle"),
        ("returns now", _DARK, 2.2, 0.8, "circle"),
        ("target returns now", GREEN, 2 * target_size, 1.0, "circle"),
        ("truth now", RED, 7.0, 1.0, "diamond"),
        ("estimate now", _DARK, 7.0, 1.0, "diamond"),
    ):
        figure.add_scatter3d(
            x=[], y=[], z=[], mode="markers", name=name,
            marker={"size": size, "color": colour, "opacity": opacity, "symbol": symbol},
            hoverinfo="skip" if name.startswith("returns") else "x+y+z+name",
        )  # fmt: skip
    for one in (*truth_trajectories(data), *track_trajectories(data)):
        figure.add_scatter3d(
            x=[], y=[], z=[], mode="lines", name=one.name, legendgroup=one.name,
            line={"color": one.colour, "width": 4 * one.width, "dash": one.dash},
        )  # fmt: skip
    for one in track_trajectories(data) if data.tracks.sigma_m is not None else ():
        figure.add_mesh3d(
            x=[], y=[], z=[], i=[], j=[], k=[], name=f"{one.name} ± 2 sigma",
            color=one.colour, opacity=0.18, legendgroup=one.name, hoverinfo="skip",
        )  # fmt: skip
    figure.add_scatter3d(
        **_station(data), name="station",
        marker={"size": 5, "color": "black", "symbol": "square"},
    )  # fmt: skip
    low, high = box_of(data)
    axes = {
        f"{axis}axis": {
            "title": {"text": f"{axis} [m]"},
            "range": [float(low[i]), float(high[i])],
            "backgroundcolor": "white",
            "gridcolor": "#dadce0",
            "zerolinecolor": "#9aa0a6",
        }
        for i, axis in enumerate("xyz")
    }
    figure.update_layout(
        _layout(),
        scene={**axes, "aspectmode": "data", "camera": camera_of(low, high)},
        legend={"orientation": "h", "y": 0, "yanchor": "top", "itemsizing": "constant"},
        margin={"l": 0, "r": 0, "t": 0, "b": 0},
        uirevision="kept",
    )
    return figure


def _station(data: ReportData) -> dict:
    """Its place, or the way that it goes."""
    if len(data.station_m) == 1:
        return {"x": [0], "y": [0], "z": [0], "mode": "markers"}
    way = data.station_m.round(2).T.tolist()
    return dict(zip("xyz", way, strict=True)) | {"mode": "lines", "line": {"color": "black"}}


def box_of(data: ReportData) -> tuple[np.ndarray, np.ndarray]:
    """Initial limits of the 3-D view: the flight and its surroundings."""
    low, high = view_box(data.flight_m, data.sample.overall_m, 0.35, data.station_m)
    lacking = np.maximum(_LEAST_AROUND_M - (high - low), 0) / 2
    lacking[2] = 0
    return low - lacking, high + lacking


def wide_box_of(data: ReportData) -> tuple[np.ndarray, np.ndarray]:
    """Flight, station and 98 % of the returns along each axis."""
    low, high = box_of(data)
    if len(data.sample.overall_m):
        outer = np.quantile(data.sample.overall_m, [0.01, 0.99], axis=0)
        low, high = np.minimum(low, outer[0]), np.maximum(high, outer[1])
    return low, high


def camera_of(low: np.ndarray, high: np.ndarray) -> dict:
    """Looks at the whole box from the south-east, from a little above."""
    # With equal scales plotly's unit is the geometric mean of the box's sides.
    longest = (high - low).max() / np.cbrt(np.prod(high - low))
    return {
        "eye": {axis: round(float(longest * v), 3) for axis, v in zip("xyz", _EYE, strict=True)},
        "center": {"x": 0, "y": 0, "z": -0.06},
    }


@dataclass(frozen=True)
class Panel:
    """A quantity over time: all rows of the tracks (N,) and of the truth (M,)."""

    title: str
    estimate: np.ndarray
    truth: np.ndarray
    sigma: np.ndarray | None  # (N,), None where it is not known


def panels_of(data: ReportData) -> list[Panel]:
    """x, y, z, speed and range."""
    tracks, truth = data.tracks, data.truth
    sigma = tracks.sigma_m
    panels = [
        Panel(
            f"{axis} [m]",
            tracks.xyz_m[:, i],
            truth.xyz_m[:, i],
            None if sigma is None else sigma[:, i],
        )
        for i, axis in enumerate("xyz")
    ]
    our_speed = (
        speed(tracks.time_s, tracks.track_id, tracks.xyz_m)
        if tracks.velocity_mps is None
        else np.linalg.norm(tracks.velocity_mps, axis=1)
    )
    their_speed = speed(truth.time_s, truth.target, truth.xyz_m)
    panels.append(Panel("speed [m/s]", our_speed, their_speed, None))
    our_range = np.linalg.norm(tracks.xyz_m, axis=1)
    their_range = np.linalg.norm(truth.xyz_m, axis=1)
    range_m = None if sigma is None else range_sigma(tracks.xyz_m, sigma)
    return [*panels, Panel("range [m]", our_range, their_range, range_m)]


def over_time(data: ReportData, begin_s: float) -> go.Figure:
    """x, y, z, speed and range with truth and +-2 sigma."""
    truths, tracks = truth_trajectories(data), track_trajectories(data)
    figure = make_subplots(rows=5, cols=1, shared_xaxes=True, vertical_spacing=0.025)
    for row, panel in enumerate(panels_of(data), start=1):
        for one in tracks if panel.sigma is not None else ():
            x, y = _band(one, begin_s, panel.estimate, 2 * panel.sigma)
            figure.add_scatter(
                x=x, y=y, row=row, col=1, fill="toself", mode="lines", line={"width": 0},
                fillcolor=faded(one.colour, 0.22), legendgroup=one.name, showlegend=False,
                hoverinfo="skip",
            )  # fmt: skip
        for one in (*truths, *tracks):
            values = panel.estimate if one.is_track else panel.truth
            figure.add_scatter(
                x=one.drawn.of(one.time_s - begin_s), y=one.drawn.of(values),
                row=row, col=1, mode="lines", name=one.name, legendgroup=one.name,
                showlegend=row == 1, hovertemplate="%{y:.2f}",
                line={"color": one.colour, "width": 1.5 * one.width, "dash": one.dash},
            )  # fmt: skip
        figure.update_yaxes(title_text=panel.title, row=row, col=1)
    figure.update_xaxes(title_text="time [s]", row=5, col=1)
    figure.update_layout(_layout(), hovermode="x unified", height=820)
    return _framed(figure)


def error_over_time(errors: Errors, begin_s: float) -> go.Figure:
    """The length of the error, with and without its mean, and its three components."""
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.05)
    rows = drawn_errors(errors)
    time_s = rows.of(errors.time_s - begin_s)
    length, rest = lengths_of(errors)
    for name, colour, values in (
        ("error", "black", length),
        ("without its mean", ORANGE, rest),
    ):
        figure.add_scatter(
            x=time_s, y=rows.of(values), row=1, col=1, mode="lines", name=name,
            line={"color": colour, "width": 1.5}, hovertemplate="%{y:.3f} m",
        )  # fmt: skip
    for i, (axis, colour) in enumerate(zip("xyz", ("#7b1fa2", "#00796b", "#6d4c41"), strict=True)):
        figure.add_scatter(
            x=time_s, y=rows.of(errors.error_m[:, i]), row=2, col=1, mode="lines", name=f"d{axis}",
            line={"color": colour, "width": 1.5}, hovertemplate="%{y:.3f} m",
        )  # fmt: skip
    figure.update_yaxes(title_text="length [m]", rangemode="tozero", row=1, col=1)
    figure.update_yaxes(title_text="per axis [m]", row=2, col=1)
    figure.update_xaxes(title_text="time [s]", row=2, col=1)
    figure.update_layout(_layout(), hovermode="x unified", height=430)
    return _framed(figure)


def error_histogram(errors: Errors) -> go.Figure:
    """Histogram of the error's length, over all errors."""
    length, rest = lengths_of(errors)
    edges = histogram_edges(errors)
    middle, width = (edges[1:] + edges[:-1]) / 2, edges[1] - edges[0]
    figure = go.Figure()
    for name, colour, values in (("error", _DARK, length), ("without its mean", ORANGE, rest)):
        count, _ = np.histogram(np.minimum(values, edges[-1]), edges)
        figure.add_bar(
            x=middle, y=100 * count / len(values), name=name, opacity=0.6,
            marker={"color": colour, "line": {"width": 0}}, width=width,
            hovertemplate="%{x:.3f} m: %{y:.1f} %",
        )  # fmt: skip
    figure.update_layout(
        _layout(),
        barmode="overlay",
        height=430,
        xaxis={"title": {"text": "length of the error [m]"}, "range": [0, float(edges[-1])]},
        yaxis={"title": {"text": "share [%]"}},
    )
    return _framed(figure)


def lengths_of(errors: Errors) -> tuple[np.ndarray, np.ndarray]:
    """Length of each error, with and without the mean error."""
    rest = errors.error_m - errors.error_m.mean(axis=0)
    return np.linalg.norm(errors.error_m, axis=1), np.linalg.norm(rest, axis=1)


def histogram_edges(errors: Errors) -> np.ndarray:
    """Edges of equal bins up to the 99th percentile; the last bin includes larger errors."""
    longest = max(1e-3, 1.1 * float(np.quantile(lengths_of(errors)[0], 0.99)))
    return np.linspace(0, longest, _BINS + 1)


def _band(
    trajectory: Trajectory, begin_s: float, middle: np.ndarray, half: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The outline of middle +- half, a closed polygon per piece."""
    x, y = [], []
    for rows in trajectory.drawn.pieces:
        time_s = trajectory.time_s[rows] - begin_s
        x += [time_s, time_s[::-1], [np.nan]]
        y += [(middle + half)[rows], (middle - half)[rows][::-1], [np.nan]]
    return np.concatenate(x).astype(np.float32), np.concatenate(y).astype(np.float32)


def _layout() -> dict:
    return {
        "template": "plotly_white",
        "font": _FONT,
        "margin": {"l": 58, "r": 10, "t": 34, "b": 44},
        "legend": {"orientation": "h", "y": 1, "yanchor": "bottom", "x": 0},
        "hoverlabel": {"font": {"size": 12}},
    }


def _framed(figure: go.Figure) -> go.Figure:
    figure.update_xaxes(showline=True, linecolor="#9aa0a6", ticks="outside", gridcolor="#e8eaed")
    figure.update_yaxes(showline=True, linecolor="#9aa0a6", ticks="outside", gridcolor="#e8eaed")
    return figure
