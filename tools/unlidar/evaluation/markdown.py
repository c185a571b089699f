"""Tables for papers and READMEs: one row a sequence or group, in Markdown."""

from collections.abc import Iterable

from unlidar.sanitize import printable

_HEAD = (
    "", "matched", "matched RMSE", "Dx", "Dy", "Dz", "RMSE", "95 % interval", "APE", "median",
    "95th", "coverage", "within 1 m", "false rows", "tracks", "switches", "NEES",
)  # fmt: skip


def markdown_table(rows: list[tuple[str, dict]], totals: int = 0) -> str:
    """Lengths in metres, a dash where a measure is not defined; the last `totals` rows in bold."""
    lines = [table_line(_HEAD), "|---|" + "---:|" * (len(_HEAD) - 1)]
    for number, (name, measures) in enumerate(rows):
        bold = number >= len(rows) - totals
        lines.append(table_line((f"**{name}**" if bold else name, *_cells(measures))))
    return "\n".join(lines) + "\n"


def table_line(cells: Iterable[str]) -> str:
    """A row of a table; separators and tags in cells are escaped."""
    texts = (printable(cell).replace("|", "&#124;").replace("<", "&lt;") for cell in cells)
    return f"| {' | '.join(texts)} |"


def table_rows(result: dict) -> list[tuple[str, dict]]:
    """Rows of `evaluate_sequences`: sequences by group, then the groups, then all."""
    groups = list(result["groups"])
    rows = []
    for group in ("", *groups[:-1]):
        for one in result["sequences"]:
            if one["group"] == group:
                rows.append((f"{group}: {one['sequence']}" if group else one["sequence"], one))
    return rows + [(group, result["groups"][group]) for group in groups]


def _cells(m: dict) -> tuple[str, ...]:
    ends = m.get("intervals", {}).get("rmse")
    return (
        percent(m.get("matched")),
        _metres(m.get("matched_rmse")),
        *(_metres(m.get(f"d{axis}")) for axis in "xyz"),
        _metres(m.get("rmse")),
        f"{ends[0]:.3f} to {ends[1]:.3f}" if ends else "-",
        _metres(m.get("ape")),
        _metres(m.get("median")),
        _metres(m.get("p95")),
        percent(m.get("coverage")),
        percent(m.get("within1m")),
        percent(m.get("false")),
        str(m["tracks"]),
        str(m.get("identity_switches", "-")),
        "-" if m.get("nees") is None else f"{m['nees']:.2f}",
    )


def _metres(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def percent(share: float | None) -> str:
    """A share as a percentage; a dash for None."""
    return "-" if share is None else f"{100 * share:.1f} %"
