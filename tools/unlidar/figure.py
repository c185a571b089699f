"""The figure of the paper: returns grey, target returns green, truth red, each track a colour."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from mpl_toolkits.mplot3d.axes3d import Axes3D

from unlidar.colours import GREEN, GREY, RED, track_colours
from unlidar.evaluation.markdown import percent
from unlidar.evaluation.measures import several_drones
from unlidar.pieces import pieces_of
from unlidar.sanitize import printable
from unlidar.truth import Tracks, Truth

_LEAST_SPAN_M = 6.0
_MOST_NAMED = 8  # tracks in the legend


@dataclass(frozen=True)
class FigureData:
    """Content of the figure; every part but the title may be empty."""

    title: str
    returns_m: np.ndarray  # (N, 3)
    target_returns_m: np.ndarray  # (N, 3)
    truth: Truth
    tracks: Tracks
    measures: dict | None  # of `evaluate`, for the title
    station_m: np.ndarray = field(default_factory=lambda: np.zeros((1, 3)))  # or its way


def write_figure(data: FigureData, path: Path) -> None:
    """Draws a 3-D view, a view from above and one from the side, all in metres.

    The suffix of `path` selects the format: .png or .pdf.
    """
    figure = Figure(figsize=(15, 7.6), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.25, 1))
    view = figure.add_subplot(grid[:, 0], projection="3d")
    top = figure.add_subplot(grid[0, 1])
    side = figure.add_subplot(grid[1, 1])
    flight = np.concatenate([data.truth.xyz_m, data.tracks.xyz_m])
    _draw_3d(view, data, *view_box(flight, data.returns_m, 0.35, data.station_m))
    flat = view_box(flight, data.returns_m, 0.25, data.station_m)
    _draw_flat(top, data, (0, 1), *flat, "From above")
    _draw_flat(side, data, (0, 2), *flat, "From the side")
    figure.suptitle(plain(headline(data)), fontsize=14)
    figure.legend(
        handles=legend(data), loc="outside lower center", ncols=6, frameon=False, fontsize=11
    )
    save(figure, path)


def save(figure: Figure, path: Path) -> None:
    """Writes the figure in the format of the suffix; the same figure gives the same bytes."""
    kind = path.suffix[1:]
    figure.savefig(
        path, dpi=110, format=kind, metadata={"CreationDate" if kind == "pdf" else "Software": None}
    )


def plain(text: str) -> str:
    """A text for matplotlib, which reads formulas between dollars, and hides labels after `_`."""
    text = printable(text).replace("$", r"\$")
    return f" {text}" if text.startswith("_") else text


def headline(data: FigureData) -> str:
    number = len(np.unique(data.tracks.track_id))
    found = "no track" if number == 0 else "1 track" if number == 1 else f"{number} tracks"
    if data.measures is None:
        return f"{data.title}: {found}, no ground truth"
    if "rmse" not in data.measures:
        coverage = data.measures.get("coverage")
        rest = "no drone in the truth" if coverage is None else f"coverage {100 * coverage:.1f} %"
        return f"{data.title}: {found}, {rest}"
    m = data.measures
    if several_drones(m):
        error = f"RMSE {m['matched_rmse']:.3f} m" if "matched_rmse" in m else "none matched"
        error += f" (one track a drone, {percent(m['matched'])} of the time)"
    else:
        error = f"RMSE {m['rmse']:.3f} m ({m['rmse_unbiased']:.3f} m without the mean offset)"
    return f"{data.title}: {found}, {error}, coverage {percent(m['coverage'])}"


def view_box(
    flight_m: np.ndarray, returns_m: np.ndarray, margin: float, station_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The box about the flight and the station; without a flight, about most of the returns.

    `margin` is the share of the longest side that is added around, less above and below.
    """
    if len(flight_m) == 0 and len(returns_m):
        flight_m = np.quantile(returns_m, [0.05, 0.95], axis=0)
    points = np.concatenate([flight_m, station_m])
    low, high = points.min(axis=0), points.max(axis=0)
    span = (high - low).max()
    around = margin * span * np.array([1.0, 1.0, 0.5])
    low, high = low - around, high + around
    lacking = np.maximum(_LEAST_SPAN_M - (high - low), 0) / 2
    return low - lacking, high + lacking


def _lines(data: FigureData) -> list[tuple[np.ndarray, str, float]]:
    truth = pieces_of(data.truth.time_s, data.truth.target)
    tracks = pieces_of(data.tracks.time_s, data.tracks.track_id)
    colours = track_colours(data.tracks.track_id)
    return [(data.truth.xyz_m[rows], RED, 3.2) for rows in truth] + [
        (data.tracks.xyz_m[rows], colours[float(data.tracks.track_id[rows[0]])], 1.6)
        for rows in tracks
    ]


def _draw_3d(view: Axes3D, data: FigureData, low: np.ndarray, high: np.ndarray) -> None:
    view.computed_zorder = False  # lines stay above the cloud
    # 3-D axes do not clip.
    inside = np.all((data.returns_m >= low) & (data.returns_m <= high), axis=1)
    view.scatter(
        *data.returns_m[inside].T, s=2, c=GREY, alpha=0.45, linewidths=0, rasterized=True, zorder=1
    )
    view.scatter(
        *data.target_returns_m.T, s=9, c=GREEN, alpha=0.8, linewidths=0, rasterized=True, zorder=2
    )
    for order, (line, colour, width) in enumerate(_lines(data), start=3):
        view.plot(*line.T, color=colour, linewidth=width, zorder=order)
    view.plot(*data.station_m.T, color="black", linewidth=1.2, linestyle=":", zorder=2)
    view.scatter(*data.station_m[0], marker="^", s=60, c="black", zorder=2)
    for axis, name in enumerate("xyz"):
        getattr(view, f"set_{name}lim")(low[axis], high[axis])
        getattr(view, f"set_{name}label")(f"{name} [m]")
    view.set_box_aspect(high - low, zoom=1.1)
    view.view_init(elev=22, azim=-58)


def _draw_flat(
    panel: Axes,
    data: FigureData,
    axes: tuple[int, int],
    low: np.ndarray,
    high: np.ndarray,
    title: str,
) -> None:
    a, b = axes
    returns = data.returns_m
    panel.scatter(
        returns[:, a], returns[:, b], s=2, c=GREY, alpha=0.45, linewidths=0, rasterized=True
    )
    target = data.target_returns_m
    panel.scatter(
        target[:, a], target[:, b], s=9, c=GREEN, alpha=0.8, linewidths=0, rasterized=True, zorder=2
    )
    for order, (line, colour, width) in enumerate(_lines(data), start=3):
        panel.plot(line[:, a], line[:, b], color=colour, linewidth=width, zorder=order)
    station = data.station_m
    panel.plot(station[:, a], station[:, b], color="black", linewidth=1.2, linestyle=":", zorder=2)
    panel.scatter(*station[0, [a, b]], marker="^", s=50, c="black", zorder=2)
    panel.set_xlim(low[a], high[a], auto=True)
    panel.set_ylim(low[b], high[b], auto=True)
    panel.set_aspect("equal", adjustable="datalim")  # extends the limits to fill the panel
    panel.set_xlabel(f"{'xyz'[a]} [m]")
    panel.set_ylabel(f"{'xyz'[b]} [m]")
    panel.set_title(title, fontsize=11)
    panel.grid(alpha=0.25)


def legend(data: FigureData) -> list[Line2D]:
    """A legend handle for each kind of data, and for each track."""

    def dot(colour: str, label: str, marker: str = "o") -> Line2D:
        return Line2D([], [], color=colour, marker=marker, linestyle="", markersize=6, label=label)

    handles = [dot(GREY, "returns"), dot(GREEN, "target returns")]
    if len(data.truth):
        handles.append(Line2D([], [], color=RED, linewidth=3.2, label="ground truth"))
    colours = track_colours(data.tracks.track_id)
    handles += [
        Line2D([], [], color=colour, linewidth=1.6, label=f"track {number:g}")
        for number, colour in list(colours.items())[:_MOST_NAMED]
    ]
    if len(colours) > _MOST_NAMED:
        handles.append(Line2D([], [], linestyle="", label=f"and {len(colours) - _MOST_NAMED} more"))
    return [*handles, dot("black", "station", "^")]
