"""The figure of `unlidar compare`: where each result is, and how far from what it is judged by."""

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from unlidar.colours import RED, track_colours
from unlidar.compare import Results
from unlidar.evaluation import Options, compare
from unlidar.figure import plain, save
from unlidar.pieces import pieces_of
from unlidar.truth import Tracks, Truth


def write_comparison(results: Results, path: Path) -> None:
    """From above, from the side, each axis and the error over time, as .png or .pdf."""
    figure = Figure(figsize=(15, 8.4), layout="constrained")
    grid = figure.add_gridspec(4, 2, width_ratios=(1, 1.2))
    above, side = figure.add_subplot(grid[:2, 0]), figure.add_subplot(grid[2:, 0])
    over_time = [figure.add_subplot(grid[row, 1]) for row in range(4)]
    origin_s = _origin_s(results)
    colours = list(track_colours(np.arange(len(results.results))).values())
    curves: list[tuple[str, Tracks | Truth, np.ndarray, str, float]] = []
    if results.truth is not None:
        curves.append(("truth", results.reference, results.reference.target, RED, 3.2))
    for result, colour in zip(results.results, colours, strict=True):
        curves.append((result.name, result.tracks, result.tracks.track_id, colour, 1.5))
    for name, rows, group, colour, width in curves:
        label: str | None = plain(name)
        for piece in pieces_of(rows.time_s, group):
            at_m, time_s = rows.xyz_m[piece], rows.time_s[piece] - origin_s
            style = {"color": colour, "linewidth": width}
            above.plot(at_m[:, 0], at_m[:, 1], label=label, **style)
            side.plot(at_m[:, 0], at_m[:, 2], **style)
            for axis in range(3):
                over_time[axis].plot(time_s, at_m[:, axis], **style)
            label = None
    for result, colour in zip(results.results, colours, strict=True):
        if results.truth is None and result is results.results[0]:
            continue
        found = compare(results.reference, result.tracks, Options())
        error_m = np.where(found.covered, found.nearest.distance_m, math.nan)
        order = np.argsort(results.reference.time_s, kind="stable")
        over_time[3].plot(
            results.reference.time_s[order] - origin_s, error_m, ".", color=colour, markersize=3
        )
    _finish(above, "x [m]", "y [m]", "From above")
    _finish(side, "x [m]", "z [m]", "From the side")
    for panel, label in zip(over_time, ("x [m]", "y [m]", "z [m]", "error [m]"), strict=True):
        panel.set_ylabel(label)
        panel.grid(alpha=0.25)
    over_time[3].set_xlabel(f"time since {origin_s:.3f} [s]")
    if results.truth is None:
        over_time[3].set_ylabel(plain(f"from {results.results[0].name} [m]"))
    over_time[3].set_yscale("symlog", linthresh=0.1)
    figure.legend(loc="outside lower center", ncols=6, frameon=False, fontsize=11)
    save(figure, path)


def _origin_s(results: Results) -> float:
    times = [results.reference.time_s, *(r.tracks.time_s for r in results.results)]
    return float(min((t.min() for t in times if len(t)), default=0.0))


def _finish(panel: Axes, x: str, y: str, title: str) -> None:
    panel.set_aspect("equal", adjustable="datalim")
    panel.set_xlabel(x)
    panel.set_ylabel(y)
    panel.set_title(title, fontsize=11)
    panel.grid(alpha=0.25)
