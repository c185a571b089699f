"""Figures for papers: the page's views drawn by matplotlib as PNG and PDF."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from unlidar.figure import FigureData, save, write_figure
from unlidar.output import clear_results, write_file
from unlidar.report import charts
from unlidar.report.data import ReportData
from unlidar.report.page import begin_of
from unlidar.report.trajectories import track_trajectories, truth_trajectories

FOLDER = "figures"
_KINDS = (".png", ".pdf")
_DASHES = {"solid": "-", "dash": "--", "dot": ":", "dashdot": "-."}  # as matplotlib calls them


def figure_data(data: ReportData) -> FigureData:
    """Input of the flight's figure."""
    return FigureData(
        title=data.record.title,
        returns_m=data.sample.overall_m,
        target_returns_m=data.sample.target_m,
        truth=data.truth,
        tracks=data.tracks,
        measures=data.measures,
        station_m=data.station_m,
    )


def write_figures(data: ReportData, run: Path) -> list[Path]:
    """Writes `run`/figures/*.png and *.pdf; those for which there is no data are left out."""
    folder = run / FOLDER
    names = ("flight", "over_time", "error")
    clear_results(folder, (name + kind for name in names for kind in _KINDS))
    written = []
    for kind in _KINDS:
        path = folder / f"flight{kind}"
        write_file(path, lambda work: write_figure(figure_data(data), work))
        written.append(path)
    figures = {"over_time": _over_time(data), "error": _error(data)}
    for name, figure in figures.items():
        for kind in _KINDS if figure is not None else ():
            path = folder / f"{name}{kind}"
            write_file(path, lambda work, figure=figure: save(figure, work))
            written.append(path)
    return written


def _over_time(data: ReportData) -> Figure | None:
    if len(data.tracks) + len(data.truth) == 0:
        return None
    figure = Figure(figsize=(7.2, 8.5), layout="constrained")
    panels = charts.panels_of(data)
    axes = figure.subplots(len(panels), 1, sharex=True)
    begin_s = begin_of(data)
    trajectories = [*truth_trajectories(data), *track_trajectories(data)]
    for axis, panel in zip(axes, panels, strict=True):
        for trajectory in trajectories if panel.sigma is not None else ():
            for rows in trajectory.drawn.pieces if trajectory.is_track else ():
                middle, half = panel.estimate[rows], 2 * panel.sigma[rows]
                axis.fill_between(
                    trajectory.time_s[rows] - begin_s,
                    middle - half,
                    middle + half,
                    color=trajectory.colour,
                    alpha=0.25,
                    linewidth=0,
                    label="\u00b1 2 sigma",
                )
        for trajectory in trajectories:
            values = panel.estimate if trajectory.is_track else panel.truth
            axis.plot(
                trajectory.drawn.of(trajectory.time_s - begin_s),
                trajectory.drawn.of(values),
                label=trajectory.name,
                color=trajectory.colour,
                linestyle=_DASHES[trajectory.dash],
                linewidth=1.2 * trajectory.width,
            )
        _finish(axis, panel.title)
    known = dict(zip(*reversed(axes[0].get_legend_handles_labels()), strict=True))
    figure.legend(known.values(), known.keys(), loc="outside upper center", ncols=5, frameon=False)
    axes[-1].set_xlabel("time [s]")
    return figure


def _error(data: ReportData) -> Figure | None:
    errors = charts.errors_of(data)
    if len(errors.time_s) == 0:
        return None
    figure = Figure(figsize=(9.5, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    rows = charts.drawn_errors(errors)
    edges = charts.histogram_edges(errors)
    lengths = zip(("error", "without its mean"), charts.lengths_of(errors), strict=True)
    for (name, length), colour in zip(lengths, ("black", charts.ORANGE), strict=True):
        time_s = rows.of(errors.time_s - begin_of(data))
        left.plot(time_s, rows.of(length), color=colour, linewidth=1.2, label=name)
        weights = np.full(len(length), 100 / len(length))
        clipped = np.minimum(length, edges[-1])
        right.hist(clipped, edges, weights=weights, color=colour, alpha=0.55, label=name)
    _finish(left, "length of the error [m]")
    _finish(right, "share [%]")
    left.set_ylim(bottom=0)
    left.set_xlabel("time [s]")
    left.legend(frameon=False)
    right.set_xlabel("length of the error [m]")
    return figure


def _finish(axis: Axes, title: str) -> None:
    axis.set_ylabel(title)
    axis.grid(alpha=0.25)
    axis.spines[["top", "right"]].set_visible(False)
