"""The one table of a run over many recordings. RMSE never stands without coverage."""

import csv
import json
import re
from collections.abc import Callable, Iterable
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.table import Table

from unlidar.batch.job import FAILED, Row
from unlidar.evaluation.markdown import table_line
from unlidar.evaluation.measures import several_drones
from unlidar.output import write_file
from unlidar.sanitize import cell

_NAME = "table"
_NUMBERS: dict[str, tuple[str, Callable[[float], str]]] = {
    "matched_rmse": ("matched RMSE, m", lambda v: f"{v:.3f}"),
    "matched": ("matched, %", lambda v: f"{100 * v:.1f}"),
    "rmse": ("RMSE, m", lambda v: f"{v:.3f}"),
    "rmse_unbiased": ("without offset, m", lambda v: f"{v:.3f}"),
    "coverage": ("coverage, %", lambda v: f"{100 * v:.1f}"),
    "within1m": ("within 1 m, %", lambda v: f"{100 * v:.1f}"),
    "false": ("false rows, %", lambda v: f"{100 * v:.1f}"),
    "tracks": ("tracks", lambda v: f"{v:g}"),
    "time_s": ("time, s", lambda v: f"{v:.1f}"),
}
_HEADERS = ["sequence", *(header for header, _ in _NUMBERS.values()), "remark"]


def rich_table(rows: list[Row], title: str) -> Table:
    """For the terminal, where reasons of failures are too long for a column."""
    # With several drones the nearest track may be another drone's: only matched errors are shown.
    several = any(several_drones(row.measures or {}) for row in rows)
    left_out = ("rmse", "rmse_unbiased") if several else ("matched_rmse", "matched")
    names = [name for name in _NUMBERS if name not in left_out]
    table = Table(title=cell(title), box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("sequence", overflow="fold")
    for name in names:
        head = re.sub(r", | (?!m\b)", "\n", _NUMBERS[name][0])
        table.add_column(head, justify="right", no_wrap=True)
    table.add_column("remark", overflow="fold")
    for row in rows:
        record = record_of(row) | {"remark": _remark(row).split(":")[0]}
        table.add_row(*(cell(text) for text in _cells(record, names)))
    table.add_section()
    table.add_row(*_cells(_mean(rows), names))
    return table


def table_files(folder: Path) -> list[Path]:
    """The paths of the tables: Markdown, CSV and JSON."""
    return [folder / f"{_NAME}.{suffix}" for suffix in ("md", "csv", "json")]


def write_tables(rows: list[Row], folder: Path) -> None:
    """The table as Markdown, CSV and JSON."""
    records = [record_of(row) for row in rows]
    everything = {"sequences": records, "mean": _mean(rows)}
    text = json.dumps(everything, indent=2) + "\n"
    lines = [_HEADERS, ["---", *("---:" for _ in _NUMBERS), "---"]]
    lines += [_cells(record) for record in [*records, _mean(rows)]]
    markdown = "".join(table_line(cells) + "\n" for cells in lines)
    paths = table_files(folder)
    write_file(paths[0], lambda work: work.write_text(markdown, encoding="utf-8"))
    write_file(paths[1], lambda work: _write_csv(work, records))
    write_file(paths[2], lambda work: work.write_text(text, encoding="utf-8"))


def record_of(row: Row) -> dict:
    """The row as one flat record; unknown values are None."""
    known = {"time_s": row.time_s, "tracks": row.tracks} | (row.measures or {})
    return {
        "sequence": row.name,
        "status": row.status,
        **{name: known.get(name) for name in _NUMBERS},
        "remark": _remark(row),
    }


def _remark(row: Row) -> str:
    if row.status == FAILED:
        return f"failed: {row.reason}"
    remarks = [row.status] if row.status != "done" else []
    if row.broken:
        remarks.append("broken, what could be read")
    if row.measures is None:
        remarks.append("no truth")
    if row.warnings:
        remarks.append(f"doubtful: {' '.join(row.warnings)}")
    return ", ".join(remarks)


def _mean(rows: list[Row]) -> dict:
    """The mean of each column over the rows that have it, with the number of rows as a remark."""
    records = [record_of(row) for row in rows]
    mean: dict = {"sequence": "mean"}
    for name in _NUMBERS:
        values = [record[name] for record in records if record[name] is not None]
        mean[name] = round(sum(values) / len(values), 4) if values else None
    judged = sum(row.measures is not None for row in rows)
    covered = sum(record["rmse"] is not None for record in records)
    return mean | {"remark": f"{judged} of {len(rows)} judged, RMSE of {covered}"}


def _cells(record: dict, names: Iterable[str] = _NUMBERS) -> list[str]:
    numbers = ["-" if record[name] is None else _NUMBERS[name][1](record[name]) for name in names]
    return [record["sequence"], *numbers, record["remark"]]


def _write_csv(path: Path, records: list[dict]) -> None:
    # Names that are not valid UTF-8 keep the bytes of the file system.
    with path.open("w", newline="", encoding="utf-8", errors="surrogateescape") as file:
        writer = csv.DictWriter(file, records[0])
        writer.writeheader()
        writer.writerows(records)
