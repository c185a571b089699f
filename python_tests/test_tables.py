"""Tables are whole: in a pipe a line for each row, on a terminal folded, at any width."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from rich.table import Table
from unlidar import tables
from unlidar.cli import main
from unlidar.sanitize import cell

LONG = "a_recording_of_a_name_that_is_longer_than_any_terminal_is_wide " * 4
NUMBERS = [f"{k}.{k:06d}" for k in range(1, 20)]


def plain_table() -> Table:
    table = Table(title=cell(f"title [b]{LONG}"), caption=cell(f"caption {LONG}"))
    table.add_column("name", overflow="fold")
    for number in NUMBERS:
        table.add_column(number, justify="right", no_wrap=True)
    table.add_column("remark")
    for name in ("first", LONG, "last"):
        table.add_row(cell(name), *NUMBERS, LONG)
    return table


@pytest.fixture
def shown(monkeypatch) -> Callable[[int, bool], str]:
    """Shows the table on a terminal or in a pipe of some columns."""

    def call(columns: int, on_terminal: bool) -> str:
        out = io.StringIO()
        monkeypatch.setattr(out, "isatty", lambda: on_terminal, raising=False)
        monkeypatch.setenv("TERM", "dumb")
        monkeypatch.setenv("COLUMNS", str(columns))
        monkeypatch.setattr("sys.stdout", out)
        tables.show(plain_table())
        return out.getvalue()

    return call


@pytest.mark.parametrize("columns", [1, 20, 80, 500])
def test_in_a_pipe_a_row_is_a_line(columns: int, shown) -> None:
    lines = shown(columns, False).splitlines()
    assert lines[0] == f"title [b]{LONG}".rstrip() + " "
    assert lines[-1].rstrip() == f"caption {LONG}".rstrip()
    rows = [line for line in lines if line.startswith("│")]
    assert [row.split("│")[1].strip() for row in rows] == ["first", LONG.strip(), "last"]
    for row in rows:
        assert [one.strip() for one in row.split("│")[2:-1]] == [*NUMBERS, LONG.strip()]


@pytest.mark.parametrize("columns", [1, 20, 80, 500])
def test_on_a_terminal_nothing_is_cut(columns: int, shown) -> None:
    found = shown(columns, True)
    assert "…" not in found
    assert all(found.count(number) >= 3 for number in NUMBERS)
    assert f"title [b]{LONG}".strip() in found
    names = [line.split("│")[1].strip() for line in found.splitlines() if line.startswith("│")]
    assert "".join(names).replace(" ", "") == f"first{LONG}last".replace(" ", "")


@pytest.mark.parametrize("columns", [20, 100])
def test_a_list_in_a_pipe_has_a_line_for_each_stream(
    columns: int, tmp_path: Path, capsys, monkeypatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    folder = tmp_path / ("x" * 90)
    names = [f"{'left' * 15}_{k}" for k in range(3)]
    for name in names:
        (folder / name).mkdir(parents=True)
        for k in range(3):
            (folder / name / f"{k}.500000.bin").write_bytes(bytes(16))
    assert main(["convert", str(folder), "--list"]) == 0
    first, *lines = capsys.readouterr().out.splitlines()
    assert first.startswith(f"{folder} (")
    listed = [line.split()[0] for line in lines if re.search(r"\bleft", line)]
    assert listed == names
