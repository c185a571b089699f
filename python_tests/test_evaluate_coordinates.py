"""Warnings of `evaluate` on a truth in other coordinates than the trajectory."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flights import track_at, truth_at, write_result
from unlidar.cli import main

TIMES = np.arange(0, 10, 0.1)
UTM_M = np.array([465_000.0, 5_250_000.0, 400.0])


def noisy() -> np.ndarray:
    return np.random.default_rng(1).normal(0, 0.1, (len(TIMES), 3))


def said_of(folder: Path, capsys, *options: str, truth=lambda xyz: xyz, own=lambda xyz: xyz) -> str:
    """The notes of `evaluate` where both are written as these say."""
    known, tracks = truth_at(TIMES), track_at(TIMES, noisy())
    known = replace(known, xyz_m=truth(known.xyz_m))
    result = write_result(folder / "run", known, replace(tracks, xyz_m=own(tracks.xyz_m)))
    files = str(result / "ground_truth.csv"), str(result / "traj.csv")
    assert main(["evaluate", *files, "--json", *options]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["rows"] == len(TIMES)
    assert len(said.err.splitlines()) <= 1
    return said.err


@pytest.mark.parametrize(
    ("per_m", "unit"), [(1e3, "millimetres"), (1e2, "centimetres"), (1 / 0.3048, "feet")]
)
@pytest.mark.parametrize("align", ["none", "translation"])
def test_a_truth_or_a_trajectory_of_another_unit_is_called_so(
    per_m: float, unit: str, align: str, tmp_path: Path, capsys
) -> None:
    options = ("--align", align)
    said = said_of(tmp_path, capsys, *options, truth=lambda xyz: xyz * per_m)
    assert f"truth seems to be in {unit}" in said
    said = said_of(tmp_path, capsys, *options, own=lambda xyz: xyz * per_m)
    assert f"trajectory seems to be in {unit}" in said


def test_coordinates_of_a_map_are_called_so_unless_the_offset_is_taken_off(
    tmp_path: Path, capsys
) -> None:
    for offset_m in (UTM_M, [300.0, -20.0, 5.0]):
        assert "(UTM)" in said_of(tmp_path, capsys, truth=lambda xyz, o=offset_m: xyz + o)
    said = said_of(tmp_path, capsys, "--align", "translation", truth=lambda xyz: xyz + UTM_M)
    assert said == ""


@pytest.mark.parametrize("order", [[0, 1], [1, 0]])
def test_degrees_are_called_so(order: list[int], tmp_path: Path, capsys) -> None:
    def degrees(xyz: np.ndarray) -> np.ndarray:
        latitude = 48.0 + xyz[:, 1] / 111_195
        longitude = 11.0 + xyz[:, 0] / 111_195 / np.cos(np.radians(48.0))
        columns = np.stack([latitude, longitude], axis=1)[:, order]
        return np.column_stack([columns, xyz[:, 2] + 500.0])

    assert "in degrees" in said_of(tmp_path, capsys, truth=degrees)


@pytest.mark.parametrize(
    ("columns", "z", "words"),
    [([0, 1, 2], -1, "z seems to point down"), ([1, 0, 2], -1, "north, east, down")],
)
def test_other_axes_are_called_so(columns, z, words: str, tmp_path: Path, capsys) -> None:
    assert words in said_of(tmp_path, capsys, truth=lambda xyz: xyz[:, columns] * [1, 1, z])


def test_of_the_same_coordinates_nothing_is_said_however_bad_the_trajectory_is(
    tmp_path: Path, capsys
) -> None:
    rng = np.random.default_rng(2)
    for own in (
        lambda xyz: xyz,
        lambda xyz: xyz - np.array([0.0, 0.0, 0.6]),  # the prism of a truth
        lambda xyz: 0 * xyz + [12.0, -9.0, 3.0],  # a tree
        lambda xyz: 0.01 * noisy() + [0.0, 0.0, 0.3],  # the station itself
        lambda xyz: xyz[::-1],
        lambda xyz: rng.uniform(-40, 40, xyz.shape),
    ):
        assert said_of(tmp_path, capsys, own=own) == ""
