"""Printed tables of results. RMSE is always shown with coverage."""

import math

from rich import box
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

from unlidar.evaluation.markdown import percent, table_rows
from unlidar.evaluation.measures import several_drones
from unlidar.sanitize import cell

_LEAST_COLUMNS = 80  # of a terminal that tables are made for
_WIDEST = 1_000_000  # columns of a pipe: nothing is wrapped


def show(table: Table) -> None:
    """Prints a table to stdout, whole: a terminal folds its cells, a pipe gets a line for each row.

    Where a terminal is narrower than folded cells, it wraps the lines.
    """
    console = Console(highlight=False)
    unbounded = console.options.update(max_width=_WIDEST)
    for column in table.columns:
        if column.no_wrap:  # rich cuts it all the same
            cells = (column.header, *column.cells)
            column.min_width = max(Measurement.get(console, unbounded, c).maximum for c in cells)
    # rich would fold title and caption to the width of the table.
    title, table.title, caption, table.caption = table.title, None, table.caption, None
    width = _WIDEST
    if console.is_terminal:
        least = Measurement.get(console, unbounded, table).minimum
        width = max(console.width, least, _LEAST_COLUMNS)
    console.size = width, console.height  # rich ignores a width alone on a dumb terminal
    for part, style in ((title, "table.title"), (table, None), (caption, "table.caption")):
        if part is not None:
            console.print(part, style=style, soft_wrap=part is not table)
    table.title, table.caption = title, caption


def sequences_table(result: dict) -> Table:
    """Table of `evaluate_sequences`: a row for each sequence, each group and all."""
    table = Table(title="lengths in metres", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    rows = table_rows(result)
    # With several drones the nearest track may be another drone's.
    kind = "matched_" if any(several_drones(m) for m in result["sequences"]) else ""
    heads = ("matched", "RMSE", "95 %") if kind else ("RMSE", "95 %", "median", "p95")
    table.add_column("sequence", overflow="fold", min_width=12)
    for name in (*heads, "cover", "false", "tracks", "ID sw"):
        table.add_column(name, justify="right", no_wrap=True)
    for i, (name, m) in enumerate(rows):
        ends = m.get("intervals", {}).get(f"{kind}rmse")
        error = [_plain(m.get(f"{kind}rmse")), f"{ends[0]:.2f}-{ends[1]:.2f}" if ends else "-"]
        table.add_row(
            cell(name),
            *([percent(m.get("matched")), *error] if kind else error),
            *([] if kind else [_plain(m.get("median")), _plain(m.get("p95"))]),
            percent(m.get("coverage")),
            percent(m["false"]),
            str(m["tracks"]),
            str(m.get("identity_switches", "-")),
            end_section=i == len(rows) - len(result["groups"]) - 1,
        )
    return table


def comparison_table(comparison: dict) -> Table:
    """Table of `comparison_of`: a row for each result."""
    kind = "judged by the truth" if comparison["is_truth"] else "distances from the result"
    table = Table(
        title=cell(f"lengths in metres, {kind} {comparison['judged_by']}"),
        box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0),
    )  # fmt: skip
    table.add_column("result", overflow="fold", min_width=12)
    for name in ("tracks", "rows", "time", "length", "RMSE", "< 1 m", "cover", "false", "NEES"):
        table.add_column(name, justify="right", no_wrap=True)
    for m in comparison["results"]:
        table.add_row(
            cell(m["name"]),
            *(str(m["tracks"]), str(m["rows"]), f"{m['duration_s']:.0f} s", f"{m['length_m']:.0f}"),
            *(_plain(m.get("rmse")), percent(m.get("within1m")), percent(m.get("coverage"))),
            *(percent(m.get("false")), f"{m['nees']:.1f}" if "nees" in m else "-"),
        )
    return table


def measures_table(measures: dict, title: str) -> Table:
    """The measures of `evaluate`, one per line with its meaning."""
    about = f"the truth is {measures['truth_is']}" if "truth_is" in measures else None
    table = Table(title=cell(title), caption=about)
    table.add_column("measure")
    table.add_column("value", justify="right")
    table.add_column("judged on")
    for section in _sections(measures):
        for row in section:
            table.add_row(*row)
        table.add_section()
    return table


def _sections(m: dict) -> list[list[tuple[str, str, str]]]:
    found = [("tracks", str(m["tracks"]), ""), ("rows", str(m["rows"]), "all tracks")]
    if "coverage" not in m:
        return [[*found, ("false rows", percent(m["false"]), "all rows: no drone in the truth")]]
    found.append(("false rows (beyond 2 m)", percent(m["false"]), "all rows"))
    sections = [found, _at_truth(m), _tracking(m), _own_rows(m)]
    if several_drones(m):
        sections.insert(1, _by_drone(m))
    return sections


def _by_drone(m: dict) -> list[tuple[str, str, str]]:
    """Matched errors by drone, shown first, as the nearest track may be another drone's."""
    rows = [("matched: one track a drone, within 2 m", percent(m["matched"]), "in-view truth")]
    if "matched_rmse" in m:
        rows.append(("RMSE, matched", _metres(m["matched_rmse"]), "matched truth"))
        rows += _interval(m, "matched_rmse")
    for one in m.get("targets", []):
        error = f"{one['matched_rmse']:.3f} m, " if "matched_rmse" in one else ""
        share = percent(one["matched"])
        rows.append((f"drone {one['target']:g}", f"{error}{share}", "RMSE and share matched"))
    return rows


def _at_truth(m: dict) -> list[tuple[str, str, str]]:
    rows = [
        ("coverage", percent(m["coverage"]), "in-view truth"),
        ("within 1 m", percent(m["within1m"]), "in-view truth"),
    ]
    if "rmse" in m:
        name = "RMSE, nearest track" if several_drones(m) else "RMSE"
        rows += [
            (name, _metres(m["rmse"]), "covered truth"),
            *_interval(m, "rmse"),
            ("RMSE without mean offset", _metres(m["rmse_unbiased"]), "covered truth"),
            ("dx, dy, dz", _metres(m["dx"], m["dy"], m["dz"]), "covered truth"),
            ("mean offset", _metres(*m["bias"]), "covered truth"),
            ("median, 95th percentile", _metres(m["median"], m["p95"]), "covered truth"),
            ("mean error (APE)", _metres(m["ape"]), "covered truth"),
        ]
    return rows


def _interval(m: dict, name: str) -> list[tuple[str, str, str]]:
    ends = m.get("intervals", {}).get(name)
    return [("its 95 % interval", f"{ends[0]:.3f} to {ends[1]:.3f} m", "")] if ends else []


def _tracking(m: dict) -> list[tuple[str, str, str]]:
    rows = [("identity switches", str(m["identity_switches"]), "in-view truth")]
    if not several_drones(m):
        matched = ("one track a target, within 2 m", percent(m["matched"]), "in-view truth")
        rows.insert(0, matched)
    if "nees" in m:
        for name, kind in (("", ""), (" without mean offset", "_unbiased")):
            mean, median = m[f"nees{kind}"], m[f"nees{kind}_median"]
            inside = percent(m[f"nees{kind}_within95"])
            rows += [
                (f"NEES{name}, mean, median", f"{mean:.2f}, {median:.2f}", "honest: 3, 2.37"),
                (f"inside the 95 % ellipsoid{name and ', same'}", inside, "honest: 95 %"),
            ]
    if m.get("challenge_mse") is not None:
        rows.append(("UG2+ MSE", f"{m['challenge_mse']:.4f} m²", "all truth, gaps bridged"))
    return rows


def _own_rows(m: dict) -> list[tuple[str, str, str]]:
    rows = []
    if m.get("rows_judged"):
        over = f"{m['rows_judged']} rows with truth"
        rows += [
            ("RMSE at own stamps", _metres(m["rows_rmse"]), over),
            ("same, without mean offset", _metres(m["rows_rmse_unbiased"]), over),
            ("same, dx, dy, dz", _metres(m["rows_dx"], m["rows_dy"], m["rows_dz"]), over),
            ("false rows (beyond 2 m)", percent(m["rows_false"]), over),
        ]
    if m.get("rows_unjudged"):
        rows.append(
            ("rows without truth", str(m["rows_unjudged"]), "not judged: before or after it")
        )
    if "align" in m:
        rows.append(
            ("tracks moved by", _metres(*m["align_translation_m"]), f"--align {m['align']}")
        )
    if "align_rotation" in m:
        rows.append(("and turned by", f"{_turn_deg(m['align_rotation']):.2f} deg", "before that"))
    if "time_offset_s" in m:
        sigma = f" +- {m['time_offset_sigma_s']:.4f}" if m["time_offset_estimated"] else ""
        how = "estimated" if m["time_offset_estimated"] else "as given"
        added = f"{m['time_offset_s']:.4f}{sigma} s"
        rows.append(("added to the stamps", added, f"--time-offset, {how}"))
    return rows


def _turn_deg(rotation: list[list[float]]) -> float:
    cosine = (sum(rotation[i][i] for i in range(3)) - 1) / 2
    return math.degrees(math.acos(max(-1.0, min(1.0, cosine))))


def _metres(*values: float) -> str:
    return ", ".join(f"{value:.3f}" for value in values) + " m"


def _plain(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
