"""`unlidar compare`: several results of one flight in one table and one figure."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from unlidar.cli import main
from unlidar.evaluation import evaluate_files
from unlidar.figure import save
from unlidar.output import RUN_RECORD
from unlidar.record import RunRecord, write_record

TIMES_S = 1_700_000_000.0 + np.arange(0, 10, 0.1)


def at_m(time_s: np.ndarray, off_m: float = 0.0) -> np.ndarray:
    since_s = time_s - TIMES_S[0]
    return np.stack([2 * since_s, 5 + 0 * since_s, 10 + off_m + 0 * since_s], axis=1)


def write_tracks(path: Path, off_m: float, times_s: np.ndarray = TIMES_S) -> Path:
    rows = [f"{t:.9f},0,{x:.6f},{y:.6f},{z:.6f}" for t, (x, y, z) in
            zip(times_s, at_m(times_s, off_m), strict=True)]  # fmt: skip
    path.write_text("\n".join(["timestamp,track_id,x,y,z", *rows]) + "\n")
    return path


def write_truth(path: Path) -> Path:
    rows = [f"{t:.9f},{x:.6f},{y:.6f},{z:.6f}" for t, (x, y, z) in
            zip(TIMES_S, at_m(TIMES_S), strict=True)]  # fmt: skip
    path.write_text("\n".join(["timestamp,x,y,z", *rows]) + "\n")
    return path


def compared(capsys, *arguments: object) -> dict:
    assert main(["compare", "--json", *map(str, arguments)]) == 0
    return json.loads(capsys.readouterr().out)


def test_measures_are_those_of_evaluate(tmp_path: Path, capsys) -> None:
    truth = write_truth(tmp_path / "truth.csv")
    files = [write_tracks(tmp_path / "a.csv", 0.1), write_tracks(tmp_path / "b.csv", 0.5)]
    found = compared(capsys, f"ours={files[0]}", files[1], "--truth", truth)
    assert found["judged_by"] == str(truth) and found["is_truth"]
    assert [row["name"] for row in found["results"]] == ["ours", "b.csv"]
    for row, path in zip(found["results"], files, strict=True):
        measures = evaluate_files(truth, path)
        for name in ("tracks", "rows", "rmse", "within1m", "coverage", "false"):
            assert row[name] == measures[name], name
        assert row["length_m"] == pytest.approx(2 * 9.9) and row["duration_s"] == pytest.approx(9.9)


def test_without_truth_the_first_result_judges(tmp_path: Path, capsys) -> None:
    files = [write_tracks(tmp_path / f"{off}.csv", off) for off in (0.0, 0.25)]
    found = compared(capsys, *files)
    assert found["judged_by"] == "0.0.csv" and not found["is_truth"]
    assert "rmse" not in found["results"][0]
    assert found["results"][1]["rmse"] == pytest.approx(0.25)


def test_folders_of_runs_know_their_truth(tmp_path: Path, capsys) -> None:
    truths = [write_truth(tmp_path / f"truth{k}.csv") for k in range(2)]
    folders = []
    for k, truth in ((0, truths[0]), (1, truths[0]), (2, truths[1])):
        folder = tmp_path / f"run{k}"
        folder.mkdir()
        write_tracks(folder / "traj.csv", 0.1 * k)
        write_record(folder, RunRecord("title", tmp_path, {}, truth, []))
        assert (folder / RUN_RECORD).is_file()
        folders.append(folder)
    found = compared(capsys, *folders[:2])
    assert found["is_truth"] and Path(found["judged_by"]).samefile(truths[0])
    assert found["results"][1]["rmse"] == pytest.approx(0.1)
    assert main(["compare", *map(str, folders)]) == 4
    assert "different truths, expected --truth" in capsys.readouterr().err
    assert compared(capsys, *folders, "--truth", truths[1])["results"][2]["rmse"] > 0.19


@pytest.mark.parametrize("suffix", ["png", "pdf"])
def test_the_figure_is_the_same_for_the_same_results(suffix: str, tmp_path: Path, capsys) -> None:
    files = [write_tracks(tmp_path / f"{off}.csv", off) for off in (0.0, 0.25)]
    figures = [tmp_path / f"{k}.{suffix}" for k in range(2)]
    for figure in figures:
        assert main(["compare", *map(str, files), "--figure", str(figure)]) == 0
        assert "0.250" in capsys.readouterr().out
    assert figures[0].read_bytes() == figures[1].read_bytes()
    assert figures[0].stat().st_size > 10_000


@pytest.mark.parametrize("columns", [20, 79, 300])
def test_tables_are_whole_however_narrow_the_output(
    columns: int, tmp_path: Path, capsys, monkeypatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    truth = write_truth(tmp_path / "truth.csv")
    far = write_tracks(tmp_path / f"{20 * 'a'}.csv", 9e8)
    files = [far, write_tracks(tmp_path / "b.csv", 0.1)]
    assert main(["compare", *map(str, files), "--truth", str(truth)]) == 0
    out = capsys.readouterr().out
    assert " 900000000.000 " in out
    assert all(head in out for head in ("tracks", "length", "< 1 m", "cover", "false", "NEES"))
    assert out.count("100.0 %") >= 3 and "…" not in out
    assert main(["evaluate", str(truth), str(files[1])]) == 0
    out = capsys.readouterr().out  # its cells are folded between words
    assert all(word in out for word in ("coverage", "in-view", "percentile")) and "…" not in out
    lines = [line.rstrip() for line in out.splitlines()]
    assert all(line[-1] in "┓┃┩│┤┘" for line in lines if line[:1] and line[0] in "┏┃┡│├└")


def test_any_name_of_a_result_is_in_the_legend(tmp_path: Path, capsys, monkeypatch) -> None:
    shown: list[str] = []

    def note_legend(figure: Figure, path: Path) -> None:
        (legend,) = figure.legends
        shown.extend(text.get_text() for text in legend.get_texts())
        save(figure, path)

    monkeypatch.setattr("unlidar.compare.figure.save", note_legend)
    names = ["a$x^$", "_b", r"$\frac$"]
    files = [write_tracks(tmp_path / f"{name}.csv", 0.1 * k) for k, name in enumerate(names)]
    assert main(["compare", *map(str, files), "--figure", str(tmp_path / "a.png")]) == 0
    assert [text.strip().replace(r"\$", "$") for text in shown] == [file.name for file in files]


def test_an_empty_result_is_one(tmp_path: Path, capsys) -> None:
    truth = write_truth(tmp_path / "truth.csv")
    files = [
        write_tracks(tmp_path / "a.csv", 0.1),
        write_tracks(tmp_path / "b.csv", 0, TIMES_S[:0]),
    ]
    figure = tmp_path / "c.png"
    found = compared(capsys, *files, "--truth", truth, "--figure", figure)
    assert found["results"][1]["coverage"] == 0 and figure.is_file()


def test_what_cannot_be_compared_is_said(tmp_path: Path, fails) -> None:
    one = write_tracks(tmp_path / "a.csv", 0.1)
    late = write_tracks(tmp_path / "b.csv", 0.1, TIMES_S + 1000)
    assert "the name a.csv is taken" in fails(2, "compare", one, one)
    assert "b.csv: no time in common" in fails(4, "compare", one, late)
    assert "expected a name that ends" in fails(2, "compare", one, "--figure", tmp_path / "x.svg")
    assert "none.csv" in fails(4, "compare", one, tmp_path / "none.csv")
    assert list(tmp_path.glob("*.png")) == []
