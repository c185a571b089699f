"""The report page: one HTML file that needs nothing but a browser."""

import json
import platform
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from string import Template

import numpy as np
import plotly
from plotly.graph_objects import Figure
from plotly.offline import get_plotlyjs

from unlidar import __version__
from unlidar.figure import FigureData, headline
from unlidar.report import charts
from unlidar.report.data import ReportData
from unlidar.report.html import (
    cards,
    drones_table,
    explanation_section,
    note,
    number,
    run_tables,
    tracks_table,
    warnings,
)
from unlidar.report.sample import FARTHEST_M
from unlidar.report.trajectories import track_trajectories, truth_trajectories
from unlidar.report.view_data import pack_trajectories, pack_view

_PAGE = Path(__file__).with_name("page")
_MOST_CLUSTERS = 1_000
_CLUSTERS_SHOWN = 25
# Columns of the cluster table shown on the page; the file has all.
_CLUSTER_COLUMNS = {
    "rank": "rank", "psi": "psi", "psi_iou": "psi IoU", "psi_rho": "psi rho", "iou": "IoU",
    "relative_density": "R", "von_neumann_ratio": "von Neumann", "size": "returns",
    "frames": "frames", "centroid_x": "x [m]", "centroid_y": "y [m]", "centroid_z": "z [m]",
    "volume_m3": "volume [m³]", "merged_density_per_m3": "density [1/m³]", "id": "id",
    "eligible": "eligible",
}  # fmt: skip


def page_of(data: ReportData) -> str:
    """The whole page; the same data gives the same text."""
    begin_s = begin_of(data)
    errors = charts.errors_of(data)
    figures = {"scene": charts.scene(data)}
    if len(data.tracks) or len(data.truth):
        figures["over_time"] = charts.over_time(data, begin_s)
    if len(errors.time_s):
        figures["error_over_time"] = charts.error_over_time(errors, begin_s)
        figures["error_histogram"] = charts.error_histogram(errors)
    head, rows = _cluster_rows(data)
    moments = pack_view(data, begin_s)
    content = {
        "moments": moments,
        "first_step": _first_step(moments),
        "traces": {
            "overall": charts.OVERALL, "targets": charts.TARGETS, "moment": charts.TIME_STEP_TRACES,
        },
        "courses": pack_trajectories(data, begin_s, charts.FIRST_TRAJECTORY),
        "duration": round(end_of(data) - begin_s, 3),
        "timed": ["over_time", "error_over_time"],
        "boxes": {"near": _box(charts.box_of(data)), "wide": _box(charts.wide_box_of(data))},
        "clusters": {"rows": rows, "shown": _CLUSTERS_SHOWN},
    }  # fmt: skip
    parts = {
        "title": escape(data.record.title),
        "subtitle": escape(_subtitle(data, begin_s)),
        "verdict": escape(_verdict(data)),
        "verdict_class": "" if len(data.tracks) else "none",
        "warnings": warnings(data),
        "cards": cards(data),
        "scene_note": escape(_scene_note(data)),
        "over_time": _over_time(data, "over_time" in figures),
        "error": _error(data, errors),
        "explanation": explanation_section(data.explanation, begin_s),
        "tracks": tracks_table(data, begin_s),
        "clusters": _cluster_section(data, head, rows),
        "run": run_tables(data, _versions(data)),
        "style": (_PAGE / "page.css").read_text(encoding="utf-8"),
        "script": (_PAGE / "page.js").read_text(encoding="utf-8"),
        "plotly": get_plotlyjs(),
        "data": _embedded(content, figures),
    }
    template = Template((_PAGE / "page.html").read_text(encoding="utf-8"))
    return template.substitute(parts)


def begin_of(data: ReportData) -> float:
    """Unix time of the page's second 0: the earliest time of frames, tracks and truth."""
    firsts = [
        t.min() for t in (data.sample.steps_s, data.tracks.time_s, data.truth.time_s) if len(t)
    ]
    return float(min(firsts, default=0.0))


def end_of(data: ReportData) -> float:
    """Unix time of the latest of frames, tracks and truth."""
    lasts = [
        t.max() for t in (data.sample.steps_s, data.tracks.time_s, data.truth.time_s) if len(t)
    ]
    return float(max(lasts, default=0.0))


def _embedded(content: dict, figures: dict[str, Figure]) -> str:
    text = json.dumps(content, separators=(",", ":"), ensure_ascii=False)
    drawn = ",".join(f'"{name}":{figure.to_json()}' for name, figure in figures.items())
    # Escaped, so that no text can close the script element.
    return f'{text[:-1]},"figures":{{{drawn}}}}}'.replace("<", "\\u003c")


def _first_step(moments: dict) -> int:
    """The middle one of the time steps with an estimate, else the first."""
    known = [step for step, found in enumerate(moments["estimate"]) if found]
    return known[len(known) // 2] if known else 0


def _box(box: tuple[np.ndarray, np.ndarray]) -> dict:
    low, high = ([round(float(v), 2) for v in corner] for corner in box)
    return {"low": low, "high": high, "camera": charts.camera_of(*box)}


def _verdict(data: ReportData) -> str:
    if len(data.tracks):
        found = headline(FigureData("", np.zeros((0, 3)), np.zeros((0, 3)), data.truth,
                                    data.tracks, data.measures))  # fmt: skip
        return found.removeprefix(": ")
    if data.measures is None:
        return "No drone was found. There is no ground truth to compare with."
    if len(data.truth):
        return "No drone was found, although the ground truth has one: coverage 0.0 %."
    return "No drone was found, and the ground truth has none."


def _subtitle(data: ReportData, begin_s: float) -> str:
    begin = datetime.fromtimestamp(begin_s, UTC).isoformat(sep=" ", timespec="milliseconds")
    duration_s = end_of(data) - begin_s
    method = data.summary.get("config", {}).get("method", "")
    parts = [f"second 0 is {begin.removesuffix('+00:00')} UTC", f"{duration_s:.1f} s"]
    parts += [", ".join(data.record.frames)]
    parts += [f"method {method}"] if method else []
    return " · ".join(parts)


def _scene_note(data: ReportData) -> str:
    s = data.sample
    parts = [f"Folder no longer there, drawn without its frames: {p}." for p in data.missing_frames]
    if s.frames:
        parts.append(
            f"Grey: {_some(len(s.overall_m), s.returns - s.far, 'returns')} of {s.frames:,} "
            f"frames. The slider has {len(s.steps_s):,} moments of "
            f"{_frames(s.frames_per_step)} of the first sensor and what the others measured "
            f"meanwhile, with {_some(s.in_steps, s.returns - s.far, 'returns')}."
        )
    if s.far:
        parts.append(f"{s.far:,} returns farther than {FARTHEST_M:.0f} m are not drawn.")
    if s.targets:
        parts.append(f"Green: {_some(len(s.target_m), s.targets, 'target returns')}.")
        lost = int(np.isnan(s.target_s).sum())
        if lost and s.frames:
            parts.append(f"{lost:,} of them were not found in the frames and do not move.")
    return " ".join([*parts, *_lines_note(data), "A click on a name in the legend hides it."])


def _lines_note(data: ReportData) -> list[str]:
    parts = []
    for name, trajectories in (
        ("truth", truth_trajectories(data)),
        ("estimate", track_trajectories(data)),
    ):
        if trajectories and trajectories[0].drawn.every > 1:
            every = trajectories[0].drawn.every
            parts.append(f"Of the {name} one row in {every} is drawn, and each end.")
    if len(data.tracks) and data.tracks.sigma_m is not None:
        parts.append("The tube about an estimate is ± 2 sigma wide.")
    return parts


def _some(shown: int, total: int, what: str) -> str:
    if shown >= total:
        return f"all {total:,} {what}"
    return f"{shown:,} of {total:,} {what}, chosen at random"


def _frames(number_of: int) -> str:
    return "one frame" if number_of == 1 else f"{number_of} frames"


def _over_time(data: ReportData, drawn: bool) -> str:
    if not drawn:
        return "<p>No drone was found and there is no ground truth: nothing changes over time.</p>"
    text = (
        "Range is the distance from the origin of the common frame; its sigma takes the axes as "
        "independent. Speed of the truth: its way across half a second. "
    )
    text += "" if len(data.tracks) else "No drone was found: only the truth is drawn. "
    text += "" if len(data.truth) else "There is no ground truth. "
    return f"<div id='over_time' class='plot'></div>{note(text + ' '.join(_lines_note(data)))}"


def _error(data: ReportData, errors: charts.Errors) -> str:
    if data.measures is None:
        return "<p>There is no ground truth: the error is not known.</p>"
    if len(errors.time_s) == 0:
        return "<p>No row of the ground truth is covered by a track: there is no error to show.</p>"
    length, rest = charts.lengths_of(errors)
    edges = charts.histogram_edges(errors)
    beyond = int((length > edges[-1]).sum())
    seen = int(data.truth.in_view.sum())
    drones = drones_table(data)
    against = "the track that each drone has to itself" if drones else "the nearest track"
    text = (
        f"At {len(length):,} of {seen:,} in-view rows of the truth, against {against}. "
        f"Median {np.median(length):.3f} m, 95th percentile {np.quantile(length, 0.95):.3f} m, "
        f"largest {length.max():.3f} m; without the mean error "
        f"({', '.join(f'{v:.3f}' for v in errors.error_m.mean(axis=0))}) m: "
        f"median {np.median(rest):.3f} m, 95th percentile {np.quantile(rest, 0.95):.3f} m. "
        "The histogram counts every one of them"
    )
    text += f"; its last bar also the {beyond:,} that are longer." if beyond else "."
    text += _about_sigmas(data.measures)
    every = charts.drawn_errors(errors).every
    text += f" The curves show one in {every}." if every > 1 else ""
    return drones + (
        "<div class='pair'><div id='error_over_time' class='plot'></div>"
        f"<div id='error_histogram' class='plot'></div></div>{note(text)}"
    )


def _about_sigmas(m: dict) -> str:
    """NEES with and without the mean error, and the truth's reference point if known."""
    said = ""
    if "nees" in m:
        said += (
            f" NEES (3 if the sigmas are honest): {m['nees']:.2f}, without the mean error "
            f"{m['nees_unbiased']:.2f}."
        )
    return said + (f" The truth is {m['truth_is']}." if "truth_is" in m else "")


def _cluster_rows(data: ReportData) -> tuple[list[str], list[list[str]]]:
    best = data.clusters[:_MOST_CLUSTERS]
    chosen = [name for name in _CLUSTER_COLUMNS if best and name in best[0]]
    rows = [[_short(row[name]) for name in chosen] for row in best]
    return [_CLUSTER_COLUMNS[name] for name in chosen], rows


def _short(text: str) -> str:
    try:
        value = float(text)
    except ValueError:
        return text
    return number(value).replace(",", "") if np.isfinite(value) else text


def _cluster_section(data: ReportData, head: list[str], rows: list[list[str]]) -> str:
    """The cluster section, unfolded for the method that ranks by these scores."""
    shown = _cluster_table(data, head, rows)
    if data.summary.get("config", {}).get("method") != "robust":
        return shown
    return f"<details><summary>The paper's scores</summary>{shown}</details>"


def _cluster_table(data: ReportData, head: list[str], rows: list[list[str]]) -> str:
    total = len(data.clusters)
    if total == 0:
        return "<p>The recording has no cluster that is large enough to be scored.</p>"
    heads = "".join(
        f"<th scope='col' tabindex='0' data-column='{i}'>{escape(name)}</th>"
        for i, name in enumerate(head)
    )
    text = (
        f"The paper's score of the global clusters, the best first: "
        f"{min(_CLUSTERS_SHOWN, total)} of {total:,} rows are shown; click a column to sort"
    )
    text += f" (the best {len(rows):,} take part). " if len(rows) < total else " all of them. "
    if data.summary.get("config", {}).get("method") == "robust":
        text += "The robust method does not use it: static clutter often has the highest psi. "
    text += "clusters.csv has all columns."
    return (
        f"<div class='scroll'><table><thead><tr>{heads}</tr></thead>"
        f"<tbody id='cluster_rows'></tbody></table></div>{note(text)}"
    )


def _versions(data: ReportData) -> list[tuple[str, str]]:
    return [
        ("unlidar_track", str(data.summary.get("version", "not known"))),
        ("unlidar", __version__),
        ("plotly (Python)", plotly.__version__),
        ("numpy", np.__version__),
        ("Python", platform.python_version()),
    ]
