"""Mistakes that anyone makes at first: a clear line and an exit code, never a wrong number."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from flights import track_at, truth_at, write_result
from many import StandIn, make_sequence
from unlidar.cli import main
from unlidar.evaluation import evaluate

TIMES = np.arange(0, 10, 0.1)


@pytest.fixture
def result(tmp_path: Path) -> Path:
    return write_result(tmp_path / "run", truth_at(TIMES), track_at(TIMES, [0.3, 0, 0]))


@pytest.fixture
def stand_in(tmp_path: Path, monkeypatch) -> StandIn:
    program = StandIn(tmp_path)
    monkeypatch.setenv("UNLIDAR_TRACK", str(program.write()))
    return program


def restamped(path: Path, stamp: Callable[[float], str]) -> Path:
    """The table beside itself with other stamps."""
    head, *rows = path.read_text().splitlines()
    changed = [",".join([stamp(float(row.split(",")[0])), *row.split(",")[1:]]) for row in rows]
    other = path.with_name("restamped.csv")
    other.write_text("\n".join([head, *changed]) + "\n")
    return other


def test_no_time_in_common_is_an_error_with_both_spans_and_the_offset(result: Path, fails) -> None:
    truth = restamped(result / "ground_truth.csv", lambda t: f"{t + 3600:.6f}")
    line = fails(4, "evaluate", truth, result / "traj.csv")
    begin_s = track_at(TIMES).time_s.min()
    assert f"{begin_s:.3f}" in line and f"{begin_s + 3600:.3f}" in line
    assert "1 h apart: --time-offset 3600" in line
    shifted = ("--time-offset", "3600", "--json")
    assert main(["evaluate", str(truth), str(result / "traj.csv"), *shifted]) == 0


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "milli"), (1e6, "micro"), (1e9, "nano")])
def test_stamps_of_another_unit_are_called_so(
    factor: float, unit: str, result: Path, fails
) -> None:
    trajectory = restamped(result / "traj.csv", lambda t: str(round(t * factor)))
    line = fails(4, "evaluate", result / "ground_truth.csv", trajectory)
    assert f"{unit}seconds" in line and "expected seconds" in line


def test_truth_and_trajectory_that_are_swapped_are_recognised(result: Path, fails) -> None:
    truth, trajectory = result / "ground_truth.csv", result / "traj.csv"
    assert "expected TRUTH first" in fails(2, "evaluate", trajectory, truth)
    assert main(["evaluate", str(truth), str(trajectory)]) == 0
    assert main(["evaluate", str(trajectory), str(trajectory)]) == 0


def test_a_trajectory_given_twice_is_refused(result: Path, fails) -> None:
    truth, trajectory = result / "ground_truth.csv", result / "traj.csv"
    again = result.parent / result.name / ".." / result.name / "traj.csv"
    assert f"{again}: is given twice" in fails(2, "evaluate", truth, trajectory, again)


def with_sigma(trajectory: Path, sigma: str) -> Path:
    """The trajectory beside itself with another sigma_x in its first row."""
    head, first, *rows = trajectory.read_text().splitlines()
    values = first.split(",")
    values[head.split(",").index("sigma_x")] = sigma
    other = trajectory.with_name("sigma.csv")
    other.write_text("\n".join([head, ",".join(values), *rows]) + "\n")
    return other


def test_a_sigma_below_zero_is_refused(result: Path, fails) -> None:
    trajectory = with_sigma(result / "traj.csv", "-0.1")
    line = fails(4, "evaluate", result / "ground_truth.csv", trajectory)
    assert f"{trajectory}: sigma_x is -0.1, expected at least 0" in line


def test_sigmas_that_only_some_rows_have_are_noted(result: Path, capsys) -> None:
    for first, said in (("0.1", False), ("", True)):
        trajectory = with_sigma(result / "traj.csv", first)
        assert main(["evaluate", str(result / "ground_truth.csv"), str(trajectory), "--json"]) == 0
        shown = capsys.readouterr()
        assert ("nees" in json.loads(shown.out)) != said
        assert ("1 of 100 rows lack sigma_x: no row's" in shown.err) == said
        assert ("so there is no NEES" in shown.err) == said


def test_no_sigma_is_left_out_of_nees_without_a_word(result: Path, capsys) -> None:
    truth, trajectory = result / "ground_truth.csv", result / "traj.csv"
    table = [line.split(",") for line in trajectory.read_text().splitlines()]
    bare, flat = result / "bare.csv", result / "flat.csv"
    sigma_z = table[0].index("sigma_z")
    bare.write_text("".join(",".join(row[:sigma_z]) + "\n" for row in table))
    flats = [table[0][: sigma_z + 1], *([*row[:sigma_z], "0"] for row in table[1:])]
    flat.write_text("".join(",".join(row) + "\n" for row in flats))
    none = result / "none.csv"
    none.write_text("".join(",".join(row[:5]) + "\n" for row in table))
    for files, said in (
        ([bare], "bare.csv: 100 of 100 rows lack sigma_z: no row's sigma_x, sigma_y, sigma_z are"),
        ([flat], "flat.csv: 100 of 100 rows have a sigma of 0: NEES is without"),
        ([trajectory, none], "none.csv: no sigmas, which other files have, so there is no NEES"),
        ([none], ""),
    ):
        assert main(["evaluate", str(truth), *map(str, files), "--json"]) == 0
        shown = capsys.readouterr()
        assert "nees" not in json.loads(shown.out)
        assert said in shown.err
        assert bool(shown.err) == bool(said), shown.err


def test_a_trajectory_without_rows_is_an_answer(result: Path, capsys) -> None:
    trajectory = result / "traj.csv"
    trajectory.write_text(trajectory.read_text().splitlines()[0] + "\n")
    assert main(["evaluate", str(result / "ground_truth.csv"), str(trajectory), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["coverage"] == 0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "it is empty"),
        ("1.5,1,2,3\n", "4 numbers"),
        ("1.5 1 2 3\n", "4 numbers"),
        ("timestamp;x;y;z\n1;2;3;4\n", "no commas"),
        ("time,x,y,z\n1,2,3,4\n", "it has time, x, y, z"),
    ],
)
def test_another_table_is_described(text: str, said: str, result: Path, fails) -> None:
    (result / "other.csv").write_text(text)
    line = fails(4, "evaluate", result / "other.csv", result / "traj.csv")
    assert said in line and "expected timestamp,x,y,z" in line


def test_a_constant_offset_is_no_error_of_the_sigmas() -> None:
    noise = np.random.default_rng(1).normal(0, 0.1, (len(TIMES), 3))
    sigma = np.full((len(TIMES), 3), 0.1)
    plain, moved = (
        evaluate(truth_at(TIMES), track_at(TIMES, noise + offset, sigma_m=sigma))
        for offset in ([0.0, 0.0, 0.0], [0.0, 0.0, 0.57])
    )
    assert moved["nees"] > 10 * plain["nees"]
    assert moved["nees_unbiased"] == pytest.approx(plain["nees_unbiased"], abs=1e-3)


def test_what_the_truth_of_mmaud_is_stands_beside_the_numbers(stand_in, tmp_path, capsys) -> None:
    out = tmp_path / "out"
    assert main(["run", str(make_sequence(tmp_path / "seq")), "--out", str(out)]) == 0
    assert "the truth is a prism" in " ".join(capsys.readouterr().out.split())
    assert "prism" in json.loads((out / "evaluation.json").read_text())["truth_is"]
    assert "The truth is a prism" in (out / "report.html").read_text()


def test_a_truth_of_another_time_is_not_evaluated_and_that_is_said(
    stand_in, tmp_path, capsys
) -> None:
    sequence = make_sequence(tmp_path / "seq")
    for path in list((sequence / "ground_truth").iterdir()):
        path.rename(path.with_name(path.name.replace("1700000000", "1700003600")))
    assert main(["run", str(sequence), "--out", str(tmp_path / "out"), "--no-report"]) == 0
    assert "not evaluated: it is of 1700003600" in capsys.readouterr().err
    assert not (tmp_path / "out/evaluation.json").exists()


def test_recordings_named_one_by_one_are_all_run_and_a_bad_one_stops_none(
    stand_in, tmp_path, capsys
) -> None:
    names = ["flug am see", "seq ü", "one"]
    recordings = [make_sequence(tmp_path / "data" / name) for name in names]
    bad = tmp_path / "data/bad.bag"
    bad.write_text("no bag")
    missing = tmp_path / "data/missing.bag"
    out = tmp_path / "out"
    options = ["--out", str(out), "--no-report", "--jobs", "2"]
    empty = tmp_path / "data/empty"
    empty.mkdir()
    again = empty / ".." / names[0]
    given = [str(path) for path in (recordings[0], bad, missing, *recordings[1:], again, empty)]
    assert main(["run", *given, *options]) == 4
    said = capsys.readouterr()
    assert "3 of 6 recordings failed" in said.err
    assert "failed   bad.bag" in said.out and "failed   missing.bag" in said.out
    for name in names:
        assert (out / name / "traj.csv").is_file()
        assert not (out / name / "report.html").exists()
    table = json.loads((out / "table.json").read_text())["sequences"]
    assert {row["sequence"] for row in table} == {*names, "bad.bag", "missing.bag", "empty"}


def test_a_list_reports_duration_and_rate(tmp_path: Path, capsys) -> None:
    assert main(["convert", str(make_sequence(tmp_path / "seq")), "--list"]) == 0
    said = capsys.readouterr().out
    assert "duration, s" in said
    (row,) = [line for line in said.splitlines() if "lidar_360" in line]
    assert row.split()[:5] == ["lidar_360", ".npy", "3", "0.2", "10.0"]
