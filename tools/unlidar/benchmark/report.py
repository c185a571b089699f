"""The table of a benchmark as Markdown and JSON."""

import dataclasses
import json
import textwrap
from collections.abc import Callable
from pathlib import Path

from unlidar import __version__
from unlidar.benchmark.job import Result
from unlidar.benchmark.summary import ALL, Estimate, Row
from unlidar.benchmark.variants import Variant
from unlidar.evaluation.markdown import table_line
from unlidar.limits import load_yaml
from unlidar.output import write_file
from unlidar.sanitize import printable

MARKDOWN, JSON = "benchmark.md", "benchmark.json"
_PUBLISHED = Path(__file__).parent / "published.yaml"
_HEAD = (
    "scene", "method", "within 1 m", "matched", "matched RMSE", "coverage", "RMSE", "dx", "dy",
    "dz", "false rows", "tracks, seed by seed", "CPU", "of duration",
)  # fmt: skip
_NOTHING = "-"
_UNKNOWN = "not available here"  # of a published figure
_DIFFERENCES = ("scene", "variant", "within 1 m", "coverage", "RMSE", "false rows")


def write_report(
    rows: list[Row], results: list[Result], variants: list[Variant], command: str, out: Path
) -> list[Path]:
    """Writes both files to the folder `out` and returns their paths."""
    published = load_yaml(_PUBLISHED)
    document = {
        "version": __version__,
        "command": command,
        "variants": [
            dataclasses.asdict(v) | {"config": v.config and v.config.name} for v in variants
        ],
        "rows": [dataclasses.asdict(row) for row in rows],
        "results": [dataclasses.asdict(result) for result in results],
        "published": published,
    }
    texts = {
        out / MARKDOWN: markdown(rows, variants, published, command),
        out / JSON: json.dumps(document, indent=2) + "\n",
    }
    for path, text in texts.items():
        write_file(path, lambda work, text=text: work.write_text(text, encoding="utf-8"))
    return list(texts)


def markdown(rows: list[Row], variants: list[Variant], published: list[dict], command: str) -> str:
    """The tables of our runs, the runs that failed, and the published figures."""
    sections = [f"# Benchmark\n\n    {printable(command)}\n", _NOTE, _table(rows)]
    changed = {v.name: v for v in variants if v.base}
    compared = [row for row in rows if row.variant in changed]
    if compared:
        listed = "\n".join(f"- {name}: `{_keys(v)}`" for name, v in changed.items())
        sections += [f"## Differences to {next(iter(changed.values())).base}\n", listed + "\n"]
        sections.append(_difference_table(compared))
    failures = [(row, failure) for row in rows if row.scene != ALL for failure in row.failures]
    if failures:
        listed = "\n".join(printable(f"- {row.variant} on {failure}") for row, failure in failures)
        sections += [
            "## Failed runs\n",
            "They count as runs that found nothing.\n",
            listed + "\n",
        ]
    return "\n".join([*sections, "## Published figures\n", _published(published)])


_NOTE = """\
Means over the seeds, in brackets their 95 % bootstrap interval. *Within 1 m* and *coverage*: shares
of the time in which a field of view holds the drone. *Matched*: the share in which a drone has a
track of its own within 2 m, *matched RMSE* the error over it. RMSE, dx, dy, dz: over the covered
time, against the nearest track, which may be another drone's. Lengths in metres. False rows are
farther than 2 m from every drone; in an empty sky any row is. *CPU*: seconds of one thread for a
recording, *of duration*: the largest share of a recording's duration.
"""


def _table(rows: list[Row]) -> str:
    cells = [_cells(row) for row in rows]
    # Columns without any value are left out.
    told = [i for i in range(len(_HEAD)) if i < 2 or any(line[i] != _NOTHING for line in cells)]
    lines = [[_HEAD[i] for i in told], ["---", "---", *("---:" for _ in told[2:])]]
    lines += [[line[i] for i in told] for line in cells]
    return "\n".join(map(table_line, lines)) + "\n"


def _cells(row: Row) -> tuple[str, ...]:
    e = row.estimates
    return (
        _scene(row),
        row.variant,
        _why_unmeasured(row) or _percent(e["within1m"]),
        _percent(e["matched"], interval=False),
        _metres(e["matched_rmse"]),
        _percent(e["coverage"], interval=False),
        _metres(e["rmse"]),
        *(_metres(e[axis], interval=False) for axis in ("dx", "dy", "dz")),
        _NOTHING if _has_failed(row) else _percent(e["false"], interval=False),
        _NOTHING if _has_failed(row) else _tracks(row) or _NOTHING,
        _NOTHING if row.cpu_s is None else f"{row.cpu_s:.2f} s",
        _NOTHING if row.share_of_duration is None else f"{row.share_of_duration:.1%}",
    )


def _why_unmeasured(row: Row) -> str:
    """The reason why there are no measures, in place of a row of dashes."""
    if _has_failed(row):
        return "failed"
    return "no drone" if row.tracks_in_empty_sky and row.estimates["coverage"].mean is None else ""


def _has_failed(row: Row) -> bool:
    return len(row.failures) == len(row.seeds)


def _difference_table(rows: list[Row]) -> str:
    lines = [table_line(_DIFFERENCES), "|---|---|" + "---:|" * (len(_DIFFERENCES) - 2)]
    for row in rows:
        d = row.differences
        cells = [_percent(d[name], sign="+") for name in ("within1m", "coverage")]
        cells += [_metres(d["rmse"], sign="+"), _percent(d["false"], sign="+")]
        lines.append(table_line((_scene(row), row.variant, *cells)))
    return "\n".join(lines) + "\n"


def _published(groups: list[dict]) -> str:
    parts = []
    for group in groups:
        known = [row for row in group["rows"] if row["value"] != _UNKNOWN]
        if not known:  # the table would be empty
            continue
        about = f"**{group['title']}**. Measured on: {group['measured_on']}. {group['measure']}."
        lines = [
            textwrap.fill(about, 118),
            "",
            table_line(("", "value", "source")),
            "|---|---:|---|",
        ]
        lines += [table_line((row["name"], row["value"], row["source"])) for row in known]
        lines += ["", f"Verified in the source: {', '.join(group['verified']) or 'nothing'}."]
        parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


def _scene(row: Row) -> str:
    failed = f" ({len(row.failures)} of {len(row.seeds)} runs failed)" if row.failures else ""
    return (f"**{ALL}**" if row.scene == ALL else row.scene) + failed


def _tracks(row: Row) -> str:
    if row.scene != ALL:
        return " ".join(map(str, row.tracks))
    if row.tracks_in_empty_sky is None:
        return ""
    return "any in {} of {} empty skies".format(*row.tracks_in_empty_sky)


def _percent(estimate: Estimate, interval: bool = True, sign: str = "") -> str:
    return _text(estimate, interval, lambda value: f"{100 * value:{sign}.1f}", " %")


def _metres(estimate: Estimate, interval: bool = True, sign: str = "") -> str:
    return _text(estimate, interval, lambda value: f"{value:{sign}.2f}")


def _text(
    estimate: Estimate, interval: bool, number: Callable[[float], str], unit: str = ""
) -> str:
    if estimate.mean is None:
        return _NOTHING
    text = number(estimate.mean) + unit
    if not interval or estimate.low is None:
        return text
    return f"{text} ({number(estimate.low)}, {number(estimate.high)})"


def _keys(variant: Variant) -> str:
    return ", ".join(variant.assignments)
