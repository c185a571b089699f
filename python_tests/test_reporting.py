"""Progress reports, and untrusted names in messages."""

from __future__ import annotations

import io
import os
import pty
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from flights import track_at, truth_at, write_result
from many import StandIn, command, make_sequence
from rich.console import Console
from unlidar.batch.job import FAILED, Row
from unlidar.batch.table import rich_table, write_tables
from unlidar.cli import main

EVIL = "[red]a[/x]\x1b[2J\n| b <i>:smile:"
SHOWN = r"[red]a[/x]\x1b[2J\n| b <i>:smile:"
STAGES = """
if "--verbose" in words:
    for stage in ("read: 3 frames, 12 returns", "targets: 1 target"):
        print(f"unlidar_track: {stage} (0.5 s)", file=sys.stderr)
        sys.stderr.flush()
        time.sleep(0.3)
print("unlidar_track: a note", file=sys.stderr)
"""


@pytest.fixture
def stand_in(tmp_path, monkeypatch) -> StandIn:
    program = StandIn(tmp_path)
    monkeypatch.setenv("UNLIDAR_TRACK", str(program.write(STAGES)))
    return program


def test_verbose_reports_commands_and_stages_and_changes_no_result(
    stand_in, tmp_path, capsys
) -> None:
    source = make_sequence(tmp_path / "seq")
    records = []
    for options in ([], ["--verbose"]):
        assert main(["run", str(source), "--out", str(tmp_path / "out"), *options]) == 0
        text = (tmp_path / "out/run.json").read_text()
        records.append(re.sub(r'"t[a-z]+_s": [0-9.]+', "", text))
        said = capsys.readouterr().err
        assert "unlidar_track: a note" in said
        words = (
            "command: ",
            "--frames lidar_360=",
            "targets: 1 target",
            "convert: ",
            "report.html",
        )
        assert [word in said for word in words] == [bool(options)] * len(words)
        lines = [line for line in said.splitlines() if line != "unlidar_track: a note"]
        assert all(line.startswith("unlidar: ") for line in lines)
    assert records[0] == records[1]


def test_verbose_reports_many_recordings_with_their_names(stand_in, tmp_path, capsys) -> None:
    for name in ("a", "b"):
        make_sequence(tmp_path / "data" / name)
    words = ["run", str(tmp_path / "data"), "--out", str(tmp_path / "out")]
    assert main(words) == 0
    assert "command: " not in capsys.readouterr().err
    shutil.rmtree(tmp_path / "out")
    assert main([*words, "--verbose"]) == 0
    said = capsys.readouterr().err
    for name in ("a", "b"):
        assert f"unlidar: {name}: command: " in said
        assert f"unlidar: {name}: unlidar_track: targets: 1 target" in said


def test_every_command_takes_verbose(tmp_path, capsys) -> None:
    folder = write_result(tmp_path / "a", truth_at(range_s()), track_at(range_s()))
    assert main(["evaluate", str(folder), "--verbose"]) == 0


def range_s():
    import numpy as np

    return np.arange(0, 2, 0.1)


def on_a_terminal(words: list[str], folder: Path) -> str:
    """All that a command writes to a terminal."""
    try:
        leader, follower = pty.openpty()
    except OSError as error:  # a root without /dev/pts
        pytest.skip(f"no terminal to be had: {error}")
    environment = os.environ | {"TERM": "xterm", "COLUMNS": "100"}
    process = subprocess.Popen(
        words, stdout=follower, stderr=follower, stdin=follower, cwd=folder, env=environment
    )
    os.close(follower)
    shown = b""
    while True:
        try:
            part = os.read(leader, 65536)
        except OSError:  # the other end is closed
            break
        if not part:
            break
        shown += part
    os.close(leader)
    assert process.wait() == 0, shown
    return shown.decode()


def test_on_a_terminal_one_sees_that_the_program_works_and_how_far_it_is(
    stand_in, tmp_path
) -> None:
    source = make_sequence(tmp_path / "seq")
    shown = on_a_terminal(command("run", source, "--out", tmp_path / "out"), tmp_path)
    assert "Tracking" in shown
    assert "read: 3 frames, 12 returns" in shown
    assert "targets: 1 target" in shown
    assert "unlidar_track: read" not in shown  # on a line of its own only with --verbose
    assert "a note" in shown


def test_in_a_pipe_there_is_no_progress(stand_in, tmp_path) -> None:
    source = make_sequence(tmp_path / "seq")
    words = command("run", source, "--out", tmp_path / "out")
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.stderr == "unlidar_track: a note\n"


def test_names_stand_in_tables_as_they_are_on_one_line(tmp_path) -> None:
    rows = [Row(EVIL, FAILED, reason=EVIL), Row("plain", "done", 1.0, 1, {"rmse": 0.5})]
    shown = io.StringIO()
    Console(width=300, file=shown).print(rich_table(rows, EVIL))
    lines = shown.getvalue().splitlines()
    assert sum(SHOWN in line for line in lines) == 2  # the title and the row
    write_tables(rows, tmp_path)
    table = (tmp_path / "table.md").read_text().splitlines()
    assert len(table) == 5
    assert len({line.count("|") for line in table}) == 1
    assert SHOWN.replace("|", "&#124;").replace("<", "&lt;") in table[2]


@pytest.mark.parametrize("output", [[], ["--markdown"]])
def test_names_of_results_and_groups_are_shown_as_they_are(output, tmp_path, capsys) -> None:
    name = EVIL.replace("/", "-")
    write_result(tmp_path / name, truth_at(range_s()), track_at(range_s()))
    assert main(["evaluate", "--group", f"{name}={tmp_path}", *output]) == 0
    shown = capsys.readouterr().out
    assert "\x1b" not in shown
    shown = "".join(shown.split())
    expected = SHOWN.replace("/", "-").replace(" ", "")
    if output:
        expected = expected.replace("|", "&#124;").replace("<", "&lt;")
    assert expected[:12] in shown


def test_messages_are_one_line_whatever_the_names_in_them(fails, tmp_path) -> None:
    line = fails(4, "evaluate", tmp_path / "a\x1b[31m[x]\nb.csv", tmp_path / "c")
    assert r"a\x1b[31m[x] b.csv" in line
    assert "[x]" in fails(4, "run", tmp_path / "[x]", "--out", tmp_path / "[y]")


def test_results_with_brackets_in_their_names_work_from_run_to_report(
    stand_in, tmp_path, capsys
) -> None:
    source = make_sequence(tmp_path / "data/[x][/]:smile:")
    make_sequence(tmp_path / "data/b")
    out = tmp_path / "out [/red]"
    assert main(["run", str(source), "--out", str(tmp_path / "one [/red]")]) == 0
    assert main(["run", str(tmp_path / "data"), "--out", str(out)]) == 0
    assert main(["evaluate", str(out)]) == 0
    assert "[x][/]:smile:" in "".join(capsys.readouterr().out.split())
    assert main(["report", str(tmp_path / "one [/red]")]) == 0
