"""Tables and notes of the page, as HTML. Every text that comes from a file is escaped."""

from collections.abc import Iterable, Sequence
from html import escape
from itertools import chain, repeat

from unlidar.colours import track_colours
from unlidar.evaluation.markdown import percent
from unlidar.evaluation.measures import several_drones
from unlidar.program import warnings_of
from unlidar.report.data import ReportData
from unlidar.report.explanation import Lost

_DIGITS = 4
_TRACK_HEADS = {
    "track_id": "track", "begin": "begin [s]", "end": "end [s]", "duration_s": "duration [s]",
    "length_m": "length [m]", "mean_speed_mps": "mean speed [m/s]",
}  # fmt: skip
_KIND_HEADS = {
    "kind.drone": "drone", "kind.bird_like": "bird-like", "kind.unknown": "unknown",
    "flight.judged_s": "judged [s]", "flight.hover_share": "hovers",
    "flight.wander_m": "wanders in 1 s [m]", "flight.speed_mps": "speed [m/s]",
    "flight.climb_mps": "climb [m/s]", "flight.turn_mps2": "turn [m/s²]",
    "flight.straightness": "straightness", "flight.log_ratio.speed": "speed says",
    "flight.log_ratio.climb": "climb says", "flight.log_ratio.turn": "turn says",
    "echo.echo_m2_per_s": "echo [m²/s]", "echo.extent_m": "extent [m]",
}  # fmt: skip

_LOST_HEADS = ("from [s]", "to [s]", "seconds", "stage", "measured")


def number(value: object) -> str:
    """Whole numbers with separators, others with four digits; texts as they are."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return str(value)
    if isinstance(value, int) or (value.is_integer() and abs(value) < 1e15):
        return f"{int(value):,}"
    return f"{value:.{_DIGITS}g}"


def table(
    head: Iterable[str],
    rows: Sequence[Iterable[object]],
    colours: Sequence[str | None] | None = None,
) -> str:
    """A table in a box that scrolls sideways by itself; `colours` mark the rows."""
    heads = "".join(f"<th scope='col'>{escape(name)}</th>" for name in head)
    marks = ["" if c is None else _mark(c) for c in colours or [None] * len(rows)]
    lines = "".join(
        "<tr>"
        + "".join(
            f"<td>{mark if first else ''}{escape(number(value))}</td>"
            for first, value in zip(chain([True], repeat(False)), row, strict=False)
        )
        + "</tr>"
        for mark, row in zip(marks, rows, strict=True)
    )
    return (
        f"<div class='scroll'><table><thead><tr>{heads}</tr></thead>"
        f"<tbody>{lines}</tbody></table></div>"
    )


def _mark(colour: str) -> str:
    return f"<span class='mark' style='background:{colour}'></span>"


def pairs(title: str, rows: Iterable[tuple[str, object]]) -> str:
    """A heading and a table of names and values."""
    lines = "".join(
        f"<tr><td class='text'>{escape(name)}</td><td>{escape(number(value))}</td></tr>"
        for name, value in rows
    )
    return f"<div><h3>{escape(title)}</h3><table>{lines}</table></div>"


def card(name: str, value: str) -> str:
    """One number of the overview."""
    return f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>"


def note(text: str) -> str:
    """A remark in small print."""
    return f"<p class='note'>{escape(text)}</p>"


def warnings(data: ReportData) -> str:
    """Warnings of the program and notes of the conversion, which make results doubtful."""
    texts = [*data.record.notes, *warnings_of(data.summary)]
    if not texts:
        return ""
    items = "".join(f"<li>{escape(text)}</li>" for text in texts)
    return f"<ul class='warnings'>{items}</ul>"


def flat(values: dict, prefix: str = "") -> list[tuple[str, object]]:
    """Nested keys with points between them, in the order of the file."""
    result: list[tuple[str, object]] = []
    for key, value in values.items():
        if isinstance(value, dict):
            result += flat(value, f"{prefix}{key}.")
        else:
            result.append((f"{prefix}{key}", value))
    return result


def cards(data: ReportData) -> str:
    """The most important numbers. RMSE is always shown with coverage."""
    counts, m = data.summary.get("counts", {}), data.measures or {}
    found = [card("tracks", number(len(set(data.tracks.track_id))))]
    if m.get("coverage") is not None:
        found.append(card("coverage", f"{100 * m['coverage']:.1f} %"))
    if several_drones(m):
        found.append(card("matched, one track a drone", percent(m["matched"])))
        if "matched_rmse" in m:
            found.append(card("RMSE of the matched", f"{m['matched_rmse']:.3f} m"))
    elif "rmse" in m:
        found.append(card("RMSE", f"{m['rmse']:.3f} m"))
        found.append(card("RMSE without mean offset", f"{m['rmse_unbiased']:.3f} m"))
    if m.get("within1m") is not None:
        found.append(card("within 1 m", f"{100 * m['within1m']:.1f} %"))
    if m.get("false") is not None:
        found.append(card("false rows", f"{100 * m['false']:.1f} %"))
    found += [
        card(name, number(counts[key]))
        for key, name in (
            ("frames", "frames"), ("returns", "returns"), ("target_returns", "target returns")
        )
        if key in counts
    ]  # fmt: skip
    return "".join([*found, card("tracking took", f"{data.record.tracking_s:.2f} s")])


def tracks_table(data: ReportData, begin_s: float) -> str:
    """A row per track from the program's summary, times after `begin_s`."""
    tracks = data.summary.get("tracks", [])
    if not tracks:
        return "<p>No drone was found, so there is no track.</p>"
    columns = [name for name, value in tracks[0].items() if not isinstance(value, dict)]
    known = track_colours(data.tracks.track_id)
    colours = [known.get(track.get("track_id")) for track in tracks]
    found = table(
        [_TRACK_HEADS.get(column, column.replace("_", " ")) for column in columns],
        [
            [_after(track.get(column, ""), column, begin_s) for column in columns]
            for track in tracks
        ],
        colours,
    )
    return found + _kinds_table(tracks, colours)


def _kinds_table(tracks: Sequence[dict], colours: Sequence[str | None]) -> str:
    """The kind of each track with its evidence."""
    if "kind" not in tracks[0]:
        return ""
    values = [dict(flat(track)) for track in tracks]
    columns = [column for column in _KIND_HEADS if column in values[0]]
    heads = ["track", *(_KIND_HEADS[column] for column in columns)]
    rows = [[one["track_id"], *(one.get(column, "") for column in columns)] for one in values]
    return (
        "<p>What it may be by how it flies. What speed, climb and turns say: above 0 for a drone, "
        f"below 0 for a bird or bat.</p>{table(heads, rows, colours)}"
    )


def drones_table(data: ReportData) -> str:
    """A row per drone of the truth, if several, with the errors of its matched tracks."""
    targets = (data.measures or {}).get("targets", [])
    if not targets:
        return ""
    rows = [
        [
            f"{one['target']:g}",
            percent(one["matched"]),
            f"{one['matched_rmse']:.3f}" if "matched_rmse" in one else "-",
            percent(one["coverage"]),
        ]
        for one in targets
    ]
    return table(["drone", "matched", "RMSE of the matched [m]", "coverage"], rows)


def explanation_section(explanation: Sequence[Lost], begin_s: float) -> str:
    """The stages at which targets were lost, times after `begin_s`; empty without explanation."""
    if not explanation:
        return ""
    parts = []
    for one in explanation:
        rows = [
            (f"{r.from_s - begin_s:.1f}", f"{r.to_s - begin_s:.1f}", r.seconds, r.stage, r.measured)
            for r in one.runs
        ]
        shares = ", ".join(f"{stage} {percent(share)}" for stage, share in one.shares.items())
        parts.append(f"<h3>{escape(one.target)}</h3>{table(_LOST_HEADS, rows)}{note(shares)}")
    meanings = {r.stage: r.meaning for one in explanation for r in one.runs}
    parts += [note(f"{stage}: {meaning}") for stage, meaning in meanings.items()]
    return f"<section><h2>Where it was lost</h2>{''.join(parts)}</section>"


def _after(value: object, column: str, begin_s: float) -> object:
    return f"{float(str(value)) - begin_s:.3f}" if column in ("begin", "end") else value


def run_tables(data: ReportData, versions: list[tuple[str, str]]) -> str:
    """Input, counts, times, versions and settings."""
    counts = data.summary.get("counts", {})
    inputs = [
        [
            i.get("name", ""),
            i.get("frames", ""),
            i.get("frame_period_s", ""),
            i.get("directory", ""),
        ]
        for i in data.summary.get("inputs", [])
    ]
    times = list(data.summary.get("times_s", {}).items())
    times.append(("whole process", data.record.tracking_s))
    settings = "".join(
        f"<li><code>{escape(key)}: {escape(str(value))}</code></li>"
        for key, value in flat(data.summary.get("config", {}))
    )
    options = " ".join(data.record.arguments) or "none"
    return (
        "<h3>Input</h3>"
        + table(["sensor", "frames", "frame period [s]", "folder"], inputs)
        + "<div class='columns'>"
        + pairs("Counts", [(k.replace("_", " "), v) for k, v in flat(counts)])
        + pairs("Time [s]", [(k.replace("_", " "), v) for k, v in times])
        + pairs("Versions", versions)
        + "</div>"
        + f"<p>Options given: <code>{escape(options)}</code></p>"
        + f"<details><summary>All settings</summary><ul class='settings'>{settings}</ul></details>"
    )
