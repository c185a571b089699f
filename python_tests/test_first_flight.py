"""docs/first_flight.ipynb runs from its first cell to its last, and prints what it shows.

With UNLIDAR_RENEW_NOTEBOOK set, what it prints and draws now is stored in it.
"""

from __future__ import annotations

import base64
import os
import re
import struct
import sys
from pathlib import Path

import nbformat
import pytest
from bags import plain_cloud, write_bag
from nbclient import NotebookClient
from synthetic import PROJECT, make_flight

PAGE = PROJECT / "docs/first_flight.ipynb"


def read() -> nbformat.NotebookNode:
    return nbformat.read(PAGE, as_version=4)


def printed(notebook: nbformat.NotebookNode) -> list[str]:
    """What each cell has printed."""
    return [
        "".join(out.text for out in cell.outputs if out.output_type == "stream").strip()
        for cell in notebook.cells
        if cell.cell_type == "code"
    ]


def pictures(notebook: nbformat.NotebookNode) -> list[bytes]:
    return [
        base64.b64decode(out.data["image/png"])
        for cell in notebook.cells
        if cell.cell_type == "code"
        for out in cell.outputs
        if out.output_type in ("display_data", "execute_result") and "image/png" in out.data
    ]


def test_the_notebook_runs_and_prints_what_it_shows(
    program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("unlidar._engine", reason="the engine for Python is not built")
    bin_folder = tmp_path / "bin"
    bin_folder.mkdir()
    script = bin_folder / "unlidar"
    script.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m unlidar "$@"\n')
    script.chmod(0o755)
    monkeypatch.setenv("PATH", f"{bin_folder}:{os.environ['PATH']}")
    monkeypatch.setenv("UNLIDAR_TRACK", str(program))
    run = read()
    where = {"metadata": {"path": str(tmp_path)}}
    NotebookClient(run, timeout=300, resources=where, record_timing=False).execute()
    if "UNLIDAR_RENEW_NOTEBOOK" in os.environ:
        nbformat.write(run, PAGE)
    assert printed(run) == printed(read())
    shapes = [struct.unpack(">II", png[16:24]) for png in pictures(run)]
    assert shapes == [struct.unpack(">II", png[16:24]) for png in pictures(read())]
    assert len(shapes) == 6


def test_its_end_tracks_a_bag(program: Path, tmp_path: Path, capsys) -> None:
    pytest.importorskip("unlidar._engine", reason="the engine for Python is not built")
    flight = make_flight()
    clouds = zip(flight.stamps_ns, flight.clouds, strict=True)
    bag = write_bag(tmp_path, "ros1", [plain_cloud("/lidar/points", *cloud) for cloud in clouds])
    (cell,) = [cell.source for cell in read().cells if cell.source.startswith("recording =")]
    mine = re.sub('"flight"', repr(str(bag)), cell, count=1)
    assert mine != cell
    exec(f"import matplotlib.pyplot as plt\nimport unlidar\n{mine}", {})
    assert capsys.readouterr().out == f"1 drone(s) in {bag}, seen by lidar_points\n"


def test_the_notebook_is_whole_and_small() -> None:
    notebook = read()
    nbformat.validate(notebook)
    assert PAGE.stat().st_size < 500_000
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == [*range(1, len(code) + 1)]
    assert not any(out.output_type == "error" for cell in code for out in cell.outputs)
    text = "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "markdown")
    links = re.findall(r"\]\(([^)#]+)\)", text)
    assert len(links) > 5
    assert [link for link in links if not (PAGE.parent / link).exists()] == []
