"""Accuracies that the pages state are those that their commands print."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from synthetic import PROJECT

SEQUENCE = "data/mmaud/val/seq0001"


def measures(program: Path, recording: Path, out: Path, *options: str) -> dict:
    """The results of `unlidar run` on a recording."""
    subprocess.run(
        [sys.executable, "-m", "unlidar", "run", recording, "--out", out, *options],
        env=os.environ | {"UNLIDAR_TRACK": str(program)},
        check=True,
        capture_output=True,
    )
    return json.loads((out / "evaluation.json").read_text())


def stated(page: str, row: str) -> list[str]:
    """The metres in a row of a table, as they are written."""
    text = (PROJECT / page).read_text()
    (line,) = re.findall(rf"^\| {row} \|.*$", text, re.MULTILINE)
    return re.findall(r"(\d\.\d{3}) m", line)


def printed(measured: dict) -> list[str]:
    return [f"{measured[key]:.3f}" for key in ("rmse", "rmse_unbiased")]


@pytest.mark.parametrize(
    ("row", "options"),
    [("Mid-360", ("--sensors", "lidar_360")), ("Mid-360 and Avia", ())],
)
def test_the_results_of_the_real_flight_are_those_of_the_program(
    row: str, options: tuple[str, ...], program: Path, shared: Path, tmp_path: Path
) -> None:
    assert stated("docs/results.md", row) == printed(
        measures(program, shared / SEQUENCE, tmp_path / "run", *options)
    )


@pytest.mark.parametrize("stamp", ["begin", "middle", "end"])
def test_the_page_on_mmaud_states_what_each_meaning_of_stamps_brings(
    stamp: str, program: Path, shared: Path, tmp_path: Path
) -> None:
    settings = ("--set", f"input.stamp={stamp}")
    assert stated("docs/mmaud.md", stamp) == printed(
        measures(program, shared / SEQUENCE, tmp_path / "run", *settings)
    )


def test_the_readme_states_the_numbers_of_its_flights(
    program: Path, shared: Path, tmp_path: Path
) -> None:
    text = (PROJECT / "README.md").read_text()
    demo = tmp_path / "demo"
    subprocess.run(
        [sys.executable, "-m", "unlidar", "simulate", "demo", demo],
        check=True,
        capture_output=True,
    )
    simulated = measures(program, demo, tmp_path / "simulated")
    assert f"A simulated flight, RMSE {simulated['rmse']:.3f} m" in text
    raw, unbiased = printed(measures(program, shared / SEQUENCE, tmp_path / "real"))
    assert f"RMSE {raw} m with the lever arm of the truth's prism, {unbiased} m without" in text
