"""The pages for users: their commands work as written, one after another, their links lead on."""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from synthetic import PROJECT, TRAJ_HEADER

PAGES = ("researcher_with_a_bag", "mmaud", "own_sensor", "live", "station", "kinds", "explain")
BLOCK = re.compile(r"^```sh\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.fixture
def folder(tmp_path: Path, program: Path, shared: Path) -> Path:
    """A project's folder as a user has it who has put recordings into it."""
    (tmp_path / "build").mkdir()
    (tmp_path / "build/unlidar_track").symlink_to(program.resolve())
    (tmp_path / ".venv/bin").mkdir(parents=True)
    unlidar = tmp_path / ".venv/bin/unlidar"
    unlidar.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m unlidar "$@"\n')
    unlidar.chmod(0o755)
    # On a station both are installed.
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin/unlidar").symlink_to(unlidar)
    (tmp_path / "bin/unlidar_track").symlink_to(program.resolve())
    (tmp_path / "mmaud").symlink_to(shared / "data/mmaud")
    bag = shared / "data/formats/bags/ros1_pointcloud2.bag"
    (tmp_path / "flight.bag").symlink_to(bag)
    (tmp_path / "bags").mkdir()
    for name in ("noon.bag", "dusk.bag"):
        (tmp_path / "bags" / name).symlink_to(bag)
    return tmp_path


def run_blocks(page: str, folder: Path, ports: tuple[str, ...] = ()) -> str:
    """`ports` are replaced by free ones: several tests may run at a time."""
    blocks = BLOCK.findall((PROJECT / "docs" / f"{page}.md").read_text())
    assert blocks
    commands = "\n".join(blocks)
    for port in ports:
        assert port in commands
        commands = commands.replace(port, str(free_port()))
    environment = {
        "UNLIDAR_TRACK": str(folder / "build/unlidar_track"),
        "PATH": f"{folder / 'bin'}:{os.environ['PATH']}",
    }
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", commands],
        cwd=folder,
        env=os.environ | environment,
        timeout=300,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


def test_the_page_on_bags_works_as_written(folder: Path) -> None:
    run_blocks("researcher_with_a_bag", folder)
    for name in ("traj.csv", "figure.png", "summary.json"):
        assert (folder / "out/flight" / name).is_file()
    assert "noon.bag" in (folder / "out/flights/table.md").read_text()


def test_the_page_on_mmaud_works_as_written(folder: Path) -> None:
    said = run_blocks("mmaud", folder)
    assert "| seq0001 | 0.5" in said
    assert (folder / "out/run/val_begin/table.md").is_file()


def test_the_page_on_own_sensors_works_as_written(folder: Path) -> None:
    run_blocks("own_sensor", folder)
    assert (folder / "traj.csv").read_text().count("\n") > 50


def test_the_page_on_live_tracking_works_as_written(folder: Path) -> None:
    said = run_blocks("live", folder)
    assert TRAJ_HEADER in said
    live = folder / "out/live"
    assert (live / "traj.csv").read_text().count("\n") > 50
    assert (live / "piped.csv").read_text().count("\n") > 50
    told = {json.loads(line)["event"] for line in (live / "events.jsonl").read_text().splitlines()}
    page = (PROJECT / "docs/live.md").read_text()
    table = page.partition("| `event` |")[2].partition("\n\n")[0]
    asked = {"returns"}  # which only --event-returns gives
    assert told | asked == set(re.findall(r"^\| `([a-z]+)` \|", table, re.MULTILINE))


def test_the_page_on_stations_works_as_written(folder: Path) -> None:
    said = run_blocks("station", folder, ports=("56301", "8377"))
    assert "http://127.0.0.1:" in said
    rows = (folder / "traj.csv").read_text().count("\n") - 1
    assert rows > 50
    events = (folder / "events.jsonl").read_text()
    assert "127-168-1-112" in events and "127-168-1-113" in events
    (feature, *_) = json.loads((folder / "flight.geojson").read_text())["features"]
    assert len(feature["properties"]["times"]) == rows
    page = (PROJECT / "docs/station.md").read_text()
    for command in ("relay", "watch", "history"):
        shown = subprocess.run(
            [sys.executable, "-m", "unlidar", command, "--help"],
            capture_output=True, text=True, check=True,
        ).stdout  # fmt: skip
        options = re.findall(r"^  (--[a-z-]+)", shown, re.MULTILINE)
        common = {"--verbose", "--port", "--station", "--origin", "--heading"}
        assert [o for o in options if o not in page and o not in common] == [], command


def test_the_page_on_explaining_works_as_written(folder: Path, program: Path) -> None:
    shown = subprocess.run([program, "--help"], capture_output=True, text=True, check=True).stdout
    if "--trace" not in shown:
        pytest.skip(f"{program} has no --trace")
    said = run_blocks("explain", folder)
    assert re.search(r"^drone 0: \d+ s: found [0-9.]+ %", said, re.MULTILINE)
    assert json.loads(said.splitlines()[-1])["targets"]


@pytest.mark.parametrize("page", PAGES)
def test_links_of_the_pages_lead_to_files(page: str) -> None:
    links = re.findall(r"\]\(([^)#]+)\)", (PROJECT / "docs" / f"{page}.md").read_text())
    assert links
    assert [link for link in links if not (PROJECT / "docs" / link).exists()] == []
