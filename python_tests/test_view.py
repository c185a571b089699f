"""`unlidar view` and `run --open`: results in the browser, or in rerun where it is installed."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from many import StandIn, make_sequence
from unlidar.cli import main


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[str]:
    """The addresses that were opened; the program is a stand-in, rerun is not installed."""
    monkeypatch.setenv("UNLIDAR_TRACK", str(StandIn(tmp_path).write()))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("unlidar.viewer.find_spec", lambda name: None)
    addresses: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda address: addresses.append(address) is None)
    return addresses


def test_results_are_shown_and_a_recording_is_run_before(
    opened: list[str], tmp_path: Path, capsys
) -> None:
    make_sequence(tmp_path / "seq")
    assert main(["view", "seq"]) == 0
    page = tmp_path / "out/run/seq/report.html"
    assert opened == [page.as_uri()] and page.is_file()
    assert capsys.readouterr().out == "page       out/run/seq/report.html\n"
    for result in ("out/run/seq", "out/run/seq/traj.csv"):
        page.unlink()
        assert main(["view", result]) == 0
        assert opened.pop() == page.as_uri() and page.is_file()


def test_run_opens_what_it_found(opened: list[str], tmp_path: Path, fails) -> None:
    make_sequence(tmp_path / "seq")
    assert main(["run", "seq", "--out", "found", "--open"]) == 0
    assert opened == [(tmp_path / "found/report.html").as_uri()]
    make_sequence(tmp_path / "many/one")
    make_sequence(tmp_path / "many/two")
    assert "--open is for one recording" in fails(2, "run", "many", "--open")
    assert "expected one of them" in fails(2, "run", "seq", "--open", "--no-report")
    assert len(opened) == 1


def test_without_a_browser_the_page_is_named(
    opened: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.setattr("webbrowser.open", lambda address: False)
    make_sequence(tmp_path / "seq")
    assert main(["view", "seq"]) == 0
    told = capsys.readouterr()
    assert "out/run/seq/report.html" in told.out and "no browser was found" in told.err


def test_rerun_is_used_where_it_is_installed(
    opened: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    started: list[list[str]] = []
    monkeypatch.setattr("unlidar.viewer.find_spec", lambda name: object())
    monkeypatch.setattr("unlidar.report.rrd.write_rrd", lambda data, run: run / "recording.rrd")
    monkeypatch.setattr("subprocess.Popen", lambda command, **_: started.append(command))
    (tmp_path / "found").mkdir()
    monkeypatch.setattr("unlidar.viewer.load_run", lambda run: None)
    (tmp_path / "found/run.json").write_text("{}")
    assert main(["view", "found"]) == 0
    assert started == [[sys.executable, "-m", "rerun", "found/recording.rrd"]]
    assert opened == [] and "found/recording.rrd" in capsys.readouterr().out


def test_what_is_no_recording_is_an_error(opened: list[str], tmp_path: Path, fails) -> None:
    (tmp_path / "empty").mkdir()
    assert "empty" in fails(4, "view", "empty")
    assert "none" in fails(4, "view", "none")
    assert opened == [] and not (tmp_path / "out").exists()
